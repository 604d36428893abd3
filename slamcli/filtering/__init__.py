"""Filtering: what a reading says about a state, against what the state predicts."""

"""Regression suites: cases with figures, a baseline they are held to, and verdicts."""

"""Estimation that survives false loop closures: losses, switches, graduated non-convexity, consistent sets."""

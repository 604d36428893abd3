"""Simulated worlds, robots and sensors with known truth, and graphs spoiled on purpose."""

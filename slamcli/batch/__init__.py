"""Batch: several methods, files or sizes side by side."""

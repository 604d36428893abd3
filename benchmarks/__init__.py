"""Benchmarks: ``make bench``. Not part of the package, never part of the tests."""

"""Elimination orders in tests: those whose library is not installed are skipped."""

import pytest


def skip_without_library(order: str) -> None:
    """Skip a test that needs pymetis where it is not installed."""
    if order == "metis":
        pytest.importorskip("pymetis")

"""Nested dissection (George 1973) by METIS' multilevel separators (Karypis, Kumar 1998), through pymetis."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph.columns import IndexArray
from slamcli.solver.ordering.adjacency import neighbours
from slamcli.solver.pattern import BlockPattern


def metis(pattern: BlockPattern) -> IndexArray:
    """Block elimination order that leaves small separators to the end, and again within each part.

    METIS starts from the same random seed each time.

    Raises
    ------
    UsageError
        If pymetis is not installed.
    """
    try:
        import pymetis
    except ImportError:
        hint = "  pip install pymetis (it comes with slamcli where it has wheels: Linux on x86-64, macOS)"
        raise UsageError(
            "ordering metis needs pymetis, which is not installed", (hint, "  or --ordering amd")
        ) from None
    pointer, others = neighbours(pattern)
    if len(others) == 0:
        return np.arange(len(pattern.sizes))
    graph = pymetis.CSRAdjacency(pointer.astype(np.int32), others.astype(np.int32))
    eliminated, _ = pymetis.nested_dissection(graph)
    return np.array(eliminated, dtype=np.intp)


def is_installed() -> bool:
    """Whether pymetis is there, without loading it."""
    return find_spec("pymetis") is not None

"""slamcli: a command-line batch tool for SLAM back-ends.

The Python API has the names of the command line::

    graph = slamcli.read("graph.g2o")
    result = slamcli.optimize(graph, method="gn")
    slamcli.write(result.graph, "out.g2o")

Importing this module costs nothing: the functions load their parts when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from slamcli.formats.reader import read
    from slamcli.formats.writer import write
    from slamcli.graph.factor_graph import FactorGraph
    from slamcli.solver.optimize import optimize

__version__ = "0.1.0"

_HOMES = {
    "FactorGraph": "slamcli.graph.factor_graph",
    "optimize": "slamcli.solver.optimize",
    "read": "slamcli.formats.reader",
    "write": "slamcli.formats.writer",
}

__all__ = ["FactorGraph", "__version__", "optimize", "read", "write"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'slamcli' has no attribute {name!r}")

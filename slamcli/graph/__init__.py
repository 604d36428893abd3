"""The factor graph as columns: variables by kind, factors by kind, and how they hang together."""

from slamcli.graph.columns import Factors, Values, Variables
from slamcli.graph.document import Document, ReadingReport
from slamcli.graph.factor_graph import FactorGraph
from slamcli.graph.topology import Topology, analyze, is_loop_closure

__all__ = [
    "Document",
    "FactorGraph",
    "Factors",
    "ReadingReport",
    "Topology",
    "Values",
    "Variables",
    "analyze",
    "is_loop_closure",
]

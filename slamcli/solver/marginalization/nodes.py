"""Variables of all kinds under one numbering, as ``graph.topology`` has it: the columns one after the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray
from slamcli.graph.topology import node_offsets
from slamcli.models import VariableKind
from slamcli.models.base import Array


class Nodes:
    """The nodes of a graph.

    Attributes
    ----------
    graph
        The graph.
    kinds
        Kinds of variable, in the order of the graph's columns.
    offsets
        First node of each kind, by name.
    kind
        (n,) which of ``kinds`` each node is.
    dimension
        (n,) tangent dimensions.
    is_pose
        (n,) whether it has an orientation.
    """

    def __init__(self, graph: FactorGraph) -> None:
        self.graph = graph
        self.kinds: list[VariableKind] = [column.kind for column in graph.variables.values()]
        self.offsets = node_offsets(graph)
        counts = [len(column) for column in graph.variables.values()]
        self.kind: IndexArray = np.repeat(np.arange(len(self.kinds)), counts)
        self.dimension: IndexArray = np.array([kind.dimension for kind in self.kinds], dtype=np.intp)[self.kind]
        self.is_pose = np.array([kind.is_pose for kind in self.kinds], dtype=bool)[self.kind]
        self._first = np.array(list(self.offsets.values()), dtype=np.intp)[self.kind]

    def __len__(self) -> int:
        return len(self.kind)

    def values(self, nodes: Sequence[int] | IndexArray) -> Array:
        """Values (m, size) of nodes of one kind."""
        nodes = np.asarray(nodes, dtype=np.intp)
        kind = self.kinds[int(self.kind[nodes[0]])]
        return self.graph.variables[kind.name].values[nodes - self.offsets[kind.name]]

    def rows(self, nodes: IndexArray) -> IndexArray:
        """Their rows in the columns of their kinds."""
        return nodes - self._first[nodes]

    def name(self, node: int) -> str:
        """As files and messages name it."""
        kind = self.kinds[int(self.kind[node])]
        return f"{kind.name} {self.graph.variables[kind.name].ids[node - self.offsets[kind.name]]}"

"""The formats of bundle adjustment by name and by content: BAL and Bundler."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from slamcli.formats import bal, bundler, scenes
from slamcli.graph import FactorGraph


@dataclass(frozen=True)
class SceneFormat:
    """A format that is not made of tagged records: what tells it, what reads it, what writes it."""

    name: str
    recognize: Callable[[bytes], bool]
    parse: Callable[[str, bytes, bytes], FactorGraph]
    make: Callable[[FactorGraph], bytes]

    def render(self, graph: FactorGraph) -> tuple[bytes, list[str]]:
        """The text of a graph, and what it loses.

        Raises
        ------
        InputError
            If the format cannot express the graph.
        """
        own = graph.report is not None and graph.report.format == self.name
        if own and scenes.unchanged(graph):
            assert graph.document is not None
            return graph.document.data, []
        scenes.require(graph, self.name)
        return self.make(graph), scenes.losses(graph, self.name)


SCENE_FORMATS: dict[str, SceneFormat] = {
    module.NAME: SceneFormat(module.NAME, module.recognize, module.parse, module.render) for module in (bal, bundler)
}


def recognize(data: bytes) -> SceneFormat | None:
    """The format of bundle adjustment that a text is in, if any."""
    return next((format for format in SCENE_FORMATS.values() if format.recognize(data)), None)

"""The formats of bundle adjustment by name and by content: BAL, the same with shared intrinsics, and Bundler."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from slamcli import models
from slamcli.formats import bal, bal_pinhole, bundler, scenes
from slamcli.graph import FactorGraph


@dataclass(frozen=True)
class SceneFormat:
    """A format that is not made of tagged records: what tells it, reads it, writes it; what its cameras see."""

    name: str
    recognize: Callable[[bytes], bool]
    parse: Callable[[str, bytes, bytes], FactorGraph]
    make: Callable[[FactorGraph], bytes]
    projection: models.Projection

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
        scenes.require(graph, self.name, self.projection)
        return self.make(graph), scenes.losses(graph, self.name)


SCENE_FORMATS: dict[str, SceneFormat] = {
    module.NAME: SceneFormat(module.NAME, module.recognize, module.parse, module.render, projection)
    for module, projection in (
        (bal_pinhole, models.SHARED_PINHOLE_PROJECTION),  # before BAL, which is told by less
        (bal, models.BAL_PROJECTION),
        (bundler, models.BAL_PROJECTION),
    )
}


def recognize(data: bytes) -> SceneFormat | None:
    """The format of bundle adjustment that a text is in, if any."""
    return next((format for format in SCENE_FORMATS.values() if format.recognize(data)), None)

"""JSON documents of results: stable keys, ``schema_version`` 1, no NaN (null instead)."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from slamcli import __version__
from slamcli.graph import FactorGraph

if TYPE_CHECKING:
    from slamcli.graph.describe import GraphDescription, WorstEdge
    from slamcli.solver.gauge import Gauge

SCHEMA_VERSION = 1


def info_document(source: FactorGraph, description: GraphDescription, worst: list[WorstEdge]) -> dict[str, Any]:
    """The document of ``slamcli info --json``."""
    return {
        **head("info"),
        "input": input_section(source, description.loop_closures, len(description.component_sizes)),
        **{key: value for key, value in asdict(description).items() if key != "loop_closures"},
        "worst": [asdict(edge) for edge in worst],
    }


def dumps(document: dict[str, Any], indent: int | None = 2) -> str:
    """JSON text; numbers that are not finite become null."""
    return json.dumps(_finite(document), indent=indent, allow_nan=False, default=_plain)


def head(command: str) -> dict[str, Any]:
    """The keys that every document begins with."""
    return {"schema_version": SCHEMA_VERSION, "command": command, "version": __version__}


def input_section(graph: FactorGraph, loop_closures: int, components: int) -> dict[str, Any]:
    """The key ``input``: what was read."""
    report, document = graph.report, graph.document
    return {
        "path": report.path if report else None,
        "sha256": document.sha256 if document else None,
        "format": report.format if report else None,
        "poses": graph.poses,
        "landmarks": graph.landmarks,
        "switches": graph.switches,
        "edges": graph.edges,
        "by_tag": report.by_tag if report else {},
        "loop_closures": loop_closures,
        "components": components,
        "skipped": report.skipped if report else {},
        "malformed": report.malformed if report else [],
        "created": {kind: len(ids) for kind, ids in report.created.items()} if report else {},
        "notes": report.notes if report else [],
    }


def gauge_section(gauge: Gauge) -> dict[str, Any]:
    """The key ``gauge``: what was held, and which freedoms of scenes of cameras there were."""
    dimensions = [{"id": identifier, "components": list(names)} for identifier, names in gauge.dimensions.items()]
    return {
        "held": list(gauge.held),
        "reason": gauge.reason,
        "freedoms": gauge.freedoms,
        "dimensions": dimensions,
    }


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value


def _plain(value: Any) -> Any:
    return value.item()

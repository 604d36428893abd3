"""What is particular to graphs of bundle adjustment: their free gauge, and the method and start that ``auto`` means.

What cameras see determines a scene up to place, orientation and scale: H has a null space of seven dimensions, in which
the gradient has no part. A damped step has none in it either, up to rounding, so Levenberg-Marquardt moves the scene
along its seven freedoms by nothing that matters and needs nobody to be held; this is what Ceres does. Gauss-Newton and
dogleg need a regular H: ``--gauge first`` gives one. Damping is in proportion to the diagonal of H, since a camera's
tangent dimensions have units as different as radians, pixels and the distortion's 1.

A step that takes a point through the plane of a camera leaves the valley that leads to the minimum: chi2 of what is
behind a camera has minima of its own. If points have gone there, the run is repeated with the same damping in all
dimensions, which moves distant points less, and the lower chi2 counts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph import FactorGraph, Variables, camera_intrinsics
from slamcli.graph.columns import BoolArray, IndexArray, Values
from slamcli.graph.depths import depths
from slamcli.graph.topology import node_offsets
from slamcli.models import BAL_INTRINSICS, CAMERA, PINHOLE_INTRINSICS, Projection
from slamcli.solver.options import OptimizeOptions


def has_projections(graph: FactorGraph) -> bool:
    """Whether cameras see points in a graph."""
    return any(isinstance(factors.kind, Projection) for factors in graph.factors)


def adapted(options: OptimizeOptions, graph: FactorGraph) -> OptimizeOptions:
    """Options as they are in effect for a graph: with cameras, ``auto`` is damped and starts from the file's values.

    Raises
    ------
    UsageError
        If another start is asked for.
    """
    if not has_projections(graph):
        return options
    if options.init not in ("auto", "file"):
        raise UsageError(
            f"init {options.init!r} places poses by relative poses, and images measure none",
            ("  --init file starts from the values of the cameras and points",),
        )
    if options.method == "auto":
        options = replace(options, method="lm", scaling="marquardt")
    return replace(options, init="file")


def gone_behind(graph: FactorGraph, before: Values, after: Values) -> int:
    """How many observations have their point in front of the camera at one state and behind it at another."""
    columns = [factors for factors in graph.factors if isinstance(factors.kind, Projection)]
    pairs = [(depths(factors, before), depths(factors, after)) for factors in columns]
    return sum(int(np.count_nonzero((first > 0.0) & ~(second > 0.0))) for first, second in pairs)


def require_cameras(graph: FactorGraph, option: str, value: str) -> None:
    """Refuse an option that is for cameras only where there are none.

    Raises
    ------
    UsageError
        If it is not ``auto``.
    """
    if value != "auto" and not has_projections(graph):
        raise UsageError(f"{option} {value!r} is for cameras that see points, and this graph has none")


def with_intrinsics(graph: FactorGraph, intrinsics: str) -> FactorGraph:
    """The graph with intrinsics as an option says.

    Parameters
    ----------
    graph
        The graph.
    intrinsics
        ``auto`` as the file has them, ``fixed`` all of them constants, ``shared`` one unknown set for all cameras,
        ``free`` unknowns of every camera.

    Raises
    ------
    UsageError
        If the graph has no cameras, or none with such intrinsics.
    """
    if intrinsics == "auto":
        return graph
    require_cameras(graph, "intrinsics", intrinsics)
    if PINHOLE_INTRINSICS.name in graph.variables:
        if intrinsics == "free":
            raise UsageError("intrinsics 'free': these cameras share one set", ("  --intrinsics shared frees it",))
        return camera_intrinsics.with_intrinsics_held(graph, intrinsics == "fixed")
    if camera_intrinsics.camera_name(graph) is None:
        if intrinsics == "fixed":
            return graph
        raise UsageError(
            f"intrinsics {intrinsics!r}: those of g2o's cameras are constants",
            ("  slamcli convert --to bal-pinhole makes one set of them, which --intrinsics shared frees",),
        )
    if intrinsics == "shared" and BAL_INTRINSICS.name in graph.variables:
        return graph
    change = {"fixed": camera_intrinsics.calibrated, "shared": camera_intrinsics.shared}
    return change.get(intrinsics, camera_intrinsics.whole)(graph)


def scenes(graph: FactorGraph, label: IndexArray, count: int) -> BoolArray:
    """Which of ``count`` components, given those of the nodes, have a camera that sees something."""
    offsets, out = node_offsets(graph), np.zeros(count, dtype=bool)
    for factors in graph.factors:
        kind = factors.kind
        if isinstance(kind, Projection):
            out[label[offsets[kind.variables[kind.camera].name] + factors.indices[:, kind.camera]]] = True
    return out


def floating(columns: dict[str, Variables], label: IndexArray, count: int) -> BoolArray:
    """Which of ``count`` components hold a camera with free intrinsics and something that it sees.

    Parameters
    ----------
    columns
        The columns of variables, one after the other.
    label
        Component of each of those variables.
    count
        Number of components.
    """
    is_camera = np.concatenate(
        [np.empty(0, dtype=bool), *(np.full(len(c), c.kind is CAMERA) for c in columns.values())]
    )
    out = np.zeros(count, dtype=bool)
    out[label[is_camera]] = True
    return out & (np.bincount(label, minlength=count) > 1)

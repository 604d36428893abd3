"""What is particular to graphs of bundle adjustment: their free gauge, and the method and start that ``auto`` means.

What cameras see determines a scene up to place, orientation and scale: H has a null space of seven dimensions, in which
the gradient has no part. A damped step has none in it either, up to rounding, so Levenberg-Marquardt moves the scene
along its seven freedoms by nothing that matters and needs nobody to be held; this is what Ceres does. Gauss-Newton and
dogleg need a regular H: ``--fix`` helps there. Damping is in proportion to the diagonal of H, since a camera's tangent
dimensions have units as different as radians, pixels and the distortion's 1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph import FactorGraph, Variables
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models import CAMERA, Projection
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

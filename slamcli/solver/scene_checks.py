"""What no image can be of: scenes that a solver would turn into numbers without a meaning, refused before it begins."""

from __future__ import annotations

import numpy as np

from slamcli import models
from slamcli.errors import InputError, NumericalError
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.depths import depths
from slamcli.models import Projection
from slamcli.solver.diagnosis import edge_name

_SHOWN = 5
#: A point is in the plane of its camera where its depth is less than this share of the median depth of the scene.
_IN_PLANE = 1e-9
#: Largest number of a value.
_FAR = 1e100
_BAL_FOCAL, _SBA_FOCAL = slice(7, 8), slice(7, 9)  # columns of the values


def require_finite(graph: FactorGraph) -> None:
    """Refuse coordinates of scenes of cameras that arithmetic overflows with; other graphs pass.

    Raises
    ------
    InputError
        Naming the first.
    """
    if not any(isinstance(factors.kind, Projection) for factors in graph.factors):
        return
    for name, column in graph.variables.items():
        bad = column.known & ~(np.abs(column.values) < _FAR).all(axis=1)
        if bad.any():
            what = "1 has a value" if bad.sum() == 1 else f"{int(bad.sum())} have values"
            raise InputError(
                f"{name} {column.ids[bad][0]} is beyond {_FAR:g}: {what} that nothing can be computed with"
            )


def check(graph: FactorGraph) -> None:
    """Refuse scenes of cameras that mean nothing; other graphs pass.

    Raises
    ------
    InputError
        If a camera with constant intrinsics has no focal length, or all points are behind the cameras that see them.
    NumericalError
        If points have no image, in the plane of their camera.
    """
    columns = [factors for factors in graph.factors if isinstance(factors.kind, Projection)]
    if not columns:
        return
    for factors in columns:
        _require_focal(graph, factors)
    known = [_known(graph, factors) for factors in columns]
    found = [depths(factors, graph.values) for factors in columns]
    every = np.concatenate([depth[mask] for depth, mask in zip(found, known, strict=True)])
    if len(every) == 0:
        return
    usual = float(np.median(np.abs(every[np.isfinite(every)]))) if np.isfinite(every).any() else 0.0
    flat = [mask & ~(np.abs(depth) > _IN_PLANE * usual) for depth, mask in zip(found, known, strict=True)]
    if total := sum(int(mask.sum()) for mask in flat):
        details = [
            f"  {edge_name(graph, factors, row)}: depth {found[k][row]:.3g}, the usual one is {usual:.3g}"
            for k, (factors, mask) in enumerate(zip(columns, flat, strict=True))
            for row in np.flatnonzero(mask)[:_SHOWN].tolist()
        ]
        what = "1 observation is" if total == 1 else f"{total} observations are"
        raise NumericalError(
            f"{what} not finite in the image: the point is in the plane of its camera", tuple(details[:_SHOWN])
        )
    if len(every) > 1 and (every < 0.0).all():
        raise InputError(
            f"all {len(every)} observations are of points behind their camera",
            ("  do the cameras look along the other axis? BAL and Bundler: -z, g2o and bal-pinhole: +z",),
        )


def _known(graph: FactorGraph, factors: Factors) -> BoolArray:
    """Which observations are of a point and by a camera that have a value."""
    out = np.ones(len(factors), dtype=bool)
    for slot, kind in enumerate(factors.kind.variables):
        out &= graph.variables[kind.name].known[factors.indices[:, slot]]
    return out


def _require_focal(graph: FactorGraph, factors: Factors) -> None:
    """A focal length that is a constant must be one."""
    kind = factors.kind
    assert isinstance(kind, Projection)
    column = graph.variables[kind.variables[kind.camera].name]
    rows: IndexArray = factors.indices[:, kind.camera]
    if factors.parameters is not None:
        focal = factors.parameters[:, :1]
    elif column.kind is models.SBA_CAMERA:
        focal = column.values[rows, _SBA_FOCAL]
    elif column.kind is models.CALIBRATED_CAMERA:
        focal = column.values[rows, _BAL_FOCAL]
    else:
        return
    bad = column.known[rows] & (focal == 0.0).any(axis=1)
    if bad.any():
        raise InputError(f"camera {column.ids[rows[bad][0]]} has the constant focal length 0, and sees nothing")

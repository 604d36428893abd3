"""How far in front of their cameras points are, camera by camera instead of observation by observation."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import so3
from slamcli.graph.columns import Factors, Values
from slamcli.models import Projection
from slamcli.models.base import Array


def depths(factors: Factors, values: Values) -> Array:
    """Distance (m,) along the camera's axis of what it sees, negative behind it: as ``Projection.depth``, sooner.

    Raises
    ------
    TypeError
        If no camera sees anything in these factors.
    """
    kind = factors.kind
    if not isinstance(kind, Projection):
        raise TypeError(f"{kind!r} has no camera")
    cameras = values[kind.variables[kind.camera].name]
    points = values[kind.variables[kind.point].name]
    rows = factors.indices[:, kind.camera]
    with np.errstate(all="ignore"):
        axis = kind.forward * so3.to_matrix(cameras[:, 3:7])[:, :, 2]  # the camera's z in the world
        start = np.vecdot(axis, cameras[:, :3])
        return np.asarray(np.vecdot(axis[rows], points[factors.indices[:, kind.point]]) - start[rows])

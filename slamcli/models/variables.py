"""The variable kinds: planar and spatial poses and points, and the switches of loop closures."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se2, se3
from slamcli.models.base import Array, VariableKind


def _unchanged(values: Array) -> Array:
    return values


def _switched(values: Array, delta: Array) -> Array:
    """Switches after a step: they stay within [0, 1], as in Vertigo."""
    return np.clip(values + delta, 0.0, 1.0)


SE2 = VariableKind(
    name="SE2",
    size=3,
    components=("x", "y", "theta"),
    is_pose=True,
    space=2,
    identity=(0.0, 0.0, 0.0),
    retract=se2.retract,
    normalize=se2.normalize,
    compose=se2.compose,
    inverse=se2.inverse,
)
SE3 = VariableKind(
    name="SE3",
    size=7,
    components=("x", "y", "z", "qx", "qy", "qz"),
    is_pose=True,
    space=3,
    identity=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
    retract=se3.retract,
    normalize=se3.normalize,
    compose=se3.compose,
    inverse=se3.inverse,
)
XY = VariableKind(
    name="XY",
    size=2,
    components=("x", "y"),
    is_pose=False,
    space=2,
    identity=(0.0, 0.0),
    retract=np.add,
    normalize=_unchanged,
    compose=np.add,
    inverse=np.negative,
)
XYZ = VariableKind(
    name="XYZ",
    size=3,
    components=("x", "y", "z"),
    is_pose=False,
    space=3,
    identity=(0.0, 0.0, 0.0),
    retract=np.add,
    normalize=_unchanged,
    compose=np.add,
    inverse=np.negative,
)

SWITCH = VariableKind(
    name="SWITCH",
    size=1,
    components=("s",),
    is_pose=False,
    space=0,
    identity=(1.0,),
    retract=_switched,
    normalize=_unchanged,
    compose=np.add,
    inverse=np.negative,
)

VARIABLE_KINDS: tuple[VariableKind, ...] = (SE2, SE3, XY, XYZ, SWITCH)

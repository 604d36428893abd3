"""Reprojection errors: how far, in pixels, cameras see points from where they were measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import IdArray, IndexArray
from slamcli.models import Projection
from slamcli.models.base import Array


@dataclass(frozen=True, eq=False)
class Reprojection:
    """Statistics of the distance |e| in the image, in pixels, whatever the information.

    Attributes
    ----------
    observations
        How many count: those with a finite residual, of a camera and a point that have a value.
    behind
        How many of all are of points behind their camera.
    sigma
        Root of the mean square of a coordinate of e: about the standard deviation of the noise of a pixel.
    rms, mean, median, largest
        Of |e|.
    cameras
        (n,) ids of the cameras that see something.
    camera_observations, camera_behind
        (n,) counts for each of them.
    camera_rms, camera_largest
        (n,) of |e|, NaN for cameras without a finite residual.
    """

    observations: int
    behind: int
    sigma: float
    rms: float
    mean: float
    median: float
    largest: float
    cameras: IdArray
    camera_observations: IndexArray
    camera_behind: IndexArray
    camera_rms: Array
    camera_largest: Array


def reprojection(graph: FactorGraph) -> Reprojection | None:
    """Statistics at the graph's values, None for a graph without cameras."""
    squares, coordinates, ids, behind = [], 0, [], []
    for factors in graph.factors:
        kind = factors.kind
        if not isinstance(kind, Projection):
            continue
        x = factors.gather(graph.values)
        with np.errstate(all="ignore"):
            squares.append(np.square(kind.residual(x, factors.measurements, factors.parameters)).sum(axis=1))
            behind.append(~(kind.depth(x) > 0.0))
        known = np.ones(len(factors), dtype=bool)
        for slot, variable in enumerate(kind.variables):
            known &= graph.variables[variable.name].known[factors.indices[:, slot]]
        squares[-1][~known] = np.nan
        behind[-1] &= known
        column = graph.variables[kind.variables[kind.camera].name]
        ids.append(column.ids[factors.indices[:, kind.camera]])
        coordinates += kind.dimension * int(np.isfinite(squares[-1]).sum())
    if not squares:
        return None
    square = np.concatenate(squares)
    cameras, owner = np.unique(np.concatenate(ids), return_inverse=True)
    count, finite = len(cameras), np.isfinite(square)
    usable = np.bincount(owner[finite], minlength=count)
    largest = np.full(count, -np.inf)
    np.maximum.at(largest, owner[finite], square[finite])
    with np.errstate(invalid="ignore", divide="ignore"):
        rms = np.sqrt(np.bincount(owner[finite], square[finite], minlength=count) / usable)
    distance = np.sqrt(square[finite])
    total = float(square[finite].sum())
    empty = len(distance) == 0
    return Reprojection(
        observations=len(distance),
        behind=int(np.concatenate(behind).sum()),
        sigma=float("nan") if empty else float(np.sqrt(total / coordinates)),
        rms=float("nan") if empty else float(np.sqrt(total / len(distance))),
        mean=float("nan") if empty else float(distance.mean()),
        median=float("nan") if empty else float(np.median(distance)),
        largest=float("nan") if empty else float(distance.max()),
        cameras=cameras,
        camera_observations=np.bincount(owner, minlength=count),
        camera_behind=np.bincount(owner[np.concatenate(behind)], minlength=count),
        camera_rms=rms,
        camera_largest=np.where(usable > 0, np.sqrt(np.maximum(largest, 0.0)), np.nan),
    )

"""Levenberg-Marquardt on all landmarks at once, each with a damping of its own, everything else given."""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import finite_rows
from slamcli.models.base import Array
from slamcli.solver.initialization.landmarks.sightings import Sightings

_STEPS = 30
#: Converged where a step moves a landmark by less than this share of its distance from what sees it.
_SMALL = 1e-10
#: ... or a step lowers its chi2 by no more than this share, as where residuals are large and convergence is slow.
_GAIN = 1e-9
#: Damping as a share of the trace of H: at the start, at least, at most; what makes it grow and shrink.
_DAMPING, _LEAST, _MOST, _GROW, _SHRINK = 1e-4, 1e-14, 1e12, 10.0, 0.2


def refined(sightings: Sightings, places: Array, steps: int = _STEPS) -> tuple[Array, Array]:
    """The minima of chi2 of single landmarks from places (n, d), and chi2 (n,) there.

    Places that are not finite stay as they are, with an infinite chi2.
    """
    places, space = places.copy(), places.shape[1]
    active = finite_rows(places) & (sightings.seen > 0)
    lowest = np.full(len(places), np.inf)
    damping = np.full(len(places), _DAMPING)
    current = sightings.of(active)
    chi2, hessian, gradient = current.normal(places)
    lowest[active] = np.where(np.isfinite(chi2[active]), chi2[active], np.inf)
    active &= finite_rows(hessian) & finite_rows(gradient) & np.isfinite(lowest)
    for _ in range(steps):
        if not active.any():
            break
        rows = np.flatnonzero(active)
        trace = np.maximum(np.trace(hessian[rows], axis1=1, axis2=2), np.finfo(np.float64).tiny)[:, None, None]
        damped = hessian[rows] / trace + damping[rows, None, None] * np.eye(space)
        step = -np.linalg.solve(damped, gradient[rows][:, :, None] / trace)[:, :, 0]
        trial = places.copy()
        trial[rows] += step
        current = current.of(active)
        new_chi2, new_hessian, new_gradient = current.normal(trial)
        finite = finite_rows(new_hessian) & finite_rows(new_gradient)
        better = finite[rows] & (new_chi2[rows] <= lowest[rows])
        taken, refused = rows[better], rows[~better]
        still = lowest[taken] - new_chi2[taken] <= _GAIN * new_chi2[taken]
        places[taken], lowest[taken] = trial[taken], new_chi2[taken]
        hessian[taken], gradient[taken] = new_hessian[taken], new_gradient[taken]
        damping[taken] = np.maximum(_SHRINK * damping[taken], _LEAST)
        damping[refused] *= _GROW
        length = np.sqrt(np.square(step).sum(axis=1))
        scale = np.maximum(np.abs(places[rows]).max(axis=1), np.finfo(np.float64).tiny)
        active[rows[length <= _SMALL * scale]] = False
        active[taken[still]] = False
        active[rows[damping[rows] > _MOST]] = False
    return places, lowest

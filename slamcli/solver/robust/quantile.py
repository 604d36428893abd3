"""Quantiles of the chi-square distribution with a whole number of degrees of freedom, without scipy.

With x = chi2 / 2, the probability above is Q(d) = Q(d - 2) + x^(d/2 - 1) e^-x / Gamma(d/2), from Q(2) = e^-x and Q(1) =
erfc(sqrt(x)) (Abramowitz, Stegun, "Handbook of Mathematical Functions", 26.4.4, 26.4.5).
"""

from __future__ import annotations

import math

from slamcli.errors import UsageError


def chi2_quantile(dof: int, probability: float) -> float:
    """The value below which a chi-square variable of ``dof`` >= 1 degrees of freedom lies with a probability.

    Raises
    ------
    UsageError
        If the probability is not between 0 and 1.
    """
    if not 0.0 < probability < 1.0:
        raise UsageError(f"a probability must lie between 0 and 1, got {probability:g}")
    low, high = 0.0, 1.0
    while _above(dof, high) > 1.0 - probability:
        low, high = high, 2.0 * high
    while high - low > 4.0 * math.ulp(high):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _above(dof, middle) > 1.0 - probability else (low, middle)
    return 0.5 * (low + high)


def _above(dof: int, value: float) -> float:
    """Probability that the variable is larger."""
    x = 0.5 * value
    d = 2 - dof % 2
    total = math.exp(-x) if d == 2 else math.erfc(math.sqrt(x))
    while d < dof:
        total += math.exp((0.5 * d) * math.log(x) - x - math.lgamma(0.5 * d + 1.0)) if x > 0.0 else 0.0
        d += 2
    return total

"""Covariances of poses and landmarks by selected inversion of the supernodal factor."""

from slamcli.solver.covariance.recover import recover
from slamcli.solver.covariance.recovery import CovarianceRecovery, recovery_at, recovery_of
from slamcli.solver.covariance.result import CovarianceRequest, CovarianceResult

__all__ = ["CovarianceRecovery", "CovarianceRequest", "CovarianceResult", "recover", "recovery_at", "recovery_of"]

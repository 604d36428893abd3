"""Certified global optima: SE-Sync's isotropic chordal objective, its dual certificate, the Riemannian staircase."""

from slamcli.solver.certificate.certificate import Certificate, CertificateStatus, Escape
from slamcli.solver.certificate.comparison import ObjectiveGap
from slamcli.solver.certificate.run import CertifiedRun, run

__all__ = ["Certificate", "CertificateStatus", "CertifiedRun", "Escape", "ObjectiveGap", "run"]

"""Certificates of global optimality: rows of the summary, and a section of the JSON document."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from slamcli.reporting.text import coloured, plural, seconds
from slamcli.solver.certificate.certificate import Certificate, CertificateStatus, Escape
from slamcli.solver.certificate.comparison import NOTHING
from slamcli.solver.certificate.run import CertifiedRun

_COLOUR = {
    CertificateStatus.CERTIFIED: "green",
    CertificateStatus.NOT_CERTIFIED: "red",
    CertificateStatus.INAPPLICABLE: "yellow",
}
#: Bounds above this share of the cost are said to be loose.
_TIGHT = 1e-4
#: Critical points that are listed, and the share of a direction from which on a pose is named.
_LISTED, _LEAST_SHARE = 4, 0.01


def objective_rows(run: CertifiedRun) -> list[tuple[str, str]]:
    """What stands for chi2 in the rows around, where it is not chi2."""
    if run.objective == "g2o":
        return []
    return [
        ("objective", "isotropic chordal (SE-Sync's): every cost in this summary is of that, not chi2"),
        ("chi2 (g2o)", f"{run.chi2:.6f} at the end, which was not minimized"),
    ]


def certificate_rows(run: CertifiedRun, colour: bool) -> list[tuple[str, str]]:
    """The certificate and what came of it."""
    certificate = run.certificate
    if certificate is None:
        return []
    status = coloured(certificate.status.value.replace("_", " "), _COLOUR[certificate.status], colour)
    rows = [("certificate", f"{status}: {certificate.reason}")]
    if certificate.status is CertificateStatus.INAPPLICABLE:
        return rows
    rows.append(("", _bound(certificate)))
    rows += [("", _escape(escape)) for escape in certificate.escapes[:_LISTED]]
    if len(certificate.escapes) > _LISTED:
        rows.append(("", f"nor {plural(len(certificate.escapes) - _LISTED, 'other critical point')}"))
    if certificate.certified:
        rows.append(("", _eigenvalues(certificate)))
    return [*rows, *_gap_rows(run), ("", f"took {seconds(run.time)}")]


def _bound(certificate: Certificate) -> str:
    share = certificate.relative_suboptimality
    excess = f"{certificate.suboptimality:.2g}" + (f" ({share:.1e} of it)" if share < 1.0 else "")
    loose = ": a loose bound" if certificate.certified and _TIGHT < share < 1.0 else ""
    return f"isotropic cost {certificate.cost:.6f}, above its global minimum by at most {excess}{loose}"


def _eigenvalues(certificate: Certificate) -> str:
    text = (
        f"eigenvalues of S: smallest {certificate.smallest_eigenvalue:.1e}, and S + eta I is positive definite "
        f"with eta {certificate.eta:.1e} ({certificate.relative_eta:.0e} of the scale of S)"
    )
    following = certificate.next_eigenvalue
    return text if following is None else f"{text}; next {following:.4g}"


def _escape(escape: Escape) -> str:
    movers = ", ".join(f"{pose} ({share:.0%})" for pose, share in escape.movers if share >= _LEAST_SHARE)
    where = f"mostly of poses {movers}" if movers else "of many poses"
    return (
        f"not it: the critical point of rank {escape.rank} and cost {escape.cost:.6f}; "
        f"eigenvalue {escape.eigenvalue:.4g}, {where}"
    )


def _gap_rows(run: CertifiedRun) -> list[tuple[str, str]]:
    """The isotropic objective beside chi2."""
    gap = run.gap
    if gap is None:
        return []
    share = f", {gap.relative:.3%} above it" if gap.isotropic_minimum > NOTHING else ""
    rows = [("", f"isotropic cost at the run's minimum of chi2: {gap.isotropic_at_result:.6f}{share}")]
    if gap.chi2_polished is None:
        return [*rows, ("", "a run of chi2 from that solution failed")]
    text = f"chi2 from that solution: {gap.chi2_at_minimum:.6f} -> {gap.chi2_polished:.6f}"
    if gap.lower:
        said = f", lower than {gap.chi2_result:.6f} of the first run: taken as the result"
    elif gap.same:
        said = ", the same minimum as the run's"
    else:
        said = f", higher than the run's {gap.chi2_result:.6f}"
    return [*rows, ("", text + said)]


def certificate_section(run: CertifiedRun) -> dict[str, Any]:
    """The keys ``objective``, ``chi2``, ``certificate`` and ``gap`` of ``optimize --json``."""
    found, gap = run.certificate, run.gap
    return {
        "objective": run.objective,
        "chi2": run.chi2,
        "certificate": None if found is None else _document(found, run.time),
        "gap": None if gap is None else {**asdict(gap), "relative": gap.relative, "same": gap.same},
    }


def _document(found: Certificate, time: float) -> dict[str, Any]:
    head = {"status": found.status.value, "reason": found.reason}
    if found.status is CertificateStatus.INAPPLICABLE:
        return head
    return {
        **head,
        "cost": found.cost,
        "lower_bound": found.lower_bound,
        "suboptimality": found.suboptimality,
        "relative_suboptimality": found.relative_suboptimality,
        "eta": found.eta,
        "relative_eta": found.relative_eta,
        "scale": found.scale,
        "smallest_eigenvalue": found.smallest_eigenvalue,
        "next_eigenvalue": found.next_eigenvalue,
        "dual_value": found.dual_value,
        "gradient_norm": found.gradient_norm,
        "estimate_cost": found.estimate_cost,
        "polished_cost": found.polished_cost,
        "escapes": [{**asdict(e), "movers": [{"id": i, "share": s} for i, s in e.movers]} for e in found.escapes],
        "phases": found.time,
        "time": time,
    }

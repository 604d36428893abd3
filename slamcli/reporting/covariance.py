"""``slamcli covariance``: its summary, its document and its files."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from slamcli.formats.covariance_files import CovarianceTable, ending_of, write_archive, write_csv
from slamcli.formats.source import write_bytes
from slamcli.graph import Topology
from slamcli.graph.columns import IdArray
from slamcli.models import VariableKind
from slamcli.models.base import Array
from slamcli.reporting import documents
from slamcli.reporting.landmarks import held_back_row
from slamcli.reporting.text import plural, seconds, table
from slamcli.solver.covariance.conventions import frame, tangent, units
from slamcli.solver.covariance.result import CovarianceResult, Marginals, Relative
from slamcli.solver.covariance.uncertainty import Uncertainty, uncertainty

_LISTED = 8
_POSE = 6  # tangent dimensions of a spatial pose
_WIDEST_JOINT = 12  # larger matrices are for files


def optimum_warning(result: CovarianceResult) -> list[str]:
    """What to say where the values are not an optimum: for standard error."""
    if result.at_optimum:
        return []
    distance = np.sqrt(result.predicted_decrease)
    return [
        f"not at an optimum: optimize first. A step would lower chi2 from {result.chi2:.6g} by "
        f"{result.predicted_decrease:.6g}, that is by {distance:.3g} standard deviations in all"
    ]


def covariance_summary(
    result: CovarianceResult, quantiles: dict[int, float], probability: float, rows: int, time: float, written: str
) -> list[str]:
    """What ``slamcli covariance`` prints.

    Parameters
    ----------
    result
        What was recovered.
    quantiles
        Of the chi-square distribution at ``probability``, by degrees of freedom.
    probability
        Of the regions.
    rows
        How many variables of each kind are listed, those of largest uncertainty; all where ids were asked for.
    time
        Seconds.
    written
        Where to.
    """
    distance = np.sqrt(result.predicted_decrease)
    facts = [
        ("covariances", ", ".join(f"{len(m.ids)} {m.kind.name}" for m in result.marginals)),
        (
            "values",
            f"of the graph: chi2 {result.chi2:.6f}, {distance:.2g} standard deviations from the optimum",
        ),
        ("gauge", gauge_text(result)),
        *([held_back_row(result.under_observed, result.edges_left_out)] if result.under_observed else []),
        *(("tangent", tangent_text(m.kind, result.request.convention)) for m in result.marginals),
        ("convention", result.request.convention),
        ("scale", scale_text(result)),
        ("written", written),
        ("time", seconds(time)),
    ]
    out = table(facts, "<<")
    for m in result.marginals:
        out += _marginal_table(m, quantiles[m.kind.space], probability, rows, listed=bool(result.request.ids))
    if result.cross:
        out += ["", *(_cross_line(c.kinds, len(c.ids)) for c in result.cross)]
    if result.joint is not None:
        out += _joint_table(result.joint.names, result.joint.covariance)
    for one in result.relative:
        out += _relative_table(one, result.request.convention, quantiles[one.kind.space], probability)
    return out


def covariance_document(
    result: CovarianceResult,
    topology: Topology,
    quantiles: dict[int, float],
    probability: float,
    time: dict[str, float],
) -> dict[str, Any]:
    """The document of ``slamcli covariance --json``, also written by ``-o FILE.json``."""
    convention = result.request.convention
    joint = result.joint
    return {
        **documents.head("covariance"),
        "input": documents.input_section(result.graph, topology.loop_closure_count, topology.component_count),
        "convention": convention,
        "scale": {"name": result.request.scale, "factor": result.factor},
        "gauge": documents.gauge_section(result.gauge),
        "chi2": result.chi2,
        "dof": result.dof,
        "predicted_decrease": result.predicted_decrease,
        "at_optimum": result.at_optimum,
        "under_observed": [asdict(landmark) for landmark in result.under_observed],
        "probability": probability,
        "marginals": [_marginal_section(m, convention, quantiles[m.kind.space]) for m in result.marginals],
        "cross": [
            {
                "kinds": [kind.name for kind in c.kinds],
                "tangents": [list(tangent(kind, convention)) for kind in c.kinds],
                "ids": c.ids.tolist(),
                "covariance": c.covariance.tolist(),
            }
            for c in result.cross
        ],
        "joint": None
        if joint is None
        else {"ids": list(joint.ids), "names": list(joint.names), "covariance": joint.covariance.tolist()},
        "relative": [
            {
                "ids": list(one.ids),
                "kind": one.kind.name,
                "value": one.value.tolist(),
                "tangent": list(tangent(one.kind, convention)),
                "covariance": one.covariance.tolist(),
                **_uncertainty_section(
                    uncertainty(one.kind, one.value[None], one.local[None], quantiles[one.kind.space]), row=0
                ),
            }
            for one in result.relative
        ],
        "time": time,
    }


def write_covariances(path: str, result: CovarianceResult, document: dict[str, Any]) -> None:
    """Write what was recovered in the format that the name asks for; ``document`` is for JSON.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    ending = ending_of(path)
    if ending == ".json":
        write_bytes(path, (documents.dumps(document, indent=None) + "\n").encode())
        return
    convention = result.request.convention
    tables = [CovarianceTable(m.kind.name, tangent(m.kind, convention), m.ids, m.covariance) for m in result.marginals]
    facts = {
        "frame": "world" if frame(result.marginals[0].kind, convention).startswith("translation") else "local",
        "convention": convention,
        "tangents": "; ".join(tangent_text(m.kind, convention) for m in result.marginals),
        "gauge": gauge_text(result),
        "scale": scale_text(result),
        "predicted_decrease": repr(float(result.predicted_decrease)),
    }
    if ending == ".csv":
        write_csv(path, tables[0], facts)
    else:
        write_archive(path, tables, facts, _arrays(result))


def gauge_text(result: CovarianceResult) -> str:
    """What was held, and so has no covariance."""
    held = result.gauge.held
    if not held and result.gauge.frozen:
        return f"{result.gauge.reason}; covariances are relative to that, and zero there"
    if not held:
        return f"{result.gauge.reason}: nothing is held, all covariances are those in the world"
    ids = ", ".join(map(str, held[:_LISTED])) + (", ..." if len(held) > _LISTED else "")
    return f"{result.gauge.reason}: {ids}; covariances are relative to what is held, whose own are zero"


def tangent_text(kind: VariableKind, convention: str) -> str:
    """The tangent space of a kind in words."""
    names = ", ".join(
        name if unit == "1" else f"{name} [{unit}]"
        for name, unit in zip(tangent(kind, convention), units(kind, convention), strict=True)
    )
    half = "; qx, qy, qz are half the rotation vector" if "qx" in tangent(kind, convention) else ""
    return f"{kind.name}: {names}; {frame(kind, convention)}{half}"


def scale_text(result: CovarianceResult) -> str:
    """What all covariances were multiplied by."""
    if result.request.scale == "none":
        return "none: as the information matrices state the noise"
    return f"posterior: times chi2 / degrees of freedom = {result.chi2:.6g} / {result.dof} = {result.factor:.6g}"


def _arrays(result: CovarianceResult) -> dict[str, Array | IdArray]:
    """Cross, joint and relative covariances as arrays of an archive."""
    out: dict[str, Any] = {"held": np.array(result.gauge.held, dtype=np.int64), "factor": np.array(result.factor)}
    for c in result.cross:
        name = "_".join(["cross", *(kind.name for kind in c.kinds)])
        out |= {f"{name}_ids": c.ids, f"{name}_covariance": c.covariance}
    if result.joint is not None:
        out |= {
            "joint_ids": np.array(result.joint.ids),
            "joint_names": np.array(result.joint.names),
            "joint_covariance": result.joint.covariance,
        }
    for kind in dict.fromkeys(one.kind for one in result.relative):
        same = [one for one in result.relative if one.kind is kind]
        out |= {
            f"relative_{kind.name}_ids": np.array([one.ids for one in same]),
            f"relative_{kind.name}_values": np.stack([one.value for one in same]),
            f"relative_{kind.name}_covariance": np.stack([one.covariance for one in same]),
        }
    return out


def _marginal_section(m: Marginals, convention: str, quantile: float) -> dict[str, Any]:
    return {
        "kind": m.kind.name,
        "tangent": list(tangent(m.kind, convention)),
        "units": list(units(m.kind, convention)),
        "frame": frame(m.kind, convention),
        "ids": m.ids.tolist(),
        "held": m.held.tolist(),
        "covariance": m.covariance.tolist(),
        **_uncertainty_section(uncertainty(m.kind, m.values, m.local, quantile)),
    }


def _uncertainty_section(found: Uncertainty, row: int | None = None) -> dict[str, Any]:
    """Of all variables, or of one row."""
    arrays: dict[str, Array] = {
        "sigma_position_m": found.position,
        "sigma_rotation_deg": found.rotation,
        "semi_axes_m": found.semi_axes,
        "directions": found.directions,
    }
    if found.position.shape[1] == 2:
        arrays["angle_deg"] = found.angle
    return {name: (array if row is None else array[row]).tolist() for name, array in arrays.items()}


def _marginal_table(m: Marginals, quantile: float, probability: float, rows: int, listed: bool) -> list[str]:
    found = uncertainty(m.kind, m.values, m.local, quantile)
    order = np.arange(len(m.ids)) if listed else np.argsort(-found.total, kind="stable")[:rows]
    if len(order) == 0:
        return []
    what = "standard deviations" if listed else f"the {len(order)} {m.kind.name} of largest uncertainty"
    title = f"{what}, and regions of {probability:.4g} probability ({_axes(m.kind)}):"
    header, cells = _columns(m.kind, found)
    for k, name in list(enumerate(m.kind.components))[_POSE:]:  # the intrinsics of cameras
        unit = units(m.kind, "slamcli")[k]
        header.append(f"sigma {name}" + f" {unit}" * (unit != "1"))
        cells.append([f"{value:.4g}" for value in np.sqrt(np.maximum(m.local[:, k, k], 0.0)).tolist()])
    lines = [("id", *header, "")]
    lines += [(str(m.ids[k]), *(column[k] for column in cells), "held" if m.held[k] else "") for k in order.tolist()]
    return ["", title, *table(lines, ">" * (1 + len(header)) + "<")]


def _axes(kind: VariableKind) -> str:
    own = "the pose" if kind.is_pose else "the world"
    return f"sigmas along the axes of {own}" + (", angles from the world's x axis" if kind.space == 2 else "")


def _columns(kind: VariableKind, found: Uncertainty) -> tuple[list[str], list[list[str]]]:
    """Header and cells, column by column."""
    header = [f"sigma {axis} m" for axis in "xyz"[: kind.space]]
    columns = list(found.position.T)
    if kind.is_pose:
        header += ["sigma theta deg"] if kind.space == 2 else [f"sigma r{axis} deg" for axis in "xyz"]
        columns += list(found.rotation.T)
    header += ["major m", "minor m", "angle deg"] if kind.space == 2 else ["axis 1 m", "axis 2 m", "axis 3 m"]
    columns += list(found.semi_axes.T)
    out = [[f"{value:.4g}" for value in column.tolist()] for column in columns]
    if kind.space == 2:
        known = found.semi_axes[:, 0] > 0.0  # what has no region has no direction
        angles = np.round(found.angle, 1) + 0.0  # no minus zero
        out.append([f"{a:.1f}" if k else "-" for a, k in zip(angles.tolist(), known.tolist(), strict=True)])
    return header, out


def _cross_line(kinds: tuple[VariableKind, VariableKind], count: int) -> str:
    return f"cross-covariances of {plural(count, 'connected pair')} of {kinds[0].name} and {kinds[1].name}: in the file"


def _joint_table(names: tuple[str, ...], covariance: Array) -> list[str]:
    if len(names) > _WIDEST_JOINT:
        return ["", f"joint covariance, {len(names)} x {len(names)}: too wide to print, see the file or --json"]
    lines = [
        ("", *names),
        *((n, *(f"{v:.4g}" for v in row)) for n, row in zip(names, covariance.tolist(), strict=True)),
    ]
    return ["", "joint covariance:", *table(lines, "<" + ">" * len(names))]


def _relative_table(one: Relative, convention: str, quantile: float, probability: float) -> list[str]:
    i, j = one.ids
    found = uncertainty(one.kind, one.value[None], one.local[None], quantile)
    names = tangent(one.kind, convention)
    value = ", ".join(f"{number:.6g}" for number in one.value.tolist())
    header, cells = _columns(one.kind, found)
    matrix = [("", *names)]
    matrix += [(n, *(f"{v:.4g}" for v in row)) for n, row in zip(names, one.covariance.tolist(), strict=True)]
    return [
        "",
        f"{j} seen from {i}, {one.kind.name} ({value}), with its covariance at that value ({convention}):",
        *table(matrix, "<" + ">" * len(names)),
        f"its standard deviations and region of {probability:.4g} probability"
        + (f" (angles from the x axis of {i}):" if one.kind.space == 2 else ":"),
        *table([header, [column[0] for column in cells]], ">" * len(header)),
    ]

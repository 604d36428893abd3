"""Which dialect a text is written in, by its tags, never by the name of the file."""

from __future__ import annotations

from slamcli.errors import InputError, UsageError
from slamcli.formats.dialect import Dialect
from slamcli.formats.g2o import G2O
from slamcli.formats.toro import TORO

DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (G2O, TORO)}

#: Tags that only other dialects of the same family use.
_FOREIGN = {
    "ODOMETRY": "iSAM or GTSAM",
    "Constraint2": "iSAM",
    "POINT3": "iSAM",
    "LANDMARK": "iSAM or GTSAM",
    "BR": "GTSAM",
    "EDGE_RANGE": "PyFG",
    "EDGE3:AXISANGLE": "SLAM++",
}


_ENDINGS = {".g2o": "g2o", ".toro": "toro", ".graph": "toro", ".bal": "bal", "bundle.out": "bundler"}


def of_ending(path: str) -> str | None:
    """The dialect that the ending of an output file suggests, if any."""
    plain = path.removesuffix(".gz").removesuffix(".bz2")
    return next((name for ending, name in _ENDINGS.items() if plain.endswith(ending)), None)


def by_name(name: str) -> Dialect:
    """The dialect of a name.

    Raises
    ------
    UsageError
        If there is none.
    """
    if name not in DIALECTS:
        raise UsageError(f"unknown dialect {name!r}", (f"  one of: {', '.join(DIALECTS)}",))
    return DIALECTS[name]


def recognize(path: str, tags: list[str]) -> Dialect:
    """The one dialect whose records a text holds.

    Raises
    ------
    InputError
        If no dialect fits, if two do, or if the numbers could mean several things.
    """
    found = [dialect for dialect in DIALECTS.values() if dialect.tags & set(tags)]
    foreign = sorted({tag: owner for tag, owner in _FOREIGN.items() if tag in tags}.items())
    if len(found) == 1 and found[0] is TORO:
        _refuse_ambiguous(path, set(tags), foreign)
    if len(found) == 1:
        return found[0]
    if len(found) > 1:
        mixed = "; ".join(f"{d.name}: {', '.join(sorted(d.tags & set(tags)))}" for d in found)
        raise InputError(
            f"{path}: holds records of two formats",
            (f"  {mixed}", "  --dialect NAME reads the records of one and counts the others as skipped"),
        )
    if foreign:
        tag, owner = foreign[0]
        raise InputError(f"{path}: {tag} records belong to {owner} files, which slamcli does not read yet")
    seen = ", ".join(tags[:5]) + (", ..." if len(tags) > 5 else "")
    raise InputError(
        f"{path}: holds no record of a known format" if tags else f"{path}: holds no record at all",
        (f"  first words of its lines: {seen[:200]}",) * bool(tags)
        + (
            "  expected g2o (VERTEX_SE2, EDGE_SE2, VERTEX_SE3:QUAT, ...), TORO (VERTEX2, EDGE2, VERTEX3, EDGE3),",
            "  BAL (three counts, for pinhole cameras also fx fy cx cy, then observations: camera point u v) or",
            "  Bundler (# Bundle file v0.3)",
        ),
    )


def _refuse_ambiguous(path: str, tags: set[str], foreign: list[tuple[str, str]]) -> None:
    """EDGE2 and EDGE3 without vertices: TORO, iSAM and GTSAM give their numbers different meanings."""
    if foreign:
        owners = ", ".join(f"{tag} ({owner})" for tag, owner in foreign)
        raise InputError(
            f"{path}: TORO tags together with {owners}: the information may be its square root or a covariance",
            ("  --dialect toro reads the TORO records as TORO information and skips the others",),
        )
    if not any(record.tag in tags for record in TORO.vertices):
        raise InputError(
            f"{path}: edges without vertices, in a notation that TORO, iSAM and GTSAM share",
            (
                "  their last numbers are the information (TORO), its square root (iSAM) or the covariance (GTSAM),",
                "  and nothing in the file says which",
                "  --dialect toro reads them as TORO information",
            ),
        )

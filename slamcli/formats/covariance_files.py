"""Covariances of poses and landmarks, written as npz archives or CSV (read again by ``formats.covariances``)."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slamcli.errors import UsageError
from slamcli.formats.source import write_bytes
from slamcli.graph.columns import IdArray
from slamcli.models.base import Array

ENDINGS = (".npz", ".csv", ".json")


@dataclass(frozen=True, eq=False)
class CovarianceTable:
    """Covariances of variables of one kind.

    Attributes
    ----------
    kind
        Name of the kind.
    tangent
        Names of the tangent dimensions in order.
    ids, covariance
        (n,) and (n, d, d).
    """

    kind: str
    tangent: tuple[str, ...]
    ids: IdArray
    covariance: Array


def ending_of(path: str) -> str:
    """The format that a name asks for, ``.npz``, ``.csv`` or ``.json``; standard output (``-``) is CSV.

    Raises
    ------
    UsageError
        If it asks for none of them.
    """
    if path == "-":
        return ".csv"
    for ending in ENDINGS:
        if path.endswith((ending, f"{ending}.gz")) and not (ending == ".npz" and path.endswith(".gz")):
            return ending
    raise UsageError(f"{path}: covariances are written as npz, csv or json", ("  name the file so",))


def require_one_size(path: str, sizes: Mapping[str, int]) -> None:
    """Check that kinds of variables, with their tangent dimensions, fit into one CSV file.

    Raises
    ------
    UsageError
        If the file is CSV and they do not.
    """
    if ending_of(path) == ".csv" and len(sizes) > 1:
        listed = " and ".join(f"{kind} ({d} x {d})" for kind, d in sizes.items())
        raise UsageError(
            f"a CSV file holds the covariances of one kind of variable, and there are {listed}",
            ("  write .npz or .json, or choose some with slamcli covariance --of",),
        )


def write_archive(
    path: str, tables: Sequence[CovarianceTable], facts: Mapping[str, str], arrays: Mapping[str, Array | IdArray]
) -> None:
    """Write an npz archive, atomically.

    Parameters
    ----------
    path
        Of the file.
    tables
        The first one is in ``ids`` and ``covariance``, those of a further kind K in ``K_ids`` and ``K_covariance``.
    facts
        Texts beside them; ``frame`` and ``convention`` among them.
    arrays
        Whatever else.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    content: dict[str, object] = {"kinds": np.array([table.kind for table in tables])}
    for k, table in enumerate(tables):
        prefix = f"{table.kind}_" if k else ""
        content[f"{prefix}ids"] = table.ids
        content[f"{prefix}covariance"] = table.covariance
        content[f"{prefix}tangent"] = np.array(table.tangent)
    buffer = io.BytesIO()
    np.savez(buffer, **content, **{name: np.array(text) for name, text in facts.items()}, **arrays)  # type: ignore[arg-type]
    write_bytes(path, buffer.getvalue())


def write_csv(path: str, table: CovarianceTable, facts: Mapping[str, str]) -> None:
    """Write one table as CSV: comments with the facts, a header, then a row of an upper triangle for each id.

    Numbers are the shortest decimals that read back as the same doubles.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    rows, columns = np.triu_indices(len(table.tangent))
    names = [f"{table.tangent[r]}_{table.tangent[c]}" for r, c in zip(rows.tolist(), columns.tolist(), strict=True)]
    lines = [f"# {name}: {text}" for name, text in facts.items()]
    lines.append(",".join(["id", *names]))
    upper = table.covariance[:, rows, columns]
    lines += [
        f"{identifier},{','.join(map(repr, numbers))}"
        for identifier, numbers in zip(table.ids.tolist(), upper.tolist(), strict=True)
    ]
    write_bytes(path, "".join(f"{line}\n" for line in lines).encode())

"""The figures that a suite is held to: read, blessed, written."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from slamcli.errors import InputError, UsageError
from slamcli.formats.source import write_bytes

SCHEMA_VERSION = 1
KIND = "slamcli regress baseline"


@dataclass(frozen=True)
class BaselineFigure:
    """A figure: median of so many repeats and their median absolute deviation (None below two)."""

    value: float
    mad: float | None = None
    repeats: int = 1


@dataclass(frozen=True)
class BaselineCase:
    """A case when it was blessed.

    Attributes
    ----------
    definition
        Hash of what it ran.
    inputs, made
        sha256 of its inputs, and of the graph that was simulated or spoiled.
    provenance
        Key of ``Baseline.provenance``.
    figures
        By name.
    """

    definition: str
    inputs: dict[str, str]
    made: str | None
    provenance: str
    figures: dict[str, BaselineFigure]


@dataclass(frozen=True)
class Baseline:
    """A baseline file.

    Attributes
    ----------
    path
        Of the file.
    digest
        sha256 of the file as it was read, None if there was none: a file with another one was changed in between.
    suite, suite_sha256
        Name and hash of the suite when it was written.
    provenance
        Of the runs whose figures it holds, by key.
    cases
        By name.
    """

    path: str
    digest: str | None = None
    suite: str = ""
    suite_sha256: str = ""
    provenance: dict[str, dict[str, Any]] = field(default_factory=dict)
    cases: dict[str, BaselineCase] = field(default_factory=dict)

    def of(self, case: str) -> dict[str, Any]:
        """Provenance of a case."""
        return self.provenance.get(self.cases[case].provenance, {})


def default_path(suite: Path) -> str:
    """Beside the suite: ``suite.yaml`` has ``suite.baseline.json``."""
    return str(suite.with_suffix(".baseline.json"))


def read(path: str) -> Baseline | None:
    """A baseline; None if there is no such file.

    Raises
    ------
    UsageError
        If it cannot be read or is no baseline of this version.
    """
    if os.path.exists(path) and not os.path.isfile(path):  # a device may have no end
        raise UsageError(f"{path}: is no file")
    try:
        text = Path(path).read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: is no JSON document: {error}") from None
    if not isinstance(document, dict) or document.get("kind") != KIND:
        raise UsageError(f"{path}: is no baseline", ("  slamcli regress SUITE --update-baseline writes one",))
    if document.get("schema_version") != SCHEMA_VERSION:
        raise UsageError(
            f"{path}: is a baseline of version {document.get('schema_version')}, expected {SCHEMA_VERSION}",
            ("  bless a new one with --update-baseline under another name",),
        )
    try:
        return Baseline(
            path=path,
            digest=hashlib.sha256(text).hexdigest(),
            suite=str(document["suite"]["name"]),
            suite_sha256=str(document["suite"]["sha256"]),
            provenance={
                key: {**entry, "versions": dict(entry["versions"])} for key, entry in document["provenance"].items()
            },
            cases={name: _case(entry) for name, entry in document["cases"].items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        what = f"the key {error} is missing" if isinstance(error, KeyError) else str(error)
        raise UsageError(f"{path}: is a damaged baseline: {what}") from None


def _case(entry: dict[str, Any]) -> BaselineCase:
    figures = {name: BaselineFigure(**figure) for name, figure in entry["figures"].items()}
    for name, figure in figures.items():
        if not _finite(figure.value):
            raise ValueError(f"{name} has the value {figure.value!r}")
        if figure.mad is not None and not (_finite(figure.mad) and figure.mad >= 0.0):
            raise ValueError(f"{name} has the deviation {figure.mad!r}")
    inputs = {str(name): str(digest) for name, digest in entry["inputs"].items()}
    return BaselineCase(str(entry["definition"]), inputs, entry["made"], str(entry["provenance"]), figures)


def _finite(value: object) -> bool:
    """Whether a value is a number that can be compared."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < math.inf and abs(value) <= sys.float_info.max


def write(baseline: Baseline) -> None:
    """Write a baseline, atomically, unless its file is no longer the one that was read.

    Raises
    ------
    InputError
        If it was changed in between, or cannot be written.
    """
    used = {case.provenance for case in baseline.cases.values()}
    document = {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "suite": {"name": baseline.suite, "sha256": baseline.suite_sha256},
        "provenance": {key: entry for key, entry in baseline.provenance.items() if key in used},
        "cases": {name: asdict(case) for name, case in baseline.cases.items()},
    }
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    with _alone(Path(baseline.path)):
        if _digest(baseline.path) != baseline.digest:
            raise InputError(
                f"{baseline.path}: was changed by someone else during this run: left as it is",
                ("  run again, so that the changes of both can be seen",),
            )
        write_bytes(baseline.path, text.encode())


def provenance_key(entry: dict[str, Any]) -> str:
    """A short name of a provenance."""
    return hashlib.sha256(json.dumps(entry, sort_keys=True).encode()).hexdigest()[:12]


def _digest(path: str) -> str | None:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return None


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """No other run writes into the folder: its lock goes with the process, and leaves no file behind."""
    try:
        import fcntl
    except ImportError:  # Windows: the rename alone is atomic
        yield
        return
    try:
        folder = os.open(path.resolve().parent, os.O_RDONLY)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)

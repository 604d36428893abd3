"""What a case reads: names of data sets and paths looked up, and hashed."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from slamcli.batch.pipeline import Case
from slamcli.batch.regression.suite import Suite, SuiteCase
from slamcli.errors import InputError, UsageError

#: A value of an option that is a file: its path, relative to the suite, stands behind this word.
FILE = "file:"
#: Endings of what is meant as a file.
_ENDINGS = (".g2o", ".graph", ".bal", ".out", ".log", ".txt", ".json", ".yaml", ".yml", ".csv", ".tum", ".npz")


@dataclass(frozen=True)
class Prepared:
    """A case that can run, or cannot.

    Attributes
    ----------
    suite_case
        As the suite has it.
    case
        With the paths of this machine; as in the suite where data are missing.
    inputs
        sha256 by the name that the suite has for it.
    optimum
        chi2 that the registry states, where the suite asks for it.
    missing
        Why it cannot run; empty if it can.
    absent
        Whether that is because a file is not there (and not because it is another one, or cannot be read).
    """

    suite_case: SuiteCase
    case: Case
    inputs: dict[str, str]
    optimum: float | None = None
    missing: str = ""
    absent: bool = False

    @property
    def name(self) -> str:
        """Of the case."""
        return self.case.name


class _Missing(Exception):
    """A file that a case needs is not there, or is another one."""

    def __init__(self, message: str, absent: bool) -> None:
        super().__init__(message)
        self.absent = absent


def prepare(suite: Suite, cases: tuple[SuiteCase, ...]) -> list[Prepared]:
    """Look up all files of cases.

    Raises
    ------
    UsageError
        If a case names a data set that does not exist, or several; or wants an optimum that is not known.
    """
    hashes: dict[Path, str] = {}
    return [_prepared(suite, entry, hashes) for entry in cases]


def _prepared(suite: Suite, entry: SuiteCase, hashes: dict[Path, str]) -> Prepared:
    case, inputs = entry.case, {}

    def file(name: str) -> str:
        path = _lookup(name, suite.folder)
        if path not in hashes:
            try:
                hashes[path] = sha256_of(path)
            except OSError as error:
                raise _Missing(f"{path}: cannot be read: {error.strerror}", False) from None
        inputs[name] = hashes[path]
        return str(path.resolve())

    def option(value: Any) -> Any:
        if isinstance(value, list):
            return [option(item) for item in value]
        return file(value[len(FILE) :]) if isinstance(value, str) and value.startswith(FILE) else value

    try:
        optimum = _optimum(case.data) if entry.optimum is not None and case.data is not None else None
        simulate = case.simulate
        if simulate is not None and _is_path(simulate):
            simulate = file(simulate)
        steps: dict[str, Any] = {
            key: {name: option(value) for name, value in getattr(case, key).items()}
            for key in ("simulation", "inject", "options", "evaluate")
        }
        data, truth, labels = (None if name is None else file(name) for name in (case.data, case.truth, case.labels))
        ready = replace(case, data=data, simulate=simulate, truth=truth, labels=labels, **steps)
        return Prepared(entry, ready, inputs, optimum)
    except UsageError as error:
        message = f"{suite.path}:{entry.line}: case {entry.name}: {error.message}"
        raise UsageError(message, error.details) from None
    except _Missing as error:
        return Prepared(entry, case, inputs, missing=str(error), absent=error.absent)


def sha256_of(path: Path) -> str:
    """Hash of a file; of a folder that of the list of hashes and names of its files."""
    if path.is_dir():
        files = sorted(found for found in path.rglob("*") if found.is_file())
        lines = (f"{sha256_of(found)}  {found.relative_to(path).as_posix()}\n" for found in files)
        return hashlib.sha256("".join(lines).encode()).hexdigest()
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _lookup(name: str, folder: Path) -> Path:
    """A file relative to the suite, else that of a data set of the registry."""
    from slamcli.batch import datasets
    from slamcli.batch.datasets.search import checked

    path = folder / name
    if path.is_file() or (path.is_dir() and _is_path(name)):
        return path
    try:
        entry = datasets.entry(name)
    except UsageError:
        if not _is_path(name):
            raise
        raise _Missing(f"{path}: no such file", True) from None
    if not datasets.available(entry.name):
        raise _Missing(f"the data set {entry.name} is not here: see slamcli datasets show {entry.name}", True)
    try:
        return checked(entry)
    except InputError as error:
        raise _Missing(" ".join([error.message, *(line.strip() for line in error.details[:1])]), False) from None


def _optimum(name: str) -> float:
    from slamcli.batch import datasets

    found = datasets.entry(name).optimum
    if found is None:
        raise UsageError(f"the registry states no optimum of {name}", ("  see slamcli datasets show",))
    return found.chi2


def _is_path(name: str) -> bool:
    """Whether a word is meant as a path."""
    plain = name.removesuffix(".gz").removesuffix(".bz2")
    return "/" in name or os.sep in name or plain != name or Path(name).suffix in _ENDINGS

"""Under what a figure was measured: versions, platform, processor, date, revision of the sources."""

from __future__ import annotations

import datetime
import functools
import hashlib
import os
import platform
import subprocess
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import slamcli

#: Libraries that figures and times depend on.
LIBRARIES = ("numpy", "scipy", "cvxopt", "pymetis")
_PACKAGE = Path(slamcli.__file__).parent


def provenance(peers: Iterable[str] = ()) -> dict[str, Any]:
    """Of a run that begins now.

    Parameters
    ----------
    peers
        Further packages whose versions count.

    Returns
    -------
    dict[str, Any]
        ``date`` (UTC), ``platform``, ``processor`` by name, number of ``processors``, ``revision`` (commit, with ``+``
        if the sources were changed since; None outside of a repository), ``source`` (hash of the sources that run),
        ``versions`` of slamcli, Python, the libraries and the peers (None for one that is not installed).
    """
    installed = {name: _version(name) for name in (*LIBRARIES, *peers)}
    return {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "platform": platform.platform(),
        "processor": _processor(),
        "processors": os.cpu_count(),
        "revision": _revision(),
        "source": source_digest(),
        "versions": {"slamcli": slamcli.__version__, "python": platform.python_version(), **installed},
    }


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """In words, what may explain other figures at two times: versions, platform, processor."""
    pairs = {name: (old.get(name), new.get(name)) for name in ("platform", "processor")}
    versions = [entry.get("versions", {}) for entry in (old, new)]
    pairs |= {name: (version, versions[1].get(name)) for name, version in versions[0].items()}
    return [
        f"{name} {before or 'absent'} -> {now or 'absent'}" for name, (before, now) in pairs.items() if before != now
    ]


@functools.cache
def source_digest() -> str:
    """Hash of the sources of slamcli that run here: a version has many states between two releases."""
    total = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        total.update(f"{path.relative_to(_PACKAGE).as_posix()}\0".encode())
        total.update(path.read_bytes())
    return total.hexdigest()


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    try:  # Linux; platform.processor() is empty there
        with open("/proc/cpuinfo", encoding="utf-8") as stream:
            found = next((line.partition(":")[2].strip() for line in stream if line.startswith("model name")), "")
            return found or platform.machine()
    except OSError:
        return platform.processor() or platform.machine()


def _revision() -> str | None:
    """Commit of the sources of slamcli, with ``+`` where they were changed since."""

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", "-C", str(_PACKAGE), *words], capture_output=True, text=True, check=True, timeout=10
        ).stdout.strip()

    try:
        # of the repository that tracks slamcli, not of one in which it is installed
        git("ls-files", "--error-unmatch", "__init__.py")
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--", ".") else "")
    except (OSError, subprocess.SubprocessError):
        return None

"""Under what a figure was measured: versions, platform, processor, date, revision of the sources."""

from __future__ import annotations

import datetime
import functools
import hashlib
import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import slamcli
from slamcli.batch.regression import reference

_LIBRARIES = ("numpy", "scipy", "cvxopt", "pymetis")
_PACKAGE = Path(slamcli.__file__).parent


def provenance() -> dict[str, Any]:
    """Of a run that begins now; ``git`` is None outside of a repository."""
    return {
        "slamcli": slamcli.__version__,
        "python": platform.python_version(),
        **{name: _version(name) for name in _LIBRARIES},
        "platform": platform.platform(),
        "cpu": _processor(),
        "cpus": os.cpu_count(),
        "date": datetime.datetime.now(datetime.UTC).replace(microsecond=0).isoformat(),
        "git": _revision(),
        "source": source_digest(),
        "reference_kernel": reference.VERSION,
    }


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """In words, what may explain other figures than those of the baseline."""
    names = ("slamcli", "python", *_LIBRARIES, "platform", "cpu")
    return [f"{name} {old[name]} -> {new.get(name)}" for name in names if name in old and old[name] != new.get(name)]


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

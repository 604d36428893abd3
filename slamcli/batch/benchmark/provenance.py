"""Where figures come from: versions, machine, date."""

from __future__ import annotations

import datetime
import os
import platform
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from slamcli import __version__

#: Libraries that times depend on.
_LIBRARIES = ("numpy", "cvxopt", "scipy", "pymetis")


def provenance(peers: Iterable[str]) -> dict[str, Any]:
    """Versions of slamcli, Python, its libraries and the peers; machine, processor and date (UTC)."""
    versions = {"slamcli": __version__, "python": platform.python_version()}
    for name in (*_LIBRARIES, *peers):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "absent"
    now = datetime.datetime.now(datetime.UTC)
    return {
        "date": now.isoformat(timespec="seconds"),
        "platform": platform.platform(),
        "processor": processor(),
        "processors": os.cpu_count(),
        "versions": versions,
    }


def processor() -> str:
    """Name of the processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as stream:
            return next(line.split(":", 1)[1].strip() for line in stream if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()

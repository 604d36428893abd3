"""The memory that a process took."""

from __future__ import annotations

import sys


def peak_memory() -> float:
    """Peak memory of this process in MB."""
    try:  # Linux; getrusage there counts what the parent had before this process began
        with open("/proc/self/status", encoding="ascii") as stream:
            return next(float(line.split()[1]) / 1024.0 for line in stream if line.startswith("VmHWM:"))
    except (OSError, StopIteration):
        pass
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0 * 1024.0) if sys.platform == "darwin" else peak / 1024.0

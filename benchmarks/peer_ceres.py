"""Ceres on a scene: a program of ours, ``ceres/bundle.cpp``, that is compiled where a compiler and Ceres are.

(pyceres has no cost function for BAL's camera, and one written in Python would be all that is measured.)
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

#: Ways to solve the reduced system, by the name on the program's command line.
SOLVERS = {"dense": "DENSE_SCHUR", "sparse": "SPARSE_SCHUR", "iterative": "ITERATIVE_SCHUR"}

_SOURCE = Path(__file__).parent / "ceres" / "bundle.cpp"
_PROGRAM = Path(__file__).parent.parent / "build" / "ceres" / "bundle"
_HEADERS = ("/usr/include/eigen3", "/usr/local/include/eigen3")


class NotThereError(Exception):
    """Why there is no program."""


def program() -> Path:
    """The program, compiled if it is older than its source.

    Raises
    ------
    NotThereError
        If it cannot be.
    """
    if _PROGRAM.exists() and _PROGRAM.stat().st_mtime > _SOURCE.stat().st_mtime:
        return _PROGRAM
    compiler = shutil.which(os.environ.get("CXX", "c++")) or shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        raise NotThereError("no C++ compiler")
    _PROGRAM.parent.mkdir(parents=True, exist_ok=True)
    headers = [f"-I{folder}" for folder in _HEADERS if Path(folder).is_dir()]
    options = ["-O3", "-DNDEBUG", "-std=c++17", *headers, str(_SOURCE), "-o", str(_PROGRAM), "-lceres", "-lglog"]
    done = subprocess.run([compiler, *options], capture_output=True, text=True, check=False)
    if done.returncode:
        first = next((line for line in done.stderr.splitlines() if "error" in line), "the compiler failed")
        raise NotThereError(f"Ceres' headers and library are needed (Debian: libceres-dev): {first}")
    return _PROGRAM


def run(path: str, solver: str) -> dict[str, Any]:
    """One run on one thread; see the program for what it prints."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    command = [str(program()), path, solver]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer

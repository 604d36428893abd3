"""Which deliberate bug does which figure catch: ``python -m benchmarks.mutations [NAME ...]``.

Each mutation changes one place of a copy of the sources, runs a suite against its baseline there, and is caught if
the suite is no longer green. First the suite has to be green in an unchanged copy. ``--suite`` takes another one than
the bundled, ``--jobs N`` runs N cases at a time, ``--json FILE`` keeps everything. Exit code 1 if a mutation survives.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
#: What a suite needs of the tree.
_COPIED = ("slamcli", "configs", "datasets")
_SUITE = "configs/suites/bundled.yaml"
#: So many figures are named in the table.
_SHOWN = 6
#: Verdicts with which nothing is wrong.
_GREEN = ("pass", "info", "new", "improved", "skipped")


@dataclass(frozen=True)
class Mutation:
    """A bug.

    Attributes
    ----------
    name
        In a word or two.
    path
        File of the project.
    old, new
        What stands there once, and what takes its place.
    """

    name: str
    path: str
    old: str
    new: str

    def apply(self, root: Path) -> None:
        """Put the bug into a tree.

        Raises
        ------
        ValueError
            If the place is not there, or not alone.
        """
        file = root / self.path
        text = file.read_text(encoding="utf-8")
        found = text.count(self.old)
        if found != 1:
            raise ValueError(f"{self.name}: {self.path} has {found} times {self.old!r}, expected once")
        file.write_text(text.replace(self.old, self.new), encoding="utf-8")


MUTATIONS = (
    # models
    Mutation(
        "sign of the SE(2) Jacobian by the heading",
        "slamcli/models/relative_pose_2d.py",
        "jacobian_i[:, 0, 2] = cos_z * v - sin_z * u",
        "jacobian_i[:, 0, 2] = sin_z * u - cos_z * v",
    ),
    Mutation(
        "sign of the SE(3) Jacobian by the rotation",
        "slamcli/models/relative_pose_3d.py",
        "jacobian_i[:, row, 3 + column] = entry",
        "jacobian_i[:, row, 3 + column] = -entry",
    ),
    Mutation(
        "sign of the landmark's Jacobian by the heading",
        "slamcli/models/point_observation.py",
        "jacobian_pose[:, 1, 2] = -u",
        "jacobian_pose[:, 1, 2] = u",
    ),
    Mutation(
        "bearing not wrapped",
        "slamcli/models/range_bearing.py",
        "residual[:, k] = so2.wrap(measurement[:, k] - view.bearing)",
        "residual[:, k] = measurement[:, k] - view.bearing",
    ),
    Mutation(
        "heading residual not wrapped",
        "slamcli/models/relative_pose_2d.py",
        "residual[:, 2] = so2.wrap(theta_j - theta_i - phi)",
        "residual[:, 2] = theta_j - theta_i - phi",
    ),
    Mutation(
        "slope of the radial distortion",
        "slamcli/models/projection.py",
        "slope = 2.0 * f * (k1 + 2.0 * k2 * square)",
        "slope = 2.0 * f * (k1 - 2.0 * k2 * square)",
    ),
    Mutation(
        "sign of the Jacobian by the focal length",
        "slamcli/models/projection.py",
        "np.multiply(distortion, place, out=of_camera[:, row, 6])",
        "np.multiply(distortion, -place, out=of_camera[:, row, 6])",
    ),
    # formats
    Mutation(
        "upper triangle read by columns",
        "slamcli/models/information.py",
        "    for k, (row, column) in enumerate(zip(*np.triu_indices(dimension), strict=True)):",
        "    for k, (column, row) in enumerate(zip(*np.tril_indices(dimension), strict=True)):",
    ),
    Mutation(
        "TORO's order of the information taken for g2o's",
        "slamcli/formats/toro.py",
        "_ROW_ORDER = [0, 1, 4, 2, 5, 3]",
        "_ROW_ORDER = [0, 1, 2, 3, 4, 5]",
    ),
    Mutation(
        "TORO's frame of the information taken for g2o's",
        "slamcli/formats/toro.py",
        "return measurement, _rotated(information, _frame_2d(measurement))",
        "return measurement, information",
    ),
    # linear system and orders
    Mutation(
        "natural ordering as default",
        "slamcli/solver/ordering/__init__.py",
        'found = choose(pattern) if name == "auto" else named(name, pattern)',
        'found = named("natural" if name == "auto" else name, pattern)',
    ),
    Mutation(
        "minimum degree reversed",
        "slamcli/solver/ordering/minimum_degree.py",
        "dtype=np.intp).ravel()",
        "dtype=np.intp).ravel()[::-1]",
    ),
    Mutation(
        "convergence declared far too early",
        "slamcli/cli/solver_options.py",
        "default=1e-9",
        "default=1e-2",
    ),
    Mutation(
        "damping never falls",
        "slamcli/solver/policies/levenberg_marquardt.py",
        "self._lambda *= max(1.0 / 3.0, min(2.0 / 3.0, 1.0 - (2.0 * rho - 1.0) ** 3))",
        "self._lambda *= 1.0",
    ),
    Mutation(
        "chordal start without weights",
        "slamcli/solver/initialization/rotations.py",
        "return np.trace(information[:, space:, space:], axis1=1, axis2=2) / (information.shape[-1] - space)",
        "return np.ones(len(information))",
    ),
    # robust estimation
    Mutation(
        "graduated non-convexity keeps what it should weigh down",
        "slamcli/solver/robust/gnc.py",
        "keep = self.squared <= gate()",
        "keep = self.squared <= 1e6 * gate()",
    ),
    Mutation(
        "width of a kernel squared",
        "slamcli/solver/robust/kernels.py",
        "return squared if options.kernel in SQUARED_WIDTH else math.sqrt(squared)",
        "return squared",
    ),
    Mutation(
        "weight of the Cauchy kernel",
        "slamcli/solver/robust/kernels.py",
        "return width**2 * np.log1p(scaled), 1.0 / (1.0 + scaled)",
        "return width**2 * np.log1p(scaled), 1.0 / (1.0 + scaled) ** 2",
    ),
    # the filter
    Mutation(
        "motion noise in the wrong frame",
        "slamcli/filtering/ekf.py",
        "state.move(pose, shift, rotation @ noise @ rotation.T)",
        "state.move(pose, shift, rotation.T @ noise @ rotation)",
    ),
    Mutation(
        "noise of the readings left out of S",
        "slamcli/filtering/ekf.py",
        "covariance = jacobian @ cross[index] + stacked.noise",
        "covariance = jacobian @ cross[index] + 0.5 * stacked.noise",
    ),
    # certificates
    Mutation(
        "kappa without its half",
        "slamcli/solver/certificate/isotropic.py",
        "return cls(tau, 0.5 * _harmonic_mean(information[:, 3:, 3:]))",
        "return cls(tau, _harmonic_mean(information[:, 3:, 3:]))",
    ),
    # bundle adjustment
    Mutation(
        "Schur complement with the wrong sign",
        "slamcli/solver/schur/complement.py",
        "complement[structure.diagonal_targets[camera]] -= own.T @ own",
        "complement[structure.diagonal_targets[camera]] += own.T @ own",
    ),
    # evaluation
    Mutation(
        "alignment reflected",
        "slamcli/evaluation/alignment.py",
        "rotation = np.matmul(u * sign, vt)  # eq. 40",
        "rotation = np.matmul(u * sign, vt).T",
    ),
)


def main() -> int:
    """Try the mutations and print a table; 1 if one survives."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="part of the name of a mutation; all without any")
    parser.add_argument("--suite", default=_SUITE)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    chosen = [m for m in MUTATIONS if not options.names or any(name in m.name for name in options.names)]
    with tempfile.TemporaryDirectory(prefix="mutations-") as name:
        base = Path(name)
        copy(ROOT, base)  # the tree may change meanwhile
        return _campaign(chosen, base, options)


def _campaign(chosen: list[Mutation], base: Path, options: argparse.Namespace) -> int:
    rows: list[dict[str, Any]] = []
    print("| mutation | in | cases that fail | figures | first message |\n|---|---|---:|---|---|")
    for mutation in (None, *chosen):
        row = tried(mutation, base, options.suite, options.jobs)
        rows.append(row)
        place = f"`{mutation.path.removeprefix('slamcli/')}`" if mutation else ""
        figures = ", ".join(row["figures"][:_SHOWN]) + (", ..." if len(row["figures"]) > _SHOWN else "")
        # a figure says more than the exit code that comes with it
        telling = [said for said in row["caught"] if "exit_code" not in said] or row["caught"] or ["**nothing**"]
        message = telling[0].replace("|", "\\|")
        print(f"| {row['name']} | {place} | {row['failed']} | {figures} | {message} |", flush=True)
        if mutation is None and row["failed"]:
            print("the suite is not green without mutations", file=sys.stderr)
            return 1
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return int(any(not row["failed"] for row in rows[1:]))


def copy(source: Path, target: Path) -> None:
    """Copy what a suite needs."""
    for part in _COPIED:
        shutil.copytree(source / part, target / part, ignore=shutil.ignore_patterns("__pycache__"))


def tried(mutation: Mutation | None, base: Path, suite: str, jobs: int) -> dict[str, Any]:
    """Run the suite in a copy of the tree with a bug; which cases and figures it fails."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="mutation-") as name:
        root = Path(name)
        copy(base, root)
        if mutation is not None:
            mutation.apply(root)
        words = [sys.executable, "-m", "slamcli", "regress", suite, "--format", "json", "--jobs", str(jobs)]
        environment = {**os.environ, "PYTHONPATH": name, "PYTHONDONTWRITEBYTECODE": "1"}
        run = subprocess.run(words, cwd=root, env=environment, capture_output=True, text=True, check=False)
    row: dict[str, Any] = {"name": mutation.name if mutation else "none", "failed": 0, "caught": [], "figures": []}
    try:
        document = json.loads(run.stdout)
    except ValueError:
        return row | {"failed": 1, "caught": [f"the run itself: {(run.stderr.splitlines() or ['no output'])[-1]}"]}
    for case in document["cases"]:
        if case["verdict"] in _GREEN:
            continue
        row["failed"] += 1
        figures = [f for f in case["metrics"] if f["verdict"] not in _GREEN]
        row["figures"] += [f["name"] for f in figures if f["name"] not in row["figures"]]
        said = [f"{case['name']}: {f['name']} {f['message']}" for f in figures]
        row["caught"] += said or [f"{case['name']}: {case['message'] or case['verdict']}"]
    return row | {"seconds": time.perf_counter() - started}


if __name__ == "__main__":
    sys.exit(main())

"""The same figures as evo on the same files, to 1e-9."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from noisy_paths import moved, planar, spatial
from support import BUNDLED, dataset

from slamcli.evaluation import EvaluateOptions, evaluate
from slamcli.evaluation.association import associate
from slamcli.formats import read
from slamcli.formats.trajectories import read_trajectory, write_trajectory
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2
from slamcli.solver.optimize import optimize

metrics = pytest.importorskip("evo.core.metrics")
ALIGNMENTS = ("none", "origin", "se", "sim")
DELTAS = (
    (1.0, "frames", False),
    (10.0, "frames", True),
    (3.0, "m", False),
    (3.0, "m", True),
    (20.0, "deg", False),
)


def relation(name: str) -> Any:
    return {
        "translation": metrics.PoseRelation.translation_part,
        "rotation": metrics.PoseRelation.rotation_angle_deg,
        "full": metrics.PoseRelation.full_transformation,
    }[name]


def evo_ape(truth: Any, estimate: Any, name: str, align: str) -> dict[str, float]:
    from evo.main_ape import ape

    return ape(copy.deepcopy(truth), copy.deepcopy(estimate), relation(name), **alignment(align)).stats


def evo_rpe(truth: Any, estimate: Any, name: str, align: str, delta: float, unit: str, every: bool) -> dict[str, float]:
    from evo.core.units import Unit
    from evo.main_rpe import rpe

    units = {"frames": Unit.frames, "m": Unit.meters, "deg": Unit.degrees}
    return rpe(
        copy.deepcopy(truth),
        copy.deepcopy(estimate),
        relation(name),
        delta=delta,
        delta_unit=units[unit],
        all_pairs=every,
        **alignment(align),
    ).stats


def alignment(name: str) -> dict[str, bool]:
    return {"align": name in ("se", "sim"), "correct_scale": name == "sim", "align_origin": name == "origin"}


def compare(ours: Any, theirs: dict[str, float]) -> None:
    for statistic, value in theirs.items():
        # errors of rotation below 1e-6 deg are rounding in both
        assert getattr(ours, statistic) == pytest.approx(value, rel=1e-9, abs=1e-9), statistic


def compare_all(
    estimate: Trajectory, truth: Trajectory, their_truth: Any, their_estimate: Any, deltas: Any = DELTAS
) -> None:
    for align in ALIGNMENTS:
        for k, (delta, unit, every) in enumerate(deltas):
            options = EvaluateOptions(align=align, deltas=(delta,), delta_unit=unit, all_pairs=every)
            result = evaluate([estimate], truth, options=options).estimates[0]
            assert result.absolute is not None
            for name in ("translation", "rotation", "full"):
                if k == 0:
                    compare(result.absolute[name], evo_ape(their_truth, their_estimate, name, align))
                theirs = evo_rpe(their_truth, their_estimate, name, align, delta, unit, every)
                assert result.relative[0].statistics is not None
                compare(result.relative[0].statistics[name], theirs)


@pytest.mark.parametrize("make", [planar, spatial])
@pytest.mark.parametrize("form", ["tum", "kitti"])
def test_files(make: Any, form: str, tmp_path: Path) -> None:
    """Trajectories of 200 noisy poses, written by us and read by both; time stamps differ by up to 4 ms."""
    from evo.core import sync
    from evo.tools import file_interface

    truth = make()
    motion = np.array([0.3, -0.2, 0.1] if truth.kind is SE2 else [0.3, -0.2, 0.1, 0.1, 0.0, -0.1, 0.98**0.5])
    estimate = moved(make(noise=0.05), motion, 1.03)
    estimate = replace(estimate, stamps=estimate.stamps + 0.004)
    files = {name: str(tmp_path / f"{name}.{form}") for name in ("truth", "estimate")}
    write_trajectory(truth, files["truth"])
    write_trajectory(estimate, files["estimate"])
    reader = getattr(file_interface, {"tum": "read_tum_trajectory_file", "kitti": "read_kitti_poses_file"}[form])
    theirs = reader(files["truth"]), reader(files["estimate"])
    if form == "tum":
        theirs = sync.associate_trajectories(*theirs)
    compare_all(read_trajectory(files["estimate"]), read_trajectory(files["truth"]), *theirs)


@pytest.mark.parametrize("form", ["tum", "kitti"])
@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o", "square_toro.graph"])
def test_our_simulations(name: str, form: str, tmp_path: Path) -> None:
    """Our graph on one side, for evo the same poses as TUM (the ids are the stamps) or KITTI on the other."""
    from evo.core import sync
    from evo.tools import file_interface

    files = {"estimate": BUNDLED / name, "truth": (BUNDLED / "truth" / name).with_suffix(".g2o")}
    ours = {role: read_trajectory(str(path)) for role, path in files.items()}
    reader = getattr(file_interface, {"tum": "read_tum_trajectory_file", "kitti": "read_kitti_poses_file"}[form])
    theirs = []
    for role in ("truth", "estimate"):
        write_trajectory(ours[role], str(tmp_path / f"{role}.{form}"))
        theirs.append(reader(str(tmp_path / f"{role}.{form}")))
    if form == "tum":
        theirs = sync.associate_trajectories(*theirs)
    compare_all(ours["estimate"], ours["truth"], *theirs, deltas=DELTAS[:3])


def as_evo(trajectory: Trajectory) -> Any:
    from evo.core.trajectory import PoseTrajectory3D

    poses = trajectory.lifted()
    return PoseTrajectory3D(poses[:, :3], np.roll(poses[:, 3:], 1, axis=1), trajectory.stamps)


@pytest.mark.parametrize("limit", [0.01, 0.1])
def test_association(limit: float) -> None:
    """Also where several poses have the same nearest neighbour, and whichever is the longer one."""
    from evo.core import sync

    rng = np.random.default_rng(3)
    sparse = replace(planar(150), stamps=np.sort(rng.uniform(99.0, 121.0, 150)))
    dense = replace(planar(200), stamps=np.sort(rng.uniform(100.0, 120.0, 200)))
    as_dense = replace(dense, stamps=np.sort(rng.uniform(100.0, 120.0, 200)))
    for estimate, truth in ((sparse, dense), (dense, sparse), (dense, as_dense)):
        pairs = associate(estimate, truth, "time", limit)
        reference, aligned = sync.associate_trajectories(as_evo(truth), as_evo(estimate), max_diff=limit)
        np.testing.assert_array_equal(truth.stamps[pairs.truth], reference.timestamps)
        np.testing.assert_array_equal(estimate.stamps[pairs.estimate], aligned.timestamps)


@pytest.mark.datasets
@pytest.mark.parametrize("optimized", [False, True])
def test_bicocca(optimized: bool, tmp_path: Path) -> None:
    """Real graphs against the ground truth of RAWSEEDS, associated by time stamps: 701 pairs within 10 ms."""
    from evo.core import sync

    truth = read_trajectory(
        str(dataset("outliers/rrr_Bicocca25b_GT_GPS.g2o")),
        timestamps=str(dataset("outliers/Bicocca25b_GT_GPS_timestamps.txt")),
    )
    path = str(dataset("outliers/rrr_B25b_1.000.g2o"))
    if optimized:
        from slamcli.formats import write

        write(optimize(read(path)).graph, tmp_path / "optimized.g2o")
        path = str(tmp_path / "optimized.g2o")
    estimate = read_trajectory(path, timestamps=str(dataset("outliers/B25b_timestamps.txt")))
    assert estimate.kind is SE2
    theirs = sync.associate_trajectories(as_evo(truth), as_evo(estimate))
    assert theirs[0].num_poses == evaluate([estimate], truth).estimates[0].pairs == 701
    compare_all(estimate, truth, *theirs)

"""Scores of filter runs: against the truth, against their own covariances, over many seeds."""

import json
from dataclasses import replace

import numpy as np
import pytest

from slamcli.cli.main import main
from slamcli.evaluation.filter_run import judge, true_trajectory
from slamcli.evaluation.monte_carlo import monte_carlo, simulated_log
from slamcli.filtering.estimate import estimated_graph, landmark_ids
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.run import run
from slamcli.formats import read
from slamcli.formats.covariances import read_covariances
from slamcli.formats.trajectories import read_trajectory
from slamcli.reporting.ekf import ekf_document, ekf_summary
from slamcli.simulation.settings import scenario_of

CALM = {
    "world": "circle",
    "poses": 60,
    "closures": {"by": "none"},
    "robot": {"noise": [0.02, 0.002]},
    "landmarks": {"count": 15},
    "sensors": [{"kind": "range-bearing", "range": 8}],
}


def scenarios(content, runs):
    return [scenario_of({**content, "seed": seed}, "test") for seed in range(runs)]


def known(log):
    return EkfOptions()


def filtered(**more):
    log = simulated_log(scenario_of({**CALM, **more}, "test"))
    return run(log, EkfOptions()), log


def test_scores_against_the_truth_by_hand():
    result, log = filtered()
    scores = judge(result, log)
    error = result.poses[:, :2] - log.true_trajectory.poses[:, :2]
    assert scores.against_truth.absolute["translation"].rmse == pytest.approx(
        np.sqrt(np.square(error).sum(axis=1).mean())
    )
    ids, positions = log.true_landmarks
    rows = np.searchsorted(ids, result.landmarks.ids)
    distance = np.square(result.landmarks.positions - positions[rows]).sum(axis=1)
    assert scores.against_truth.landmarks.error.rmse == pytest.approx(np.sqrt(distance.mean()))
    assert scores.nis_mean == pytest.approx(result.updates.nis.sum() / result.updates.degrees_of_freedom.sum())
    assert scores.nis_band[0] < 1.0 < scores.nis_band[1]
    assert scores.aligned.absolute["translation"].rmse <= scores.against_truth.absolute["translation"].rmse


def test_without_truth_there_is_nothing_to_compare():
    from dataclasses import replace

    result, log = filtered()
    scores = judge(result, replace(log, true_trajectory=None))
    assert scores.against_truth is None and scores.aligned is None
    assert scores.nis_mean is not None


def test_true_landmarks_come_with_the_true_path():
    _, log = filtered()
    truth = true_trajectory(log)
    assert set(truth.graph.variables["XY"].ids) == set(log.true_landmarks[0])


def test_small_errors_are_consistent():
    runs = monte_carlo(scenarios(CALM, 30), known)
    assert runs.inside > 0.85
    assert runs.mean == pytest.approx(1.0, abs=0.25)
    assert runs.nis == pytest.approx(1.0, abs=0.1)
    # the error is as large as the filter says
    assert np.mean(runs.position_rmse[10:] / runs.position_sigma[10:]) == pytest.approx(1.0, abs=0.15)


def test_large_heading_errors_make_the_filter_too_sure_and_first_estimates_help():
    # one blind round of 240 m: the heading is off by some 10 degrees before the first landmarks are seen again
    wild = {**CALM, "poses": 241, "robot": {"noise": [0.05, 0.01]}, "landmarks": {"count": 25}}
    standard = monte_carlo(scenarios(wild, 20), known)
    first = monte_carlo(scenarios(wild, 20), first_estimates)
    assert standard.mean > 2.0 and standard.inside < 0.8
    assert first.mean < 0.7 * standard.mean
    assert first.inside > standard.inside + 0.1


def first_estimates(log):
    return EkfOptions(jacobians="first-estimates")


def test_processes_give_the_same_numbers():
    one, two = (monte_carlo(scenarios(CALM, 4), known, jobs=jobs) for jobs in (1, 2))
    assert np.array_equal(one.nees, two.nees, equal_nan=True)
    assert one.nis == two.nis


def test_ids_of_landmarks_are_unique():
    result, _ = filtered()
    ids = landmark_ids(result)
    assert ids.tolist() == result.landmarks.ids.tolist()
    unnamed = result.landmarks.ids.copy()
    unnamed[1], unnamed[2] = -1, unnamed[0]
    object.__setattr__(result.landmarks, "ids", unnamed)
    ids = landmark_ids(result)
    assert len(set(ids.tolist())) == len(ids)
    assert ids[0] == unnamed[0]
    assert not set(ids[1:3].tolist()) & set(result.ids.tolist())
    assert estimated_graph(result).landmarks == len(ids)


def test_files_of_the_command_hold_what_was_filtered(tmp_path, capsys):
    config = tmp_path / "calm.yaml"
    config.write_text(json.dumps(CALM))
    names = {name: str(tmp_path / name) for name in ("e.g2o", "e.tum", "c.npz", "l.npz", "r.npz", "t.jsonl")}
    words = ["ekf", str(config), "-o", names["e.g2o"], "--trajectory", names["e.tum"], "--trace", names["t.jsonl"]]
    words += [
        "--covariances",
        names["c.npz"],
        "--landmark-covariances",
        names["l.npz"],
        "--correlation",
        names["r.npz"],
        "--json",
    ]
    assert main(words) == 0
    document = json.loads(capsys.readouterr().out)
    result, _ = filtered()
    graph = read(names["e.g2o"])
    np.testing.assert_array_equal(graph.variables["SE2"].values, result.poses)
    np.testing.assert_array_equal(graph.variables["XY"].values, result.landmarks.positions)
    assert np.abs(read_trajectory(names["e.tum"]).positions[:, :2] - result.poses[:, :2]).max() < 1e-12
    np.testing.assert_array_equal(read_covariances(names["c.npz"]).covariance, result.covariances)
    np.testing.assert_array_equal(read_covariances(names["l.npz"]).covariance, result.landmarks.covariances)
    with np.load(names["r.npz"]) as archive:
        np.testing.assert_array_equal(archive["correlation"], result.correlation())
        assert archive["names"][:4].tolist() == ["x", "y", "theta", f"{landmark_ids(result)[0]} x"]
    events = [json.loads(line) for line in (tmp_path / "t.jsonl").read_text(encoding="utf-8").splitlines()]
    assert [event["event"] for event in events] == ["start"] + ["step"] * 60
    assert events[-1]["pose"] == document["final_pose"] == result.poses[-1].tolist()
    assert events[-1]["map_trace"] == pytest.approx(np.trace(result.covariance()[3:, 3:]))
    used = sum(reading["decision"] == "used" for event in events[1:] for reading in event["readings"])
    assert used == document["counts"]["used"] == result.counts["used"]


def test_a_truth_that_determines_no_alignment_is_compared_as_it_is():
    """Two poses: ATE and NEES stay, what needs an alignment is missing."""
    result, log = filtered(poses=2)
    scores = judge(result, log)
    assert scores.aligned is None
    assert scores.against_truth.pairs == 2 and scores.against_truth.consistency.count == 1


def test_runs_without_readings_have_no_nis():
    runs = monte_carlo(scenarios({**CALM, "poses": 20, "landmarks": {"count": 0}}, 2), known)
    assert np.isnan(runs.nis)


def test_nees_of_the_filter_is_that_of_evaluate(tmp_path, capsys):
    """Covariances that are written have the frames that evaluate takes them for."""
    config = tmp_path / "calm.yaml"
    config.write_text(json.dumps({**CALM, "robot": {"noise": [0.05, 0.02, 0.01]}}))
    graph, truth, estimate, poses = (str(tmp_path / name) for name in ("g.g2o", "t.g2o", "e.g2o", "c.npz"))
    assert main(["simulate", str(config), "-o", graph, "--truth", truth]) == 0
    capsys.readouterr()
    assert main(["ekf", graph, "--truth", truth, "-o", estimate, "--covariances", poses, "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)["truth"]
    words = ["evaluate", estimate, "--truth", truth, "--covariances", poses, "--align", "none", "--json"]
    assert main(words) == 0
    assert f'"mean": {scores["nees_mean"]!r}' in capsys.readouterr().out


def test_true_landmarks_without_a_true_path():
    result, log = filtered()
    scores = judge(result, replace(log, true_trajectory=None))
    assert scores.against_truth is None and scores.aligned is None
    ids, positions = log.true_landmarks
    error = result.landmarks.positions - positions[np.searchsorted(ids, result.landmarks.ids)]
    assert scores.landmarks.matched == len(error) > 5
    assert scores.landmarks.error.rmse == pytest.approx(np.sqrt(np.square(error).sum(axis=1).mean()))
    document = ekf_document(log, EkfOptions(), result, scores, 0.0)
    assert document["truth"]["landmark_rmse"] == scores.landmarks.error.rmse
    assert any("the true path is not known" in line for line in ekf_summary(log, result, scores, "", 0.0))

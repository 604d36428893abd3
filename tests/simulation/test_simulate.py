"""What a simulation holds together: graph, truth, labels, log; determinism; independence of its parts."""

import numpy as np
import pytest

import slamcli
from slamcli.cli.main import main
from slamcli.evaluation.drift import dead_reckoning, gap
from slamcli.evaluation.drift_sweep import drift_sweep
from slamcli.formats import render
from slamcli.formats.labels import read_labels
from slamcli.graph.trajectory import of_graph
from slamcli.simulation.guess import integrate
from slamcli.simulation.record import log_blocks
from slamcli.simulation.settings import scenario_of, sweep_of
from slamcli.simulation.simulate import simulate

SENSORS = [{"kind": kind, "range": 6} for kind in ("xy", "range-bearing", "bearing", "range")] + [{"kind": "gps"}]
RICH = {"world": "corridor", "poses": 200, "landmarks": {"density": 0.1}, "sensors": SENSORS}


def run(content, **more):
    return simulate(scenario_of({**content, **more}, "test"))


def text(simulation):
    return render(simulation.graph).data + render(simulation.truth).data


@pytest.mark.parametrize("world", ["manhattan", "torus"])
def test_same_seed_same_bytes(world):
    assert text(run({"world": world, "seed": 3})) == text(run({"world": world, "seed": 3}))
    assert text(run({"world": world, "seed": 3})) != text(run({"world": world, "seed": 4}))


def test_parts_draw_from_streams_of_their_own():
    plain, rich = run({"world": "manhattan"}), run({"world": "manhattan"}, landmarks={"count": 9}, sensors=SENSORS)
    assert (plain.odometry.measurements == rich.odometry.measurements).all()
    assert (plain.closures.pairs == rich.closures.pairs).all()
    fewer = run({"world": "manhattan"}, landmarks={"count": 9}, sensors=SENSORS[:2])
    assert (fewer.readings[0].measurements == rich.readings[0].measurements).all()
    assert (
        run({"world": "manhattan"}, closures={"by": "none"}).truth.variables["SE2"].values
        == plain.truth.variables["SE2"].values
    ).all()


@pytest.mark.parametrize("content", [RICH, {"world": "helix", "poses": 300}], ids=["planar", "spatial"])
def test_files_hold_what_was_simulated(content, tmp_path):
    simulation = run(content)
    for graph, name in ((simulation.graph, "graph.g2o"), (simulation.truth, "truth.g2o")):
        slamcli.write(graph, str(tmp_path / name))
        again = slamcli.read(str(tmp_path / name))
        assert (again.poses, again.landmarks, again.edges) == (graph.poses, graph.landmarks, graph.edges)
        assert again.chi2() == pytest.approx(graph.chi2(), rel=1e-6)


def test_the_guess_is_dead_reckoning():
    for content in (RICH, {"world": "sphere", "poses": 400}):
        simulation = run(content, decimals=None)
        integrated = dead_reckoning(simulation.graph)
        for name, column in simulation.graph.variables.items():
            if column.kind.is_pose:
                assert np.abs(integrated.variables[name].values - column.values).max() < 1e-9


def test_landmarks_hang_off_the_drifting_path():
    simulation = run(RICH, sensors=[{"kind": "xy", "range": 6}])
    factors = simulation.graph.factors[1]
    residual = factors.residual(simulation.graph.values)
    first = np.unique(factors.indices[:, 1], return_index=True)[1]
    assert np.abs(residual[first]).max() < 1e-8
    assert np.abs(residual).max() > 0.05


@pytest.mark.parametrize("world", ["square", "figure-eight", "sphere", "lawnmower"])
def test_integration_inverts_differences(world):
    simulation = run({"world": world, "poses": 300}, robot={"noise": 0}, decimals=None)
    truth = next(iter(simulation.truth.variables.values())).values
    path = np.asarray(integrate(truth[0], simulation.odometry.measurements))
    assert np.abs(path - truth).max() < 1e-10


def test_no_noise_is_written_with_a_finite_information():
    simulation = run({"world": "square", "poses": 41}, robot={"noise": 0}, closures={"by": "none"})
    assert np.allclose(simulation.graph.factors[0].information, 1e6 * np.eye(3))
    assert simulation.chi2_at_truth() < 1e-9


def test_information_is_the_inverse_of_the_covariance():
    covariance = [[0.004, 0.001, 0.0002], [0.001, 0.002, -0.0003], [0.0002, -0.0003, 0.0004]]
    simulation = run({"world": "square", "poses": 41}, robot={"noise": covariance})
    assert np.allclose(simulation.graph.factors[0].information[0] @ covariance, np.eye(3), atol=1e-9)


def test_spatial_rotations_are_stated_as_rotation_vectors():
    simulation = run({"world": "helix", "poses": 100}, robot={"noise": [0.1, 0.02]})
    # the residual has half the rotation vector: its deviation is 0.01
    assert np.allclose(np.diag(simulation.graph.factors[0].information[0]), [100.0] * 3 + [1e4] * 3)


def test_false_closures_are_labelled():
    simulation = run({"world": "manhattan"}, closures={"false": 0.1})
    (factors, *_), (wrong, *_) = simulation.graph.factors, simulation.outliers
    assert wrong.sum() == round(0.1 * (~simulation.closures.false).sum()) > 0
    chi2 = factors.chi2(simulation.truth.values)
    assert np.median(chi2[wrong]) > 1000.0
    assert chi2[~wrong].max() < 40.0
    assert (factors.indices[wrong, 1] - factors.indices[wrong, 0] >= 10).all()


def test_field_of_view_limits_closures_and_readings():
    content = {"world": "manhattan", "poses": 2000, "closures": {"probability": 1, "field_of_view": "90deg"}}
    simulation = run(
        content, landmarks={"density": 0.05}, sensors=[{"kind": "xy", "range": 5, "field_of_view": "90deg"}]
    )
    heading = simulation.truth.variables["SE2"].values[:, 2]
    turn = np.diff(heading[simulation.closures.pairs], axis=1)
    assert np.abs(np.sin(0.5 * turn)).max() < 1e-9  # on a lattice: none at all
    assert len(simulation.closures.pairs) > 100
    x, y = simulation.graph.factors[1].measurements.T
    assert np.mean(np.abs(np.arctan2(y, x)) <= np.pi / 4 + 0.1) > 0.99


def test_landmarks_seen_too_rarely_are_left_out_and_said():
    content = {"world": "circle", "poses": 100, "landmarks": {"count": 60}}
    simulation = run(content, sensors=[{"kind": "bearing", "range": 6, "detection": 0.1}])
    counts = np.bincount(simulation.graph.factors[1].indices[:, 1])
    assert counts.min() >= 2
    assert any(f"{60 - len(counts)} landmarks were not seen often enough" in note for note in simulation.notes)


def test_guesses():
    truth, none = run({"world": "square", "guess": "truth"}), run({"world": "square", "guess": "none"})
    assert (truth.graph.variables["SE2"].values == truth.truth.variables["SE2"].values).all()
    assert render(none.graph).data.count(b"VERTEX_SE2") == 1
    assert len(none.graph.factors[0]) == len(truth.graph.factors[0])


def test_wheel_ticks_are_whole():
    robot = {"model": "differential", "slip": 0.01, "ticks_per_metre": 100}
    controls = run({"world": "circle", "poses": 50}, robot=robot).odometry.controls
    assert np.allclose(controls * 100, np.round(controls * 100), atol=1e-6)


def test_the_log_is_the_graph_in_the_order_of_time():
    simulation = run(RICH | {"robot": {"model": "velocity", "period": 0.5}})
    blocks = {block.kind: block for block in log_blocks(simulation)}
    assert list(blocks) == ["velocity", "odometry", "closure", "xy", "range-bearing", "bearing", "range", "gps"]
    assert (blocks["odometry"].readings == simulation.odometry.measurements).all()
    assert blocks["odometry"].times[-1] == pytest.approx(0.5 * 199)
    assert set(blocks["xy"].others.tolist()) <= set(simulation.graph.variables["XY"].ids.tolist())
    assert blocks["gps"].others is None


def test_a_sweep_is_of_dead_reckoning_whatever_the_guess_is():
    content = {"world": "square", "poses": 41, "landmarks": {"density": 0.1}}
    measured, guessed = (
        drift_sweep(sweep_of(content | {"guess": guess}, "robot.noise=0.05", 2, "test")[1], lambda: None)
        for guess in ("odometry", "truth")
    )
    assert measured == guessed


def test_zero_slip_has_no_gap_and_the_gap_grows_with_slip():
    # lesson, row 0
    content = {"world": "square", "poses": 201, "robot": {"model": "differential"}, "decimals": None}
    content["landmarks"] = {"density": 0.02}
    content["sensors"] = [{"kind": "xy", "noise": 0}]
    _, values = sweep_of(content, "robot.slip=0,0.002,0.01,0.05", 20, "test")
    ticks = []
    points = drift_sweep(values, lambda: ticks.append(1))
    assert len(ticks) == 80
    assert points[0].gap_max < 1e-10 and points[0].landmark_rmse < 1e-10
    gaps, landmarks = [p.gap_mean for p in points], [p.landmark_rmse for p in points]
    assert gaps == sorted(gaps) and landmarks == sorted(landmarks)
    assert gaps[1] > 0.05
    # while errors are small they grow in proportion
    assert gaps[2] / gaps[1] == pytest.approx(5.0, rel=0.2)


def test_gap_of_the_guess_against_a_hand_worked_one():
    simulation = run({"world": "square", "poses": 41}, robot={"noise": 0}, decimals=None)
    measured = gap(of_graph(simulation.graph), of_graph(simulation.truth))
    assert measured.translation == pytest.approx(0.0, abs=1e-12)
    assert measured.closing_distance == pytest.approx(0.0, abs=1e-12)
    assert measured.path_length == pytest.approx(40.0)


def test_labels_are_of_the_edges_that_the_file_holds(tmp_path):
    toro, labels = str(tmp_path / "x.graph"), str(tmp_path / "l.csv")
    words = ["simulate", "square", "--poses", "41", "--set", "landmarks.count=5", "-o", toro, "--labels", labels, "-q"]
    assert main(words) == 0
    graph = slamcli.read(toro)
    assert len(read_labels(labels).edge) == graph.edges > 0

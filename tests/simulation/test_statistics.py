"""The noise that is drawn has the covariance that is stated: for every sensor and motion model, over 200 seeds."""

import numpy as np
import pytest

import slamcli
from slamcli.evaluation.consistency import chi2_band
from slamcli.geometry import se2
from slamcli.simulation.scenario import Sensor
from slamcli.simulation.sensing import _anywhere_in_view
from slamcli.simulation.settings import scenario_of
from slamcli.simulation.simulate import simulate

SEEDS = 200
PLANAR = {
    "world": "circle",
    "poses": 60,
    "closures": {"by": "place", "reach": 3, "probability": 0.5, "gap": 2},
    "landmarks": {"count": 20},
    "sensors": [{"kind": kind, "range": 5} for kind in ("xy", "bearing", "range", "range-bearing")] + [{"kind": "gps"}],
}
SPATIAL = {
    "world": "lawnmower",
    "poses": 60,
    "landmarks": {"count": 20},
    "sensors": [{"kind": "point", "range": 25}, {"kind": "gps", "noise": [0.5, 0.5, 1.0]}],
}
FULL_2D = [[0.004, 0.001, 0.0002], [0.001, 0.002, -0.0003], [0.0002, -0.0003, 0.0004]]
SCENARIOS = {
    "planar sensors": PLANAR,
    "spatial sensors": SPATIAL,
    "full covariance": PLANAR | {"robot": {"noise": FULL_2D}},
    "heavy tails": {**PLANAR, "robot": {"tails": 6}, "closures": {**PLANAR["closures"], "tails": 8}},
    "odometry model": PLANAR | {"robot": {"model": "odometry"}},
    "velocity model": PLANAR | {"robot": {"model": "velocity"}},
    "differential drive": PLANAR | {"robot": {"model": "differential", "slip": 0.005}},
}


def whitened(content):
    """Residuals at the truth over all seeds, by kind of factor, that should have the identity as covariance."""
    found = {}
    for seed in range(SEEDS):
        simulation = simulate(scenario_of({**content, "seed": seed}, "test"))
        for factors in simulation.graph.factors:
            error = factors.residual(simulation.truth.values)
            root = np.linalg.cholesky(factors.information)
            found.setdefault(factors.kind.name, []).append(np.matvec(root.transpose(0, 2, 1), error))
    return {name: np.concatenate(parts) for name, parts in found.items()}


@pytest.mark.parametrize("name", SCENARIOS)
def test_empirical_covariance_is_the_stated_one(name):
    content = SCENARIOS[name]
    for kind, error in whitened(content).items():
        count, size = error.shape
        mean = error.mean(axis=0)
        assert np.abs(mean).max() < 3.0 / np.sqrt(count), kind
        products = (error[:, :, None] * error[:, None, :]).reshape(count, -1)
        deviation = products.mean(axis=0) - np.eye(size).ravel()
        # the standard error of each entry, from the samples themselves: heavy tails have a larger one
        assert (np.abs(deviation) < 3.0 * products.std(axis=0) / np.sqrt(count)).all(), kind


def test_chi2_at_the_truth_has_the_mean_and_variance_of_a_chi_square():
    ratios = []
    for seed in range(SEEDS):
        simulation = simulate(scenario_of(PLANAR | {"seed": seed}, "test"))
        ratios.append(simulation.chi2_at_truth() / simulation.measured_dimensions())
        dimensions = simulation.measured_dimensions()
    ratios = np.array(ratios)
    sigma = np.sqrt(2.0 / dimensions)  # the number of readings varies by seed, but little
    assert abs(ratios.mean() - 1.0) < 3.0 * sigma / np.sqrt(SEEDS)
    assert 0.85 < ratios.std() / sigma < 1.15  # three standard errors of a standard deviation of 200 are 0.15


@pytest.mark.parametrize("world", ["manhattan", "figure-eight"])
def test_chi2_and_nees_after_optimization_lie_in_their_bands(world):
    runs, poses = 40, 40
    chi2 = nees = dof = 0.0
    for seed in range(runs):
        content = {"world": world, "poses": poses, "seed": seed, "robot": {"noise": [0.02, 0.005]}}
        simulation = simulate(scenario_of(content, "test"))
        result = slamcli.optimize(simulation.graph)
        assert result.status == "converged"
        chi2, dof = chi2 + result.final_chi2, dof + result.dof
        estimate, truth = result.graph.variables["SE2"].values, simulation.truth.variables["SE2"].values
        error = se2.local(truth[1:], estimate[1:]).ravel()
        nees += float(error @ information_matrix(result.graph) @ error)
    low, high = chi2_band(dof, 0.999)
    assert low < chi2 < high
    low, high = chi2_band(runs * 3 * (poses - 1), 0.999)
    assert low < nees < high


def information_matrix(graph):
    """J^T Omega J of all poses but the first, dense."""
    (column,) = graph.variables.values()
    size = 3 * len(column)
    total = np.zeros((size, size))
    for factors in graph.factors:
        _, jacobians = factors.linearize(graph.values)
        for k, rows in enumerate(factors.indices):
            wide = np.zeros((3, size))
            for row, jacobian in zip(rows, jacobians, strict=True):
                wide[:, 3 * row : 3 * row + 3] += jacobian[k]
            total += wide.T @ factors.information[k] @ wide
    return total[3:, 3:]


def test_systematic_turns_are_in_no_covariance():
    content = {"world": "circle", "poses": 200, "closures": {"by": "none"}, "robot": {"turn_bias": 0.02}}
    simulation = simulate(scenario_of(content, "test"))
    error = simulation.graph.factors[0].residual(simulation.truth.values)
    assert error[:, 2].mean() == pytest.approx(-0.02, abs=3 * 0.01 / np.sqrt(199))
    assert simulation.chi2_at_truth() > 1.5 * simulation.measured_dimensions()


def test_false_alarms_come_at_the_stated_rate():
    sensor = {"kind": "xy", "range": 6, "false_alarms": 0.5}
    content = {"world": "circle", "poses": 400, "landmarks": {"density": 0.1}, "sensors": [sensor]}
    simulation = simulate(scenario_of(content, "test"))
    false = simulation.outliers[1].sum()
    assert abs(false - 200) < 3 * np.sqrt(200)
    wrong = simulation.graph.factors[1].chi2(simulation.truth.values)[simulation.outliers[1]]
    assert np.median(wrong) > 100.0


def test_detection_probability():
    def seen(detection):
        sensor = {"kind": "xy", "range": 6, "detection": detection}
        content = {"world": "circle", "poses": 400, "landmarks": {"density": 0.1}, "sensors": [sensor]}
        return len(simulate(scenario_of(content, "test")).graph.factors[1])

    everything = seen(1.0)
    assert abs(seen(0.3) - 0.3 * everything) < 4 * np.sqrt(0.21 * everything)


@pytest.mark.parametrize(("space", "angle"), [(2, 7.0), (2, 0.5), (3, 7.0), (3, 2.0), (3, 1e-6)])
def test_clutter_is_uniform_in_the_view(space, angle):
    """The share of distances below half the range is 1/2^d; off the axis, areas grow as the angle or as 1 - cos."""
    sensor = Sensor(kind="xy" if space == 2 else "point", range=6.0, field_of_view=angle)
    points = np.asarray(_anywhere_in_view(space, sensor, 20_000, np.random.default_rng(3)))
    distance = np.sqrt(np.square(points).sum(axis=1))
    half = min(0.5 * angle, np.pi)
    off = np.arctan2(np.sqrt(np.square(points[:, 1:]).sum(axis=1)), points[:, 0])
    assert points.shape == (20_000, space)
    assert distance.max() <= 6.0
    assert off.max() <= half * (1.0 + 1e-9)
    assert (distance < 3.0).mean() == pytest.approx(0.5**space, abs=0.012)
    inner = 0.5 if space == 2 else (np.sin(0.25 * half) / np.sin(0.5 * half)) ** 2
    assert (off < 0.5 * half).mean() == pytest.approx(inner, abs=0.012)
    assert np.abs((points[:, 1:] > 0.0).mean(axis=0) - 0.5).max() < 0.012

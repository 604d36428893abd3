"""The scenarios of configs/ that stand in for the standard data sets: as large as those, and consistent."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support import dataset

import slamcli
from slamcli.simulation.settings import load_scenario, scenario_of
from slamcli.simulation.simulate import Simulation, simulate

CONFIGS = Path(__file__).parents[2] / "configs"
#: Poses and edges of the set that each one resembles, and its file where we have it.
SIZES = {
    "manhattan3500": (3500, 5453, "pose2d/M3500.g2o"),
    "city10000": (10000, 20687, "pose2d/city10000.g2o"),
    "sphere2500": (2500, 4949, "pose3d/sphere2500.g2o"),
    "torus3D": (5000, 9048, "pose3d/torus3D.g2o"),
    "grid3D": (8000, 22236, None),
}


@cache
def simulated(name: str) -> Simulation:
    path = str(CONFIGS / f"{name}.yaml")
    return simulate(scenario_of(load_scenario(path), path))


def test_every_scenario_is_tested() -> None:
    assert {path.stem for path in CONFIGS.glob("*.yaml")} == {*SIZES, "optimize"}


@pytest.mark.parametrize("name", SIZES)
def test_size(name: str) -> None:
    graph = simulated(name).graph
    assert (graph.poses, graph.edges, graph.landmarks) == (*SIZES[name][:2], 0)


@pytest.mark.datasets
@pytest.mark.parametrize("name", [name for name, size in SIZES.items() if size[2]])
def test_size_is_that_of_the_standard_set(name: str) -> None:
    poses, edges, path = SIZES[name]
    graph = slamcli.read(str(dataset(str(path))))
    assert (graph.poses, graph.edges) == (poses, edges)


@pytest.mark.parametrize("name", SIZES)
def test_noise_at_the_truth(name: str) -> None:
    simulation = simulated(name)
    dimensions = simulation.measured_dimensions()
    assert abs(simulation.chi2_at_truth() - dimensions) < 5.0 * np.sqrt(2.0 * dimensions)


@pytest.mark.parametrize("name", [name for name in SIZES if name != "grid3D"])  # whose factor takes half a minute
def test_optimum_is_consistent(name: str) -> None:
    """chi2 of the optimum over the degrees of freedom is 1, give or take five standard deviations."""
    result = slamcli.optimize(simulated(name).graph, init="spanning-tree")
    assert result.exit_code == 0
    assert abs(result.final_chi2 / result.dof - 1.0) < 5.0 * np.sqrt(2.0 / result.dof)

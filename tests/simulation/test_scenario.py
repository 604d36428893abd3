"""Configurations: what is refused, with which words; what the settings of the command line do."""

import pytest

from slamcli.errors import UsageError
from slamcli.simulation.scenario import Scenario
from slamcli.simulation.settings import assign, load_scenario, scenario_of, sweep_of
from slamcli.simulation.simulate import simulate

REFUSED = {
    "unknown world": ({"world": "manhatan"}, "did you mean manhattan"),
    "unknown key": ({"pose": 3}, "did you mean poses"),
    "unknown key of a section": ({"robot": {"slp": 3}}, "did you mean slip"),
    "unknown key of a sensor": ({"sensors": [{"knd": "xy"}]}, "did you mean kind"),
    "unknown key of the world": ({"path": {"blok": 3}}, "did you mean block"),
    "key of another world": ({"path": {"rooms": 3}}, "unknown key 'path.rooms'"),
    "a word for a number": ({"poses": "many"}, "poses"),
    "a fraction for a count": ({"poses": 2.5}, "whole number"),
    "one pose": ({"poses": 1}, "from 2 to"),
    "a negative length": ({"path": {"spacing": -1}}, "path.spacing must be positive"),
    "a spatial sensor in a plane": ({"sensors": [{"kind": "point"}]}, "in a planar world: xy"),
    "a planar sensor in space": ({"world": "grid", "sensors": [{"kind": "xy"}]}, "in a spatial world: point"),
    "a planar robot in space": ({"world": "grid", "robot": {"model": "velocity"}}, "robot.model"),
    "sensors that are no list": ({"sensors": {"kind": "xy"}}, "needs a list"),
    "a section that is a number": ({"robot": 3}, "robot needs options"),
    "tails too heavy": ({"robot": {"tails": 2}}, "more than 2"),
    "a probability above one": ({"closures": {"probability": 1.5}}, "from 0 to 1"),
    "detection below zero": ({"sensors": [{"detection": -0.1}]}, "sensors.0.detection must be from 0 to 1"),
    "a negative seed": ({"seed": -1}, "seed must be 0 or more"),
    "too few alphas": ({"robot": {"model": "odometry", "alphas": [1]}}, "are 4 numbers"),
    "an unknown unit": ({"robot": {"period": "3 parsec"}}, "parsec"),
    "a guess of its own": ({"guess": "wild"}, "guess cannot be 'wild'"),
}
REFUSED_LATER = {
    "too few deviations": ({"robot": {"noise": [1, 2, 3, 4]}}, "expected 3 standard deviations"),
    "a matrix that is not symmetric": ({"robot": {"noise": [[1, 1, 0], [0, 1, 0], [0, 0, 1]]}}, "symmetric"),
    "an indefinite matrix": ({"robot": {"noise": [[1, 2, 0], [2, 1, 0], [0, 0, 1]]}}, "semidefinite"),
    "noise that is a word": ({"robot": {"noise": "loud"}}, "robot.noise"),
    "a negative deviation": ({"sensors": [{"kind": "gps", "noise": [-1, 1]}]}, "sensors.0.noise"),
    "more closures than there are": ({"world": "circle", "closures": {"count": 9999}}, "only"),
    "topology of a plane": ({"closures": {"by": "topology"}}, "has no topology"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name):
    content, said = REFUSED[name]
    with pytest.raises(UsageError) as error:
        scenario_of(content, "x.yaml")
    assert said in "\n".join([error.value.message, *error.value.details])
    assert "x.yaml" in error.value.message


@pytest.mark.parametrize("name", REFUSED_LATER)
def test_refused_when_it_is_simulated(name):
    content, said = REFUSED_LATER[name]
    with pytest.raises(UsageError) as error:
        simulate(scenario_of(content, "x.yaml"))
    assert said in "\n".join([error.value.message, *error.value.details])


def test_defaults_need_no_file():
    assert scenario_of(load_scenario("manhattan"), "") == Scenario(world="manhattan")


def test_units():
    scenario = scenario_of({"sensors": [{"field_of_view": "180deg", "range": "50cm"}]}, "")
    assert scenario.sensors[0].field_of_view == pytest.approx(3.141592653589793)
    assert scenario.sensors[0].range == 0.5


def test_settings_reach_every_level():
    content = {}
    for setting in (
        "poses=50",
        "robot.slip=0.1",
        "closures.by=none",
        "sensors.0.kind=bearing",
        "sensors.1.kind=xy",
        "sensors.0.field-of-view=90deg",
        "path={half: 3}",
    ):
        assign(content, setting)
    scenario = scenario_of(content, "")
    assert (scenario.poses, scenario.robot.slip, scenario.closures.by) == (50, 0.1, "none")
    assert [sensor.kind for sensor in scenario.sensors] == ["bearing", "xy"]
    assert scenario.path == {"half": 3}


@pytest.mark.parametrize("setting", ["poses", "=3", "poses.x=3", "sensors.3.kind=xy", "robot=[", "sensors.x=1"])
def test_settings_that_are_none(setting):
    content = {"poses": 3, "sensors": [{"kind": "xy"}]}
    with pytest.raises(UsageError) as error:
        assign(content, setting)
    assert setting.split("=")[0] in error.value.message


def test_a_sweep_has_a_scenario_for_each_value_and_seed():
    key, values = sweep_of({"world": "square", "seed": 5}, "robot.slip=0, 0.1", 3, "")
    assert key == "robot.slip"
    assert [value for value, _ in values] == ["0", "0.1"]
    assert [(s.robot.slip, s.seed) for _, runs in values for s in runs] == [
        *((0.0, seed) for seed in (5, 6, 7)),
        *((0.1, seed) for seed in (5, 6, 7)),
    ]


@pytest.mark.parametrize("sweep", ["robot.slip", "=1", "robot.slip="])
def test_sweeps_that_are_none(sweep):
    with pytest.raises(UsageError, match="--sweep needs"):
        sweep_of({}, sweep, 1, "")


@pytest.mark.parametrize("text", ["[1, 2]", "world: [", "3", ""])
def test_files_that_are_no_configuration(tmp_path, text):
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=r"x\.yaml"):
        load_scenario(str(path))

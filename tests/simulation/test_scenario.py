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
    "a length without end": ({"path": {"half": float("inf")}}, "path.half must be a finite number"),
    "a length that is a list": ({"path": {"spacing": [1]}}, "path.spacing must be a finite number"),
    "half a lap": ({"world": "square", "path": {"laps": 0.5}}, "path.laps must be a whole number"),
    "more rooms than fit": ({"world": "corridor", "path": {"rooms": 10**9}}, "at most 1e+06"),
    "turning too often": ({"path": {"turning": 2}}, "path.turning must be positive and at most 1"),
    "two numbers for one": ({"robot": {"turn_bias": "1,2"}}, "robot.turn_bias must be one number"),
    "digits that no double has": ({"decimals": 400}, "decimals must be from 0 to 17"),
    "landmarks without end": ({"landmarks": {"count": 10**9}}, "landmarks.count must be from 0 to"),
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
    "noise without a square": ({"robot": {"noise": 1e200}}, "at most 1e+100"),
    "alphas without a square": ({"robot": {"model": "odometry", "alphas": [1e200] * 4}}, "beyond the range"),
    "landmarks everywhere": ({"landmarks": {"density": 1e9}}, "landmarks.density"),
    "false closures everywhere": ({"closures": {"false": 1e9, "gap": 2}}, "closures.false"),
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


@pytest.mark.parametrize(
    "setting", ["poses", "=3", "poses.x=3", "sensors.3.kind=xy", "robot=[", "sensors.x=1", "sensors.²=1"]
)
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


def test_numbers_of_a_path_may_have_units_and_exponents():
    written = scenario_of({"world": "sphere", "path": {"radius": "200cm", "per_ring": "1e1"}}, "x")
    assert written.path == {"radius": 2, "per_ring": 10}
    assert len(simulate(scenario_of({"world": "city", "poses": 20, "path": {"spacing": "1e-6"}}, "x")).truth.variables)


def test_a_sweep_refuses_a_seed_that_is_a_word():
    with pytest.raises(UsageError, match="seed"):
        sweep_of({"world": "square", "seed": "abc"}, "robot.slip=0,1", 2, "x")


def test_a_reach_beyond_the_world_closes_every_pair():
    closures = {"by": "place", "reach": 1e200, "gap": 2, "probability": 1, "per_pose": 30}
    simulation = simulate(scenario_of({"world": "circle", "poses": 12, "closures": closures}, "x"))
    assert len(simulation.closures.pairs) == 11 * 10 // 2

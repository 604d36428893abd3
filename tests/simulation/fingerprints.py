"""Hashes of small simulations that use everything there is: run as a program it prints them as JSON.

That is how a test compares this process with one of other instructions.
"""

import hashlib
import json
from typing import Any

import numpy as np

from slamcli.formats import render
from slamcli.simulation.record import log_blocks
from slamcli.simulation.scenario import MOTIONS, PLANAR_SENSORS, SPATIAL_SENSORS
from slamcli.simulation.settings import scenario_of
from slamcli.simulation.simulate import simulate
from slamcli.simulation.worlds import PLANAR, WORLDS

_CORRELATED = [[0.01, 0.002, 0.001], [0.002, 0.02, 0.003], [0.001, 0.003, 0.004]]


def scenarios() -> dict[str, dict[str, Any]]:
    """Every world, every model of a robot and every sensor; outliers, heavy tails and correlated noise as well."""
    out: dict[str, dict[str, Any]] = {}
    for world in WORLDS:
        kinds = PLANAR_SENSORS if world in PLANAR else SPATIAL_SENSORS
        sensors = [{"kind": kind, "range": 6, "false_alarms": 0.1, "field_of_view": 3} for kind in kinds]
        closures = {"false": 0.2, "field_of_view": 4, "probability": 0.5}
        out[world] = {
            "world": world,
            "poses": 150,
            "landmarks": {"count": 30},
            "sensors": sensors,
            "closures": closures,
            "seed": 5,
            "decimals": None,  # rounded numbers would hide a wrong last digit
        }
    for model in MOTIONS:
        robot = {"model": model, "slip": 0.05, "ticks_per_metre": 500, "turn_bias": 0.01, "tails": 4}
        out[model] = {**out["figure-eight"], "robot": robot}
    out["correlated"] = {**out["manhattan"], "robot": {"noise": _CORRELATED}}
    return out


def fingerprints() -> dict[str, str]:
    """SHA-256 of graph, truth and log of each scenario."""
    return {name: _fingerprint(content) for name, content in scenarios().items()}


def _fingerprint(content: dict[str, Any]) -> str:
    simulation = simulate(scenario_of(content, "test"))
    out = hashlib.sha256(render(simulation.graph).data + render(simulation.truth).data)
    for block in log_blocks(simulation):
        for array in (block.times, block.poses, block.others, block.readings, block.information):
            if array is not None:
                out.update(np.ascontiguousarray(array).tobytes())
    return out.hexdigest()


def vector_units() -> list[str]:
    """What numpy makes use of on this machine beyond what it was built for."""
    found: list[str] = np.show_config(mode="dicts").get("SIMD Extensions", {}).get("found", [])
    return found


if __name__ == "__main__":
    print(json.dumps({"vector_units": vector_units(), "fingerprints": fingerprints()}))

"""``slamcli simulate``: a world, a robot in it, and the graph it would record."""

from __future__ import annotations

import os
import sys
import time
from typing import Any

import click

from slamcli.cli.options import FILE, check_outputs, json_option, warn
from slamcli.cli.process import peak_memory
from slamcli.errors import UsageError

_EXAMPLES = """\b
Examples:
  slamcli simulate manhattan --poses 3500 -o graph.g2o --truth truth.g2o
  slamcli simulate square --set landmarks.density=0.02 -o - | slamcli optimize -
  slamcli simulate configs/torus3D.yaml --seed 7 -o torus.g2o --truth truth.tum
  slamcli simulate square --set robot.model=differential \\
      --sweep robot.slip=0,0.01,0.02,0.05 --runs 20

\b
Worlds: square, circle, figure-eight, corridor, manhattan, city, garage (planar);
sphere, torus, grid, helix, lawnmower (spatial). docs/simulation.md lists all keys.
Scenes for bundle adjustment: camera-ring, camera-flight (docs/bundle-adjustment.md).

\b
Exit codes: 0 simulated, 2 usage or configuration, 3 a file cannot be read or written.
"""


@click.command(name="simulate", epilog=_EXAMPLES)
@click.argument("source", metavar="SOURCE")
@click.option("-o", "--output", type=FILE, metavar="FILE", help="Write the graph (.g2o, .toro); - is standard output.")
@click.option("--truth", type=FILE, metavar="FILE", help="Write the truth: a graph of vertices, or .tum or .kitti.")
@click.option("--log", type=FILE, metavar="FILE", help="Write what the robot senses, in the order of time, as CSV.")
@click.option("--labels", type=FILE, metavar="FILE", help="Write which edges are outliers, as CSV.")
@click.option("--poses", type=int, metavar="N", help="Number of poses: --set poses=N.")
@click.option("--seed", type=int, metavar="N", help="Seed of all random numbers.  [default: the file's, or 0]")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Set any key of the configuration.")
@click.option("--sweep", metavar="KEY=V1,V2,...", help="Print the drift of dead reckoning for each value of a key.")
@click.option(
    "--runs", type=click.IntRange(min=1), default=10, show_default=True, help="Seeds for each value of --sweep."
)
@click.option("-q", "--quiet", is_flag=True, help="Print no summary; warnings and errors remain.")
@json_option
def command(source: str, **given: Any) -> int:
    """Simulate a robot in a world: a graph with noise of stated covariance, and the truth beside it.

    SOURCE is the name of a world or a YAML file. The same seed gives the same bytes on every machine. The
    information written is the inverse of the covariance that was drawn from.
    """
    started = time.perf_counter()
    from slamcli.simulation.camera_scenes import CAMERA_WORLDS
    from slamcli.simulation.worlds import WORLDS

    inputs = [] if source in WORLDS or source in CAMERA_WORLDS else [source]
    check_outputs(given, ("output", "truth", "log", "labels"), json=given["json"], inputs=inputs)
    _check_output(given["output"])
    content = _content(source, given)
    if content.get("world") in CAMERA_WORLDS:
        from slamcli.cli.camera_scene import simulate_scene

        return simulate_scene(_name(source), content, given)
    if given["sweep"]:
        return _sweep(source, content, given)
    from slamcli.evaluation.drift import gap
    from slamcli.graph.trajectory import of_graph
    from slamcli.reporting import documents
    from slamcli.reporting import simulation as reporting
    from slamcli.simulation.settings import scenario_of
    from slamcli.simulation.simulate import simulate

    simulation = simulate(scenario_of(content, _name(source)))
    times = {"simulate": time.perf_counter() - started}
    before = time.perf_counter()
    files = _write(simulation, given)
    if files:
        times["write"] = time.perf_counter() - before
    drift = gap(of_graph(simulation.graph), of_graph(simulation.truth))
    if given["json"]:
        print(documents.dumps(reporting.simulation_document(simulation, drift, files, times, peak_memory())))
    elif not given["quiet"]:
        out = sys.stderr if "-" in (given["output"], given["truth"], given["log"], given["labels"]) else sys.stdout
        shown = files or {"written": "nothing (-o FILE keeps the graph)"}
        print(*reporting.simulation_summary(simulation, drift, shown, times, peak_memory()), sep="\n", file=out)
    return 0


def _check_output(path: str | None) -> None:
    """The graph does not go into a file of another kind."""
    plain = (path or "").removesuffix(".gz")
    if plain.endswith((".tum", ".kitti", ".csv", ".yaml", ".yml", ".json", ".npz")):
        raise UsageError(
            f"--output {path}: the graph is written as g2o or TORO",
            ("  --truth writes trajectories (.tum, .kitti), --log and --labels write CSV",),
        )


def _content(source: str, given: dict[str, Any]) -> dict[str, Any]:
    """The configuration with what the command line sets."""
    from slamcli.simulation.settings import assign, load_scenario

    content = load_scenario(source)
    for name in ("poses", "seed"):
        if given[name] is not None:
            content[name] = given[name]
    for setting in given["settings"]:
        assign(content, setting)
    return content


def _write(simulation: Any, given: dict[str, Any]) -> dict[str, str]:
    """Write what was asked for; say what went where."""
    from dataclasses import replace
    from itertools import compress

    from slamcli.formats import DIALECTS, write
    from slamcli.formats.labels import labels_of, write_labels
    from slamcli.formats.recognize import of_ending
    from slamcli.formats.trajectories import form_of_ending, write_trajectory
    from slamcli.simulation.record import comment, log_blocks, true_trajectory

    said = comment(simulation.scenario)
    graph, outliers = simulation.graph, simulation.outliers
    if given["output"]:
        dialect = of_ending(given["output"])
        warn(write(graph, given["output"], dialect=dialect, comments=[said]))
        kept = [DIALECTS[dialect or "g2o"].edge_tag(factors.kind) is not None for factors in graph.factors]
        graph = replace(graph, factors=list(compress(graph.factors, kept)))
        outliers = list(compress(outliers, kept))
    if given["truth"]:
        if form_of_ending(given["truth"]):
            write_trajectory(true_trajectory(simulation), given["truth"])
        else:
            write(simulation.truth, given["truth"], dialect=of_ending(given["truth"]), comments=[f"truth of {said}"])
    if given["log"]:
        from slamcli.formats.log import write_log

        write_log(log_blocks(simulation), given["log"], [said])
    if given["labels"]:
        labels, tags = labels_of(graph, outliers)  # of the edges that are in the file
        write_labels(given["labels"], labels, tags)
    return {name: given[name] for name in ("output", "truth", "log", "labels") if given[name]}


def _sweep(source: str, content: dict[str, Any], given: dict[str, Any]) -> int:
    """Print the drift for each value of a key."""
    from slamcli.cli.process import progress
    from slamcli.evaluation.drift_sweep import drift_sweep
    from slamcli.reporting import documents
    from slamcli.reporting import simulation as reporting
    from slamcli.simulation.settings import scenario_of, sweep_of

    if given["output"] or given["truth"] or given["log"] or given["labels"]:
        raise UsageError("--sweep prints a table and writes no file", ("  leave out -o, --truth, --log and --labels",))
    key, values = sweep_of(content, given["sweep"], given["runs"], _name(source))
    base = scenario_of(content, _name(source))
    with progress("simulating", len(values) * given["runs"]) as tick:
        points = drift_sweep(values, tick)
    if given["json"]:
        print(documents.dumps(reporting.drift_document(key, base, points)))
    else:
        print(*reporting.drift_table(key, points), sep="\n")
    return 0


def _name(source: str) -> str:
    return source if os.path.exists(source) else f"simulate {source}"

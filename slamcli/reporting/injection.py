"""What ``slamcli inject`` says: the summary and the JSON document."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from slamcli.graph import FactorGraph, Topology
from slamcli.reporting.documents import head, input_section
from slamcli.reporting.text import plural, table
from slamcli.simulation.injection import Injected, InjectOptions, Operation

_NOUNS = {
    "false_closures": "false closures",
    "false_observations": "false observations",
    "corrupt_odometry": "corrupted odometry",
    "drop_closures": "dropped closures",
    "scale_information": "scaled information",
    "perturb": "perturbed guess",
}


def inject_summary(
    source: FactorGraph, injected: Injected, options: InjectOptions, output: str, labels: str | None
) -> list[str]:
    """What ``slamcli inject`` prints at the end."""
    graph = injected.graph
    rows = [("graph", f"{source.space}-D, {plural(source.poses, 'pose')}, {plural(source.edges, 'edge')}")]
    rows += [(_NOUNS[operation.name], _told(operation)) for operation in injected.operations]
    if injected.reference is not None:
        rows.append(("reference", injected.reference.source))
    rows += [
        ("seed", str(options.seed)),
        ("outliers", f"{injected.outlier_count} of {plural(graph.edges, 'edge')}"),
        ("written", "standard output" if output == "-" else output),
        ("labels", {"-": "standard output", None: "nowhere (--labels FILE keeps them)"}.get(labels, str(labels))),
    ]
    return table(rows, "<<")


def inject_document(
    source: FactorGraph,
    topology: Topology,
    injected: Injected,
    options: InjectOptions,
    output: str,
    labels: str | None,
) -> dict[str, Any]:
    """The document of ``slamcli inject --json``."""
    reference = injected.reference
    return {
        **head("inject"),
        "input": input_section(source, topology.loop_closure_count, topology.component_count),
        "seed": options.seed,
        "operations": [asdict(operation) for operation in injected.operations],
        "reference": None if reference is None else {"source": reference.source, "doubtful": reference.doubtful},
        "edges": injected.graph.edges,
        "outliers": injected.outlier_count,
        "output": output,
        "labels": labels,
    }


def inject_warnings(injected: Injected) -> list[str]:
    """What may not be as expected: for standard error."""
    reference, out = injected.reference, []
    if reference is not None and reference.doubtful:
        out.append(
            f"the reference ({reference.source}) contradicts the graph's own edges, so a false edge may be true by "
            "chance: --truth FILE gives a better one"
        )
    if any(operation.name == "perturb" and operation.count == 0 for operation in injected.operations):
        out.append("nothing is perturbed: no variable has an estimate that may move")
    return out


def _told(operation: Operation) -> str:
    """One operation in words."""
    details = operation.details
    if operation.name == "false_closures":
        sizes = details.get("group_size")
        runs = f" in {plural(int(str(details['runs'])), 'run')}" if sizes else ""
        return f"{operation.count}{runs}, policy {details['policy']}; {operation.of} are true"
    if operation.name == "corrupt_odometry":
        return f"{operation.count} of {plural(operation.of, 'edge')}, magnitude {details['magnitude']:g}"
    if operation.name == "scale_information":
        return f"of {plural(operation.count, 'edge')} ({details['edges']}), times {details['factor']:g}"
    if operation.name == "perturb":
        sigma = f"{details['translation_sigma']:g} m and {details['rotation_sigma']:g} rad"
        return f"{operation.count} of {plural(operation.of, 'variable')}, standard deviations {sigma}"
    return f"{operation.count} of {operation.of}"

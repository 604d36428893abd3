"""The factor graph as text: Graphviz's dot language, the summary, the steps of an elimination, the JSON document."""

from __future__ import annotations

from collections import Counter
from typing import Any

from slamcli.graph import FactorGraph, Topology
from slamcli.graph.bipartite import MARGINAL, Bipartite, Factor, Step, Variable
from slamcli.reporting.documents import head, input_section
from slamcli.reporting.text import plural, table

#: Fill colours of factors by role: those of the figures (Okabe and Ito).
_FILL = {
    "odometry": "#1A1A1A",
    "loop closure": "#0072B2",
    "observation": "#009E73",
    "prior": "#E69F00",
    "marginal": "#D55E00",
}


def dot(graph: Bipartite, name: str = "factor_graph", step: Step | None = None) -> str:
    """A graph in Graphviz's language: circles are variables, squares factors.

    With a step, its variable is drawn dashed and its fill-in as dashed edges.
    """
    lines = [f"graph {name} {{", "  layout=neato; overlap=false; splines=true;"]
    lines.append('  node [fontname="Helvetica", fontsize=10];')
    variables = list(graph.variables.values())
    lines += [_variable(variable, "") for variable in variables]
    if step is not None:
        lines.append(_variable(step.variable, ", style=dashed, color=gray, fontcolor=gray"))
    for number, factor in enumerate(graph.factors):
        lines.append(
            f'  f{number} [shape=square, style=filled, fillcolor="{_FILL[factor.role]}", label="", width=0.12, '
            f'tooltip="{_tooltip(factor, graph)}"];'
        )
        lines += [f"  f{number} -- v{key};" for key in dict.fromkeys(factor.variables)]
    if step is not None:
        lines += [f'  v{a.key} -- v{b.key} [style=dashed, color="{_FILL[MARGINAL]}"];' for a, b in step.fill_in]
    return "\n".join([*lines, "}", ""])


def dot_steps(start: Bipartite, steps: list[Step]) -> str:
    """One graph for the start and one for each step, one after the other in a file."""
    parts = [dot(start, "start")]
    parts += [dot(step.graph, f"step_{k}", step) for k, step in enumerate(steps, 1)]
    return "\n".join(parts)


def _variable(variable: Variable, more: str) -> str:
    peripheries = ", peripheries=2" if variable.fixed else ""
    return f'  v{variable.key} [shape=circle, label="{variable.label}"{peripheries}{more}];'


def _tooltip(factor: Factor, graph: Bipartite) -> str:
    names = " ".join(graph.variables[key].label for key in factor.variables)
    return f"{factor.role} {names}"


def step_lines(steps: list[Step]) -> list[str]:
    """A table of the steps of an elimination."""
    rows = [("step", "goes", "factors absorbed", "new factor on", "fill-in")]
    for number, step in enumerate(steps, 1):
        names = " ".join(variable.label for variable in step.separator)
        fill = " ".join(f"{a.label}-{b.label}" for a, b in step.fill_in)
        rows.append((str(number), step.variable.label, str(len(step.absorbed)), names or "-", fill or "-"))
    total = sum(len(step.fill_in) for step in steps)
    return ["", *table(rows, "><><<"), "", f"fill-in: {plural(total, 'pair')} in all"]


def graph_summary(
    source: FactorGraph, drawn: Bipartite, variant: str, cut: int, written: list[str], layout: str
) -> list[str]:
    """What ``slamcli graph`` prints at the end."""
    rows = [
        ("graph", f"{source.space}-D, {_count_variables(source)}, {plural(source.edges, 'factor')}"),
        ("variant", {"full": "full: all poses", "online": "online: past poses eliminated"}[variant]),
        ("drawn", f"{_drawn_variables(drawn)}, {plural(len(drawn.factors), 'factor')}: {_roles(drawn)}"),
    ]
    if cut:
        rows.append(("left out", f"{plural(cut, 'factor')} to variables outside the choice"))
    rows += [("layout", layout), ("written", ", ".join(written) or "nothing (--dot FILE or --svg FILE draws it)")]
    return table(rows, "<<")


def graph_document(
    source: FactorGraph, topology: Topology, drawn: Bipartite, variant: str, cut: int, steps: list[Step]
) -> dict[str, Any]:
    """The document of ``slamcli graph --json``."""
    return {
        **head("graph"),
        "input": input_section(source, topology.loop_closure_count, topology.component_count),
        "variant": variant,
        "variables": [
            {"id": v.id, "kind": v.kind, "fixed": v.fixed, "position": list(drawn.positions.get(v.key, ())) or None}
            for v in drawn.variables.values()
        ],
        "factors": [
            {"role": f.role, "tag": f.tag or None, "ids": [drawn.variables[key].id for key in f.variables]}
            for f in drawn.factors
        ],
        "left_out": cut,
        "steps": [
            {
                "id": step.variable.id,
                "separator": [variable.id for variable in step.separator],
                "absorbed": len(step.absorbed),
                "fill_in": [[a.id, b.id] for a, b in step.fill_in],
            }
            for step in steps
        ],
    }


def _count_variables(source: FactorGraph) -> str:
    parts = [plural(source.poses, "pose")] + ([plural(source.landmarks, "landmark")] if source.landmarks else [])
    return ", ".join(parts)


def _drawn_variables(drawn: Bipartite) -> str:
    poses = sum(variable.is_pose for variable in drawn.variables.values())
    switches = sum(variable.is_switch for variable in drawn.variables.values())
    landmarks = len(drawn.variables) - poses - switches
    parts = [plural(poses, "pose")] + ([plural(landmarks, "landmark")] if landmarks else [])
    return ", ".join(parts + ([plural(switches, "switch")] if switches == 1 else [f"{switches} switches"][:switches]))


def _roles(drawn: Bipartite) -> str:
    counts = Counter(factor.role for factor in drawn.factors)
    return ", ".join(f"{number} {role}" for role, number in counts.items()) or "none"

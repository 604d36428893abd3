"""Pictures and dot files of factor graphs."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from support import BUNDLED, write_file

from slamcli.formats import read
from slamcli.graph.bipartite import bipartite, eliminate_all, online, spring_layout
from slamcli.reporting import graph_dot
from slamcli.reporting.plots import factor_graph, style
from slamcli.reporting.plots.files import render

SMALL = (
    "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_SE2 2 2 0 0\nVERTEX_XY 7 1 1\n"
    "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\nEDGE_SE2 0 2 2 0 0 1 0 0 1 0 1\n"
    "EDGE_SE2_XY 0 7 1 1 1 0 1\nEDGE_PRIOR_SE2 0 0 0 0 1 0 0 1 0 1\n"
)


def test_dot_has_a_node_for_each_variable_and_factor(tmp_path: Path) -> None:
    graph, _ = bipartite(read(str(write_file(tmp_path, SMALL))))
    text = graph_dot.dot(graph)
    assert text.startswith("graph factor_graph {") and text.endswith("}\n")
    assert len(re.findall("shape=circle", text)) == 4
    assert len(re.findall("shape=square", text)) == 5
    assert len(re.findall(" -- ", text)) == 9
    assert 'label="l7"' in text


def test_dot_of_steps_is_one_graph_for_each(tmp_path: Path) -> None:
    graph, _ = bipartite(read(str(write_file(tmp_path, SMALL))))
    text = graph_dot.dot_steps(graph, eliminate_all(graph, [0, 1]))
    assert re.findall(r"^graph (\w+) \{", text, re.MULTILINE) == ["start", "step_1", "step_2"]
    assert text.count("{") == text.count("}") == 3
    assert text.count("style=dashed, color=gray") == 2


def test_steps_as_text(tmp_path: Path) -> None:
    graph, _ = bipartite(read(str(write_file(tmp_path, SMALL))))
    lines = graph_dot.step_lines(eliminate_all(graph, [0, 1, 2, 3]))
    assert lines[2].split() == ["1", "x0", "4", "x1", "x2", "l7", "x1-l7", "x2-l7"]
    assert lines[-1] == "fill-in: 2 pairs in all"


@pytest.mark.parametrize("what", ["full", "online", "steps", "one"])
def test_pictures_are_well_formed_and_reproducible(what: str, tmp_path: Path) -> None:
    graph, _ = bipartite(read(str(write_file(tmp_path, SMALL if what != "one" else "VERTEX_SE2 0 0 0 0\n"))))
    drawn = []
    for _ in range(2):
        with style.house_style():
            if what == "steps":
                steps = eliminate_all(graph, [0, 3, 1, 2])
                figure = factor_graph.draw_steps(graph, steps, spring_layout(graph), "a_b", "$x")
            else:
                shown = online(graph) if what == "online" else graph
                figure = factor_graph.draw(shown, {k: graph.positions[k] for k in shown.variables}, "t", "s", True)
            drawn.append(render(figure, "svg", 100)[0])
    assert drawn[0] == drawn[1]
    ElementTree.fromstring(drawn[0])


def test_squares_do_not_hide_each_other() -> None:
    """Parallel edges, closures along the odometry, several priors on one pose."""
    graph, _ = bipartite(read(str(BUNDLED / "square_toro.graph")))
    graph.factors.extend([graph.factors[0], graph.factors[0]])
    at = {key: factor_graph.np.array(place) for key, place in spring_layout(graph).items()}
    places = [place for _, _, place in factor_graph._factor_places(graph, at, 0.05)]
    gaps = [float(factor_graph.np.hypot(*(a - b))) for k, a in enumerate(places) for b in places[:k]]
    assert min(gaps) > 0.02


def test_names_can_be_read_and_places_have_a_size(tmp_path: Path) -> None:
    """Ids of 19 digits stand beside their circles; a single pose has a metre around it."""
    text = SMALL.replace(" 7 ", " 9223372036854775807 ")
    for content in (text, "VERTEX_SE2 0 3 4 0\n"):
        graph, _ = bipartite(read(str(write_file(tmp_path, content))))
        with style.house_style():
            figure = factor_graph.draw(graph, graph.positions, "t", "s", True)
        axes = figure.axes[0]
        assert {text.get_text() for text in axes.texts} >= {v.label for v in graph.variables.values()}
        assert min(text.get_fontsize() for text in axes.texts) >= 5.5
        assert axes.get_xlim()[1] - axes.get_xlim()[0] > 1.0

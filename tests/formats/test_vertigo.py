"""Vertigo's records: switches, their priors and switchable edges, read and written; mixtures are counted."""

from pathlib import Path

import numpy as np
import pytest
from support import BUNDLED, write_file

import slamcli
from slamcli import models
from slamcli.errors import InputError
from slamcli.formats import render
from slamcli.formats.labels import labels_of, outlier_masks, read_labels, write_labels
from slamcli.graph import is_loop_closure
from slamcli.reporting.summaries import reading_warnings
from slamcli.solver.robust import switchable

PLANAR = """\
# a triangle with one false closure
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 1 1 1.5
VERTEX_SWITCH 3 1
VERTEX_SWITCH 4 0.5
EDGE_SE2 0 1 1 0 0 10 0 0 10 0 10
EDGE_SE2 1 2 0 1 1.5 10 0 0 10 0 10
EDGE_SE2_SWITCHABLE 0 2 3 1 1 1.5 10 0 0 10 0 10
EDGE_SWITCH_PRIOR 3 1.0 1.0
EDGE_SE2_SWITCHABLE 0 2 4 5 5 0 10 0 0 10 0 10
EDGE_SWITCH_PRIOR 4 1.0 1.0
"""


def test_switches_and_their_edges_are_read(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, PLANAR)))
    assert graph.switches == 2
    assert graph.landmarks == 0
    by_tag = {factors.tag: factors for factors in graph.factors}
    edges = by_tag["EDGE_SE2_SWITCHABLE"]
    assert edges.kind is models.SWITCHABLE_RELATIVE_POSE_2D
    assert edges.variable_ids(graph.variables).tolist() == [[0, 2, 3], [0, 2, 4]]
    assert is_loop_closure(graph, edges).all()
    # half of (-4, -4, 1.5) at weight 10, and the prior of the second switch
    assert edges.chi2(graph.values) == pytest.approx([0.0, 0.25 * 10.0 * (16.0 + 16.0 + 2.25)])
    assert by_tag["EDGE_SWITCH_PRIOR"].chi2(graph.values) == pytest.approx([0.0, 0.25])


def test_a_switch_without_a_record_is_one(tmp_path: Path) -> None:
    text = "".join(line + "\n" for line in PLANAR.splitlines() if not line.startswith("VERTEX_SWITCH 4"))
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert graph.report is not None
    assert graph.report.created == {"SWITCH": [4]}
    assert graph.values["SWITCH"][:, 0].tolist() == [1.0, 1.0]
    found = slamcli.optimize(graph, init="file")
    assert found.final_chi2 == pytest.approx(slamcli.optimize(graph, init="odometry").final_chi2, rel=1e-6)


def test_what_has_not_changed_is_written_as_it_was(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, PLANAR)))
    assert render(graph).data == PLANAR.encode()
    found = slamcli.optimize(graph).graph
    written = render(found).data.decode()
    again = slamcli.read(str(write_file(tmp_path, written)))
    for name, values in found.values.items():
        np.testing.assert_array_equal(again.values[name], values)
    assert [line for line in written.splitlines() if line.startswith(("EDGE", "#"))] == [
        line for line in PLANAR.splitlines() if line.startswith(("EDGE", "#"))
    ]
    assert again.values["SWITCH"][0, 0] > 0.99
    assert again.values["SWITCH"][1, 0] < 0.01


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o"])
def test_a_graph_given_switches_is_a_file_for_vertigo(tmp_path: Path, name: str) -> None:
    source = slamcli.read(str(BUNDLED / name))
    closing = [is_loop_closure(source, factors) for factors in source.factors]
    made = switchable.with_switches(source, closing)
    text = render(made).data
    again = slamcli.read(str(write_file(tmp_path, text)))
    assert again.report is not None
    count = int(sum(mask.sum() for mask in closing))
    tag = "EDGE_SE2_SWITCHABLE" if source.space == 2 else "EDGE_SE3_SWITCHABLE"
    assert {again.report.by_tag[t] for t in ("VERTEX_SWITCH", "EDGE_SWITCH_PRIOR", tag)} == {count}
    assert again.chi2() == pytest.approx(made.chi2(), rel=1e-12)
    assert again.edges == source.edges + count


def test_mixtures_are_counted_and_explained(tmp_path: Path) -> None:
    text = PLANAR + "EDGE_SE2_MAXMIX 0 2 1e-9 1 1 1.5 10 0 0 10 0 10\n" * 2
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert graph.report is not None
    assert graph.report.skipped == {"EDGE_SE2_MAXMIX": 2}
    assert any("2 EDGE_SE2_MAXMIX records skipped: mixtures" in line for line in reading_warnings(graph.report))
    assert render(graph).data == text.encode()


def test_the_edges_that_vertigo_writes_without_a_quaternion_are_refused(tmp_path: Path) -> None:
    triangle = " ".join("100000100001000100101"[k] for k in range(21))
    path = write_file(tmp_path, f"EDGE_SE3_SWITCHABLE 0 1 2 1 0 0 {triangle}\n")
    with pytest.raises(InputError, match="expects 31 numbers, found 27"):
        slamcli.read(str(path))


def test_a_switch_is_no_pose(tmp_path: Path) -> None:
    text = PLANAR.replace("EDGE_SE2_SWITCHABLE 0 2 4", "EDGE_SE2_SWITCHABLE 0 2 1")
    with pytest.raises(InputError, match="needs a SWITCH vertex, but 1 is of another kind"):
        slamcli.read(str(write_file(tmp_path, text)))


def test_labels_name_a_switchable_edge_by_its_poses(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, PLANAR)))
    false = [np.zeros(len(factors), dtype=bool) for factors in graph.factors]
    column = next(k for k, factors in enumerate(graph.factors) if factors.tag == "EDGE_SE2_SWITCHABLE")
    false[column][1] = True
    labels, tags = labels_of(graph, false)
    path = str(tmp_path / "labels.csv")
    write_labels(path, labels, tags)
    assert "5,EDGE_SE2_SWITCHABLE,0,2,outlier" in Path(path).read_text()
    for mask, expected in zip(outlier_masks(read_labels(path), graph), false, strict=True):
        np.testing.assert_array_equal(mask, expected)

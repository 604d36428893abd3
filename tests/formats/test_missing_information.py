"""Edges without information matrices: the identity where no record of a tag has one, an error where some have."""

from pathlib import Path

import numpy as np
import pytest
from support import write_file

import slamcli
from slamcli.errors import InputError
from slamcli.formats.writer import render

POSES = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_SE2 2 2 0 0\n"


def test_a_tag_without_any_information_has_the_identity(tmp_path: Path) -> None:
    text = POSES + "EDGE_SE2 0 1 1 0 0\nEDGE_SE2 1 2 1 0 0\nEDGE_SE2_XY 0 9 2 1 4 0 4\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert graph.report is not None
    assert graph.report.notes == ["2 EDGE_SE2 records have no information: the identity is used"]
    weights = {factors.tag: factors.information for factors in graph.factors}
    assert np.array_equal(weights["EDGE_SE2"], np.tile(np.eye(3), (2, 1, 1)))
    assert np.array_equal(weights["EDGE_SE2_XY"], [4.0 * np.eye(2)])
    assert render(graph).data.decode() == text  # nothing is added to records that do not change


@pytest.mark.parametrize("last", ["EDGE_SE2 1 2 1 0 0", "EDGE_SE2 1 2 1 0 0 1 0"])
def test_a_record_that_is_cut_off_is_an_error(last: str, tmp_path: Path) -> None:
    """A file that ends in the middle of a record says less than it seems to."""
    text = POSES + f"EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n{last}\n"
    with pytest.raises(InputError, match=r":5:\d+: EDGE_SE2 expects 11 numbers"):
        slamcli.read(str(write_file(tmp_path, text)))
    assert slamcli.read(str(write_file(tmp_path, text)), lenient=True).edges == 1


def test_the_hint_says_what_is_missing(tmp_path: Path) -> None:
    text = POSES + "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 0\n"
    with pytest.raises(InputError) as caught:
        slamcli.read(str(write_file(tmp_path, text)))
    assert any("the information matrix is missing here and not in all records" in line for line in caught.value.details)

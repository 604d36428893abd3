"""Files of covariances: what is written reads back, and what is not meant for slamcli is refused."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from slamcli.errors import InputError, UsageError
from slamcli.formats.covariance_files import (
    CovarianceTable,
    ending_of,
    require_one_size,
    write_archive,
    write_csv,
)
from slamcli.formats.covariances import read_all_covariances, read_covariances

FACTS = {"frame": "local", "convention": "slamcli", "gauge": "lowest id held: 0, and so on"}


def table(kind: str, tangent: tuple[str, ...], ids: list[int], seed: int = 0) -> CovarianceTable:
    root = np.random.default_rng(seed).standard_normal((len(ids), len(tangent), len(tangent)))
    return CovarianceTable(kind, tangent, np.array(ids), root @ root.transpose(0, 2, 1))


POSES = table("SE2", ("x", "y", "theta"), [7, 3, -2])
POINTS = table("XY", ("x", "y"), [100, 101])


def test_an_archive_reads_back(tmp_path: Path) -> None:
    """Poses come first, for those who read one kind; the rest is for numpy."""
    path = str(tmp_path / "both.npz")
    write_archive(path, [POSES, POINTS], FACTS, {"joint_ids": np.array([3, 100])})
    poses, points = read_all_covariances(path)
    for found, wanted in ((poses, POSES), (points, POINTS), (read_covariances(path), POSES)):
        np.testing.assert_array_equal(found.ids, wanted.ids)
        np.testing.assert_array_equal(found.covariance, wanted.covariance)
    with np.load(path) as archive:
        assert archive["kinds"].tolist() == ["SE2", "XY"]
        assert archive["tangent"].tolist() == ["x", "y", "theta"] and archive["XY_tangent"].tolist() == ["x", "y"]
        assert str(archive["gauge"]) == FACTS["gauge"] and archive["joint_ids"].tolist() == [3, 100]


@pytest.mark.parametrize("name", ["poses.csv", "poses.csv.gz"])
def test_csv_reads_back(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    write_csv(str(path), POSES, FACTS)
    found = read_covariances(str(path))
    np.testing.assert_array_equal(found.ids, POSES.ids)
    np.testing.assert_array_equal(found.covariance, POSES.covariance)
    raw = path.read_bytes()
    lines = (gzip.decompress(raw) if name.endswith(".gz") else raw).decode().splitlines()
    assert lines[:3] == [f"# {key}: {value}" for key, value in FACTS.items()]
    assert lines[3] == "id,x_x,x_y,x_theta,y_y,y_theta,theta_theta"


def test_json_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "both.json"
    marginals = [{"ids": t.ids.tolist(), "covariance": t.covariance.tolist()} for t in (POSES, POINTS)]
    path.write_text(json.dumps({"convention": "slamcli", "marginals": marginals}))
    poses, points = read_all_covariances(str(path))
    np.testing.assert_array_equal(poses.covariance, POSES.covariance)
    np.testing.assert_array_equal(points.ids, POINTS.ids)


def test_another_convention_is_refused(tmp_path: Path) -> None:
    """A covariance in another tangent space has the right shape and the wrong meaning."""
    facts = FACTS | {"convention": "gtsam"}
    paths = [str(tmp_path / name) for name in ("a.npz", "a.csv", "a.json")]
    write_archive(paths[0], [POSES], facts, {})
    write_csv(paths[1], POSES, facts)
    marginals = [{"ids": POSES.ids.tolist(), "covariance": POSES.covariance.tolist()}]
    Path(paths[2]).write_text(json.dumps({"convention": "gtsam", "marginals": marginals}))
    for path in paths:
        with pytest.raises(InputError, match="in the convention of gtsam, expected slamcli"):
            read_covariances(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"marginals": []}', "has no marginals"),
        ('{"command": "info"}', "has no marginals"),
        ("{not json", "has no marginals"),
        ('{"marginals": [{"ids": [1], "covariance": [["a"]]}]}', "lists of numbers"),
        ('{"marginals": [{"ids": [1.5], "covariance": [[[1, 0], [0, 1]]]}]}', "whole numbers"),
        ('{"marginals": [{"ids": [1, 2], "covariance": [[[1, 0], [0, 1]]]}]}', "covariance must be"),
        ('{"marginals": [{"ids": [1, 1], "covariance": [[[1, 0], [0, 1]], [[1, 0], [0, 1]]]}]}', "twice"),
        ('{"marginals": [{"ids": [1], "covariance": [[[1, 2], [0, 1]]]}]}', "not symmetric"),
    ],
)
def test_json_that_is_something_else(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_covariances(str(path))


def test_an_archive_that_lacks_a_kind(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, ids=POSES.ids, covariance=POSES.covariance, frame=np.array("local"), kinds=np.array(["SE2", "XY"]))
    with pytest.raises(InputError, match="lacks XY_ids and XY_covariance"):
        read_covariances(str(path))


def test_names_of_files() -> None:
    wanted = {
        "a.npz": ".npz",
        "a.csv": ".csv",
        "a.csv.gz": ".csv",
        "a.json": ".json",
        "a.json.gz": ".json",
        "-": ".csv",
    }
    assert {name: ending_of(name) for name in wanted} == wanted
    for name in ("a", "a.txt", "a.npz.gz", "a.g2o"):
        with pytest.raises(UsageError, match="npz, csv or json"):
            ending_of(name)
    require_one_size("a.npz", {"SE2": 3, "XY": 2})
    require_one_size("a.csv", {"SE2": 3})
    with pytest.raises(UsageError, match=r"SE2 \(3 x 3\) and XY \(2 x 2\)"):
        require_one_size("-", {"SE2": 3, "XY": 2})

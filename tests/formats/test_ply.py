"""PLY files: header, places, colours, where the pyramids open."""

from pathlib import Path

import numpy as np
import pytest
from bundle_scenes import ring
from numpy.testing import assert_allclose
from support import BUNDLED, write_file

import slamcli
from slamcli.errors import InputError
from slamcli.formats import ply
from slamcli.graph import FactorGraph
from slamcli.models.base import Array


def parts(data: bytes) -> tuple[list[str], Array, Array, Array]:
    """Header, places, colours and faces of a file, read on its own."""
    head, body = data.split(b"end_header\n", 1)
    header = head.decode().splitlines()
    counts = [int(line.split()[-1]) for line in header if line.startswith("element")]
    vertex = np.dtype([("place", "<f4", 3), ("colour", "u1", 3)])
    face = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
    assert len(body) == counts[0] * vertex.itemsize + counts[1] * face.itemsize
    vertices = np.frombuffer(body, vertex, counts[0])
    faces = np.frombuffer(body, face, counts[1], offset=counts[0] * vertex.itemsize)
    assert (faces["count"] == 3).all()
    return header, vertices["place"], vertices["colour"], faces["corners"]


def test_a_scene() -> None:
    scene = ring(cameras=5, points=20)
    header, places, colours, faces = parts(ply.render(scene))
    assert header[:2] == ["ply", "format binary_little_endian 1.0"]
    assert (len(places), len(faces)) == (20 + 5 * 5, 5 * 6)
    assert_allclose(places[:20], scene.values["XYZ"], atol=1e-5)
    pyramids = places[20:].reshape(5, 5, 3)
    assert_allclose(pyramids[:, 0], scene.values["CAMERA"][:, :3], atol=1e-5)
    opens = pyramids[:, 1:].mean(axis=1) - pyramids[:, 0]  # the cameras look at the origin
    towards = -scene.values["CAMERA"][:, :3]
    cosine = np.vecdot(opens, towards) / np.linalg.norm(opens, axis=1) / np.linalg.norm(towards, axis=1)
    assert_allclose(cosine, 1.0, atol=1e-5)
    assert faces.min() == 20
    assert faces.max() == 44
    assert len(np.unique(colours, axis=0)) == 2


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o"])
def test_pose_graphs(name: str) -> None:
    graph = slamcli.read(str(BUNDLED / name))
    _, places, _, faces = parts(ply.render(graph))
    assert len(places) == graph.landmarks + 5 * graph.poses
    assert len(faces) == 6 * graph.poses
    if graph.space == 2:
        heading = next(c for c in graph.variables.values() if c.kind.is_pose).values[0]
        pyramid = places[graph.landmarks : graph.landmarks + 5].astype(float)
        opens = pyramid[1:].mean(axis=0) - pyramid[0]
        assert_allclose(np.arctan2(opens[1], opens[0]), heading[2], atol=1e-4)


def test_colours_of_bundler(tmp_path: Path) -> None:
    text = "# Bundle file v0.3\n1 1\n100 0 0\n1 0 0\n0 1 0\n0 0 1\n0 0 0\n0 0 -2\n255 0 10\n1 0 0 1 2\n"
    _, _, colours, _ = parts(ply.render(slamcli.read(str(write_file(tmp_path, text, "bundle.out")))))
    assert colours[0].tolist() == [255, 0, 10]


def test_nothing_to_write() -> None:
    with pytest.raises(InputError, match="nothing is written"):
        ply.render(FactorGraph({}, []))

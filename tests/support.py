"""What several test files need: the standard data sets, g2o's test vectors, a graph from a few lines of text."""

import os
from pathlib import Path

import pytest

BUNDLED = Path(__file__).parents[1] / "datasets"
STANDARD = Path(os.environ["SLAMCLI_DATASETS"]) if os.environ.get("SLAMCLI_DATASETS") else None

# One edge of each tag that slamcli reads, with what it adds to chi2: g2opy 2.3.0's numbers, to six decimals. The
# measured quaternions of EDGE_SE3:QUAT and EDGE_SE3_PRIOR have six digits; slamcli normalizes both. g2opy has
# 14.282676 and 0.963337 for them as they stand, and the numbers below for the same ones written as unit quaternions.
VECTOR_VARIABLES = """\
PARAMS_SE3OFFSET 1 0.1 -0.2 0.3 0.1 0.2 0.3 0.9273618495495703
VERTEX_SE2 0 0.1 0.2 0.3
VERTEX_SE2 1 1.2 0.3 -0.4
VERTEX_XY 10 2.0 1.5
VERTEX_XY 11 2.5 0.5
VERTEX_SE3:QUAT 20 0.1 0.2 0.3 0.1 0.2 0.3 0.9273618495495703
VERTEX_SE3:QUAT 21 1.1 0.4 0.2 -0.2 0.1 0.05 0.9733961166965893
VERTEX_TRACKXYZ 30 1 2 5
VERTEX_TRACKXYZ 31 1.5 2 5
"""
VECTOR_EDGES = {
    "EDGE_SE2 0 1 1.0 0.1 -0.5 10 1 0.5 20 0.2 30": 2.838604,
    "EDGE_SE2_XY 0 10 1.9 0.6 10 1 20": 1.073499,
    "EDGE_BEARING_SE2_XY 0 10 0.4 100": 0.998996,
    "EDGE_PRIOR_SE2 0 0.12 0.18 0.31 10 1 0.5 20 0.2 30": 0.016702,
    "EDGE_PRIOR_SE2_XY 1 1.1 0.2 10 1 20": 0.320000,
    "EDGE_PRIOR_XY 10 2.1 1.4 10 1 20": 0.280000,
    "EDGE_POINTXY 10 11 0.4 -0.9 10 1 20": 0.280000,
    "EDGE_SE3:QUAT 20 21 1 0.1 0.05 -0.1 0.05 0.1 0.9886858"
    " 10 0 0 0 0 0.3 11 0 0 0 0 12 0 0 0 40 0 0 50 0 60": 14.282677,
    "EDGE_SE3_TRACKXYZ 20 30 1 0.5 2 4.5 10 0 0 11 0 12": 26.107280,
    "EDGE_SE3_PRIOR 20 1 0.2 0.1 0.5 0.15 0.35 0.5 0.777817 10 0 0 0 0 0 11 0 0 0 0 12 0 0 0 40 0 0 50 0 60": 0.963335,
    "EDGE_SE3_XYZ_PRIOR 20 1 0.15 0.25 0.2 10 0 0 11 0 12": 0.172500,
    "EDGE_POINTXYZ 30 31 0.4 0.1 -0.1 10 0 0 11 0 12": 0.330000,
    "EDGE_POINTXYZ_PRIOR 30 1.1 1.9 5.2 10 0 0 11 0 12": 0.690000,
}
# The same of tags that g2o does not know. The point 10 is at (1.9, 1.3) from pose 0, which looks along 0.3: its range
# is sqrt(5.3) = 2.302173, its bearing atan2(1.3, 1.9) - 0.3 = 0.300050, and the residual (0.097827, 0.099950).
# Vertigo's edges are those of g2o above, with a quarter of their chi2 at a switch of one half.
SENSOR_EDGES = {
    "EDGE_SE2_RB 0 10 2.4 0.4 10 1 100": 1.114253,
    "EDGE_BEARING_SE2_RB 0 10 2.4 0.4 10 0 100": 1.094697,
    "LANDMARK2:RB 0 10 2.4 0.4 10 0 0": 0.095701,
    "EDGE_RANGE_SE2_XY 0 10 2.4 10": 0.095701,
    "EDGE_SE2_SWITCHABLE 0 1 40 1.0 0.1 -0.5 10 1 0.5 20 0.2 30": 0.709651,
    "EDGE_SE3_SWITCHABLE 20 21 40 1 0.1 0.05 -0.1 0.05 0.1 0.9886858"
    " 10 0 0 0 0 0.3 11 0 0 0 0 12 0 0 0 40 0 0 50 0 60": 3.570669,
    "EDGE_SWITCH_PRIOR 40 1 4": 1.0,
}
# What cameras see, by the formulas of g2o's master: from the pose of 20 the point 30 is at (0.278111, 2.410945, 4.5).
# With fx fy cx cy = 500 510 320 240 and a baseline of 0.1 m, u = 350.901169, v = 513.240404 and u_right = 339.790058;
# with f = 500 for both, v = 507.882749.
CAMERA_VARIABLES = """\
PARAMS_CAMERAPARAMETERS 3 500 320 240 0.1
VERTEX_CAM 50 0.1 0.2 0.3 0.1 0.2 0.3 0.9273618495495703 500 510 320 240 0.1
VERTEX_SE3:EXPMAP 51 0.1 0.2 0.3 0.1 0.2 0.3 0.9273618495495703
VERTEX_XYZ 52 1 2 5
VERTEX_POINT_XYZ 53 1 2 5
"""
CAMERA_EDGES = {
    "EDGE_PROJECT_P2MC 30 50 400 420 1 0 1": 11104.468122,
    "EDGE_PROJECT_P2SC 52 50 400 420 390 1 0 0 1 0 1": 13625.506416,
    "EDGE_PROJECT_XYZ2UV:EXPMAP 53 51 3 400 420 1 0 1": 10134.072761,
}
EDGES = VECTOR_EDGES | SENSOR_EDGES | CAMERA_EDGES
VARIABLES = VECTOR_VARIABLES + CAMERA_VARIABLES + "VERTEX_SWITCH 40 0.5\n"
vectors = VARIABLES + "".join(f"{edge}\n" for edge in EDGES)


def dataset(relative_path: str) -> Path:
    """A standard data set, such as 'pose2d/M3500.g2o'; the test is skipped where the data sets are not."""
    if STANDARD is None:
        pytest.skip("SLAMCLI_DATASETS does not name the folder of the standard data sets")
    path = STANDARD / relative_path
    if not path.exists():
        pytest.skip(f"{path} is not here")
    return path


def write_file(tmp_path: Path, text: str | bytes, name: str = "graph.g2o") -> Path:
    """A file with this text and no other: no newline is added or translated."""
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path

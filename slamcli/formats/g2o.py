"""The g2o text format: its tag table.

Information matrices are upper triangles, row by row, in the order of the residual; translation before rotation;
quaternions are Hamilton, x y z w, and are normalized on reading (vertices, measurements and parameters). Poses of
VERTEX_CAM and VERTEX_SE3:EXPMAP are those of the camera in the world, as g2o's master writes them.

Not of g2o itself, but of files in its notation: SLAM++'s EDGE_SE2_RB with its two synonyms, EDGE_RANGE_SE2_XY, whose
files often leave the information out, and Vertigo's switches with their priors and edges (``TAG i j switch ...``).
Course files leave it out of all edges: where no record of a tag has one, it is the identity, and a note says so.
"""

from __future__ import annotations

from slamcli import models
from slamcli.formats.dialect import Dialect, EdgeTag, ParameterTag, VertexTag

G2O = Dialect(
    name="g2o",
    vertices=(
        VertexTag("VERTEX_SE2", models.SE2, 3),
        VertexTag("VERTEX_XY", models.XY, 2),
        VertexTag("VERTEX_SE3:QUAT", models.SE3, 7),
        VertexTag("VERTEX_TRACKXYZ", models.XYZ, 3),
        VertexTag("VERTEX_XYZ", models.XYZ, 3),
        VertexTag("VERTEX_POINT_XYZ", models.XYZ, 3),
        VertexTag("VERTEX_CAM", models.SBA_CAMERA, 12, defaults=(300.0, 300.0, 320.0, 320.0, 0.1)),
        VertexTag("VERTEX_SE3:EXPMAP", models.SE3_EXPMAP, 7),
        VertexTag("VERTEX_SWITCH", models.SWITCH, 1),
    ),
    edges=(
        EdgeTag("EDGE_SE2", models.RELATIVE_POSE_2D, 3),
        EdgeTag("EDGE_SE2_XY", models.POINT_OBSERVATION_2D, 2),
        EdgeTag("EDGE_BEARING_SE2_XY", models.BEARING_2D, 1),
        EdgeTag("EDGE_SE2_RB", models.RANGE_BEARING_2D, 2),
        EdgeTag("EDGE_BEARING_SE2_RB", models.RANGE_BEARING_2D, 2),
        EdgeTag("LANDMARK2:RB", models.RANGE_BEARING_2D, 2),
        EdgeTag("EDGE_RANGE_SE2_XY", models.RANGE_2D, 1, optional_information=True),
        EdgeTag("EDGE_PRIOR_SE2", models.POSE_PRIOR_2D, 3),
        EdgeTag("EDGE_PRIOR_SE2_XY", models.POSITION_PRIOR_2D, 2),
        EdgeTag("EDGE_PRIOR_XY", models.POINT_PRIOR_2D, 2),
        EdgeTag("EDGE_POINTXY", models.POINT_DIFFERENCE_2D, 2),
        EdgeTag("EDGE_SE3:QUAT", models.RELATIVE_POSE_3D, 7),
        EdgeTag("EDGE_SE3_TRACKXYZ", models.POINT_OBSERVATION_3D, 3),
        EdgeTag("EDGE_SE3_PRIOR", models.POSE_PRIOR_3D, 7),
        EdgeTag("EDGE_SE3_XYZ_PRIOR", models.POSITION_PRIOR_3D, 3),
        EdgeTag("EDGE_POINTXYZ", models.POINT_DIFFERENCE_3D, 3),
        EdgeTag("EDGE_POINTXYZ_PRIOR", models.POINT_PRIOR_3D, 3),
        EdgeTag("EDGE_PROJECT_P2MC", models.SBA_PROJECTION, 2),
        EdgeTag("EDGE_PROJECT_P2SC", models.SBA_STEREO_PROJECTION, 3),
        EdgeTag("EDGE_PROJECT_XYZ2UV:EXPMAP", models.EXPMAP_PROJECTION, 2),
        EdgeTag("EDGE_SE2_SWITCHABLE", models.SWITCHABLE_RELATIVE_POSE_2D, 3),
        EdgeTag("EDGE_SE3_SWITCHABLE", models.SWITCHABLE_RELATIVE_POSE_3D, 7),
        EdgeTag("EDGE_SWITCH_PRIOR", models.SWITCH_PRIOR, 1),
    ),
    parameters=(
        ParameterTag("PARAMS_SE3OFFSET", models.SE3),
        ParameterTag("PARAMS_CAMERAPARAMETERS", models.CAMERA_PARAMETERS),
    ),
    fix="FIX",
    bare_edges=True,
    unused=dict.fromkeys(("ROBOTLASER1", "VERTEX_TAG", "VERTEX_ELLIPSE"), "data of the vertex before it")
    | dict.fromkeys(
        ("EDGE_SE2_MAXMIX", "EDGE_SE2_MIXTURE", "EDGE_SE3:QUAT_MIXTURE", "EDGE_SE2_XY_MIXTURE"),
        "mixtures of hypotheses are not supported, so the graph lacks these edges",
    ),
)

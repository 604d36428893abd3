"""The g2o text format: its tag table.

Information matrices are upper triangles, row by row, in the order of the residual; translation before rotation;
quaternions are Hamilton, x y z w, and are normalized on reading (vertices, measurements and parameters).

Not of g2o itself, but of files in its notation: SLAM++'s EDGE_SE2_RB with its two synonyms, and EDGE_RANGE_SE2_XY,
whose files often leave the information out.
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
    ),
    parameters=(ParameterTag("PARAMS_SE3OFFSET", models.SE3),),
    fix="FIX",
    unused=dict.fromkeys(("ROBOTLASER1", "VERTEX_TAG", "VERTEX_ELLIPSE"), "data of the vertex before it"),
)

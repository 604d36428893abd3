"""Lie groups of the plane and of space: SO(2), SE(2), SO(3) and SE(3).

Each group is a module with the same functions in the same argument order, on float64
arrays whose last axis holds one element or tangent vector and whose leading axes are a
batch that broadcasts::

    identity normalize compose inverse between act exp log adjoint
    left_jacobian right_jacobian left_jacobian_inverse right_jacobian_inverse
    wrap retract local to_matrix from_matrix          and the sizes SIZE, DIM

===========  ==========================  =============================================
module       element (``SIZE`` numbers)  tangent vector (``DIM`` numbers)
===========  ==========================  =============================================
``so2``      theta                       theta
``se2``      x y theta                   rho_x rho_y theta
``so3``      qx qy qz qw                 omega (rotation vector)
``se3``      x y z qx qy qz qw           rho omega (translation first)
===========  ==========================  =============================================

Angles are radians, in [-pi, pi); quaternions are Hamilton, scalar last; an element X of a
pose group takes coordinates in the body frame to the world frame. Functions neither check
nor repair their input: elements are taken to be normalized, and NaN goes through as NaN.
"""

from slamcli.geometry import se2, se3, so2, so3

__all__ = ["se2", "se3", "so2", "so3"]

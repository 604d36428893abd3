"""Where an optimization starts: odometry, spanning trees, chordal relaxations, and the choice among them."""

from slamcli.solver.initialization.initialize import initialize

__all__ = ["initialize"]

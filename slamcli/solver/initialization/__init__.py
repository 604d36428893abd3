"""Where an optimization starts: odometry, spanning trees, chordal relaxations."""

from slamcli.solver.initialization.initialize import initialize
from slamcli.solver.initialization.start import Start, automatic, in_doubt, make

__all__ = ["Start", "automatic", "in_doubt", "initialize", "make"]

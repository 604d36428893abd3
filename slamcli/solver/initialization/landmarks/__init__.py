"""Where landmarks are, with the poses given: triangulation, multilateration, and what determines no place."""

from slamcli.solver.initialization.landmarks.place import place

__all__ = ["place"]

"""The registry of standard data sets: what each one is, where its file is, whether that file is the right one.

Other commands need three functions: ``resolve`` finds the file of a data set by its name, ``available`` says whether
it is there, ``entry`` what is known about it. Nothing here reads a registry before it is asked to.
"""

from slamcli.batch.datasets.entries import DatasetEntry, Optimum
from slamcli.batch.datasets.search import available, entry, resolve

__all__ = ["DatasetEntry", "Optimum", "available", "entry", "resolve"]

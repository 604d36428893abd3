"""Figures of graphs, trajectories, iterations and errors. The only folder that imports matplotlib.

``inputs`` reads what is to be drawn, ``scene`` turns trajectories and graphs into points and segments, ``maps``,
``iterations`` and ``errors`` draw one kind of figure each, ``style`` holds what they share, and ``files`` makes the
bytes of a file.
"""

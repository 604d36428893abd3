"""Benchmarks: variants of the optimizer and peers on the same graphs, in turn, each run in a process of its own.

``grid`` makes the variants, ``runner`` lets them alternate, ``result`` has the figures. A run is a child process
(``child``, started by ``processes``) that times slamcli or one of the ``peers`` on one graph (``case``); ``search``
finds the fewest iterations with which a peer reaches the optimum.
"""

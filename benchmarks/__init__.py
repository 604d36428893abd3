"""Benchmarks. Not part of the package, never part of the tests.

``make bench`` runs ``run``: the parts of an optimization, loading, start-up and the filter. ``make bench BENCH=name
ARGS='...'`` runs another one:

* ``optimum``: every pose graph, the defaults against each peer's best setting
* ``certificate``: certified minima of the isotropic objective
* ``outliers``: robust methods on injected false closures
* ``covariance``: all marginal covariances
* ``scale``: 100 000 poses with 300 000 edges
* ``bundle``: bundle adjustment
* ``publish``: ``docs/benchmarks.md`` (``make benchmarks``)

What they have in common, children and peers, is ``slamcli.batch.benchmark``, which is behind ``slamcli bench``.
"""

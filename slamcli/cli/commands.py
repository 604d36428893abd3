"""The table of subcommands, and the top-level help made of it without loading anything."""

from __future__ import annotations

from slamcli import __version__

#: Name of each subcommand: the module that holds its ``command``, and what it does in a line.
COMMANDS: dict[str, tuple[str, str]] = {
    "bench": ("slamcli.cli.bench", "Time methods, orderings and peers side by side on the same data."),
    "compare": ("slamcli.cli.compare", "Dead reckoning, filter and smoother on the same data, side by side."),
    "convert": ("slamcli.cli.convert", "Convert a graph between g2o, TORO, BAL and Bundler."),
    "covariance": ("slamcli.cli.covariance", "Print marginal covariances of poses and landmarks."),
    "datasets": ("slamcli.cli.datasets", "List, fetch and verify the standard data sets."),
    "ekf": ("slamcli.cli.ekf", "Run EKF-SLAM on a graph, a simulation or a real sensor log."),
    "evaluate": ("slamcli.cli.evaluate", "Compare estimates with the truth: ATE, RPE, drift, landmarks."),
    "graph": ("slamcli.cli.graph", "Draw the factor graph itself: variables, factors, elimination."),
    "info": ("slamcli.cli.info", "Describe a graph: counts, connectivity, chi2, information."),
    "inject": ("slamcli.cli.inject", "Spoil a graph on purpose: false closures, bad odometry."),
    "marginalize": ("slamcli.cli.marginalize", "Marginalize variables out of a graph, keeping what they say."),
    "optimize": ("slamcli.cli.optimize", "Optimize a pose graph and report every iteration."),
    "plot": ("slamcli.cli.plot", "Draw graphs, trajectories, iterations and errors."),
    "predict": ("slamcli.cli.predict", "Print what a sensor should read, the innovation and the Jacobians."),
    "regress": ("slamcli.cli.regress", "Run a suite of cases and compare its figures with a baseline."),
    "simulate": ("slamcli.cli.simulate", "Simulate a robot in a world: a graph with its truth."),
    "sparsity": ("slamcli.cli.sparsity", "Compare elimination orders: fill-in, flops, trees, pictures."),
    "sweep": ("slamcli.cli.sweep", "Run Monte-Carlo and parameter studies, here or on a cluster."),
}

_OPTIONS = {
    "--version": "Show the version, and those of the libraries with it.",
    "-h, --help": "Show this message and exit.",
}


def help_text() -> str:
    """What ``slamcli --help`` prints."""
    lines = ["Usage: slamcli [OPTIONS] COMMAND [ARGS]...", "", "  A batch tool for SLAM back-ends.", "", "Options:"]
    lines += _aligned(_OPTIONS)
    lines += ["", "Commands:"]
    lines += _aligned({name: summary for name, (_, summary) in COMMANDS.items()})
    lines += [
        "",
        "  slamcli COMMAND --help explains a command. Exit codes: 0 success, 1 a check failed,",
        "  2 usage, 3 invalid input, 4 not converged, 5 numerical failure, 130 interrupted.",
    ]
    return "\n".join(lines)


def version_text() -> str:
    """What ``slamcli --version`` prints: fit to be pasted into an issue."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    parts = [f"slamcli {__version__}", f"Python {platform.python_version()} on {platform.platform()}"]
    for name in ("numpy", "scipy", "cvxopt"):
        try:
            parts.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            parts.append(f"{name} is not installed")
    return "\n".join(parts)


def _aligned(entries: dict[str, str]) -> list[str]:
    width = max(len(name) for name in entries)
    return [f"  {name:{width}}  {summary}" for name, summary in entries.items()]

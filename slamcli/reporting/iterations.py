"""One line for each iteration: our table, and g2o's line byte for byte."""

from __future__ import annotations

from slamcli.reporting.text import seconds
from slamcli.solver.result import IterationRecord

_WIDTHS = (9, 20, 10, 9, 9, 9, 6, 9)
_G2O_STEPS = {"gauss-newton": "GN", "steepest-descent": "Descent", "dogleg": "Dogleg"}


def header(method: str) -> str:
    """Titles of the table; dogleg's damping is its trust radius."""
    damping = "radius" if method == "dogleg" else "damping"
    titles = ("iteration", "chi2", "change", "gradient", "step", damping, "trials", "time")
    return "  ".join(f"{title:>{width}}" for title, width in zip(titles, _WIDTHS, strict=True))


def line(chi2: float, record: IterationRecord | None) -> str:
    """A row of the table; without a record the row of the start."""
    if record is None:
        return f"{0:9d}  {chi2:20.6f}"
    damping = "-" if record.damping is None else f"{record.damping:.2e}"
    mark = "" if record.accepted else "  rejected"
    if record.step not in ("gauss-newton", "damped"):
        mark = f"  {record.step}{mark}"
    if record.linear_iterations is not None:
        mark = f"  cg {record.linear_iterations}{mark}"
    return (
        f"{record.iteration:9d}  {chi2:20.6f}  {record.chi2_change:10.3e}  {record.gradient_norm:9.2e}  "
        f"{record.step_norm:9.2e}  {damping:>9}  {record.trials:6d}  {seconds(record.time):>9}{mark}"
    )


def g2o_line(record: IterationRecord, edges: int, cumulated: float) -> str:
    """The line that g2o prints with ``-v`` (``SparseOptimizer::optimize`` and each algorithm's ``printVerbose``).

    Iterations count from 0, chi2 is the one after the step, times have six significant digits.
    """
    text = (
        f"iteration= {record.iteration - 1}\t chi2= {record.chi2:.6f}\t time= {record.time:g}"
        f"\t cumTime= {cumulated:g}\t edges= {edges}"
    )
    if record.step in _G2O_STEPS and record.damping is not None:
        return f"{text}\t Delta= {record.damping:g}\t step= {_G2O_STEPS[record.step]}\t tries= {record.trials}"
    if record.damping is not None:
        return f"{text}\t schur= 0\t lambda= {record.damping:.6f}\t levenbergIter= {record.trials}"
    return f"{text}\t schur= 0"

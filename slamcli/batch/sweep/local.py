"""Tasks on this machine, by joblib."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Sequence

import joblib

from slamcli.batch.sweep.journal import Record
from slamcli.batch.sweep.perform import Performer, close
from slamcli.batch.sweep.plan import Task


def local(tasks: Sequence[Task], perform: Performer, jobs: int) -> Iterator[Record]:
    """The records of tasks, in the order in which they end.

    The workers are threads: each waits for a process of its own that does the work (``batch.interpreter``). Closing
    the iterator ends these processes; tasks that were running have no record then.
    """
    parallel = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator_unordered", batch_size=1)
    records = parallel(joblib.delayed(perform)(task) for task in tasks)
    try:
        for record in records:  # noqa: UP028 - "yield from" would close them before the processes end
            yield record
    finally:
        close()
        # of tasks that are not finished: they are meant not to be
        warnings.filterwarnings("ignore", category=UserWarning, module="joblib.parallel")
        with contextlib.suppress(Exception):
            records.close()


def processors() -> int:
    """How many processors this process may use."""
    return int(joblib.cpu_count())

"""Tasks on a cluster, by dask.distributed.

Dask runs a task again elsewhere if its worker dies, so a task can be run twice; its key makes it one task, and the
coordinator takes the first record of each. Workers may have any number of threads: each thread has a process of its
own that does the work (``batch.interpreter``).
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import signal
import uuid
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from slamcli.batch.sweep.journal import Record
from slamcli.batch.sweep.perform import Performer
from slamcli.batch.sweep.plan import Task
from slamcli.errors import InputError, SlamcliError, UsageError

if TYPE_CHECKING:
    from distributed import Client, Future

#: Exit code that stands for a task whose workers died one after the other.
_KILLED = 137
#: Seconds to wait for the scheduler, and for its first worker.
_PATIENCE = (10, 60)
#: Tasks that the scheduler has at the same time, for each thread of a worker, and at least.
_AHEAD, _LEAST_AHEAD = 4, 64


def cluster(tasks: Sequence[Task], perform: Performer, address: str) -> Iterator[Record]:
    """The records of tasks, in the order in which they end.

    Parameters
    ----------
    address
        Of a scheduler, such as ``tcp://10.0.0.1:8786``; or ``local:N``, which starts N workers on this machine for as
        long as the sweep runs.

    Raises
    ------
    UsageError
        If dask.distributed is not installed, or the address is none.
    InputError
        If there is no scheduler, or no worker, or they go away; if a worker cannot run slamcli.
    """
    with contextlib.ExitStack() as stack:
        yield from _records(_connected(address, stack), tasks, perform, address)


def _connected(address: str, stack: contextlib.ExitStack) -> Client:
    """A client; it is closed with the stack, as is a cluster that was started here."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise UsageError("--dask needs dask.distributed", ("  pip install 'slamcli[dask]'",)) from None
    # its messages about workers that die are for programmers; what matters is said by us
    for name in ("distributed", "tornado", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    own = None
    if address.startswith("local:"):
        count = address.removeprefix("local:")
        if not count.isdecimal() or int(count) < 1:
            raise UsageError(f"--dask {address}: expected local:N with a number of workers")
        own = LocalCluster(
            n_workers=int(count), threads_per_worker=1, dashboard_address=":0", silence_logs=logging.CRITICAL
        )
        stack.callback(_closed, own)
    try:
        client = Client(own or address, timeout=_PATIENCE[0], set_as_default=False)
    except ValueError as error:
        raise UsageError(f"--dask {address}: {error}") from None
    except (OSError, TimeoutError):
        raise InputError(f"no dask scheduler answers at {address}", ("  start one with: dask scheduler",)) from None
    stack.callback(_closed, client)
    try:
        client.wait_for_workers(1, timeout=_PATIENCE[1])
    except TimeoutError:
        raise InputError(
            f"the dask scheduler at {address} has no worker", ("  start one with: dask worker ADDRESS",)
        ) from None
    if own is not None:
        _deaf(client)
    return client


def _closed(connection: Any) -> None:
    with contextlib.suppress(Exception):  # whatever is left of it
        connection.close(timeout=5)


def _deaf(client: Client) -> None:
    """Ctrl-C in a terminal reaches workers on this machine, too: what becomes of them is for this process to say."""
    from distributed import WorkerPlugin

    class Deaf(WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: Any) -> None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    client.register_plugin(Deaf())


def _records(client: Client, tasks: Sequence[Task], perform: Performer, address: str) -> Iterator[Record]:
    """Submit as many tasks as keep the workers busy; more as some end."""
    from distributed import as_completed

    rest = iter(tasks)
    # not the task's key alone: the same task of another sweep on this cluster is none of ours, and ends with it
    token = uuid.uuid4().hex
    running: dict[str, tuple[Task, Future]] = {}

    def submitted(count: int) -> list[Future]:
        futures = []
        for task in itertools.islice(rest, count):
            future = client.submit(on_worker, perform, task, key=f"slamcli-sweep-{task.key}-{token}")
            running[future.key] = (task, future)
            futures.append(future)
        return futures

    try:
        ahead = max(_LEAST_AHEAD, _AHEAD * sum(client.nthreads().values()))
        ended = as_completed(submitted(ahead), loop=client.loop)
        for future in ended:
            if future.status in ("pending", "lost"):  # its worker died with the result: it is run again
                ended.add(future)
                continue
            record = _record(future, running[future.key][0], address)
            del running[future.key]
            yield record
            future.release()
            for another in submitted(1):
                ended.add(another)
    except (OSError, TimeoutError, asyncio.CancelledError):
        raise _gone(address) from None
    finally:
        if running:
            with contextlib.suppress(Exception):
                client.cancel([future for _, future in running.values()], force=True)


def _record(future: Future, task: Task, address: str) -> Record:
    from distributed.scheduler import KilledWorker

    if future.status == "finished":
        record: Record = future.result()
        return record
    if future.status == "cancelled":
        raise _gone(address)
    error = future.exception()
    if isinstance(error, KilledWorker):
        return Record(
            task.key, _KILLED, task.case.command, "the workers that ran it died", dict.fromkeys(task.metrics), {}
        )
    if isinstance(error, SlamcliError):
        raise error
    raise InputError(f"a worker of {address} cannot run slamcli: {error}") from None


def _gone(address: str) -> InputError:
    return InputError(f"the dask scheduler at {address} is gone", ("  the same command goes on where this one ended",))


def on_worker(perform: Performer, task: Task) -> Record:
    """Run a task by a worker of dask, in the folder that it removes when it ends, or when it is started again."""
    from distributed import get_worker

    return perform(task, get_worker().local_directory)

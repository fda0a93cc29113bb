"""One function over many items, each of which makes one file: in this process, in several, or on a Dask cluster.

What is finished stands as a file, so a run that was stopped at any instant goes on where it was: the same call
again makes the files that are missing. For that, the function has to put its file in place whole or not at all,
as everything in `hums.store` does, and what it writes may depend on its item alone.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Generic, TypeVar

from hums.store import remove_parts

__all__ = ["Cluster", "Job", "JobError", "Processes", "Serial", "Tally", "Workers", "run_jobs"]

Item = TypeVar("Item")
_AHEAD = 2  # jobs handed out for each worker, so that none waits for the next
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_REACH_S = 10  # to find a scheduler


class JobError(ValueError):
    """A run that cannot start or cannot go on, in one sentence."""


@dataclass(frozen=True, kw_only=True)
class Serial:
    """Work in this process."""


@dataclass(frozen=True, kw_only=True)
class Processes:
    """Work in `count` processes of this machine, each with one thread for its linear algebra."""

    count: int

    def __post_init__(self) -> None:
        if self.count < 1:
            raise JobError(f"workers = {self.count}: at least 1 process is needed.")


@dataclass(frozen=True, kw_only=True)
class Cluster:
    """Work on a Dask cluster whose scheduler listens at `address`, such as ``tcp://10.0.0.1:8786``.

    It and its workers need this package in the same version, and the workers the disk that is written to.
    """

    address: str


Workers = Serial | Processes | Cluster


@dataclass(frozen=True, kw_only=True)
class Job(Generic[Item]):
    """One item, the name of the file it makes, and how many things are in it, which the progress bar counts."""

    name: str
    item: Item
    size: int = 1


@dataclass(frozen=True, kw_only=True)
class Tally:
    """How many jobs were done in this run, and how many had been done before it."""

    done: int
    kept: int


def run_jobs(
    function: Callable[[Item, Path], None],
    jobs: Sequence[Job[Item]],
    *,
    folder: Path,
    workers: Workers,
    title: str | None = None,
) -> Tally:
    """Call ``function(item, folder / name)`` for every job whose file does not exist.

    Parameters
    ----------
    function : callable
        Writes the file of one item, whole or not at all. For processes and clusters it and the items are pickled:
        a function of a module, or a `functools.partial` of one.
    jobs : sequence of Job
    folder : Path
        An existing folder, given over to these files: what a killed run left half written is removed from it.
    workers : Serial, Processes or Cluster
    title : str, optional
        Words beside a progress bar on standard error; without them no bar is drawn.

    Returns
    -------
    Tally

    Raises
    ------
    JobError
        If another run works in the folder, a worker dies, or a cluster cannot be reached or writes elsewhere.
    Exception
        What `function` raised, after jobs that were under way have ended. Finished files stay.
    """
    folder = folder.resolve()
    with _alone(folder):
        remove_parts(folder)
        there = {path.name for path in folder.iterdir()}
        missing = [job for job in jobs if job.name not in there]
        kept = sum(job.size for job in jobs) - sum(job.size for job in missing)
        with _bar(title, total=kept + sum(job.size for job in missing), done=kept) as advance:
            if isinstance(workers, Serial):
                for job in missing:
                    function(job.item, folder / job.name)
                    advance(job.size)
            elif missing:
                with _pool(workers, jobs=len(missing)) as (pool, width):
                    _spread(function, missing, folder=folder, pool=pool, width=width, advance=advance)
    return Tally(done=len(missing), kept=len(jobs) - len(missing))


def _spread(
    function: Callable[[Item, Path], None],
    jobs: Sequence[Job[Item]],
    *,
    folder: Path,
    pool: Executor,
    width: int,
    advance: Callable[[int], None],
) -> None:
    """Keep `width` jobs with the pool, so that a hundred thousand do not wait in its queue."""
    waiting = iter(jobs)
    running: dict[Future[None], Job[Item]] = {}
    while True:
        while len(running) < width and (job := next(waiting, None)) is not None:
            running[pool.submit(function, job.item, folder / job.name)] = job
        if not running:
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            job = running.pop(future)
            future.result()
            if not (folder / job.name).exists():
                raise JobError(
                    f"a worker wrote {folder / job.name}, but it is not on this machine; the folder has to be on a "
                    "disk that all workers share, under one path."
                )
            advance(job.size)


# ---- where the work is done --------------------------------------------------------------------------------


@contextmanager
def _pool(workers: Processes | Cluster, *, jobs: int) -> Iterator[tuple[Executor, int]]:
    """Yield an executor and how many jobs to keep with it."""
    if isinstance(workers, Cluster):
        with _cluster(workers.address) as (pool, threads):
            yield pool, _AHEAD * threads
        return
    count = min(workers.count, jobs)
    with _one_thread_each(), ProcessPoolExecutor(count, get_context("spawn"), initializer=_prepare_worker) as pool:
        try:
            yield pool, _AHEAD * count
        except BrokenProcessPool:
            raise JobError(
                "a worker process died, as it does when memory runs out. What is finished is kept: run the same "
                "again, with fewer workers if memory was the reason."
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Have processes started meanwhile use one thread each: they are the parallel part, and sums keep their order."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _prepare_worker() -> None:
    """Leave interrupts to the parent, and end with it: killed outright, it cannot tell its workers to stop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Executor, int]]:
    try:
        from dask.distributed import Client  # noqa: PLC0415 - an optional part
    except ImportError:
        raise JobError('a cluster needs Dask: pip install "hums-toolkit[dask]".') from None
    connect: Any = Client  # which has no types
    try:
        client = connect(address, timeout=_REACH_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise JobError(
            f"no Dask scheduler answers at {address} ({error}); start one with: dask scheduler, and give its address."
        ) from None
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise JobError(f"the Dask scheduler at {address} has no workers; start some with: dask worker {address}.")
        pool = client.get_executor()
        try:
            yield pool, threads
        except RuntimeError as error:
            if "deserialization" not in str(error):
                raise
            raise JobError(
                f"the Dask cluster at {address} cannot load what it is to do ({error.__cause__ or error}). Install "
                "this package, in the same version, where the scheduler and its workers run."
            ) from error
        finally:
            pool.shutdown(wait=False)  # what still runs was asked for by a run that has failed


# ---- one run at a time, and how far it is ------------------------------------------------------------------


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the folder against a second run; the system lets go of it when a process dies."""
    if os.name != "posix":  # elsewhere two runs at once are the user's to avoid
        yield
        return
    import fcntl  # noqa: PLC0415 - exists on POSIX only

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise JobError(f"another run is at work in {folder}; wait for it, or stop it first.") from None
        yield
    finally:
        os.close(descriptor)


@contextmanager
def _bar(title: str | None, *, total: int, done: int) -> Iterator[Callable[[int], None]]:
    """Yield the function that moves a bar on."""
    if title is None:
        yield lambda _: None
        return
    from rich.console import Console  # noqa: PLC0415 - only a person needs it
    from rich.progress import (  # noqa: PLC0415
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task(title, total=total, completed=done)
        yield lambda size: progress.advance(task, size)

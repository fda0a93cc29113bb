"""Jobs that write one file each: in this process, in several, or on a Dask cluster.

A run that was stopped at any instant resumes: the same call again writes the files that are missing. For that, the
function has to write its file atomically, as `hums.records.store` does, and the file may depend on its item alone.
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

__all__ = ["Cluster", "Job", "JobError", "Processes", "Serial", "Tally", "Workers", "run_jobs"]

Item = TypeVar("Item")
_JOBS_PER_WORKER = 2  # submitted at a time, so that no worker waits for the next
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_TIMEOUT_S = 10  # of the connection to a scheduler


class JobError(ValueError):
    """A run that cannot start or cannot continue.

    Examples
    --------
    >>> import hums
    >>> try:
    ...     hums.Processes(count=0)
    ... except hums.JobError as error:
    ...     print(error)
    workers = 0: at least 1 process is needed.
    """


@dataclass(frozen=True, kw_only=True)
class Serial:
    """Run jobs in this process, one after another.

    Examples
    --------
    >>> import hums
    >>> hums.Serial()
    Serial()
    """


@dataclass(frozen=True, kw_only=True)
class Processes:
    """Run jobs in processes of this machine, each with one thread for its linear algebra.

    Attributes
    ----------
    count : int
        Number of processes, at least 1.

    Examples
    --------
    >>> import hums
    >>> hums.Processes(count=2).count
    2
    """

    count: int

    def __post_init__(self) -> None:
        if self.count < 1:
            raise JobError(f"workers = {self.count}: at least 1 process is needed.")


@dataclass(frozen=True, kw_only=True)
class Cluster:
    """Run jobs on a Dask cluster.

    The scheduler and its workers need this package in the same version, and the workers access to the folder that is
    written to.

    Attributes
    ----------
    address : str
        Address of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Examples
    --------
    >>> import hums
    >>> hums.Cluster(address="tcp://10.0.0.1:8786").address
    'tcp://10.0.0.1:8786'
    """

    address: str


Workers = Serial | Processes | Cluster


@dataclass(frozen=True, kw_only=True)
class Job(Generic[Item]):
    """One item, the name of its file, and its size in units of the progress bar."""

    name: str
    item: Item
    size: int = 1


@dataclass(frozen=True, kw_only=True)
class Tally:
    """Number of jobs done in this run, and of those whose files were kept from earlier runs."""

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
        Writes the file of one item atomically. For processes and clusters it is pickled, as are the items: a function
        of a module, or a `functools.partial` of one.
    jobs : sequence of Job
        Items and the names of their files.
    folder : Path
        Existing folder for these files only: partial files of killed runs are removed from it.
    workers : Serial, Processes or Cluster
        Where the jobs run.
    title : str, optional
        Label of a progress bar on standard error; None: no bar.

    Returns
    -------
    Tally

    Raises
    ------
    JobError
        If another run uses the folder, a worker dies, or a cluster cannot be reached or writes elsewhere.
    Exception
        Any exception of `function`, after the running jobs have ended. Finished files remain.
    """
    from hums.records.store import remove_partial_files  # noqa: PLC0415 - xarray, which a worker may do without

    folder = folder.resolve()
    with _locked(folder):
        remove_partial_files(folder)
        finished = {path.name for path in folder.iterdir()}
        missing = [job for job in jobs if job.name not in finished]
        kept = sum(job.size for job in jobs) - sum(job.size for job in missing)
        with _progress_bar(title, total=kept + sum(job.size for job in missing), done=kept) as advance:
            if isinstance(workers, Serial):
                for job in missing:
                    function(job.item, folder / job.name)
                    advance(job.size)
            elif missing:
                with _pool(workers, jobs=len(missing)) as (pool, width):
                    _submit(function, missing, folder=folder, pool=pool, width=width, advance=advance)
    return Tally(done=len(missing), kept=len(jobs) - len(missing))


def _submit(
    function: Callable[[Item, Path], None],
    jobs: Sequence[Job[Item]],
    *,
    folder: Path,
    pool: Executor,
    width: int,
    advance: Callable[[int], None],
) -> None:
    """Run the jobs in a pool with at most `width` of them submitted at a time, so that its queue stays short."""
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


# ---- executors ---------------------------------------------------------------------------------------------


@contextmanager
def _pool(workers: Processes | Cluster, *, jobs: int) -> Iterator[tuple[Executor, int]]:
    """Yield an executor and the number of jobs to submit to it at a time."""
    if isinstance(workers, Cluster):
        with _cluster(workers.address) as (pool, threads):
            yield pool, _JOBS_PER_WORKER * threads
        return
    count = min(workers.count, jobs)
    with _one_thread_each(), ProcessPoolExecutor(count, get_context("spawn"), initializer=_prepare_worker) as pool:
        try:
            yield pool, _JOBS_PER_WORKER * count
        except BrokenProcessPool:
            raise JobError(
                "a worker process died, as it does when memory runs out. What is finished is kept: run the same "
                "again, with fewer workers if memory was the reason."
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Limit the processes that are started meanwhile to one thread each, which also fixes the order of sums."""
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
    """Ignore interrupts, which the parent handles, and end with the parent, also if it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """Yield an executor on a Dask cluster, and its number of threads; JobError where it does not answer."""
    try:
        from dask.distributed import Client  # noqa: PLC0415 - an optional part
    except ImportError:
        raise JobError('a cluster needs Dask: pip install "hums-toolkit[dask]".') from None
    connect: Any = Client  # which has no types
    try:
        client = connect(address, timeout=_TIMEOUT_S, set_as_default=False)
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
            pool.shutdown(wait=False)  # after a failure, running jobs are not awaited


# ---- lock and progress -------------------------------------------------------------------------------------


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock the folder against a second run; the system releases the lock of a process that dies."""
    if os.name != "posix":  # no lock elsewhere: the user has to avoid two runs at once
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
def _progress_bar(title: str | None, *, total: int, done: int) -> Iterator[Callable[[int], None]]:
    """Yield a function that advances a progress bar by a number of units."""
    if title is None:
        yield lambda _: None
        return
    from rich.console import Console  # noqa: PLC0415 - for the bar only
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

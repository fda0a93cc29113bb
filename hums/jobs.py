"""Jobs that write one file each: in this process, in several, or on a Dask cluster.

A run that was stopped at any time is resumed by the same call, which writes the missing files. For that, the function
must write its file atomically, as `hums.records.store` does, and the file may depend only on its item.
"""

import math
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Generic, TypeVar

from signals._validation import SentenceError

Item = TypeVar("Item")
_TIMEOUT_S = 10  # for the connection to a scheduler
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class JobError(SentenceError):
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
    """Run jobs in processes on this machine, each with one thread for linear algebra.

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

    The scheduler and its workers need the same version of this package, and the workers need access to the output
    folder.

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
    """Number of jobs done in this run, and of files kept from earlier runs."""

    done: int
    kept: int


def run_jobs(
    function: Callable[[Item, Path], None],
    jobs: Sequence[Job[Item]],
    *,
    folder: Path,
    workers: Workers,
    title: str | None = None,
    when_killed: Callable[[Item, Path], None] | None = None,
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
        Label of a progress bar on standard error. Default: no bar.
    when_killed : callable, optional
        Called in this process with an item and the path of its file if its worker process died twice, the second time
        while no other job was running. The other jobs continue, and the next run tries the item again unless the file
        was written. Default: the run ends with an error.

    Returns
    -------
    Tally

    Raises
    ------
    JobError
        If another run uses the folder, a job kills its worker process without `when_killed`, or a cluster cannot be
        reached or does not write to this folder.
    Exception
        Any exception of `function`, after the running jobs have ended. Finished files remain.
    """
    from hums.records.outputs import remove_partial_files  # noqa: PLC0415 - xarray, which not every worker needs

    folder = Path(os.path.realpath(folder))
    with locked(folder):
        remove_partial_files(folder)
        finished = {path.name for path in folder.iterdir()}
        missing = [job for job in jobs if job.name not in finished]
        kept = sum(job.size for job in jobs) - sum(job.size for job in missing)
        with _progress_bar(title, total=kept + sum(job.size for job in missing), done=kept) as advance:
            if isinstance(workers, Serial):
                for job in missing:
                    function(job.item, folder / job.name)
                    advance(job.size)
            else:
                for job in _killers(function, missing, folder=folder, workers=workers, advance=advance):
                    if when_killed is None:
                        raise JobError(
                            f"a worker process died twice at {job.name}, as happens when memory runs out. Finished "
                            "files are kept: run the same command again, with more memory or fewer workers."
                        )
                    when_killed(job.item, folder / job.name)
                    advance(job.size)
    return Tally(done=len(missing), kept=len(jobs) - len(missing))


def _killers(
    function: Callable[[Item, Path], None],
    jobs: Sequence[Job[Item]],
    *,
    folder: Path,
    workers: Processes | Cluster,
    advance: Callable[[int], None],
) -> Iterator[Job[Item]]:
    """Run all jobs; yield those whose worker process also dies when they run alone."""
    waiting = deque(jobs)
    while waiting:
        with _pool(workers, jobs=len(waiting)) as (pool, width, death):
            lost = _submit(function, waiting, folder=folder, pool=pool, width=width, death=death, advance=advance)
        alone = deque(lost)  # running or queued when a process died, perhaps killed from outside
        while alone:
            with _pool(workers, jobs=1) as (pool, _, death):
                _refuse_dead_on_arrival(pool, death)
                yield from _submit(function, alone, folder=folder, pool=pool, width=1, death=death, advance=advance)


def _submit(
    function: Callable[[Item, Path], None],
    waiting: deque[Job[Item]],
    *,
    folder: Path,
    pool: Executor,
    width: int,
    death: type[Exception],
    advance: Callable[[int], None],
) -> list[Job[Item]]:
    """Run the jobs in a pool with at most `width` of them submitted at a time, so that its queue stays short.

    After the first death of a process no more are taken from `waiting`; the jobs lost with it are returned.
    """
    running: dict[Future[None], Job[Item]] = {}
    lost: list[Job[Item]] = []
    while True:
        while waiting and not lost and len(running) < width:
            try:
                future = pool.submit(function, waiting[0].item, folder / waiting[0].name)
            except death:
                lost.append(waiting.popleft())
            else:
                running[future] = waiting.popleft()
        if not running:
            return lost
        done = wait(running, return_when=FIRST_COMPLETED).done
        for future in [one for one in running if one in done]:  # in order, so that the first is named if all die
            job = running.pop(future)
            try:
                future.result()
            except death:
                lost.append(job)
                continue
            if not (folder / job.name).exists():
                raise JobError(
                    f"a worker wrote {folder / job.name}, but it is not on this machine; use a folder on a disk that "
                    "all workers share under the same path."
                )
            advance(job.size)


def _refuse_dead_on_arrival(pool: Executor, death: type[Exception]) -> None:
    """Stop if processes die before any job runs: no job is then the cause."""
    try:
        pool.submit(os.getpid).result()
    except death:
        raise JobError(
            "worker processes die as soon as they start. Protect the script that starts them by "
            'if __name__ == "__main__":, and check that enough memory is available.'
        ) from None


# ---- executors ---------------------------------------------------------------------------------------------


@contextmanager
def _pool(workers: Processes | Cluster, *, jobs: int) -> Iterator[tuple[Executor, int, type[Exception]]]:
    """Yield an executor, the number of jobs to submit at a time, and the error it raises if a job's process dies."""
    jobs_per_worker = 2  # submitted at a time, so that no worker waits for the next
    if isinstance(workers, Cluster):
        with _cluster(workers.address) as (pool, threads, death):
            yield pool, jobs_per_worker * threads, death
        return
    count = min(workers.count, jobs)
    with _one_thread_each(), ProcessPoolExecutor(count, get_context("spawn"), initializer=_prepare_worker) as pool:
        try:
            yield pool, jobs_per_worker * count, BrokenProcessPool
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Limit processes started meanwhile to one thread each, which also fixes the order of summation."""
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
    """Ignore interrupts, which the parent handles, and end with the parent, even if it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Executor, int, type[Exception]]]:
    """Yield an executor on a Dask cluster, its number of threads, and the error it raises if a job kills its workers.

    JobError if the cluster does not answer.
    """
    try:
        from dask.distributed import Client, KilledWorker  # noqa: PLC0415 - an optional part
    except ImportError:
        raise JobError('a cluster needs Dask: pip install "hums-toolkit[dask]".') from None
    connect: Any = Client  # which has no types
    try:
        client = connect(address, timeout=_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise JobError(
            f"no Dask scheduler answers at {address} ({error}); start one with: dask scheduler, and use its address."
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_TIMEOUT_S)  # a nanny restarts one that died
        except TimeoutError:
            raise JobError(
                f"the Dask scheduler at {address} has no workers; start some with: dask worker {address}."
            ) from None
        threads = sum(client.nthreads().values())
        pool = client.get_executor()
        try:
            yield pool, threads, KilledWorker
        except CancelledError:
            raise JobError(
                f"the connection to the Dask scheduler at {address} was lost; run the same command again, with another "
                "scheduler or none. Finished jobs are kept."
            ) from None
        except RuntimeError as error:
            if "deserialization" not in str(error):
                raise
            raise JobError(
                f"the Dask cluster at {address} cannot load the jobs ({error.__cause__ or error}). Install "
                "the same version of this package where the scheduler and its workers run."
            ) from error
        finally:
            pool.shutdown(wait=False)  # without waiting for running jobs after a failure


@contextmanager
def cpu_limit(seconds: float) -> Iterator[None]:
    """Let the system kill this worker process if the block takes more processor time; no limit in other processes.

    A library that hangs on damaged bytes never returns to Python, where it could be interrupted.
    """
    try:
        import resource  # noqa: PLC0415 - exists on POSIX only
    except ImportError:
        resource = None  # type: ignore[assignment]
    if resource is None or parent_process() is None:
        yield
        return
    before, times = resource.getrlimit(resource.RLIMIT_CPU), os.times()
    most = math.ceil(times.user + times.system + seconds)
    resource.setrlimit(
        resource.RLIMIT_CPU, (most if before[1] == resource.RLIM_INFINITY else min(most, before[1]), before[1])
    )
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, before)


# ---- lock and progress -------------------------------------------------------------------------------------


@contextmanager
def locked(folder: Path, *, wait: bool = False) -> Iterator[None]:
    """Lock the folder against other runs, or wait for one to end; the lock is released when its process ends."""
    if os.name != "posix":  # no lock elsewhere: the user must avoid simultaneous runs
        yield
        return
    import fcntl  # noqa: PLC0415 - exists on POSIX only

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise JobError(f"another run is using {folder}; wait until it ends, or stop it.") from None
        try:
            yield
        finally:
            fcntl.flock(descriptor, fcntl.LOCK_UN)  # explicitly, as a process forked meanwhile holds a copy
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

"""A Dask cluster of separate processes on this machine, and jobs for it and for processes of our own."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
START_S = 300  # on a busy machine


def write_item(item, path):
    """Write the item, whole or not at all, as jobs have to."""
    part = path.with_suffix(".part")
    part.write_text(f"item {item}")
    part.replace(path)


def write_threads(_item, path):
    """Write how many threads linear algebra may use."""
    path.write_text(os.environ.get("OMP_NUM_THREADS", "any"))


def write_nothing(_item, _path):
    """Behave like a worker whose disk is another one."""


def fail_at_three(item, path):
    if item == 3:
        raise ValueError("three is too many")
    write_item(item, path)


def die(_item, _path):
    os._exit(9)


def die_at_three(item, path):
    if item == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    write_item(item, path)


def die_once(item, path):
    """Die as one that is killed from outside: no second time."""
    if item == 3 and not (path.parent.parent / "died").exists():
        (path.parent.parent / "died").touch()
        os._exit(9)
    write_item(item, path)


def die_at_record(_gearbox, _settings, _source, _path):
    """Do what a record does that crashes the library which reads it."""
    os.kill(os.getpid(), signal.SIGKILL)


def die_at_start():
    os._exit(9)


def note_and_sleep(_item, path):
    (path.parent.parent / f"worker {os.getpid()}").touch()
    time.sleep(60)


@contextmanager
def dask_cluster(folder, workers=1, *, nanny=False, failures=None):
    """Run a scheduler and workers, each a process of its own, and yield the scheduler's address.

    A nanny starts its worker again when it dies; then one death is enough for the scheduler to give a job up, or
    `failures` and one.
    """
    where = folder / "scheduler.json"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    environment["DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES"] = str(
        (0 if nanny else 3) if failures is None else failures
    )

    def start(*words):
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *words, "--scheduler-file", str(where), "--no-dashboard"],
            cwd=folder,
            env=environment,
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    processes = [start("scheduler", "--host", "127.0.0.1", "--port", "0")]
    try:
        # Without a nanny each is one process.
        nurse = "--nanny" if nanny else "--no-nanny"
        processes += [start("worker", nurse, "--nthreads", "1", "--host", "127.0.0.1") for _ in range(workers)]
        address = _answered(where, workers)
        yield address
    finally:
        for process in processes:
            os.killpg(process.pid, signal.SIGKILL)  # at once: asked politely, they take several seconds
            process.wait(START_S)


def _answered(where, workers):
    from dask.distributed import Client  # noqa: PLC0415 - an optional part

    until = time.monotonic() + START_S
    while not where.exists() or not where.read_text().strip():
        assert time.monotonic() < until, "the scheduler did not start"
        time.sleep(0.05)
    address = json.loads(where.read_text())["address"]
    with Client(address, timeout=START_S, set_as_default=False) as client:
        client.wait_for_workers(workers, timeout=START_S)
    return address

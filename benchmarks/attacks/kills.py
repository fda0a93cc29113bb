"""Writers and fleets killed at random instants: whole files, nothing lost, nothing left behind."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import hums
from attacks.damaged_files import small_analysis
from hums.fleet.watched_machines import read_state, write_state
from hums.jobs import Job, Processes, run_jobs
from hums.records.store import open_tree, write_tree

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

LONGEST_S = 0.03  # until a save is killed: that of a record takes about that
JOBS = 40
WRITERS = ("record", "analysis", "state")


def _writer(kind: str, folder: Path) -> tuple[list[Any], Callable[[Any, Path], None]]:
    """Return two things to write by turns, and how one is written."""
    if kind == "record":
        return [
            hums.make_record({"a": np.full(200_000, k)}, rate_hz=1000, units="g", angle=hums.UnknownAngle())
            for k in (1.0, 2.0)
        ], hums.save_record
    analyses = [small_analysis(seed) for seed in (1, 2)]
    if kind == "analysis":
        few = [{where: one[where].to_dataset() for where in ("/health", "/speed", "/gears")} for one in analyses]
        return [xr.DataTree.from_dict(groups) for groups in few], write_tree
    states = []
    for number, analysis in enumerate(analyses):
        hums.watch(analysis, folder / f"{number}.state")
        states.append(read_state(folder / f"{number}.state"))
    return states, write_state


def _contents(kind: str, path: Path) -> Any:  # noqa: ANN401 - a record, a tree or bytes
    if kind == "state":
        read_state(path)
        return path.read_bytes()
    with hums.open_record(path) if kind == "record" else open_tree(path) as opened:
        return opened.load()


def kill_saves(folder: Path, *, count: int, kind: str = "record", seed: int = 20) -> list[str]:
    """Kill a process that saves one file over another `count` times; return what went wrong."""
    folder.mkdir(exist_ok=True)
    rng, wrong, path = np.random.default_rng([seed, WRITERS.index(kind)]), [], folder / f"saved {kind}"
    things, write = _writer(kind, folder)
    calm = []
    for thing in things:
        write(thing, path)
        calm.append(_contents(kind, path))
    for _ in range(count):
        child = os.fork()
        if child == 0:
            for turn in range(1000):
                write(things[turn % 2], path)
            os._exit(0)
        time.sleep(rng.uniform(0, LONGEST_S))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        found = _contents(kind, path)
        if not any(found == one if kind == "state" else found.identical(one) for one in calm):
            wrong.append(f"a saved {kind} is neither the old nor the new one")
    write(things[0], path)
    wrong += [f"{part.name} was left behind" for part in folder.glob(".hums-*")]
    return wrong


def slow_job(item: int, path: Path) -> None:
    """Note the process, and write the item after a while."""
    (path.parent.parent / "pids" / str(os.getpid())).touch()
    time.sleep(0.02)
    part = path.with_suffix(".part")
    part.write_text(str(item), encoding="ascii")
    part.replace(path)


def kill_workers(folder: Path, *, count: int, seed: int = 20) -> tuple[int, list[str]]:
    """Kill workers of runs of jobs at random instants; return how many died, and what went wrong."""
    rng, wrong, killed = np.random.default_rng(seed), [], 0
    for run in range(count):
        out, pids = folder / str(run) / "out", folder / str(run) / "pids"
        out.mkdir(parents=True)
        pids.mkdir()
        over = threading.Event()

        def kill(pids: Path = pids, over: threading.Event = over, wait_s: float = rng.uniform(0.0, 0.2)) -> None:
            nonlocal killed
            while not over.is_set() and not any(pids.iterdir()):
                time.sleep(0.01)
            time.sleep(wait_s)
            for pid in pids.iterdir():
                if not over.is_set():
                    os.kill(int(pid.name), signal.SIGKILL)
                    killed += 1
                    return

        killer = threading.Thread(target=kill)
        killer.start()
        jobs = [Job(name=f"{item}.txt", item=item) for item in range(JOBS)]
        blamed: list[str] = []
        run_jobs(
            slow_job,
            jobs,
            folder=out,
            workers=Processes(count=2),
            when_killed=lambda _, path, to=blamed: to.append(path.name),
        )
        over.set()
        killer.join()
        texts = {path.name: path.read_text(encoding="ascii") for path in out.iterdir()}
        if blamed or texts != {f"{item}.txt": str(item) for item in range(JOBS)}:
            wrong.append(f"run {run}: {len(texts)} of {JOBS} files, blamed {blamed}")
    return killed, wrong

"""Fleets and datasets under load: killed at random instants, with a scheduler or input that is lost, two at once."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import hums

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ROOT = Path(__file__).resolve().parents[2]
FEW = 20  # records of the loads that need no more
DIFFERENT = 5  # records; the others are copies of them
LONGEST_S = 2.0  # between the start of a run, or a kill, and the next kill
PATIENCE_S = 900
FLEET = """\
import sys
import hums
if __name__ == "__main__":
    settings = hums.AnalysisSettings(pictures=False, most_tracks=0, envelope_band_hz=None)
    workers = hums.Cluster(address=sys.argv[3]) if len(sys.argv) > 3 else hums.Processes(count=2)
    try:
        box = hums.load_gearbox("two-stage")
        hums.analyze_fleet([sys.argv[1]], box, sys.argv[2], settings=settings, workers=workers)
    except (ValueError, OSError) as error:
        sys.exit(f"SENTENCE {error}")
"""
DATASET = """\
import sys
import data_synth
if __name__ == "__main__":
    try:
        data_synth.make_dataset(sys.argv[1], sys.argv[2])
    except (ValueError, OSError) as error:
        sys.exit(f"SENTENCE {error}")
"""
PLAN = """\
records = 8
seed = 1
records_per_shard = 1
class = [{ name = "healthy" }]
[scene]
gearbox = "two-stage"
rate_hz = 2000
duration_s = 1
fidelity = "kinematic"
speed = { link = "input", rpm = 600 }
tachometer = { link = "input", pulses_per_rev = 1 }
resonance = { frequency_hz = 500, damping_ratio = 0.05 }
sensor = [{ name = "vib", on = "output", units = "g" }]
"""


def make_records(folder: Path, count: int) -> Path:
    """Write `count` small records, copies of a few different ones."""
    folder.mkdir(parents=True)
    for seed in range(DIFFERENT):
        noise = np.random.default_rng(seed).normal(size=2000)
        record = hums.make_record(
            {"a": noise}, rate_hz=2000, units="g", angle=hums.NominalSpeed(rpm=1200, shaft="input"), machine="mill",
            recorded_at=f"2026-01-0{seed + 1}T00:00:00Z",
        )  # fmt: skip
        hums.save_record(record, folder / f"{seed}.h5")
    for number in range(DIFFERENT, count):
        shutil.copyfile(folder / f"{number % DIFFERENT}.h5", folder / f"{number}.h5")
    return folder


class Run:
    """A script in a session of its own."""

    def __init__(self, script: Path, *words: object) -> None:
        environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(  # noqa: S603 - our own scripts
            [sys.executable, "-W", "ignore", script, *map(str, words)],
            env=environment, cwd=script.parent, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip

    def members(self) -> list[int]:
        """Return the processes of the session."""
        found = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == self.process.pid and fields[0] != "Z":
                found.append(int(stat.parent.name))
        return found

    def wait(self) -> str:
        """Return what it said, empty if all went well."""
        text, _ = self.process.communicate(timeout=PATIENCE_S)
        if self.process.returncode == 0:
            return ""
        return text.strip() or f"ended with {self.process.returncode}"

    def end(self) -> None:
        """Kill all that is left of it."""
        for member in self.members():
            try:
                os.kill(member, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.process.communicate()


def table(folder: Path, records: Path) -> str:
    """Return the table of a fleet, without the folder of its records."""
    return (folder / "fleet.csv").read_text(encoding="utf-8").replace(str(records), "")


def kill_fleet(
    script: Path,
    records: Path,
    out: Path,
    *words: str,
    kills: int,
    rng: np.random.Generator,
    victims: Callable[[Run], list[int]] = lambda run: run.members(),
) -> int:
    """Run a fleet until it is done, killing one of its processes again and again; return how many died."""
    killed = 0
    run = Run(script, records, out, *words)
    while killed < kills:
        time.sleep(rng.uniform(0.05, LONGEST_S))
        members = victims(run)
        if run.process.poll() is not None:
            run.end()
            for path in sorted(out.rglob("*.json.gz"))[::2]:  # more to do: half of it again
                path.unlink()
            run = Run(script, records, out, *words)
        elif members:
            try:
                os.kill(members[int(rng.integers(len(members)))], signal.SIGKILL)
            except ProcessLookupError:
                continue
            killed += 1
    run.wait()
    run.end()
    said = Run(script, records, out, *words).wait()
    if said:
        raise RuntimeError(said[-300:])
    return killed


def nursed_workers(folder: Path) -> list[int]:
    """Return the workers that nannies started of a cluster with its scheduler file in `folder`."""
    parents, commands = {}, {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            stat = (process / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
            words = (process / "cmdline").read_bytes()
        except OSError:
            continue
        parents[int(process.name)], commands[int(process.name)] = int(stat[1]), words
    nannies = {
        number for number, words in commands.items()
        if b"\0worker\0" in words and str(folder / "scheduler.json").encode() in words
    }  # fmt: skip
    return [number for number, parent in parents.items() if parent in nannies and b"spawn_main" in commands[number]]


def attack_fleets(folder: Path, *, records: int, kills: int, seed: int = 20) -> tuple[list[str], list[str]]:
    """Return a row of a table for each load, and sentences on what went wrong."""
    rng, wrong = np.random.default_rng(seed), []
    folder.mkdir(parents=True)
    script, dataset = folder / "fleet.py", folder / "dataset.py"
    script.write_text(FLEET, encoding="utf-8")
    dataset.write_text(DATASET, encoding="utf-8")
    sources = make_records(folder / "records", records)
    few = make_records(folder / "few", FEW)
    calm = {}
    for where in (sources, few):
        if said := Run(script, where, folder / f"calm {where.name}").wait():
            return [], [f"undisturbed: {said[-300:]}"]
        calm[where] = table(folder / f"calm {where.name}", where)

    def check(name: str, out: Path, said: str = "", *, of: Path = few) -> bool:
        if said:
            wrong.append(f"{name}: {said[-300:]}")
        elif table(out, of) != calm[of]:
            wrong.append(f"{name}: another table")
        left = [path.name for path in out.rglob(".hums-*")]
        if left:
            wrong.append(f"{name}: {left[0]} was left behind")
        return not said and not left

    rows = []
    begun = time.perf_counter()

    def row(name: str, what: str) -> None:
        nonlocal begun
        rows.append(f"| {name} | {what} | {time.perf_counter() - begun:.0f} |")
        begun = time.perf_counter()

    row("undisturbed", f"{records} records, and {FEW}, which the loads below have")
    killed = kill_fleet(script, sources, folder / "killed", kills=kills, rng=rng)
    check("killed", folder / "killed", of=sources)
    row("its processes killed (-9)", f"{killed} killed, {records} records")
    for name, outcome in chain(
        _others(script, dataset, few, folder, check),
        _on_a_cluster(script, few, folder, check, kills=kills, rng=rng),
    ):
        row(name, outcome)
        if outcome.startswith("wrong"):
            wrong.append(f"{name}: {outcome}")
    return rows, wrong


def _others(
    script: Path, dataset: Path, sources: Path, folder: Path, check: Callable[..., bool]
) -> Iterator[tuple[str, str]]:
    two = [Run(script, sources, folder / "both") for _ in range(2)]
    said = [text for text in (run.wait() for run in two) if text]
    refused = [text for text in said if "another run is at work" in text]
    check("two fleets at once", folder / "both", "".join(text for text in said if text not in refused))
    yield "two fleets in one folder at once", f"{len(refused)} refused in a sentence"

    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    calm = Run(dataset, folder / "plan.toml", folder / "data").wait()
    two = [Run(dataset, folder / "plan.toml", folder / "data twice") for _ in range(2)]
    said = [text for text in (run.wait() for run in two) if text]
    refused = [text for text in said if "another run is at work" in text]
    whole = all(
        (folder / "data twice" / path.relative_to(folder / "data")).read_bytes() == path.read_bytes()
        for path in (folder / "data").rglob("*") if path.is_file()
    )  # fmt: skip
    problem = calm or "".join(text for text in said if text not in refused) or ("" if whole else "other files")
    yield (
        "two datasets in one folder at once",
        f"wrong: {problem[-200:]}" if problem else f"{len(refused)} refused in a sentence",
    )

    (folder / "real").mkdir()
    (folder / "link").symlink_to(folder / "real", target_is_directory=True)
    check("linked", folder / "link", Run(script, sources, folder / "link").wait())
    yield "output folder that is a link", "the same table"

    for path in (folder / "link").rglob("*"):
        moment = 4e9 if path.stat().st_ino % 2 else 1.0  # 2096 and 1970
        os.utime(path, (moment, moment), follow_symlinks=False)
    check("clock", folder / "link", Run(script, sources, folder / "link").wait())
    yield "clock that jumped: files of 1970 and 2096", "the same table"

    said = Run(script, sources, "/proc/fleet").wait()
    yield "output that cannot be written", _sentence(said)

    fewer = make_records(folder / "vanishing", FEW)
    run = Run(script, fewer, folder / "fewer")
    _first_result(folder / "fewer")
    gone = sorted(fewer.glob("*.h5"))[-FEW // 4 :]
    for path in gone:
        path.unlink()
    said = run.wait()
    lines = (folder / "fewer" / "fleet.csv").read_text(encoding="utf-8").splitlines() if not said else []
    errors = sum("there is no such file" in line for line in lines)
    yield (
        "input that vanishes",
        f"wrong: {said[-200:]}" if said else f"{len(lines) - 1} rows of {FEW}, {errors} with a sentence",
    )


def _first_result(out: Path) -> None:
    """Wait until a fleet has analysed one of its records."""
    until = time.monotonic() + PATIENCE_S
    while not list(out.rglob("*.json.gz")) and time.monotonic() < until:
        time.sleep(0.02)


def _sentence(said: str) -> str:
    found = re.search(r"^SENTENCE (.*)", said, flags=re.MULTILINE | re.DOTALL)
    return f"a sentence: {found[1].strip()[:120]}" if found and "Traceback" not in found[1] else f"wrong: {said[-200:]}"


def _on_a_cluster(
    script: Path,
    sources: Path,
    folder: Path,
    check: Callable[..., bool],
    *,
    kills: int,
    rng: np.random.Generator,
) -> Iterator[tuple[str, str]]:
    try:
        import dask.distributed  # noqa: F401, PLC0415 - an optional part
    except ImportError:
        yield "a local Dask cluster", "not tried: Dask is not installed"
        return
    sys.path.append(str(ROOT / "tests"))
    from clusters import dask_cluster  # noqa: PLC0415

    (folder / "cluster").mkdir()
    with dask_cluster(folder / "cluster", workers=2) as address:
        check("cluster", folder / "on cluster", Run(script, sources, folder / "on cluster", address).wait())
    yield "a local Dask cluster of two workers", "the same table"

    (folder / "struck").mkdir()
    with dask_cluster(folder / "struck", workers=2, nanny=True, failures=10) as address:
        out = folder / "struck out"
        killed = kill_fleet(
            script, sources, out, address, kills=kills, rng=rng, victims=lambda _: nursed_workers(folder / "struck")
        )
        check("workers of a cluster killed", out)
    yield "workers of a local Dask cluster killed (-9), each started again", f"{killed} killed, the same table"

    (folder / "lost").mkdir()
    with dask_cluster(folder / "lost", workers=1) as address:
        run = Run(script, sources, folder / "lost out", address)
        _first_result(folder / "lost out")
        for command in Path("/proc").glob("[0-9]*/cmdline"):
            try:
                words = command.read_bytes().split(b"\0")
            except OSError:
                continue
            if b"scheduler" in words and str(folder / "lost" / "scheduler.json").encode() in words:
                os.kill(int(command.parent.name), signal.SIGKILL)
        try:
            said = run.process.communicate(timeout=120)[0]
        except subprocess.TimeoutExpired:
            said = "still waiting after 120 s"
            run.end()
    again = Run(script, sources, folder / "lost out").wait()
    check("scheduler lost", folder / "lost out", again)
    yield "scheduler lost, then run again on processes", _sentence(said)

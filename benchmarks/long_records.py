"""Records that are long, wide, or never end: python benchmarks/long_records.py [FOLDER] [--kept FOLDER].

Writes long_records.md into FOLDER (default docs/benchmarks). Each row is a process of its own; what it measures is kept
in --kept, if named: a run that was stopped goes on there.
"""

import argparse
import gc
import hashlib
import json
import os
import pickle
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from attacks.parts import kept_or_made

import hums
from signals.harmonics import OrderTracker

SAMPLES = 100_000_000  # 50 minutes at 33 kHz
BLOCKS = 86_400  # of a second each: a day
WATCHED = 10_000  # of them: nearly three hours, as each costs more
WIDE_SAMPLES, CHANNELS = 1_000_000, (1, 4, 32)
RATE_HZ, TURN_HZ, MESH = 33_333, 20.0, 16
STREAM_RATE_HZ = 1000
QUARTERS = 4
AFTER = 1000  # blocks for which a stopped watch is repeated
ANALYSES = 10  # different ones that a watch sees by turns
CALM = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
GEARBOX = "wijianto-pair"


PAGE = """\
# Long and wide records

Made by `python benchmarks/long_records.py`. Each row is a separate process with one thread; seconds are CPU time.

## Records

A mesh line in noise, float32 at {rate_hz} Hz, one pulse per revolution; read from its file and analysed without plots.
Above 4,000,000 samples per channel the record is analysed in segments, whose spectra are averaged.

| samples per channel | channels | s | µs per sample | peak memory, GB |
|---|---|---|---|---|
{rows}

## Streams

`OrderTracker`: two orders at {stream_rate_hz} Hz; pickled and loaded halfway, and every output of the second half is
compared with that of an uninterrupted tracker. `hums.watch`: analyses of one second; another process repeats the last
{after:,} from the saved state, and the state files, of {state_kb:.0f} kB, are compared.

| stream | blocks of one second | ms per block, by quarter | memory after each, MB | bit-identical |
|---|---|---|---|---|
{tracked}
{watched}
"""


def samples(count: int, seed: int) -> np.ndarray:
    """Return a mesh line in noise, in single precision."""
    rng, x = np.random.default_rng(seed), np.empty(count, dtype=np.float32)
    for start in range(0, count, 1_000_000):
        t = np.arange(start, min(count, start + 1_000_000)) / RATE_HZ
        x[start : start + t.size] = 0.5 * np.cos(2 * np.pi * MESH * TURN_HZ * t) + rng.normal(0, 0.1, t.size)
    return x


def make(path: Path, count: int, channels: int) -> dict[str, float]:
    """Save a record; its channels are copies of one, so that memory here does not count."""
    x = samples(count, 0)
    pulses = hums.PulseTimes(times_s=np.arange(0, count / RATE_HZ, 1 / TURN_HZ), shaft="input", pulses_per_rev=1)
    record = hums.make_record({f"c{number}": x for number in range(channels)}, rate_hz=RATE_HZ, units="g", angle=pulses)
    hums.save_record(record, path)
    return {}


def analyse(path: Path) -> dict[str, float]:
    """Analyse a record from its file; return processor time and the most memory of this process."""
    box, begun = hums.load_gearbox("two-stage"), time.process_time()
    with hums.open_record(path) as record:
        before = _most_bytes()
        hums.analyze(record, box, settings=hums.AnalysisSettings(pictures=False))
    return {
        "cpu_s": time.process_time() - begun, "before": before, "most": _most_bytes(),
    }  # fmt: skip


def track(folder: Path, blocks: int) -> dict[str, object]:
    """Track two orders in a stream, stopped and restarted in its middle beside the one that goes on."""
    tracker = OrderTracker(orders=[1, MESH], noise_variance=0.01, bandwidth_hz=0.5, rate_hz=STREAM_RATE_HZ)
    again: OrderTracker | None = None
    digests = [hashlib.sha256(), hashlib.sha256()]
    seconds, most, begun = [], [], time.process_time()
    for number in range(blocks):
        if 2 * number == blocks:
            (folder / "tracker").write_bytes(pickle.dumps(tracker))
            again = pickle.loads((folder / "tracker").read_bytes())  # noqa: S301 - its own
        t = (number * STREAM_RATE_HZ + np.arange(STREAM_RATE_HZ)) / STREAM_RATE_HZ
        turn = 2 * np.pi * TURN_HZ * t
        x = 0.5 * np.cos(MESH * turn) + np.random.default_rng(number).normal(0, 0.1, t.size)
        found = tracker.update(x, phase_rad=turn)
        if again is not None:
            since = time.process_time()
            other = again.update(x, phase_rad=turn)
            for digest, one in zip(digests, (found, other), strict=True):
                digest.update(one.complex_amplitude.tobytes() + one.std.tobytes())
            begun += time.process_time() - since  # of the proof, not of the stream
        if (number + 1) % (blocks // QUARTERS) == 0:
            seconds.append(time.process_time() - begun)
            most.append(_held_bytes())
            begun = time.process_time()
    return {"seconds": seconds, "most": most, "equal": digests[0].digest() == digests[1].digest()}


def watch(folder: Path, blocks: int) -> dict[str, object]:
    """Watch a machine of which a second is analysed at a time; the last blocks are watched twice, in two processes."""
    analyses = _watched()
    state, seconds, most, begun = folder / "mill.state", [], [], time.process_time()
    for number in range(blocks):
        if number == blocks - AFTER:
            shutil.copyfile(state, folder / "stopped.state")
        _watch_one(analyses, number, state)
        if (number + 1) % (blocks // QUARTERS) == 0:
            seconds.append(time.process_time() - begun)
            most.append(_held_bytes())
            begun = time.process_time()
    part("resume", folder, blocks)
    equal = (folder / "stopped.state").read_bytes() == state.read_bytes()
    return {"seconds": seconds, "most": most, "equal": equal, "state": state.stat().st_size}


def resume(folder: Path, blocks: int) -> dict[str, object]:
    """Go on from the state that a stopped watch left."""
    analyses = _watched()
    for number in range(blocks - AFTER, blocks):
        _watch_one(analyses, number, folder / "stopped.state")
    return {}


def _watched() -> list[hums.Analysis]:
    box = hums.load_gearbox(GEARBOX)
    angle = hums.NominalSpeed(rpm=60 * TURN_HZ, shaft=box.reference)
    records = [
        hums.make_record({"housing": samples(4000, seed)}, rate_hz=4000, units="g", angle=angle, machine="mill")
        for seed in range(ANALYSES)
    ]
    settings = hums.AnalysisSettings(pictures=False, most_tracks=0)
    return [hums.analyze(record, box, settings=settings) for record in records]


def _watch_one(analyses: list[hums.Analysis], number: int, state: Path) -> None:
    analysis = analyses[int(np.random.default_rng(number).integers(ANALYSES))]
    analysis.attrs["recorded_at"] = (datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=number)).isoformat()
    hums.watch(analysis, state, settings=hums.MonitorSettings(baseline_records=50))


def _most_bytes() -> int:
    # ru_maxrss would be that of the parent where that was larger: getrusage(2)
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024 * next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


def _held_bytes() -> int:
    gc.collect()
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * resource.getpagesize()


PARTS: dict[str, Callable[..., dict[str, object]]] = {
    "make": make, "analyse": analyse, "track": track, "watch": watch, "resume": resume,
}  # fmt: skip


def part(name: str, folder: Path, *numbers: int) -> dict[str, object]:
    """Return what a part finds in a process of its own."""
    words = [sys.executable, "-W", "ignore", __file__, "part", name, str(folder), *map(str, numbers)]
    done = subprocess.run(words, env=os.environ | CALM, capture_output=True, text=True, check=True)  # noqa: S603
    return dict(json.loads(done.stdout))


def _analysed(folder: Path, count: int, channels: int) -> dict[str, object]:
    path = folder / f"{count}-{channels}.h5"
    part("make", path, count, channels)
    found = part("analyse", path)
    path.unlink()
    return found


def _analysed_row(found: dict[str, object], count: int, channels: int) -> str:
    return (
        f"| {count:.3g} | {channels} | {found['cpu_s']:.0f} | "
        f"{found['cpu_s'] / count / channels * 1e6:.2f} | {found['most'] / 1e9:.2f} |"
    )


def _streamed(name: str, found: dict[str, object], blocks: int) -> str:
    each = ", ".join(f"{1000 * s / (blocks // QUARTERS):.2f}" for s in found["seconds"])
    held = ", ".join(f"{one / 1e6:.0f}" for one in found["most"])
    return f"| {name} | {blocks:,} | {each} | {held} | {'yes' if found['equal'] else 'NO'} |"


def main(folder: Path, kept: Path | None) -> int:
    """Write the page; return 1 where a stream that was stopped went on otherwise."""
    sizes = [(size, 1) for size in (SAMPLES // 25, SAMPLES // 10, SAMPLES // 3, SAMPLES)]
    sizes += [(WIDE_SAMPLES, channels) for channels in CHANNELS]
    with tempfile.TemporaryDirectory() as scratch:
        there = Path(scratch)
        kept = kept or there / "kept"
        kept.mkdir(parents=True, exist_ok=True)
        tracked = kept_or_made(kept, "tracked", lambda: part("track", there, BLOCKS))
        rows = [
            _analysed_row(kept_or_made(kept, f"{size[0]} {size[1]}", lambda size=size: _analysed(there, *size)), *size)
            for size in sizes
        ]
        watched = kept_or_made(kept, "watched", lambda: part("watch", there, WATCHED))
    page = PAGE.format(
        rate_hz=RATE_HZ, stream_rate_hz=STREAM_RATE_HZ, after=AFTER, state_kb=watched["state"] / 1000,
        rows="\n".join(rows), tracked=_streamed("`OrderTracker`", tracked, BLOCKS),
        watched=_streamed("`hums.watch`", watched, WATCHED),
    )  # fmt: skip
    (folder / "long_records.md").write_text(page, encoding="utf-8")
    print(page)  # noqa: T201 - what the command is for
    return int(not (tracked["equal"] and watched["equal"]))


if __name__ == "__main__":
    if sys.argv[1:2] == ["part"]:
        print(json.dumps(PARTS[sys.argv[2]](Path(sys.argv[3]), *map(int, sys.argv[4:]))))  # noqa: T201
        sys.exit()
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", nargs="?", type=Path, default=Path("docs/benchmarks"))
    options.add_argument("--kept", type=Path)
    given = options.parse_args()
    sys.exit(main(given.folder, given.kept))

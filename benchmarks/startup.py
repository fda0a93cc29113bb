"""How long the commands take, and how much memory: python benchmarks/startup.py [FOLDER].

Writes startup.md into FOLDER (default docs/benchmarks). Every figure is of processes of their own, one thread each.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from statistics import median
from tempfile import TemporaryDirectory
from textwrap import wrap

import numpy as np
from numpy.typing import NDArray
from page_files import folder_given, table, write_page

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
REPEATS = 3  # of each figure
PROCESSES, ROUNDS = 5, 9  # that analyse, and analyses in each whose ratio to the unit is taken
SAMPLES = 20_000_000  # of the long record
_KEPT_BYTES = 32_000_000  # just below the most by which glibc's allocator learns what it is to keep (mallopt(3))
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed program keeps its compiled modules

NOTE = """\
Made by `python benchmarks/startup.py`, one thread. Times are CPU times, user and system, the minimum of {repeats} runs
(of one for the first demo, with an empty folder of compiled kernels). {analysis}
The long record: {samples:,} samples of float32 in one channel, one pulse per revolution, analysed without tracks;
memory is the peak of the process, including interpreter and imports. A read is one of all samples of the channel.
The saved record has two channels of 2,560 samples and is written atomically. If dask is installed (extras `dask`
and `test`), xarray imports it, about 0.2 s per command."""

OF_ANALYSIS = """\
The analysis is that of an open record without imports and report, in units of one `numpy.fft.rfft` of as many float64
samples. This call takes twice as long if the allocator returned the pages of its result and work arrays after the
previous one, so that they are mapped again: 1,900 pages of some 2 us each for 500,000 samples. Which case applies
depends on the history of the process and often persists until its end; a ratio to calls in the analysing process is
therefore one of two numbers. The unit is the transform alone: into an existing array, in a process that does nothing
else and retains its memory, counted only if no page was mapped. The time of an analysis includes that for its own
pages. Both are measured alternately, an analysis and five transforms, {rounds} times after a warm-up; the figure is the
median of their ratios in a process, and of {processes} processes, with the range in brackets."""

ANALYSIS = """
import sys, time
from hums import AnalysisSettings, analyze, load_gearbox, open_record

gearbox = load_gearbox("two-stage")
settings = {"tracked": AnalysisSettings(), "untracked": AnalysisSettings(most_tracks=0)}
with open_record(sys.argv[1]) as record:
    for line in sys.stdin:
        start = time.process_time()
        analyze(record, gearbox, settings=settings[line.strip()])
        print(time.process_time() - start, flush=True)
"""

MILLION = """
import sys
from data_synth import load_scene, simulate
from hums import save_record

save_record(simulate(load_scene("demo").changed(duration_s=20.0), seed=1), sys.argv[1])
"""

LONG = """
import sys
import numpy as np
from hums import PulseTimes, make_record, save_record

count, rate_hz, turns_s = int(sys.argv[2]), 50_000.0, 20.0
rng, x = np.random.default_rng(1), np.empty(count, dtype=np.float32)
for first in range(0, count, 1 << 20):
    t = np.arange(first, min(first + (1 << 20), count)) / rate_hz
    ringing = np.exp(-40 * (t * turns_s * 8.1 % 1)) * np.cos(2 * np.pi * 8000 * t)
    meshes = sum(np.cos(2 * np.pi * order * turns_s * t) for order in (23, 46, 69))
    x[first : first + t.size] = meshes + ringing + 0.1 * rng.standard_normal(t.size)
pulses = PulseTimes(times_s=np.arange(0.001, count / rate_hz, 1 / turns_s), shaft="input", pulses_per_rev=1)
save_record(make_record({"case": x}, rate_hz=rate_hz, units="g", angle=pulses), sys.argv[1])
"""

MEMORY = """
import json, sys
import xarray
from hums import AnalysisSettings, analyze, load_gearbox, open_record

read, values = [0], xarray.DataArray.values

def counted(array):
    read[0] += array.size if array.name == "case" else 0
    return values.fget(array)

xarray.DataArray.values = property(counted, values.fset)
with open_record(sys.argv[1]) as record:
    analyze(record, load_gearbox("two-stage"), settings=AnalysisSettings(most_tracks=0))
    reads = read[0] / record["case"].size
with open("/proc/self/status") as status:  # ru_maxrss would be that of the parent where that was larger: getrusage(2)
    kilobytes = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
print(json.dumps({"reads": reads, "memory": 1.024e-3 * kilobytes}))
"""

SAVING = """
import json, sys, time
import numpy as np
from hums import PulseTimes, make_record, save_record

rng = np.random.default_rng(1)
pulses = PulseTimes(times_s=np.arange(0.01, 0.09, 0.01), shaft="input", pulses_per_rev=1)
channels = {"a": rng.standard_normal(2560), "b": rng.standard_normal(2560)}
record, taken = make_record(channels, rate_hz=25_600.0, units="g", angle=pulses), []
for _ in range(20):
    start = time.process_time()
    save_record(record, sys.argv[1])
    taken.append(time.process_time() - start)
print(json.dumps({"save": 1e3 * min(taken)}))
"""


@dataclass(frozen=True, kw_only=True)
class Target:
    """A figure, its unit, and what it may be at most."""

    figure: str
    what: str
    unit: str
    most: float


TARGETS = (
    Target(figure="first demo", what="`hums demo` for the first time", unit="s", most=20),
    Target(figure="demo", what="`hums demo` afterwards", unit="s", most=3.5),
    Target(figure="analyze", what="`hums analyze` of the demo's record", unit="s", most=3),
    Target(figure="demo tracked", what="analysis of the demo's record, tracks included", unit="rffts", most=100),
    Target(figure="demo untracked", what="as above, without tracks", unit="rffts", most=64),
    Target(figure="million tracked", what="analysis of 1e6 samples, tracks included", unit="rffts", most=100),
    Target(figure="million untracked", what="as above, without tracks", unit="rffts", most=64),
    Target(figure="memory", what="the long record: peak memory", unit="MB", most=1000),
    Target(figure="bytes", what="the long record: memory per sample", unit="bytes", most=50),
    Target(figure="reads", what="the long record: reads of its samples", unit="", most=3),
    Target(figure="save", what="saving a small record", unit="ms", most=10),
)


def unit_s(samples: Array, lines: NDArray[np.complex128]) -> float:
    """Return the time of one transform into memory that is there: the median of five that mapped no page."""
    taken: list[float] = []
    np.empty(_KEPT_BYTES // 8)  # an array that is freed: from then on smaller ones are kept
    for _ in range(100):
        mapped, start = getrusage(RUSAGE_SELF).ru_minflt, time.process_time()
        np.fft.rfft(samples, out=lines)
        seconds = time.process_time() - start
        if getrusage(RUSAGE_SELF).ru_minflt == mapped:
            taken.append(seconds)
        if len(taken) == 5:  # noqa: PLR2004
            return median(taken)
    raise RuntimeError(f"of 100 transforms of {samples.size} samples {100 - len(taken)} mapped pages anew.")


@dataclass(frozen=True, kw_only=True)
class Checkout:
    """A checkout of this project, and the folder in which its processes work and keep their compiled kernels."""

    root: Path
    room: Path

    @property
    def environment(self) -> dict[str, str]:
        """Variables of its processes."""
        own = {"PYTHONPATH": str(self.root), "NUMBA_CACHE_DIR": str(self.room / "kernels")}
        return {**os.environ, **ONE_THREAD, **own}

    def run(self, *words: str) -> tuple[float, str]:
        """Run Python; return processor time in s, and what it printed."""
        with subprocess.Popen(  # noqa: S603
            [sys.executable, *words], env=self.environment, cwd=self.room, stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None  # noqa: S101 - by its construction
            printed = process.stdout.read()
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise RuntimeError(f"{' '.join(words)[:200]} in {self.root} ended with {process.returncode}.")
        return usage.ru_utime + usage.ru_stime, printed

    def ratios(self, record: str, samples: int, rounds: int) -> dict[str, float]:
        """Return the cost of analyses of a record in transforms of so many samples, both measured in turn."""
        x, lines = np.random.default_rng(1).standard_normal(samples), np.empty(samples // 2 + 1, dtype=np.complex128)
        found: dict[str, float] = {}
        with subprocess.Popen(  # noqa: S603
            [sys.executable, "-c", ANALYSIS, record],
            env=self.environment,
            cwd=self.room,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdin is not None  # noqa: S101 - by its construction
            assert process.stdout is not None  # noqa: S101 - by its construction
            for name in ("tracked", "untracked"):
                ratios = []
                for _ in range(1 + rounds):
                    print(name, file=process.stdin, flush=True)
                    ratios.append(float(process.stdout.readline()) / unit_s(x, lines))
                found[name] = median(ratios[1:])
            process.stdin.close()
        return found

    def figures(self, code: str, *words: str) -> dict[str, float]:
        """Run code that prints figures as JSON; return them."""
        return dict(json.loads(self.run("-c", code, *words)[1]))


def measure(checkout: Checkout) -> dict[str, float]:
    """Return all figures of one round but that of the first demo."""
    found = {"demo": checkout.run("-m", "hums", "demo", "-o", "demo")[0]}
    words = ("-m", "hums", "analyze", "demo/record.h5", "--gearbox", "two-stage", "-o", "analysis")
    found["analyze"] = checkout.run(*words)[0]
    long = checkout.room / "long.h5"
    if not long.exists():
        checkout.run("-c", LONG, str(long), str(SAMPLES))
    read = checkout.figures(MEMORY, str(long))
    return found | read | {"bytes": read["memory"] * 1e6 / SAMPLES} | checkout.figures(SAVING, "s.h5")


def measure_analyses(checkout: Checkout) -> dict[str, float]:
    """Return the cost of an analysis of the demo's record and of one twice as long, in a process of its own each."""
    million = checkout.room / "million.h5"
    if not million.exists():
        checkout.run("-c", MILLION, str(million))
    records = {"demo": ("demo/record.h5", 500_000), "million": (str(million), 1_000_000)}
    return {
        f"{name} {setting}": ratio
        for name, (record, samples) in records.items()
        for setting, ratio in checkout.ratios(record, samples, ROUNDS).items()
    }


def report(found: Mapping[str, float], ratios: Sequence[Mapping[str, float]]) -> list[str]:
    """Return the page, a row for each figure; of the ratios of every process the median, the least and the largest."""
    analysis = OF_ANALYSIS.format(rounds=ROUNDS, processes=PROCESSES)
    note, rows = NOTE.format(repeats=REPEATS, samples=SAMPLES, analysis=analysis), []
    for target in TARGETS:
        if target.figure in found:
            value = found[target.figure]
            shown = f"{value:.3g}"
        else:
            each = [one[target.figure] for one in ratios]
            value = median(each)
            shown = f"{value:.0f} ({min(each):.0f} to {max(each):.0f})"
        what = f"{target.what}, {target.unit}" if target.unit else target.what
        rows.append((what, f"{target.most:g}", shown, "yes" if value <= target.most else "**no**"))
    head = ("figure", "at most", "measured", "reached")
    return ["# Start, run and memory", "", *wrap(note, 120), "", *table(head, rows)]


def main(folder: Path) -> None:
    """Measure, and write the table."""
    with TemporaryDirectory() as room:
        checkout = Checkout(root=ROOT, room=Path(room))
        first = {"first demo": checkout.run("-m", "hums", "demo", "-o", "demo")[0]}
        rounds = [measure(checkout) for _ in range(REPEATS)]
        ratios = [measure_analyses(checkout) for _ in range(PROCESSES)]
    least = {name: min(found[name] for found in rounds) for name in rounds[0]}
    write_page(folder / "startup.md", report(first | least, ratios))


if __name__ == "__main__":
    main(folder_given())

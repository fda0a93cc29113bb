"""Time against error of every way to resample over angle: python benchmarks/resampling.py [FOLDER].

Writes resampling.md and resampling.svg into FOLDER (default docs/benchmarks). The record is a tone of a shaft whose
speed swings by a tenth, 50 (1 + 0.1 sin(2 pi 0.5 t)) Hz, at 51.2 kHz, and its phase is known from one pulse a
revolution. finufft joins in where it is installed.
"""

import os

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )

import dataclasses
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from page_files import folder_given, table, write_page
from scipy import fft
from scipy.interpolate import CubicSpline
from tracking.clock import seconds

from hums.plots import save_figure
from hums.plots.style import FAINT, INK, LINE, MARK
from signals.resampling._engine import Map, Method, Warp
from signals.resampling._engine_kernels import invert
from signals.resampling.resampling import angle_map, angular_resample
from signals.shaft.phase import ShaftPhase

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]

RATE_HZ = 51_200.0
ORDERS = (1, 36, 200, 400)
SAMPLES_PER_REV = 1024
COARSE, FOLDING = 512, (313, 400)  # samples a revolution, and orders that fold onto those below 0.78 of half of them
EDGE = 64  # samples: reached by a filter from either end of a chunk

NOTE = """\
Made by `python benchmarks/resampling.py`, one thread: {samples:,} samples to 1,024 per revolution, at a speed at which
the record has 931 to 1,138. Time as a multiple of `np.interp` at the same positions, both timed alternately ({repeats}
times), ratio of medians, without compilation. Error: RMS of the difference from the exact signal at the exact angles
over the RMS of the signal, middle 90 %. "Whole": from the record and the shaft phase to the angular signal, including
the search for positions; "given": the positions, and those of the samples in angle, are known beforehand. The search
alone takes {places:.2f}.

The last columns: remainder of a tone that would alias onto orders below 200, at 512 samples per revolution.
"""


@dataclass(frozen=True, kw_only=True)
class Record:
    """The shaft, its phase, and where everything lies."""

    samples: int
    revolutions: Floats  # of the shaft at every sample
    phase: ShaftPhase

    @classmethod
    def made(cls, samples: int) -> "Record":
        """Make the shaft of the job, for this many samples."""
        t = np.arange(samples) / RATE_HZ
        turns = np.arange(np.floor(_turned(t[-1:])[0]) + 1.0)
        times = turns / 50
        for _ in range(6):  # Newton's method from within 0.07 s: squared each time
            times -= (_turned(times) - turns) / (50 + 5 * np.sin(np.pi * times))
        return cls(samples=samples, revolutions=_turned(t), phase=ShaftPhase(times_s=times, revolutions=turns))

    def tone(self, order: float) -> Floats:
        """Amplitude 1 at this order."""
        return np.asarray(np.cos(2 * np.pi * order * self.revolutions))

    def grid(self, samples_per_rev: int) -> Map:
        """Lay the samples on an angle grid."""
        whole = int(self.phase.revolutions[-1])
        return angle_map(
            self.phase,
            rate_hz=RATE_HZ,
            start_s=0.0,
            samples_per_rev=samples_per_rev,
            first=0.0,
            revolutions=whole,
        )


def _turned(t: Floats) -> Floats:
    return np.asarray(50 * t + 5 * (1 - np.cos(np.pi * t)) / np.pi)


@dataclass(frozen=True)
class Known:
    """A track whose values are at hand."""

    values: Floats
    slopes: Floats
    first: int = 0

    def at(self, first: int, last: int) -> tuple[Floats, Floats]:
        """Values and slopes from `first` up to and without `last`."""
        within = slice(first - self.first, last - self.first)
        return self.values[within], self.slopes[within]


def placed(grid: Map, samples: int) -> tuple[Floats, Floats]:
    """Places of all outputs among the samples, and the output rate over the input rate there."""
    q, slopes = grid.outward.at(0, samples)
    places, cuts = np.empty(grid.outputs), np.empty(grid.outputs)
    invert(q, slopes, 0.0, places, cuts)
    return places, cuts


@dataclass(frozen=True, kw_only=True)
class Choice:
    """One way to resample: from a record on a grid to a function of the samples."""

    name: str
    colour: str
    prepare: Callable[[Record, int], Callable[[Floats], Floats]]


def whole(method: Method) -> Choice:
    """Return what a user calls."""

    def prepare(record: Record, per_rev: int) -> Callable[[Floats], Floats]:
        return lambda x: (
            angular_resample(x, rate_hz=RATE_HZ, phase=record.phase, samples_per_rev=per_rev, method=method).values
        )

    return Choice(name=f"{method}, whole", colour=LINE, prepare=prepare)


def given(method: Method) -> Choice:
    """Return the same without finding the places."""

    def prepare(record: Record, per_rev: int) -> Callable[[Floats], Floats]:
        grid = record.grid(per_rev)
        places, cuts = placed(grid, record.samples)
        known: Any = {
            "outward": Known(*grid.outward.at(-EDGE, record.samples + EDGE), first=-EDGE),
            "inward": Known(places, 1 / cuts),
        }
        ready = dataclasses.replace(grid, **known)
        return lambda x: Warp(ready, method=method).whole(x[None])[0][0]

    return Choice(name=f"{method}, given", colour=LINE, prepare=prepare)


def linear(record: Record, per_rev: int) -> Callable[[Floats], Floats]:
    """Prepare np.interp, the unit of time."""
    places, at = placed(record.grid(per_rev), record.samples)[0], np.arange(record.samples)
    return lambda x: np.interp(places, at, x)


def spline(record: Record, per_rev: int) -> Callable[[Floats], Floats]:
    """Prepare a cubic spline through all samples."""
    places, at = placed(record.grid(per_rev), record.samples)[0], np.arange(record.samples)
    return lambda x: np.asarray(CubicSpline(at, x)(places))


def nonuniform(tolerance: float) -> Choice:
    """Return a Fourier transform of the record, evaluated at the places by finufft."""
    finufft = importlib.import_module("finufft")

    def prepare(record: Record, per_rev: int) -> Callable[[Floats], Floats]:
        angles = 2 * np.pi * placed(record.grid(per_rev), record.samples)[0] / record.samples

        def run(x: Floats) -> Floats:
            lines = np.fft.fftshift(fft.fft(x)) / x.size
            return np.asarray(finufft.nufft1d2(angles, lines, eps=tolerance, isign=1, nthreads=1).real)

        return run

    return Choice(name=f"finufft {tolerance:.0e}", colour=FAINT, prepare=prepare)


UNIT = Choice(name="np.interp", colour=MARK, prepare=linear)


def choices() -> list[Choice]:
    """Return every choice that can run here."""
    found = [UNIT, *(make(method) for method in ("linear", "cubic", "sinc") for make in (given, whole))]
    found.append(Choice(name="CubicSpline", colour=FAINT, prepare=spline))
    try:
        found += [nonuniform(1e-6), nonuniform(1e-9)]
    except ImportError:
        print("finufft is not installed and is left out.")  # noqa: T201
    return found


@dataclass(frozen=True, kw_only=True)
class Row:
    """What was measured of one choice."""

    choice: Choice
    time: float  # multiples of np.interp
    errors: tuple[float, ...]  # by order
    left: tuple[float, ...]  # of folding tones, dB


def timed(run: Callable[[], object], unit: Callable[[], object], repeats: int) -> float:
    """Time `run` as a multiple of `unit`, the two in turn."""
    took = np.array([(seconds(run), seconds(unit)) for _ in range(repeats + 1)])[1:]  # the first compiles
    return float(np.divide(*np.median(took, axis=0)))


def middle(values: Floats) -> Floats:
    """Return the middle 90 %."""
    margin = values.size // 20
    return values[margin : values.size - margin]


def errors_of(choice: Choice, record: Record) -> tuple[list[float], list[float]]:
    """Return the relative error at each of `ORDERS`, and what is left of tones that fold, in dB."""
    run, errors = choice.prepare(record, SAMPLES_PER_REV), []
    for order in ORDERS:
        found = run(record.tone(order))
        truth = np.cos(2 * np.pi * order * np.arange(found.size) / SAMPLES_PER_REV)
        errors.append(float(np.std(middle(found - truth)) / np.std(middle(truth))))
    coarse = choice.prepare(record, COARSE)
    left = (np.std(middle(coarse(record.tone(order)))) for order in FOLDING)
    return errors, [float(20 * np.log10(each * np.sqrt(2))) for each in left]


def measured(choice: Choice, record: Record, repeats: int) -> Row:
    """Run one choice on every order."""
    errors, left = errors_of(choice, record)
    run, unit, x = (*(each.prepare(record, SAMPLES_PER_REV) for each in (choice, UNIT)), record.tone(ORDERS[-1]))
    ratio = timed(lambda: run(x), lambda: unit(x), repeats)
    return Row(choice=choice, time=ratio, errors=tuple(errors), left=tuple(left))


def draw(rows: list[Row], ax: "Axes") -> None:
    """Draw time against error: a line from order 1 to order 400 for every choice."""
    ax.set(xscale="log", yscale="log")
    for row in rows:
        ax.plot([row.time] * len(ORDERS), row.errors, "-", color=row.choice.colour, linewidth=0.8)
        for size, error in zip((2, 3, 4, 5), row.errors, strict=True):
            ax.plot(row.time, error, "o", color=row.choice.colour, markersize=size)
        ax.text(row.time * 1.025, max(row.errors), row.choice.name, fontsize=6, color=INK, va="top", rotation=90)
    ax.axhline(2e-6, color=INK, linewidth=0.6, linestyle=":")
    ax.set(xlabel="time, multiples of np.interp", ylabel="relative error, RMS")
    ax.margins(x=0.12)
    ax.text(0.01, 0.02, "dots from small to large: orders 1, 36, 200, 400", fontsize=6, transform=ax.transAxes)


def main(folder: Path, *, samples: int = 1_000_000, repeats: int = 15) -> None:
    """Measure, and write the table and the picture."""
    record = Record.made(samples)
    rows = [measured(choice, record, repeats) for choice in choices()]
    grid, x = record.grid(SAMPLES_PER_REV), record.tone(ORDERS[-1])
    unit = UNIT.prepare(record, SAMPLES_PER_REV)
    places = timed(lambda: placed(grid, record.samples), lambda: unit(x), repeats)
    heads = ["method", "time", *(f"order {order}" for order in ORDERS), *(f"left of {order}, dB" for order in FOLDING)]
    lines = ["# Resampling: time against error", "", NOTE.format(samples=samples, repeats=repeats, places=places)]
    cells = (
        (row.choice.name, f"{row.time:.2f}", *(f"{e:.1e}" for e in row.errors), *(f"{d:.0f}" for d in row.left))
        for row in rows
    )
    write_page(folder / "resampling.md", [*lines, *table(heads, cells)])
    save_figure(lambda ax: draw(rows, ax), folder / "resampling.svg", width=7, height=4)


if __name__ == "__main__":
    main(folder_given())

"""What trackers make of gears that run up through their resonances and back: python benchmarks/resonance.py [FOLDER].

Writes resonance.md and resonance.svg into FOLDER (default docs/benchmarks). The record is that of `gears-in-motion`
without its fault; the truth is the generator's, which no tracker sees.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from page_files import folder_given, table, write_page

from data_synth import load_scene, simulate
from hums.plots import save_figure
from hums.plots.style import INK, LINE, MARK
from signals.harmonics import likely_bandwidth, track_orders

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SEED, RATE_HZ, DURATION_S, NOISE = 1, 25600, 20.0, 0.02
LOW_RPM, HIGH_RPM = 700, 1700
LINES = 12
EVERY = 256  # samples from output to output
WIDEST_HZ = 20.0
INSIDE = 1.96  # standard deviations, 95 %
MARGIN_S = 0.5  # at both ends, where trackers and truth have one side only
TRACKERS = (("smoother", 1), ("smoother", 2), ("smoother", 3), ("filter", 1), ("filter", 2))
SHOWN = 3  # of the loudest lines, in the picture

NOTE = """\
Made by `python benchmarks/resonance.py`. `gears-in-motion` without its fault, from {low} to {high} rpm and back in
{duration:g} s, in white noise of {noise:g} g: mesh harmonics of both stages pass natural frequencies twice. The {lines}
strongest lines are tracked jointly with the exact phase of the shaft, each at its maximum-likelihood bandwidth
(`likely_bandwidth`, at most {widest:g} Hz), and compared with the ground truth every {every} samples, except in the
first and last {margin:g} s.

Error: `sqrt(sum |Z' - Z|^2 / sum |Z|^2)` over all lines, and of the worst line; up and down: of either half. Inside:
quadratures within 1.96 of the tracker's standard deviations of the truth, nominally 95%.

![true and tracked amplitudes of three lines against speed](resonance.svg)
"""
HEADER = ("estimator", "poles", "bandwidths, Hz", "error", "worst line", "up", "down", "inside")


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A record and its truth.

    Attributes
    ----------
    x, phase_rad : (sample,) arrays
    orders : (line,) array, rising
    rpm : (output,) array
    truth : (line, output) array
    inside : slice
        Outputs that count.
    """

    x: Floats
    phase_rad: Floats
    orders: Floats
    rpm: Floats
    truth: Complexes
    inside: slice


def case(duration_s: float = DURATION_S) -> Case:
    """Return the record, its loudest lines and their truth."""
    half = duration_s / 2
    scene = load_scene("gears-in-motion").changed(
        speed={"link": "input", "rpm": [[0, LOW_RPM], [half, HIGH_RPM], [duration_s, LOW_RPM]]},
        duration_s=duration_s,
        rate_hz=RATE_HZ,
        faults=(),
        noise={"rms": NOISE},
    )
    record = simulate(scene, seed=SEED, phases=True)
    amplitude = record["truth_amplitude"].to_numpy()[0]
    loudest = np.sort(np.argsort(-np.mean(np.abs(amplitude) ** 2, axis=1))[:LINES])
    outputs_s = np.arange(0, scene.samples, EVERY) / RATE_HZ
    times_s = record["truth_time"].to_numpy()
    margin = round(MARGIN_S * RATE_HZ / EVERY)
    turns = record["truth_shaft_revolutions"].sel(truth_shaft="input").to_numpy()
    return Case(
        x=record["input vertical"].to_numpy(),
        phase_rad=2 * np.pi * turns,
        orders=record["truth_order"].to_numpy()[loudest],
        rpm=np.interp(outputs_s, times_s, 60 * record["truth_speed"].to_numpy()),
        truth=np.array([np.interp(outputs_s, times_s, row) for row in amplitude[loudest]]),
        inside=slice(margin, outputs_s.size - margin),
    )


def tracked(made: Case, estimator: str, poles: int) -> tuple[Floats, Complexes, Floats]:
    """Return bandwidths (line,), and the tracks and their standard deviations (line, output)."""
    setting = {"phase_rad": made.phase_rad, "orders": made.orders, "rate_hz": float(RATE_HZ), "poles": poles}
    widths = likely_bandwidth(made.x, largest_bandwidth_hz=WIDEST_HZ, **setting)
    tracks = track_orders(made.x, bandwidth_hz=widths, estimator=estimator, output_every=EVERY, **setting)  # type: ignore[arg-type]
    return widths, np.asarray(tracks.complex_amplitude), np.asarray(tracks.std)


def error(found: Complexes, true: Complexes) -> float:
    """Return the RMS of the difference over the RMS of the truth."""
    return float(np.sqrt(np.sum(np.abs(found - true) ** 2) / np.sum(np.abs(true) ** 2)))


def row(made: Case, estimator: str, poles: int) -> list[str]:
    """Return one row of the table."""
    widths, tracks, std = tracked(made, estimator, poles)
    found, true, std = tracks[:, made.inside], made.truth[:, made.inside], std[:, made.inside]
    middle = found.shape[1] // 2
    difference = found - true
    near = np.mean([np.abs(part) < INSIDE * std for part in (difference.real, difference.imag)])
    worst = max(error(one, own) for one, own in zip(found, true, strict=True))
    halves = (error(found[:, part], true[:, part]) for part in (slice(0, middle), slice(middle, None)))
    errors = f"{error(found, true):.4f}", f"{worst:.3f}", *(f"{each:.4f}" for each in halves)
    return [estimator, str(poles), f"{widths.min():.1f} to {widths.max():.1f}", *errors, f"{near:.1%}"]


def draw(ax: "Axes", made: Case) -> None:
    """Draw the loudest lines against speed, as they are and as the smoother with two poles finds them."""
    _, tracks, _ = tracked(made, "smoother", 2)
    loudest = np.argsort(-np.max(np.abs(made.truth), axis=1))[:SHOWN]
    for number, line in enumerate(loudest):
        true, found = (np.abs(each[line, made.inside]) for each in (made.truth, tracks))
        rpm = made.rpm[made.inside]
        ax.plot(rpm, true, color=INK, linewidth=2.2, alpha=0.35, label="true" if not number else None)
        ax.plot(rpm, found, color=LINE, linewidth=0.9, label="tracked" if not number else None)
        top = int(np.argmax(true))
        ax.annotate(f"{made.orders[line]:.2f}", (rpm[top], true[top]), color=MARK, fontsize=8, ha="center", va="bottom")
    ax.set(xlabel="speed of the input, rpm", ylabel="amplitude, g", ylim=(0, None))
    ax.legend(frameon=False, fontsize=8)


def main(folder: Path, duration_s: float = DURATION_S) -> None:
    """Track, and write the table and the picture."""
    made = case(duration_s)
    note = NOTE.format(
        low=LOW_RPM,
        high=HIGH_RPM,
        duration=duration_s,
        noise=NOISE,
        lines=LINES,
        widest=WIDEST_HZ,
        every=EVERY,
        margin=MARGIN_S,
    )
    rows = (row(made, estimator, poles) for estimator, poles in TRACKERS)
    write_page(folder / "resonance.md", ["# Gears that pass through their resonances", "", note, *table(HEADER, rows)])
    save_figure(lambda ax: draw(ax, made), folder / "resonance.svg", width=7, height=4)


if __name__ == "__main__":
    main(folder_given())

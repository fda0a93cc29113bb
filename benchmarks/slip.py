"""A line that slips by a per cent, and what trackers make of it: python benchmarks/slip.py [FOLDER].

Writes slip.md and slip.svg into FOLDER (default docs/benchmarks). The line of a bearing, at 9.46 orders by its drawing,
lies one per cent lower and wanders; its amplitude changes; the noise of a sample is four times it. The plain tracker
looks at the nominal order with one bandwidth after the other, the slip tracker with the narrowest of them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from page_files import folder_given, table, write_page

from hums.plots import save_figure
from hums.plots.style import FAINT, INK, LINE, MARK
from signals.harmonics import SlippingTrack, track_orders, track_slipping_order

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

ORDER, PER_REV, REVOLUTIONS, NOISE = 9.46, 128, 400, 4.0
BANDWIDTHS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8)  # orders
EVERY = 64  # samples from output to output
INSIDE = 1.96  # standard deviations, 95 %

NOTE = """\
Made by `python benchmarks/slip.py`. A line with a nominal order of 9.46 lies one per cent lower and varies by half a
per cent; its amplitude is 1 +- 0.3, the noise is white with a standard deviation of 4; 400 revolutions of 128 samples
each. The error is the RMS of estimate minus truth, as complex amplitudes at the nominal order; an estimate of 0 has an
error of {silent:.2f}.

![slip and amplitude, true and estimated by the trackers](slip.svg)

A bandwidth that covers the variation of the line passes the noise; a narrower one loses the line.
`track_slipping_order` has the slip in its state. {slip:.0%} of its slips and {amplitude:.0%} of its amplitudes are
within 1.96 of its standard deviations of the truth: both are sinusoidal here, smoother than the random walks of its
model. The probability that noise alone gives an equally good slip path is at most {chance}."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A record and its truth.

    Attributes
    ----------
    x, phase : (sample,) arrays, the record and the angle of the shaft in rad.
    slip : (sample,) array, relative.
    truth : (sample,) array, complex amplitude as the nominal order sees it.
    """

    x: Floats
    phase: Floats
    slip: Floats
    truth: Complexes


def case() -> Case:
    """Make the record."""
    rev = np.arange(REVOLUTIONS * PER_REV) / PER_REV
    phase = 2 * np.pi * rev
    slip = -0.01 + 0.004 * np.sin(2 * np.pi * rev / 170) + 0.001 * np.sin(2 * np.pi * rev / 61)
    turn = np.append(0.0, np.cumsum(ORDER * slip[:-1] * np.diff(phase)))
    truth = (1 + 0.3 * np.sin(2 * np.pi * rev / 260)) * np.exp(1j * turn)
    noise = NOISE * np.random.default_rng(3).standard_normal(rev.size)
    return Case(x=(truth * np.exp(1j * ORDER * phase)).real + noise, phase=phase, slip=slip, truth=truth)


def plain(made: Case, bandwidth: float) -> Complexes:
    """Return what the plain tracker finds at the nominal order."""
    tracks = track_orders(
        made.x,
        phase_rad=made.phase,
        orders=[ORDER],
        bandwidth_orders=bandwidth,
        samples_per_rev=PER_REV,
        output_every=EVERY,
    )
    return np.asarray(tracks.complex_amplitude[0])


def slipping(made: Case) -> SlippingTrack:
    """Return what the slip tracker finds within 2 % of the nominal order."""
    # A per cent in a hundred revolutions.
    return track_slipping_order(
        made.x,
        phase_rad=made.phase,
        order=ORDER,
        largest_slip=0.02,
        slip_change_per_rev=5e-4,
        bandwidth_orders=BANDWIDTHS[0],
        samples_per_rev=PER_REV,
        output_every=EVERY,
    )


def error(found: Complexes, truth: Complexes) -> float:
    """Return the RMS difference."""
    return float(np.sqrt(np.mean(np.abs(found - truth) ** 2)))


def draw(ax: "Axes", made: Case, track: SlippingTrack) -> None:
    """Draw slip and amplitude over revolutions, in place of the Axes."""
    figure = ax.figure
    ax.remove()
    upper, lower = figure.subplots(2, 1, sharex=True)
    at = track.sample_index
    rev = at / PER_REV
    _band(upper, rev, 100 * track.slip, 100 * track.slip_std)
    upper.plot(rev, 100 * made.slip[at], color=INK, linewidth=1, linestyle="--", label="true")
    upper.axhline(0, color=MARK, linewidth=1, label="order the plain tracker follows")
    upper.set(ylabel="slip, %", ylim=(-2, 0.5))
    lower.plot(rev, np.abs(plain(made, BANDWIDTHS[-2]))[: rev.size], color=FAINT, linewidth=0.6, label=_named(-2))
    _band(lower, rev, np.abs(track.complex_amplitude[0]), track.amplitude_std[0])
    lower.plot(rev, np.abs(made.truth[at]), color=INK, linewidth=1, linestyle="--", label="true")
    lower.plot(rev, np.abs(plain(made, BANDWIDTHS[0]))[: rev.size], color=MARK, linewidth=1, label=_named(0))
    lower.set(
        xlabel="revolutions of the shaft", ylabel="amplitude, units of the record", xlim=(0, REVOLUTIONS), ylim=(0, 2.8)
    )
    for panel in (upper, lower):
        named = sorted(zip(*panel.get_legend_handles_labels(), strict=True), key=lambda entry: entry[1], reverse=True)
        panel.legend(*zip(*named, strict=True), frameon=False, ncols=2, loc="upper right", fontsize=8)


def _named(place: int) -> str:
    return f"plain tracker, {BANDWIDTHS[place]:g} orders wide"


def _band(panel: "Axes", rev: Floats, value: Floats, std: Floats) -> None:
    low, high = value - INSIDE * std, value + INSIDE * std
    panel.fill_between(rev, low, high, color=LINE, alpha=0.25, linewidth=0, label="slip tracker, 95 %")
    panel.plot(rev, value, color=LINE, linewidth=1.2, label="slip tracker")


def main(folder: Path) -> None:
    """Track, and write the table and the picture."""
    made = case()
    track = slipping(made)
    at = track.sample_index
    true = made.truth[at]
    found = track.complex_amplitude[0] * np.exp(1j * track.slip_phase_rad)
    note = NOTE.format(
        silent=error(np.zeros_like(true), true),
        slip=np.mean(np.abs(track.slip - made.slip[at]) < INSIDE * track.slip_std),
        amplitude=np.mean(np.abs(np.abs(found) - np.abs(true)) < INSIDE * track.amplitude_std[0]),
        chance=f"{track.false_alarm_probability:.0e}",
    )
    rows = [("plain", f"{each:g}", f"{error(plain(made, each), made.truth[::EVERY]):.2f}") for each in BANDWIDTHS]
    rows.append(("slip", f"{BANDWIDTHS[0]:g}", f"{error(found, true):.2f}"))
    lines = ["# A line that slips by a per cent", "", note, "", *table(("tracker", "bandwidth, orders", "error"), rows)]
    write_page(folder / "slip.md", lines)
    save_figure(lambda ax: draw(ax, made, track), folder / "slip.svg", width=7, height=5)


if __name__ == "__main__":
    main(folder_given())

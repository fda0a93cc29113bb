"""A line that slips: its own estimator beside one that trusts the nominal order."""

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from jobs import SAMPLES_PER_REV, Floats, Indices
from numpy.typing import NDArray
from page_files import table

from signals.harmonics import track_orders, track_slipping_order
from tracking.clock import Effort, time_in_ffts
from tracking.settings import DECIMATED

if TYPE_CHECKING:
    from collections.abc import Callable

ORDER = 9.46
SAMPLES = 1_000_000
BANDWIDTH = 0.02  # orders; the line wanders over four times as much

Answer = tuple[NDArray[np.complex128], Floats | None, Indices]


@dataclass(frozen=True, kw_only=True, eq=False)
class Slipping:
    """A line of amplitude 1 in noise of variance 1, whose order is 0.6 to 1.4 % below the nominal one.

    Attributes
    ----------
    x, phase_rad : (sample,) arrays.
    slip : (sample,) array, relative deviation of the line from its nominal order.
    turn_rad : (sample,) array, how far the line has turned beyond its nominal order.
    """

    x: Floats
    phase_rad: Floats
    slip: Floats
    turn_rad: Floats

    @classmethod
    def of(cls, samples: int) -> "Slipping":
        """Return so many samples of the record."""
        at = np.arange(samples)
        phase_rad = 2 * np.pi / SAMPLES_PER_REV * at
        slow = 2 * np.pi * 3 / SAMPLES
        slip = -0.01 + 0.004 * np.sin(slow * at)
        turn_rad = ORDER * 2 * np.pi / SAMPLES_PER_REV * (-0.01 * at + 0.004 * (1 - np.cos(slow * at)) / slow)
        x = np.cos(ORDER * phase_rad + turn_rad) + np.random.default_rng(4).standard_normal(samples)
        return cls(x=x, phase_rad=phase_rad, slip=slip, turn_rad=turn_rad)


def slipping(effort: Effort) -> list[str]:
    """Time the estimators on one record, and compare waveforms and slips with the truth, middle 90 %."""
    record = Slipping.of(min(SAMPLES, effort.samples or SAMPLES))
    ways: list[tuple[str, Callable[[], Answer]]] = [
        ("slip smoother", partial(_slip, record, estimator="smoother")),
        ("slip filter", partial(_slip, record, estimator="filter")),
        ("smoother, fast, 2 poles", partial(_plain, record, poles=2, method="fast")),
        ("filter, fast, 1 pole", partial(_plain, record, poles=1, method="fast", estimator="filter")),
    ]
    lines = []
    for what, way in ways:
        wave, slip, at = way()
        middle = slice(round(0.05 * at.size), round(0.95 * at.size))
        error = _rms(wave[middle] - np.exp(1j * record.turn_rad[at[middle]]))
        off = "-" if slip is None else f"{100 * _rms(slip[middle] - record.slip[at[middle]]):.4f} %"
        lines.append((what, f"{time_in_ffts(way, record.x, effort):.3g}", f"{error:.3f}", off))
    return table(("estimator", "time", "error", "error of the slip"), lines)


def _slip(record: Slipping, **settings: Any) -> Answer:  # noqa: ANN401
    track = track_slipping_order(
        record.x,
        phase_rad=record.phase_rad,
        order=ORDER,
        largest_slip=0.02,
        slip_change_per_rev=1e-4,
        bandwidth_orders=BANDWIDTH,
        samples_per_rev=SAMPLES_PER_REV,
        **settings,
    )
    return track.complex_amplitude[0] * np.exp(1j * track.slip_phase_rad), track.slip, track.sample_index


def _plain(record: Slipping, **settings: Any) -> Answer:  # noqa: ANN401
    tracks = track_orders(
        record.x,
        phase_rad=record.phase_rad,
        orders=[ORDER],
        bandwidth_orders=BANDWIDTH,
        samples_per_rev=SAMPLES_PER_REV,
        output_every=DECIMATED,
        **settings,
    )
    return tracks.complex_amplitude[0], None, tracks.sample_index


def _rms(values: NDArray[Any]) -> float:
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))

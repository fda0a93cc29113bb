"""Data of the report other than spectra and tracks: waveforms, wideband spectra, order maps, averages, kurtograms.

They are computed while a channel's samples are in memory, at screen resolution, and do not affect verdicts.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from hums.analysis.indicators import SHAFT_ORDERS, Gear, gears_on_shafts, shaft_average
from hums.analysis.result import ChannelPictures
from hums.analysis.segments import Segment, Values
from hums.analysis.settings import AnalysisSettings
from hums.records.channels import Sampling
from signals.angle.residual import difference_signal
from signals.demodulation.kurtogram import fast_kurtogram
from signals.spectra.order_map import map_orders
from signals.spectra.spectra import averaged_spectrum

if TYPE_CHECKING:
    from numpy.typing import NDArray

WAVEFORM, WIDEBAND, ORDER_MAP, AVERAGES, KURTOGRAM = "waveform", "wideband", "order_map", "averages", "kurtogram"
_COLUMNS = 2000  # of a waveform, each with its least and largest sample: the pixels of a wide screen
_EXCERPT = 8192  # samples around the largest, in full
_ROWS = 120  # of a map
_CELLS = 800  # orders of a map
_TURNS = 8  # of the reference in a row of a map: a sixth of an order resolved, and speed nearly steady
_WIDEBAND_SAMPLES = 8192  # in a block of a wideband spectrum
_KURTOGRAM_SAMPLES = 2**21  # 42 s at 50 kHz: enough for 7 levels, in bounded time and memory


def channel_pictures(segment: Segment, settings: AnalysisSettings) -> ChannelPictures:
    """Return the pictures of a segment of a channel."""
    made = {WAVEFORM: _waveform(segment.values, segment.when)}
    makers: dict[str, Callable[[], xr.Dataset]] = {
        WIDEBAND: partial(_wideband, segment),
        ORDER_MAP: partial(_order_map, segment),
        AVERAGES: partial(_averages, segment, settings),
        KURTOGRAM: partial(_kurtogram, segment),
    }
    for name, make in makers.items():
        try:
            made[name] = make()
        except ValueError:  # too short, or constant: the verdicts and indicators say so where it matters
            continue
    for picture in made.values():
        for name in {"least", "largest", "excerpt", "amplitude", "average", "difference"} & set(picture):
            picture[name].attrs["units"] = segment.units
    return ChannelPictures(channel=segment.name, datasets=made)


def picture_groups(pictures: Sequence[ChannelPictures]) -> dict[str, xr.Dataset]:
    """Return the datasets of all channels by path: a group for each kind, with a child for each channel, in order."""
    groups = {f"/{name}": xr.Dataset() for name in (WAVEFORM, WIDEBAND, ORDER_MAP, AVERAGES, KURTOGRAM)}
    for one in pictures:
        groups |= {f"/{name}/{one.channel}": dataset for name, dataset in one.datasets.items()}
    return groups


def pictures_of(analysis: xr.DataTree, name: str) -> Iterator[tuple[str, xr.Dataset]]:
    """Yield channel and dataset of each picture of a kind; none if the analysis has none."""
    if name in analysis.children:
        for channel, child in analysis.children[name].children.items():
            yield channel, child.to_dataset(inherit=False)


def _waveform(values: Values, when: Sampling) -> xr.Dataset:
    """Return the minimum and maximum of every column, and all samples around the largest deviation."""
    starts = np.arange(0, values.size, -(-values.size // _COLUMNS))
    mean = values.mean(dtype=np.float64)
    peak = int(np.argmax(values)) if values.max() - mean >= mean - values.min() else int(np.argmin(values))
    first = max(0, min(peak - _EXCERPT // 2, values.size - _EXCERPT))
    excerpt = values[first : first + _EXCERPT]
    excerpt_s = when.start_s + (first + np.arange(excerpt.size)) / when.rate_hz
    return xr.Dataset(
        {
            "least": ("column", np.minimum.reduceat(values, starts)),
            "largest": ("column", np.maximum.reduceat(values, starts)),
            "excerpt": ("sample", np.array(excerpt)),
        },
        coords={
            "time_s": ("column", when.start_s + starts / when.rate_hz, {"units": "s"}),
            "excerpt_time_s": ("sample", excerpt_s, {"units": "s"}),
        },
        attrs={"column_s": float(starts[1] / when.rate_hz if starts.size > 1 else values.size / when.rate_hz)},
    )


def _wideband(segment: Segment) -> xr.Dataset:
    """Return the amplitude spectrum over frequency, from 0 to half the sampling rate, power-averaged over blocks."""
    size = min(_WIDEBAND_SAMPLES, segment.filled.size)
    found = averaged_spectrum(segment.filled, rate=segment.when.rate_hz, segment=size, scaling="peak")
    return xr.Dataset(
        {"amplitude": ("frequency", found.value, {"long_name": "peak amplitude"})},
        attrs={"bin_width_hz": found.bin_width, "resolution_hz": found.resolution, "blocks": found.averages},
    )


def _order_map(segment: Segment) -> xr.Dataset:
    """Return spectra over orders of blocks of whole revolutions, spread evenly over the segment."""
    signal, machine = segment.signal, segment.machine
    turns = min(_TURNS, signal.revolutions)
    starts = np.unique(np.linspace(0, signal.revolutions - turns, _ROWS).astype(int))
    length = turns * signal.samples_per_rev
    blocks = np.lib.stride_tricks.sliding_window_view(signal.values, length)[starts * signal.samples_per_rev]
    one_by_one = (blocks - blocks.mean(axis=1, keepdims=True)).ravel()
    rows = map_orders(replace(signal, values=one_by_one, unsettled=(0, 0)), revolutions=turns, overlap=0.0)
    times = machine.phase.times_at(signal.start_rev + starts + turns / 2)
    amplitude = rows.value
    every = -(-amplitude.shape[1] // _CELLS)  # of neighbouring orders the largest, so that no line is lost
    cells = amplitude.shape[1] // every
    amplitude = amplitude[:, : cells * every].reshape(len(amplitude), cells, every).max(axis=2)
    return xr.Dataset(
        {
            "amplitude": (("row", "order"), amplitude),
            "speed_hz": ("row", machine.phase.speed_hz(times), {"units": "rev s-1"}),
        },
        coords={
            "order": (np.arange(cells) * every + (every - 1) / 2) / turns,
            "time_s": ("row", times, {"units": "s"}),
        },
        attrs={"turns": turns, "resolution_orders": rows.resolution},
    )


def _averages(segment: Segment, settings: AnalysisSettings) -> xr.Dataset:
    """Return the synchronous average and the difference signal of every gear on a fixed axis, one after the other."""
    rows: list[dict[str, Any]] = []
    averages: list[NDArray[np.float64]] = []
    differences: list[NDArray[np.float64]] = []
    for shaft, gears in gears_on_shafts(segment.machine).items() if not segment.faulty else ():
        try:
            average = shaft_average(segment, shaft)
        except ValueError:
            continue
        for component, teeth in gears.items():
            gear = Gear(component=component, teeth=teeth, on_shaft=tuple(gears.values()), harmonics=settings.harmonics)
            try:
                left = difference_signal(
                    average,
                    teeth=gear.on_shaft,
                    harmonics=gear.harmonics,
                    shaft_orders=SHAFT_ORDERS,
                    max_order=gear.last_order(average),
                ).values
            except ValueError:
                left = np.full(average.values.size, np.nan)
            averages.append(average.values)
            differences.append(left)
            size, turns = average.values.size, average.revolutions
            rows.append({"component": component, "teeth": teeth, "revolutions": turns, "size": size})
    if not rows:
        raise ValueError("no synchronous average could be computed.")
    table = {name: ("gear", [row[name] for row in rows]) for name in rows[0]}
    return xr.Dataset(
        {"average": ("angle", np.concatenate(averages)), "difference": ("angle", np.concatenate(differences))} | table
    )


def _kurtogram(segment: Segment) -> xr.Dataset:
    """Return the bands of the kurtogram with the kurtosis of each."""
    values, when = segment.values, segment.when
    transform = segment.transform if values.size <= _KURTOGRAM_SAMPLES else None
    gram = fast_kurtogram(values[:_KURTOGRAM_SAMPLES], rate_hz=when.rate_hz, transform=transform)
    return xr.Dataset(
        {name: ("band", getattr(gram, name)) for name in ("level", "low_hz", "high_hz", "kurtosis", "noise_std")},
        attrs={"seconds": min(values.size, _KURTOGRAM_SAMPLES) / when.rate_hz},
    )

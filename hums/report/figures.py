"""Figures of a report: data of an analysis at screen resolution, drawn by the views of report.js."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import fft

from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.pictures import AVERAGES, KURTOGRAM, ORDER_MAP, WAVEFORM, WIDEBAND, pictures_of
from hums.analysis.result import Analysis, envelope_bands, group
from hums.pages.page import Figure, figure_html, least_and_largest, packed, packed_codes
from hums.plots.style import line_label
from hums.report.verdict_strip import frequency_words, with_hz

Floats = NDArray[np.floating[Any]]

_FULL_CHANNELS = 2  # whose maps, tracks and waveforms are drawn in full; more share the same space


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of the report: its title, identifier and figures, as (channel, HTML)."""

    title: str
    name: str
    figures: tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True)
class _Drawn:
    """One figure of a section: its channel (empty for all), text alternative, data, caption, and title if not that."""

    channel: str
    alt: str
    data: Mapping[str, Any]
    caption: str
    title: str = ""


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """Input of all figures: the analysis, its summary, the styles of faulty components, and an earlier analysis."""

    analysis: Analysis
    facts: Mapping[str, Any]
    styles: Mapping[str, str]
    past: Analysis | None = None
    past_name: str = ""

    @property
    def speed_hz(self) -> float | None:
        """Mean speed of the reference in rev/s; None if unknown."""
        speed: float | None = self.facts["speed_hz"]["mean"]
        return speed


def sections(pictures: Pictures) -> list[Section]:
    """Return the sections that have figures."""
    made = (
        ("Order spectra", "orders", "spectrum", 460, _spectra(pictures, ORDER_SPECTRUM)),
        ("Wideband spectra", "wideband", "wideband", 360, _wideband(pictures)),
        ("Envelope spectra", "envelopes", "spectrum", 460, _spectra(pictures, ENVELOPE)),
        ("Order maps", "maps", "map", 480, _maps(pictures)),
        ("Tracked envelope lines", "parts", "tracks", 560, _tracks(pictures, "envelope_tracks")),
        ("Tracked orders", "tracks", "tracks", 560, _tracks(pictures, "tracks")),
        ("Synchronous averages", "averages", "average", 400, _averages(pictures)),
        ("Kurtograms", "kurtograms", "kurtogram", 360, _kurtograms(pictures)),
        ("Waveforms", "waveforms", "waveform", 460, _waveforms(pictures)),
        ("Speed", "speed", "speed", 280, _speed(pictures)),
    )
    found = []
    for title, name, view, height_px, drawn in made:
        figures = []
        for number, one in enumerate(drawn):
            figure = Figure(
                name=f"{name}-{number}",
                alt=one.alt,
                view=view,
                title=one.title or one.channel,
                height_px=height_px,
                data=one.data,
            )
            figures.append((one.channel, figure_html(figure, caption=one.caption)))
        found += [Section(title=title, name=name, figures=tuple(figures))] if figures else []
    return found


def cursor_choices(facts: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the defect orders on which a cursor can be placed: name, order and sideband spacing in orders."""
    families: dict[tuple[str, str], dict[tuple[int, int], float]] = {}
    for row in [*facts["orders"], *facts["envelope"]]:
        lines = families.setdefault((row["component"], row["kind"]), {})
        lines.setdefault((row["harmonic"], row["sideband"]), row["order"])
    choices = []
    for (component, kind), lines in families.items():
        low, high, own = lines.get((1, -1)), lines.get((1, 1)), lines.get((1, 0))
        spacing = (high - low) / 2 if low is not None and high is not None else 0.0
        order = own if own is not None else (low + high) / 2 if low is not None and high is not None else None
        if order is not None:
            choices.append({"name": f"{component}, {kind.replace('_', ' ')}", "order": order, "spacing": spacing})
    return choices


# ---- Spectra ---------------------------------------------------------------------------------------------------------


def _spectra(pictures: Pictures, name: str) -> Iterator[_Drawn]:
    dataset = group(pictures.analysis, name)
    bands = {band["channel"]: band for band in envelope_bands(pictures.analysis)}
    what = "Order spectrum" if name == ORDER_SPECTRUM else "Envelope spectrum"
    for channel in _channels(dataset):
        one = dataset.sel(channel=channel)
        lines, searched = _lines(dataset, channel, pictures.styles)
        named = ", ".join(dict.fromkeys(line["label"] for line in lines[:3])) or "none"
        traces = {"now": _curve(one, dataset.sizes["channel"])}
        if (past := _past_spectrum(pictures, name, channel, str(one["units"].item()))) is not None:
            traces["past"] = _curve(past, dataset.sizes["channel"])
        about = {"units": str(one["units"].item()), "log": name == ORDER_SPECTRUM, "pastName": pictures.past_name}
        width = float(dataset.attrs["resolution_orders"])
        resolution = f"{dataset.attrs['window'].capitalize()} window, resolution {_orders(pictures, width)}."
        band = _band_caption(bands[channel]) if name == ENVELOPE and channel in bands else ""
        yield _Drawn(
            channel=channel,
            alt=f"{what} of channel {channel}; identified lines: {len(lines)}, the first of them {named}.",
            data=traces | about | {"lines": lines, "searched": packed(searched)},
            caption=f"{band}{resolution}",
        )


def _wideband(pictures: Pictures) -> Iterator[_Drawn]:
    for channel, dataset in pictures_of(pictures.analysis, WIDEBAND):
        amplitude, step_hz = dataset["amplitude"].to_numpy(), float(dataset.attrs["bin_width_hz"])
        largest = int(amplitude.argmax())
        resolution_hz, blocks = float(dataset.attrs["resolution_hz"]), int(dataset.attrs["blocks"])
        yield _Drawn(
            channel=channel,
            alt=f"Spectrum of channel {channel} up to half its sampling rate; the largest line is at "
            f"{largest * step_hz:.6g} Hz.",
            data={"level": _levels(amplitude), "step": step_hz, "units": _units(pictures, channel)},
            caption=f"Hann window, resolution {resolution_hz:.3g} Hz, power average of {blocks} blocks.",
        )


def _curve(one: xr.Dataset, channels: int) -> dict[str, Any]:
    # 4200 of all channels together, 0.1 MB of the page
    columns = max(700, 4200 // channels)
    amplitude, indices = least_and_largest(one["amplitude"].to_numpy(), columns=columns)
    return {"x": packed_codes(one["order"].to_numpy()[indices], digits="u2"), "level": _levels(amplitude)}


def _levels(amplitude: Floats) -> dict[str, Any]:
    """Return the decimal logarithms of amplitudes, down to 1e-9 of the largest, in two bytes: errors of 0.02 %."""
    least = max(float(amplitude.max()) * 1e-9, np.finfo(float).tiny)
    return packed_codes(np.log10(np.maximum(amplitude, least)), digits="u2")


def _past_spectrum(pictures: Pictures, name: str, channel: str, units: str) -> xr.Dataset | None:
    """Return the spectrum of the same channel in the earlier record, if it has one in the same units."""
    if pictures.past is None:
        return None
    dataset = group(pictures.past, name)
    if channel not in _channels(dataset):
        return None
    one = dataset.sel(channel=channel)
    return one if one["units"].item() == units else None


def _lines(dataset: xr.Dataset, channel: str, styles: Mapping[str, str]) -> tuple[list[dict[str, Any]], Floats]:
    """Return the identified lines of one channel, those of faulty components first, and the orders of the others."""
    table = dataset[[name for name in dataset.data_vars if dataset[name].dims == ("line",)]].to_dataframe()
    mine = table[table["line_channel"] == channel]
    of_lines = {"order": "order_found", "nominal": "line_order", "amplitude": "line_amplitude", "snr": "snr"}
    rows = [
        {
            "label": line_label(row),
            "style": styles.get(row["component"], ""),
            **{name: float(f"{row[column]:.7g}") for name, column in of_lines.items()},
        }
        for row in mine[mine["claimed"] == 1].to_dict("records")
    ]
    searched = mine[(mine["sideband"] == 0) & (mine["claimed"] == 0)]["line_order"].to_numpy()
    return sorted(rows, key=lambda row: (row["style"] != "alarm", not row["style"], -row["amplitude"])), searched


def _orders(pictures: Pictures, width: float) -> str:
    return with_hz(f"{width:.2g} orders", pictures.speed_hz)


def _order(pictures: Pictures, order: float) -> str:
    """Return an order in words, with its frequency in Hz at the mean speed."""
    frequency = "" if pictures.speed_hz is None else f", {frequency_words(order * pictures.speed_hz)}"
    return f"order {order:.5g}{frequency}"


def _band_caption(band: Mapping[str, Any]) -> str:
    edges = f"{band['low_hz']:.6g} to {band['high_hz']:.6g} Hz"
    if not band["chosen"]:
        return f"Band {edges}, as specified. "
    return f"Band chosen from the record: {band['why']} "


def _kurtogram_caption(dataset: xr.Dataset, band: Mapping[str, Any] | None) -> str:
    """Return the duration a kurtogram is computed from, and how the demodulation band was chosen."""
    frame = ""
    if band is not None and band["chosen"]:
        frame = (
            " The demodulation band is the one with the most prominent bearing lines, not necessarily the highest "
            "kurtosis."
        )
    elif band is not None:
        frame = " The demodulation band is as specified."
    empty = ""
    if dataset["kurtosis"].isnull().any():
        empty = " Empty cells: bands with less power than leaks into them from other bands."
    seconds = float(dataset.attrs["seconds"])
    return f"Kurtosis of the complex envelope of {seconds:.4g} s, 0 for Gaussian noise.{empty}{frame}"


# ---- Maps, tracks, averages, kurtograms, waveforms and speed ---------------------------------------------------------


def _maps(pictures: Pictures) -> Iterator[_Drawn]:
    found = list(pictures_of(pictures.analysis, ORDER_MAP))
    for channel, dataset in found:
        amplitude, order = dataset["amplitude"].to_numpy(), dataset["order"].to_numpy()
        every = -(-len(found) // _FULL_CHANNELS)  # neighbouring orders are joined where there are many channels
        if every > 1:
            cells = order.size // every
            amplitude = amplitude[:, : cells * every].reshape(len(amplitude), cells, every).max(axis=2)
            order = order[: cells * every].reshape(cells, every).mean(axis=1)
        level = 20 * np.log10(np.maximum(amplitude, np.finfo(float).tiny))
        level = np.maximum(level, level.max() - 100.0)  # dB below the highest cell
        yield _Drawn(
            channel=channel,
            alt=f"Colour map of the level of channel {channel} against order and time or speed.",
            data={
                "order": packed(order),
                "time": packed(dataset["time_s"]),
                "speed": packed(dataset["speed_hz"]),
                "level": packed_codes(level),
                "units": _units(pictures, channel),
            },
            caption=f"Each row is the spectrum of {int(dataset.attrs['turns'])} revolutions.",
        )


def _tracks(pictures: Pictures, name: str) -> Iterator[_Drawn]:
    """Yield a figure per channel of its tracked orders, or of the envelope lines of components with a finding."""
    if name not in pictures.analysis.children:
        return
    tracks = group(pictures.analysis, name)
    if "track" not in tracks.sizes:
        return
    of_parts, named = name != "tracks", tracks["track_channel"].to_numpy()
    size = np.nanmean(np.abs(tracks["complex_amplitude"].to_numpy()), axis=1)
    faulty = np.array([str(part) in pictures.styles for part in tracks["component"].to_numpy()])
    labels = [line_label(_track_line(tracks, at)) for at in range(named.size)]
    ranked = np.lexsort((-size, ~faulty)).tolist()
    channels = list(dict.fromkeys(named.tolist()))
    own = {channel: [at for at in ranked if named[at] == channel] for channel in channels}
    shown_first = (labels[at] for row in zip_longest(*own.values()) for at in row if at is not None)
    colours = {label: place for place, label in enumerate(dict.fromkeys(shown_first))}
    outputs = slice(None, None, -(-len(channels) // _FULL_CHANNELS))
    for channel in channels:
        mine = tracks.isel(track=own[channel], output=outputs)
        amplitude, half_width = mine["complex_amplitude"].to_numpy(), mine["half_width"].to_numpy()
        rows = [
            {
                "name": f"{labels[at]}, {_order(pictures, float(mine['track_order'][place]))}",
                "real": packed_codes(amplitude[place].real, digits="u2"),
                "imag": packed_codes(amplitude[place].imag, digits="u2"),
                "halfWidth": packed_codes(half_width[place], digits="u2"),
                "colour": colours[labels[at]],
            }
            for place, at in enumerate(own[channel])
        ]
        data = {
            "tracks": rows,
            "time": packed(mine["time_s"]),
            "speed": packed(mine["speed_hz"]),
            "units": str(mine["track_units"].to_numpy()[0]),
        }
        what = "envelope lines" if of_parts else "orders"
        said = _parts_caption(mine) if of_parts else _tracks_caption(mine)
        yield _Drawn(
            channel=channel,
            alt=f"Amplitude and phase of {len(rows)} {what} of {channel} against time or speed, or a Nyquist plot.",
            data=data,
            caption=with_hz(said, pictures.speed_hz),
        )


def _tracks_caption(tracks: xr.Dataset) -> str:
    widths = tracks["bandwidth_orders"].to_numpy()
    return (
        f"Kalman smoother, bandwidths {widths.min():.2g} to {widths.max():.2g} orders. Phase of a "
        "cosine, relative to the angle of the reference."
    )


def _parts_caption(tracks: xr.Dataset) -> str:
    """Return how the envelope lines were tracked: band, modulation depth, slip and bandwidth of each."""
    said = []
    for at in range(tracks.sizes["track"]):
        one = tracks.isel(track=at)
        slip = (100 * one["slip"].to_numpy()).round(2) + 0.0  # no -0.00
        follows = f", slip {np.nanmin(slip):+.2f}% to {np.nanmax(slip):+.2f}%" if slip.any() else ""
        depth = np.nanmean(np.abs(one["complex_amplitude"].to_numpy())) / float(one["level"])
        said.append(
            f"{line_label(_track_line(tracks, at))}: envelope of {float(one['band_low_hz']):.5g} to "
            f"{float(one['band_high_hz']):.5g} Hz, mean modulation depth {depth:.1%}{follows}, bandwidth "
            f"{float(one['bandwidth_orders']):.2g} orders"
        )
    return f"{'; '.join(said)}. Kalman smoother of the envelope. Phase relative to the angle of the line."


def _track_line(tracks: xr.Dataset, at: int) -> dict[str, Any]:
    return {name: tracks[name].to_numpy()[at].item() for name in ("component", "kind", "harmonic", "sideband")}


def _averages(pictures: Pictures) -> Iterator[_Drawn]:
    """Yield a figure per channel and gear, faulty gears first, with enough samples per tooth."""
    for channel, dataset in pictures_of(pictures.analysis, AVERAGES):
        names, ends = dataset["component"].to_numpy().tolist(), np.cumsum(dataset["size"].to_numpy())
        for at in sorted(range(len(names)), key=lambda at: names[at] not in pictures.styles):
            teeth, size = int(dataset["teeth"][at]), int(dataset["size"][at])
            samples = max(size, 20 * teeth)
            part = slice(int(ends[at]) - size, int(ends[at]))
            curves = {
                name: packed_codes(
                    fft.irfft(fft.rfft(dataset[name].to_numpy()[part]), samples) * samples / size, digits="u2"
                )
                for name in ("average", "difference")
            }
            yield _Drawn(
                channel=channel,
                alt=f"Synchronous average and difference signal of {names[at]} in channel {channel}, over one "
                f"revolution of {teeth} teeth.",
                data=curves | {"teeth": teeth, "units": _units(pictures, channel)},
                caption=f"{channel}, {int(dataset['revolutions'][at])} revolutions.",
                title=names[at],
            )


def _kurtograms(pictures: Pictures) -> Iterator[_Drawn]:
    bands = {band["channel"]: band for band in envelope_bands(pictures.analysis)}
    for channel, dataset in pictures_of(pictures.analysis, KURTOGRAM):
        level, kurtosis = dataset["level"].to_numpy(), dataset["kurtosis"].to_numpy()
        levels = np.unique(level)
        cells = 3 * 2 ** int(levels[-1])
        band, best = bands.get(channel), int(np.nanargmax(kurtosis))
        yield _Drawn(
            channel=channel,
            alt=f"Kurtosis of every band of channel {channel}; the highest, {kurtosis[best]:.2g}, from "
            f"{float(dataset['low_hz'][best]):.6g} to {float(dataset['high_hz'][best]):.6g} Hz.",
            data={
                "kurtosis": packed_codes(
                    [np.repeat(row := kurtosis[level == one], cells // row.size) for one in levels]
                ),
                "levels": levels.tolist(),
                "half": float(dataset["high_hz"].max()),
                "band": band and [band["low_hz"], band["high_hz"]],
            },
            caption=_kurtogram_caption(dataset, band),
        )


def _waveforms(pictures: Pictures) -> Iterator[_Drawn]:
    found = list(pictures_of(pictures.analysis, WAVEFORM))
    every = -(-len(found) // _FULL_CHANNELS)
    for channel, dataset in found:
        starts, times = np.arange(0, dataset.sizes["column"], every), dataset["time_s"].to_numpy()
        least = np.minimum.reduceat(dataset["least"].to_numpy(), starts)
        largest = np.maximum.reduceat(dataset["largest"].to_numpy(), starts)
        excerpt = dataset["excerpt"].to_numpy()[: dataset.sizes["sample"] // every]
        rate_hz = next(one["rate_hz"] for one in pictures.facts["channels"] if one["name"] == channel)
        width_ms = 1e3 * every * float(dataset.attrs["column_s"])
        yield _Drawn(
            channel=channel,
            alt=f"Waveform of channel {channel}: the whole record, and an excerpt around the largest deviation.",
            data={
                "both": packed_codes(np.stack([least, largest], axis=1).ravel(), digits="u2"),
                "first": float(times[0]),
                "step": every * float(dataset.attrs["column_s"]) / 2,
                "excerpt": packed_codes(excerpt, digits="u2"),
                "excerptFirst": float(dataset["excerpt_time_s"][0]),
                "excerptStep": 1 / rate_hz,
                "units": _units(pictures, channel),
            },
            caption=f"Top: minimum and maximum per {width_ms:.3g} ms. Bottom: excerpt around the largest deviation.",
        )


def _speed(pictures: Pictures) -> Iterator[_Drawn]:
    dataset = group(pictures.analysis, "speed")
    if not dataset["speed_hz"].size:
        return
    speed, indices = least_and_largest(dataset["speed_hz"].to_numpy(), columns=2000)
    yield _Drawn(
        channel="",
        alt=f"Speed of {dataset.attrs['shaft']} against time, {speed.min():.4g} to {speed.max():.4g} rev/s.",
        data={
            "time": packed(dataset["time_s"].to_numpy()[indices]),
            "speed": packed(speed),
            "shaft": str(dataset.attrs["shaft"]),
        },
        caption="Mean over each revolution.",
    )


def _units(pictures: Pictures, channel: str) -> str:
    return next((str(one["units"]) for one in pictures.facts["channels"] if one["name"] == channel), "")


def _channels(dataset: xr.Dataset) -> Sequence[str]:
    return [str(name) for name in dataset["channel"].to_numpy()] if "channel" in dataset.coords else []

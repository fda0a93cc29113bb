"""Figures of a report, from an analysis: data at the resolution of a screen, drawn by the views of report.js."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.pictures import AVERAGES, KURTOGRAM, ORDER_MAP, WAVEFORM, pictures_of
from hums.analysis.result import Analysis, envelope_bands, group
from hums.pages.page import Figure, figure_html, least_and_largest, packed, packed_codes
from hums.report.verdict_strip import frequency_words, with_hz

Floats = NDArray[np.floating[Any]]

_COLUMNS = 16_000  # of the spectra of all channels together: 0.7 MB of the page
_FEWEST_COLUMNS, _MOST_COLUMNS = 700, 6000
_FULL_CHANNELS = 8  # whose maps and waveforms are drawn in full; more share the same space
_DRAWN_TRACKS = 4  # shown at first; the legend shows the others
_LEVEL_FLOOR_DB = 100.0  # below the highest cell of a map
_MOST_LABELS = 200
_TOOTH_TICKS = 25


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of the report: its title, identifier and figures as HTML."""

    title: str
    name: str
    figures: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """What all figures of a report need: the analysis, its summary, the styles of faulty components, an earlier one."""

    analysis: Analysis
    facts: Mapping[str, Any]
    styles: Mapping[str, str]
    past: Analysis | None = None
    past_name: str = ""

    @property
    def speed_hz(self) -> float | None:
        """Mean speed of the reference in rev/s; None where the record does not say."""
        speed: float | None = self.facts["speed_hz"]["mean"]
        return speed


def sections(pictures: Pictures) -> list[Section]:
    """Return the sections with figures; one without data is left out."""
    made = (
        ("Order spectra", "orders", _spectra(pictures, ORDER_SPECTRUM)),
        ("Envelope spectra", "envelopes", _spectra(pictures, ENVELOPE)),
        ("Order maps", "maps", _maps(pictures)),
        ("Tracked envelope lines", "parts", _tracks(pictures, "envelope_tracks")),
        ("Tracked orders", "tracks", _tracks(pictures, "tracks")),
        ("Synchronous averages", "averages", _averages(pictures)),
        ("Kurtograms", "kurtograms", _kurtograms(pictures)),
        ("Waveforms", "waveforms", _waveforms(pictures)),
        ("Speed", "speed", _speed(pictures)),
    )
    found = [Section(title=title, name=name, figures=tuple(figures)) for title, name, figures in made]
    return [section for section in found if section.figures]


def cursor_choices(facts: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the defect orders that a cursor can be put on: name, order and sideband spacing in orders."""
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


def _spectra(pictures: Pictures, name: str) -> Iterator[str]:
    dataset = group(pictures.analysis, name)
    bands = {band["channel"]: band for band in envelope_bands(pictures.analysis)}
    what = "order spectrum" if name == ORDER_SPECTRUM else "envelope spectrum"
    for number, channel in enumerate(_channels(dataset)):
        one = dataset.sel(channel=channel)
        lines = _lines(dataset, channel, pictures.styles)
        claimed = [line for line in lines if line["claimed"]]
        named = ", ".join(dict.fromkeys(line["label"] for line in claimed[:3])) or "none"
        traces = {"now": _curve(one, dataset.sizes["channel"])}
        if (past := _past_spectrum(pictures, name, channel, str(one["units"].item()))) is not None:
            traces["past"] = _curve(past, dataset.sizes["channel"])
        figure = Figure(
            name=f"{name.replace('_', '-')}-{number}",
            alt=f"The {what} of channel {channel}; identified lines: {len(claimed)}, the first of them {named}.",
            view="spectrum",
            title=channel,
            height_px=460,
            data=traces
            | {
                "lines": lines[:_MOST_LABELS],
                "units": str(one["units"].item()),
                "log": name == ORDER_SPECTRUM,
                "pastName": pictures.past_name,
            },
        )
        width = float(dataset.attrs["resolution_orders"])
        resolution = f"{dataset.attrs['window'].capitalize()} window, resolution {_orders(pictures, width)}."
        band = _band_caption(bands[channel]) if name == ENVELOPE and channel in bands else ""
        yield figure_html(figure, caption=f"{band}{resolution}")


def _curve(one: xr.Dataset, channels: int) -> dict[str, Any]:
    columns = min(_MOST_COLUMNS, max(_FEWEST_COLUMNS, _COLUMNS // channels))
    amplitude, indices = least_and_largest(one["amplitude"].to_numpy(), columns=columns)
    return {"x": packed(one["order"].to_numpy()[indices]), "y": packed(amplitude)}


def _past_spectrum(pictures: Pictures, name: str, channel: str, units: str) -> xr.Dataset | None:
    """Return the spectrum of the same channel in the earlier record, if there is one in the same units."""
    if pictures.past is None:
        return None
    dataset = group(pictures.past, name)
    if channel not in _channels(dataset):
        return None
    one = dataset.sel(channel=channel)
    return one if one["units"].item() == units else None


def _lines(dataset: xr.Dataset, channel: str, styles: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return the lines of one channel: claimed before others, those of faulty parts first, then by amplitude."""
    table = dataset[[name for name in dataset.data_vars if dataset[name].dims == ("line",)]].to_dataframe()
    mine = table[(table["line_channel"] == channel) & ((table["sideband"] == 0) | (table["claimed"] == 1))]
    rows = [
        {
            "label": _label(row),
            "order": float(row["order_found"] if row["claimed"] else row["line_order"]),
            "nominal": float(row["line_order"]),
            "amplitude": float(row["line_amplitude"]),
            "snr": float(row["snr"]),
            "claimed": bool(row["claimed"]),
            "style": styles.get(row["component"], "") if row["claimed"] else "",
        }
        for row in mine.to_dict("records")
    ]
    return sorted(
        rows, key=lambda row: (not row["claimed"], row["style"] != "alarm", not row["style"], -row["amplitude"])
    )


def _label(line: Mapping[Any, Any]) -> str:
    harmonic = f"{line['harmonic']}x " if line["harmonic"] != 1 else ""
    sideband = f" {line['sideband']:+d}" if line["sideband"] else ""
    kind = "" if line["kind"] in {"shaft", "gear_mesh", "tooth"} else " " + str(line["kind"]).replace("_", " ")
    return f"{harmonic}{line['component']}{kind}{sideband}"


def _orders(pictures: Pictures, width: float) -> str:
    return with_hz(f"{width:.2g} orders", pictures.speed_hz)


def _order(pictures: Pictures, order: float) -> str:
    """Return a place in orders and in Hz at the mean speed."""
    frequency = "" if pictures.speed_hz is None else f", {frequency_words(order * pictures.speed_hz)}"
    return f"order {order:.5g}{frequency}"


def _band_caption(band: Mapping[str, Any]) -> str:
    edges = f"{band['low_hz']:.6g} to {band['high_hz']:.6g} Hz"
    if not band["chosen"]:
        return f"Band {edges}, as given. "
    return " ".join([f"Band chosen from the record: {band['why']}", *band["doubts"]]) + " "


def _kurtogram_caption(dataset: xr.Dataset, band: Mapping[str, Any] | None) -> str:
    """Return how long the record is that a kurtogram is of, and where its frame comes from."""
    frame = ""
    if band is not None and band["chosen"]:
        frame = (
            " The demodulated band is the one with the most prominent bearing lines, not necessarily the one of the "
            "highest kurtosis."
        )
    elif band is not None:
        frame = " The demodulated band is the one specified."
    return f"{float(dataset.attrs['seconds']):.4g} s; the kurtosis of Gaussian noise is 0.{frame}"


# ---- Maps, tracks, averages, kurtograms, waveforms and speed ---------------------------------------------------------


def _maps(pictures: Pictures) -> Iterator[str]:
    found = list(pictures_of(pictures.analysis, ORDER_MAP))
    for number, (channel, dataset) in enumerate(found):
        amplitude, order = dataset["amplitude"].to_numpy(), dataset["order"].to_numpy()
        every = -(-len(found) // _FULL_CHANNELS)  # neighbouring orders are joined where there are many channels
        if every > 1:
            cells = order.size // every
            amplitude = amplitude[:, : cells * every].reshape(len(amplitude), cells, every).max(axis=2)
            order = order[: cells * every].reshape(cells, every).mean(axis=1)
        level = 20 * np.log10(np.maximum(amplitude, np.finfo(float).tiny))
        level = np.maximum(level, level.max() - _LEVEL_FLOOR_DB)
        figure = Figure(
            name=f"map-{number}",
            alt=f"Level of every order of channel {channel} against time or speed, as colours.",
            view="map",
            title=channel,
            height_px=480,
            data={
                "order": packed(order),
                "time": packed(dataset["time_s"]),
                "speed": packed(dataset["speed_hz"]),
                "level": packed_codes(level),
                "units": _units(pictures, channel),
            },
        )
        turns = int(dataset.attrs["turns"])
        yield figure_html(figure, caption=f"Each row is the spectrum of {turns} revolutions.")


def _tracks(pictures: Pictures, name: str) -> Iterator[str]:
    """Yield a figure per channel: of its orders, or of the envelope lines of components with a finding."""
    if name not in pictures.analysis.children:
        return
    tracks, speed = group(pictures.analysis, name), group(pictures.analysis, "speed")
    if "track" not in tracks.sizes:
        return
    of_parts = name != "tracks"
    for number, channel in enumerate(dict.fromkeys(tracks["track_channel"].to_numpy().tolist())):
        mine = tracks.isel(track=np.flatnonzero(tracks["track_channel"].to_numpy() == channel))
        amplitude = mine["complex_amplitude"].to_numpy()
        size = np.abs(amplitude).mean(axis=1)
        faulty = np.array([str(name) in pictures.styles for name in mine["component"].to_numpy()])
        rows = [
            {
                "name": f"{_label(_track_line(mine, at))}, {_order(pictures, float(mine['track_order'][at]))}",
                "real": packed(amplitude[at].real),
                "imag": packed(amplitude[at].imag),
                "std": packed(mine["std"].to_numpy()[at]),
                "shown": place < _DRAWN_TRACKS,
            }
            for place, at in enumerate(np.lexsort((-size, ~faulty)).tolist())
        ]
        time = mine["time_s"].to_numpy()
        data = {
            "tracks": rows,
            "time": packed(time),
            "speed": packed(np.interp(time, speed["time_s"].to_numpy(), speed["speed_hz"].to_numpy())),
            "units": str(mine["track_units"].to_numpy()[0]),
        }
        what = "envelope lines" if of_parts else "orders"
        yield figure_html(
            Figure(
                name=f"{'parts' if of_parts else 'tracks'}-{number}",
                alt=f"Amplitude and phase of {len(rows)} {what} of {channel} against time or speed, or a Nyquist plot.",
                view="tracks",
                title=channel,
                height_px=560,
                data=data,
            ),
            caption=with_hz(_parts_caption(mine) if of_parts else _tracks_caption(mine), pictures.speed_hz),
        )


def _tracks_caption(tracks: xr.Dataset) -> str:
    widths = tracks["bandwidth_orders"].to_numpy()
    return (
        f"Kalman smoother, bandwidths {widths.min():.2g} to {widths.max():.2g} orders. Bands and circles: "
        "two standard deviations. Phase of a cosine, relative to the angle of the reference."
    )


def _parts_caption(tracks: xr.Dataset) -> str:
    """Return how the envelope lines were tracked: band, level, slip and bandwidth of each."""
    said = []
    for at in range(tracks.sizes["track"]):
        one = tracks.isel(track=at)
        slip = one["slip"].to_numpy()
        follows = f", slip {100 * np.nanmin(slip):+.2f} to {100 * np.nanmax(slip):+.2f} %" if slip.any() else ""
        depth = np.nanmean(np.abs(one["complex_amplitude"].to_numpy())) / float(one["level"])
        said.append(
            f"{_label(_track_line(tracks, at))}: envelope of {float(one['band_low_hz']):.5g} to "
            f"{float(one['band_high_hz']):.5g} Hz, mean modulation depth {depth:.1%}{follows}, bandwidth "
            f"{float(one['bandwidth_orders']):.2g} orders"
        )
    return (
        "; ".join(said) + ". Kalman smoother of the envelope. Bands and circles: two standard deviations. "
        "Phase relative to the angle of the line."
    )


def _track_line(tracks: xr.Dataset, at: int) -> dict[str, Any]:
    return {name: tracks[name].to_numpy()[at].item() for name in ("component", "kind", "harmonic", "sideband")}


def _averages(pictures: Pictures) -> Iterator[str]:
    """Yield a figure per gear, those of faulty gears first, with the averages of all channels."""
    gears: dict[str, list[tuple[str, int, int, Floats, Floats]]] = {}
    for channel, dataset in pictures_of(pictures.analysis, AVERAGES):
        ends = np.cumsum(dataset["size"].to_numpy())
        for at, name in enumerate(dataset["component"].to_numpy().tolist()):
            part = slice(int(ends[at] - dataset["size"][at]), int(ends[at]))
            gears.setdefault(name, []).append(
                (
                    channel,
                    int(dataset["teeth"][at]),
                    int(dataset["revolutions"][at]),
                    dataset["average"].to_numpy()[part],
                    dataset["difference"].to_numpy()[part],
                )
            )
    for number, name in enumerate(sorted(gears, key=lambda gear: gear not in pictures.styles)):
        teeth, revolutions = gears[name][0][1:3]
        traces: list[dict[str, Any]] = []
        for place, (channel, _, _, average, difference) in enumerate(gears[name]):
            x = packed(1 + teeth * np.arange(average.size) / average.size)
            shown: dict[str, Any] = {
                "type": "scatter",
                "mode": "lines",
                "x": x,
                "line": {"color": f"--c{place % 8}", "width": 1.2},
                "visible": True if place == 0 else "legendonly",
            }
            traces += [
                shown | {"y": packed(average), "name": f"average, {channel}"},
                shown | {"y": packed(difference), "yaxis": "y2", "name": f"difference, {channel}"},
            ]
        units = _units(pictures, gears[name][0][0])
        figure = Figure(
            name=f"average-{number}",
            alt=f"Synchronous average and difference signal of {name}, one revolution, against its {teeth} teeth.",
            title=name,
            traces=traces,
            height_px=400,
            layout={
                "xaxis": {
                    "title": {"text": "tooth, counted from the start of the average"},
                    "range": [1, 1 + teeth],
                    "tick0": 1,
                    "dtick": -(-teeth // _TOOTH_TICKS),
                    "anchor": "y2",
                },
                "yaxis": {"title": {"text": f"average, {units}"}, "domain": [0.55, 1]},
                "yaxis2": {"title": {"text": f"difference, {units}"}, "domain": [0, 0.45]},
                "margin": {"b": 84},
                "showlegend": len(gears[name]) > 1,
            },
        )
        said = f"{revolutions} revolutions." + (f" Channel {gears[name][0][0]}." if len(gears[name]) == 1 else "")
        yield figure_html(figure, caption=said)


def _kurtograms(pictures: Pictures) -> Iterator[str]:
    bands = {band["channel"]: band for band in envelope_bands(pictures.analysis)}
    for number, (channel, dataset) in enumerate(pictures_of(pictures.analysis, KURTOGRAM)):
        level, kurtosis = dataset["level"].to_numpy(), dataset["kurtosis"].to_numpy()
        rate_half = float(dataset["high_hz"].max())
        levels = np.unique(level)
        cells = 3 * 2 ** int(levels[-1])
        image = np.array([np.repeat(row := kurtosis[level == one], cells // row.size) for one in levels])
        best = int(np.nanargmax(kurtosis))
        shapes = []
        if channel in bands:
            edges = {"x0": bands[channel]["low_hz"], "x1": bands[channel]["high_hz"]}
            shapes.append(
                edges
                | {"type": "rect", "yref": "paper", "y0": 0, "y1": 1, "line": {"color": "--alarm", "width": 2}}
                | {"label": {"text": "demodulated band", "textposition": "top center", "font": {"color": "#ffffff"}}}
            )
        figure = Figure(
            name=f"kurtogram-{number}",
            alt=f"Kurtosis of every band of channel {channel}; the highest, {kurtosis[best]:.2g}, from "
            f"{float(dataset['low_hz'][best]):.6g} to {float(dataset['high_hz'][best]):.6g} Hz.",
            traces=[
                {
                    "type": "heatmap",
                    "z": packed_codes(image),
                    "x0": rate_half / cells / 2,
                    "dx": rate_half / cells,
                    "colorscale": "Viridis",
                    "colorbar": {"title": {"text": "kurtosis"}, "thickness": 12},
                    "hovertemplate": "%{x:.5g} Hz, %{y}: %{z:.3g}<extra></extra>",
                }
            ],
            title=channel,
            layout={
                "xaxis": {"title": {"text": "frequency, Hz"}, "range": [0, rate_half]},
                "yaxis": {
                    "title": {"text": "bandwidth, Hz"},
                    "tickvals": list(range(levels.size)),
                    "ticktext": [f"{rate_half / 2**one:,.0f}" for one in levels],
                    "autorange": "reversed",
                },
                "shapes": shapes,
            },
        )
        yield figure_html(figure, caption=_kurtogram_caption(dataset, bands.get(channel)))


def _waveforms(pictures: Pictures) -> Iterator[str]:
    found = list(pictures_of(pictures.analysis, WAVEFORM))
    every = -(-len(found) // _FULL_CHANNELS)
    for number, (channel, dataset) in enumerate(found):
        units = _units(pictures, channel)
        starts = np.arange(0, dataset.sizes["column"], every)
        times = np.repeat(dataset["time_s"].to_numpy()[starts], 2)
        least = np.minimum.reduceat(dataset["least"].to_numpy(), starts)
        largest = np.maximum.reduceat(dataset["largest"].to_numpy(), starts)
        both = np.stack([least, largest], axis=1).ravel()
        excerpt = dataset["excerpt"].to_numpy()[: dataset.sizes["sample"] // every]
        first = float(dataset["excerpt_time_s"][0])
        step = float(dataset["excerpt_time_s"][1]) - first if excerpt.size > 1 else 0.0
        line = {"type": "scatter", "mode": "lines", "line": {"color": "--line", "width": 0.8}, "showlegend": False}
        figure = Figure(
            name=f"waveform-{number}",
            alt=f"Waveform of channel {channel}: the whole record, and an excerpt around the largest deviation.",
            traces=[
                line | {"x": packed(times), "y": packed(both), "hovertemplate": "%{x:.4f} s: %{y:.4g}<extra></extra>"},
                line
                | {"x0": first, "dx": step, "y": packed(excerpt), "xaxis": "x2", "yaxis": "y2"}
                | {"hovertemplate": "%{x:.6f} s: %{y:.4g}<extra></extra>"},
            ],
            height_px=460,
            title=channel,
            layout={
                "xaxis": {"title": {"text": "time, s"}, "anchor": "y"},
                "yaxis": {"title": {"text": units}, "domain": [0.62, 1]},
                "xaxis2": {"title": {"text": "time, s"}, "anchor": "y2"},
                "yaxis2": {"title": {"text": units}, "domain": [0, 0.42], "anchor": "x2"},
            },
        )
        width_ms = 1e3 * every * float(dataset.attrs["column_s"])
        yield figure_html(figure, caption=f"Top: minimum and maximum of each {width_ms:.3g} ms.")


def _speed(pictures: Pictures) -> Iterator[str]:
    dataset = group(pictures.analysis, "speed")
    if not dataset["speed_hz"].size:
        return
    speed, indices = least_and_largest(dataset["speed_hz"].to_numpy(), columns=2000)
    figure = Figure(
        name="speed-0",
        alt=f"Speed of {dataset.attrs['shaft']} against time, {speed.min():.4g} to {speed.max():.4g} rev/s.",
        view="speed",
        height_px=280,
        data={
            "time": packed(dataset["time_s"].to_numpy()[indices]),
            "speed": packed(speed),
            "shaft": str(dataset.attrs["shaft"]),
        },
    )
    yield figure_html(figure, caption="Mean over each revolution.")


def _units(pictures: Pictures, channel: str) -> str:
    return next((str(one["units"]) for one in pictures.facts["channels"] if one["name"] == channel), "")


def _channels(dataset: xr.Dataset) -> Sequence[str]:
    return [str(name) for name in dataset["channel"].to_numpy()] if "channel" in dataset.coords else []

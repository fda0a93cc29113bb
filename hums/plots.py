"""Figures of an analysis: functions that draw on an Axes they are given."""

from collections.abc import Callable, Hashable
from io import StringIO
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK, FAINT, LINE, MARK, DOUBT = "#1f2933", "#9aa5b1", "#2563a8", "#c2410c", "#b7791f"
KIND_COLOURS = {
    "shaft": "#4b5563",
    "gear_mesh": "#2f855a",
    "tooth": "#805ad5",
    "inner_race": "#c2410c",
    "outer_race": "#b7791f",
    "rolling_element": "#b83280",
    "cage": "#2c7a7b",
}
TRACK_COLOURS = ("#2563a8", "#c2410c", "#2f855a", "#805ad5", "#b7791f", "#2c7a7b")
_COLUMNS = 1600  # of a drawn spectrum; between them the highest point is kept
_MOST_LABELS = 14


def plot_speed(speed: xr.Dataset, *, ax: Axes) -> Axes:
    """Draw the speed over time; `speed` is the group `/speed` of an analysis."""
    ax.plot(speed["time_s"], speed["speed_hz"], color=LINE, lw=1.2)
    ax.set(xlabel="time, s", ylabel=f"speed of {speed.attrs['shaft']}, rev/s")
    low, high = float(speed["speed_hz"].min()), float(speed["speed_hz"].max())
    margin = max(0.1 * (high - low), 0.002 * high)
    ax.set_ylim(low - margin, high + margin)
    return ax


def plot_spectrum(group: xr.Dataset, *, channel: str, ax: Axes) -> Axes:
    """Draw one channel's spectrum over orders with the claimed lines marked and named.

    Lines that were looked for and not claimed are ticks on the axis; `group` is `/order_spectrum` or `/envelope`.
    """
    spectrum = group.sel(channel=channel)
    orders, amplitude = _highest(spectrum["order"].to_numpy(), spectrum["amplitude"].to_numpy())
    ax.plot(orders, amplitude, color=LINE, lw=0.7)
    lines = _lines(group, channel)
    top = float(amplitude.max()) or 1.0
    labelled: list[tuple[float, float]] = []
    for line in lines:
        colour = KIND_COLOURS.get(line["kind"], INK)
        if not line["claimed"]:
            ax.plot(line["line_order"], 0, "|", color=colour, ms=5, alpha=0.5, clip_on=False)
            continue
        ax.plot(line["order_found"], line["line_amplitude"], "o", color=colour, ms=3.5, zorder=3)
        near = any(abs(line["order_found"] - x) < 0.035 * orders[-1] for x, _ in labelled)
        if len(labelled) < _MOST_LABELS and not near:
            labelled.append((line["order_found"], line["line_amplitude"]))
            ax.annotate(
                _label(line),
                (line["order_found"], line["line_amplitude"]),
                xytext=(0, 5),
                textcoords="offset points",
                rotation=90,
                ha="center",
                va="bottom",
                fontsize=7,
                color=colour,
            )
    ax.set(
        xlabel="order, cycles per revolution of the reference",
        ylabel=f"peak amplitude, {spectrum['units'].item()}",
        xlim=(0, float(orders[-1])),
        ylim=(0, 1.7 * top),
    )
    return ax


def plot_tracks(tracks: xr.Dataset, *, channel: str, ax: Axes, most: int = 6) -> Axes:
    """Draw the largest amplitude tracks of a channel with a band of plus and minus two standard deviations."""
    mine = tracks.isel(track=np.flatnonzero(tracks["track_channel"].to_numpy() == channel))
    size = np.abs(mine["complex_amplitude"].to_numpy()).mean(axis=1)
    for rank, index in enumerate(np.argsort(-size)[:most]):
        track = mine.isel(track=index)
        amplitude = np.abs(track["complex_amplitude"].to_numpy())
        std, time, colour = (
            track["std"].to_numpy(),
            track["time_s"].to_numpy(),
            TRACK_COLOURS[rank % len(TRACK_COLOURS)],
        )
        name = f"{track['component'].item()} {track['track_order'].item():.4g}"
        ax.plot(time, amplitude, color=colour, lw=1.2, label=name)
        ax.fill_between(time, np.maximum(amplitude - 2 * std, 0), amplitude + 2 * std, color=colour, alpha=0.2, lw=0)
    ax.set(xlabel="time, s", ylabel=f"peak amplitude, {mine['track_units'].to_numpy()[0]}")
    ax.set_ylim(bottom=0)
    ax.legend(fontsize=7, ncols=2, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return ax


def svg(draw: Callable[[Axes], object], *, width: float = 6.4, height: float = 3.4) -> str:
    """Return an SVG figure, as text to stand inside a page, of what `draw` puts on its Axes."""
    style: dict[str, Any] = {
        "font.size": 9,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "svg.fonttype": "path",
    }
    style |= {
        "svg.hashsalt": "hums",
        "axes.edgecolor": FAINT,
        "axes.labelcolor": INK,
        "xtick.color": INK,
        "ytick.color": INK,
    }
    with mpl.rc_context(style):  # type: ignore[arg-type]
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure.add_subplot())
        text = StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    page = text.getvalue()
    return page[page.index("<svg") :]


def _highest(orders: np.ndarray, amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Thin a spectrum for drawing: in each column the highest point stays, so no line is lost."""
    step = max(1, orders.size // _COLUMNS)
    size = orders.size // step * step
    blocks = amplitude[:size].reshape(-1, step)
    at = np.argmax(blocks, axis=1) + np.arange(blocks.shape[0]) * step
    return orders[at], amplitude[at]


def _lines(group: xr.Dataset, channel: str) -> list[dict[Hashable, Any]]:
    """Rows of the line table of one channel, fundamentals first, then by height; sidebands only where claimed."""
    table = group[[name for name in group.data_vars if group[name].dims == ("line",)]].to_dataframe()
    mine = table[(table["line_channel"] == channel) & ((table["sideband"] == 0) | (table["claimed"] == 1))]
    plain = (mine["harmonic"] == 1) & (mine["sideband"] == 0) & (mine["kind"] != "shaft")
    order = np.lexsort((-mine["line_amplitude"], ~plain))
    return mine.iloc[order].to_dict("records")


def _label(line: dict[Hashable, Any]) -> str:
    harmonic = f"{line['harmonic']}x " if line["harmonic"] != 1 else ""
    sideband = f" {line['sideband']:+d}" if line["sideband"] else ""
    kind = "" if line["kind"] in {"shaft", "gear_mesh", "tooth"} else " " + str(line["kind"]).replace("_", " ")
    return f"{harmonic}{line['component']}{kind}{sideband}"

"""Figures of an analysis: speed, spectra with identified lines, tracks, maps, averages; control charts of a fleet."""

from collections.abc import Hashable
from typing import Any, Literal

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation
from scipy.signal import resample

from hums.plots.labels import LabelSpace, apply_layout, point_size
from hums.plots.style import INK, KIND_COLOURS, LINE, MARK, TRACK_COLOURS, line_label

_NAME_GAP = 5  # points, from a line to its label
_ORDER = "order, cycles per revolution of the reference"


def plot_speed(analysis: xr.DataTree, *, ax: Axes) -> Axes:
    """Draw the speed of the reference against time.

    Parameters
    ----------
    analysis : xarray.DataTree
        Analysis of a record.
    ax : matplotlib.axes.Axes
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Examples
    --------
    >>> import xarray as xr
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_speed
    >>> speed = xr.Dataset(
    ...     {"speed_hz": ("revolution", [20.0, 20.5])},
    ...     coords={"time_s": ("revolution", [0.025, 0.074])},
    ...     attrs={"shaft": "input"},
    ... )
    >>> plot_speed(xr.DataTree.from_dict({"speed": speed}), ax=Figure().add_subplot()).get_ylabel()
    'speed of input, rev/s'
    """
    speed = analysis["speed"].to_dataset()
    ax.plot(speed["time_s"], speed["speed_hz"], color=LINE, lw=1.2)
    ax.set(xlabel="time, s", ylabel=f"speed of {speed.attrs['shaft']}, rev/s")
    low, high = float(speed["speed_hz"].min()), float(speed["speed_hz"].max())
    margin = max(0.1 * (high - low), 0.002 * high)
    ax.set_ylim(low - margin, high + margin)
    return ax


def plot_spectrum(
    analysis: xr.DataTree,
    *,
    channel: str,
    ax: Axes,
    spectrum: Literal["order_spectrum", "envelope"] = "order_spectrum",
) -> Axes:
    """Draw one channel's spectrum against order: identified lines with dot and label, other expected ones with a tick.

    Parameters
    ----------
    analysis : xarray.DataTree
        Analysis of a record.
    channel : str
        Channel to draw.
    ax : matplotlib.axes.Axes
        Axes to draw on.
    spectrum : {"order_spectrum", "envelope"}
        Which spectrum to draw.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> noise = np.random.default_rng(0).normal(size=8000)
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> record = hums.make_record({"housing": noise}, rate_hz=4000, units="g", angle=angle)
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_spectrum
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> plot_spectrum(analysis, channel="housing", ax=Figure().add_subplot()).get_ylabel()
    'peak amplitude, g'
    """
    group = analysis[spectrum].to_dataset()
    drawn = group.sel(channel=channel)
    orders, amplitude = _column_maxima(drawn["order"].to_numpy(), drawn["amplitude"].to_numpy())
    ax.plot(orders, amplitude, color=LINE, lw=0.7)
    lines = _lines(group, channel)
    top = float(amplitude.max()) or 1.0
    for kind in dict.fromkeys(line["kind"] for line in lines):
        colour, mine = KIND_COLOURS.get(kind, INK), [line for line in lines if line["kind"] == kind]
        dots = [(line["order_found"], line["line_amplitude"]) for line in mine if line["claimed"]]
        ticks = [(line["line_order"], 0.0) for line in mine if not line["claimed"]]
        ax.plot(*zip(*dots, strict=True), "o", color=colour, ms=3.5, zorder=3) if dots else None
        ax.plot(*zip(*ticks, strict=True), "|", color=colour, ms=5, alpha=0.5, clip_on=False) if ticks else None
    ax.set(
        xlabel=_ORDER,
        ylabel=f"peak amplitude, {drawn['units'].item()}",
        xlim=(0, float(orders[-1])),
        ylim=(0.0, 1.1 * top),
    )
    _name_lines([line for line in lines if line["claimed"]], np.column_stack((orders, amplitude)), ax=ax)
    return ax


def plot_tracks(
    analysis: xr.DataTree,
    *,
    channel: str,
    ax: Axes,
    of: Literal["tracks", "envelope_tracks"] = "tracks",
) -> Axes:
    """Draw the largest amplitude tracks of a channel against time, each with its pointwise 95 % confidence interval.

    Parameters
    ----------
    analysis : xarray.DataTree
        Analysis of a record.
    channel : str
        Channel to draw.
    ax : matplotlib.axes.Axes
        Axes to draw on.
    of : {"tracks", "envelope_tracks"}
        Which group of an analysis to draw: orders of the record, or envelope lines of components with a finding.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Raises
    ------
    ValueError
        If the channel has no tracks.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> times_s = np.arange(8000) / 4000
    >>> tone = 0.5 * np.cos(2 * np.pi * 23 * 20 * times_s)  # 23 teeth at 20 rev/s
    >>> noise = np.random.default_rng(0).normal(0, 0.05, times_s.size)
    >>> pulses = hums.PulseTimes(times_s=np.arange(41) / 20, shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"housing": tone + noise}, rate_hz=4000, units="g", angle=pulses)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_tracks
    >>> ax = plot_tracks(analysis, channel="housing", ax=Figure().add_subplot())
    >>> round(float(ax.lines[0].get_ydata().mean()), 2)
    0.5
    """
    tracks = analysis[of].to_dataset()
    if "track" not in tracks.sizes or channel not in tracks["track_channel"].to_numpy():
        raise ValueError(f'the analysis has no {of.replace("_", " ")} of channel "{channel}" to draw.')
    mine = tracks.isel(track=np.flatnonzero(tracks["track_channel"].to_numpy() == channel))
    size = np.abs(mine["complex_amplitude"].to_numpy()).mean(axis=1)
    for rank, index in enumerate(np.argsort(-size)[: len(TRACK_COLOURS)]):
        track = mine.isel(track=index)
        amplitude = np.abs(track["complex_amplitude"].to_numpy())
        half_width, time = track["half_width"].to_numpy(), track["time_s"].to_numpy()
        low, high = np.maximum(amplitude - half_width, 0), amplitude + half_width
        colour = TRACK_COLOURS[rank]
        name = f"{track['component'].item()} {track['track_order'].item():.4g}"
        ax.plot(time, amplitude, color=colour, lw=1.2, label=name)
        ax.fill_between(time, low, high, color=colour, alpha=0.2, lw=0)
    ax.set(xlabel="time, s", ylabel=f"peak amplitude, {mine['track_units'].to_numpy()[0]}")
    ax.set_ylim(bottom=0)
    ax.legend(fontsize=7, ncols=2, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return ax


def plot_order_map(analysis: xr.DataTree, *, channel: str, ax: Axes) -> Axes:
    """Draw the order map of a channel: order spectra against time, in dB relative to the largest amplitude.

    Parameters
    ----------
    analysis : xarray.DataTree
        From `hums.analyze` or `hums.open_analysis`.
    channel : str
        Channel to draw.
    ax : matplotlib.axes.Axes
        Axes to draw on; a colour bar is added.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Raises
    ------
    ValueError
        If the channel has no order map.

    Examples
    --------
    >>> import numpy as np
    >>> import xarray as xr
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_order_map
    >>> table = xr.Dataset(
    ...     {"amplitude": (("row", "order"), np.array([[0.1, 1.0, 0.1]]))},
    ...     coords={"order": [0.0, 1.0, 2.0], "time_s": ("row", [0.5])},
    ... )
    >>> analysis = xr.DataTree.from_dict({"order_map/housing": table})
    >>> ax = plot_order_map(analysis, channel="housing", ax=Figure().add_subplot())
    >>> ax.collections[0].get_array().tolist()  # dB
    [[-20.0, 0.0, -20.0]]
    """
    rows = _of_channel(analysis, "order_map", channel)
    amplitude = rows["amplitude"].to_numpy()
    top = float(amplitude.max()) or 1.0
    level = 20 * np.log10(np.maximum(amplitude / top, 1e-9))
    image = ax.pcolormesh(rows["order"], rows["time_s"], level, vmin=-60, vmax=0, shading="nearest", rasterized=True)
    ax.figure.colorbar(image, ax=ax, label="amplitude, dB re the largest")
    ax.set(xlabel=_ORDER, ylabel="time, s")
    return ax


def plot_kurtogram(analysis: xr.DataTree, *, channel: str, ax: Axes) -> Axes:
    """Draw the kurtogram of a channel: kurtosis against frequency and bandwidth, narrow bands at the bottom.

    Parameters
    ----------
    analysis : xarray.DataTree
        From `hums.analyze` or `hums.open_analysis`.
    channel : str
        Channel to draw.
    ax : matplotlib.axes.Axes
        Axes to draw on; a colour bar is added.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Raises
    ------
    ValueError
        If the channel has no kurtogram.

    Examples
    --------
    >>> import xarray as xr
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_kurtogram
    >>> bands = {"level": [0.0, 1.0, 1.0], "low_hz": [0.0, 0.0, 500.0], "high_hz": [1000.0, 500.0, 1000.0]}
    >>> bands |= {"kurtosis": [0.1, 0.0, 2.0]}
    >>> table = xr.Dataset({name: ("band", values) for name, values in bands.items()})
    >>> analysis = xr.DataTree.from_dict({"kurtogram/housing": table})
    >>> ax = plot_kurtogram(analysis, channel="housing", ax=Figure().add_subplot())
    >>> [label.get_text() for label in ax.get_yticklabels()]  # bandwidths in Hz
    ['1000', '500']
    """
    bands = _of_channel(analysis, "kurtogram", channel)
    low, high = bands["low_hz"].to_numpy(), bands["high_hz"].to_numpy()
    levels, row = np.unique(bands["level"].to_numpy(), return_inverse=True)
    cells = [Rectangle((a, y - 0.5), b - a, 1.0) for a, b, y in zip(low, high, row, strict=True)]
    image = ax.add_collection(PatchCollection(cells, array=bands["kurtosis"].to_numpy(), edgecolor="white", lw=0.3))
    ax.figure.colorbar(image, ax=ax, label="kurtosis of the complex envelope")
    ax.set(xlabel="frequency, Hz", ylabel="bandwidth, Hz", xlim=(0, high.max()), ylim=(levels.size - 0.5, -0.5))
    ax.set_yticks(range(levels.size), [f"{(high - low)[row == number][0]:.5g}" for number in range(levels.size)])
    return ax


def plot_average(analysis: xr.DataTree, *, channel: str, component: str, ax: Axes) -> Axes:
    """Draw the synchronous average of a gear and its difference signal against the teeth, numbered from 1.

    The difference signal is the average without its regular mesh lines. Tooth k lies between k - 1/2 and k + 1/2.

    Parameters
    ----------
    analysis : xarray.DataTree
        From `hums.analyze` or `hums.open_analysis`.
    channel : str
        Channel to draw.
    component : str
        Gear on a fixed axis, such as ``"stage 1/pinion"``.
    ax : matplotlib.axes.Axes
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Raises
    ------
    ValueError
        If the channel or gear has no average.

    Examples
    --------
    >>> import numpy as np
    >>> import xarray as xr
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_average
    >>> gears = {"component": ["wheel"], "teeth": [2], "revolutions": [50], "size": [4]}
    >>> table = xr.Dataset({name: ("gear", values) for name, values in gears.items()})
    >>> table["average"] = table["difference"] = "angle", np.array([1.0, -1.0, 1.0, -1.0])
    >>> tree = xr.DataTree.from_dict({"averages/housing": table})
    >>> ax = plot_average(tree, channel="housing", component="wheel", ax=Figure().add_subplot())
    >>> ax.lines[0].get_xdata()[:3].round(2).tolist(), ax.get_title(loc="left")
    ([0.5, 0.55, 0.6], 'wheel, 50 revolutions')
    """
    averages = _of_channel(analysis, "averages", channel)
    names = averages["component"].to_numpy().tolist()
    if component not in names:
        raise ValueError(f'channel "{channel}" has no average of "{component}"; it has {", ".join(names) or "none"}.')
    number, ends = names.index(component), np.cumsum(averages["size"].to_numpy())
    size, teeth = int(averages["size"][number]), int(averages["teeth"][number])
    samples = max(size, 20 * teeth)  # 20 samples per tooth or more
    for of, colour in (("average", LINE), ("difference", MARK)):
        values = resample(averages[of].to_numpy()[ends[number] - size : ends[number]], samples)
        ax.plot(0.5 + np.arange(samples) * teeth / samples, values, color=colour, lw=0.9, label=of)
    ax.set(xlabel="tooth", ylabel="amplitude, unit of the channel", xlim=(0.5, teeth + 0.5))
    ax.legend(fontsize=7, ncols=2, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    ax.set_title(f"{component}, {int(averages['revolutions'][number])} revolutions", loc="left", fontsize=8, color=INK)
    return ax


def plot_control_chart(fleet: xr.Dataset, *, machine: str, ax: Axes) -> Axes:
    """Draw the condition indices of a machine's worst components against record number, with the alarm limit.

    Parameters
    ----------
    fleet : xarray.Dataset
        Table ``fleet.h5`` of `hums.analyze_fleet`, as `xarray.open_dataset` reads it.
    machine : str
        Machine to draw.
    ax : matplotlib.axes.Axes
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Raises
    ------
    ValueError
        If the machine has no condition index.

    Examples
    --------
    >>> import xarray as xr
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_control_chart
    >>> fleet = xr.Dataset(
    ...     {"machine": ("record", ["mill", "mill"]), "health": (("record", "watched"), [[0.2, 0.1], [1.4, 0.2]])},
    ...     coords={"watched": ["stage 1", "stage 2"]},
    ... )
    >>> ax = plot_control_chart(fleet, machine="mill", ax=Figure().add_subplot())
    >>> [line.get_label() for line in ax.lines[:2]]
    ['stage 1', 'stage 2']
    """
    health = fleet["health"].to_numpy()[fleet["machine"].to_numpy() == machine]
    if not np.isfinite(health).any():
        raise ValueError(
            f'machine "{machine}" has no condition index to draw: it has no records, or only those of its baseline.'
        )
    largest = np.where(np.isfinite(health), health, -np.inf).max(axis=0)
    for colour, column in zip(TRACK_COLOURS, np.argsort(-largest, kind="stable"), strict=False):
        name = str(fleet["watched"].to_numpy()[column])
        ax.plot(1 + np.arange(len(health)), health[:, column], ".-", color=colour, lw=1.0, ms=4, label=name)
    ax.axhline(1.0, color=INK, lw=0.9, ls="--", label="alarm")
    ax.set(xlabel="record", ylabel="condition index")
    ax.set_ylim(bottom=0)
    ax.legend(fontsize=7, ncols=3, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return ax


def _of_channel(analysis: xr.DataTree, name: str, channel: str) -> xr.Dataset:
    """Return the data of a channel in a group of an analysis."""
    parts = analysis[name].children if name in analysis.children else {}
    if channel not in parts:
        known = ", ".join(parts) or "none"
        raise ValueError(f'the analysis has no {name.replace("_", " ")} of channel "{channel}"; available: {known}.')
    return parts[channel].to_dataset()


def _name_lines(lines: list[dict[Hashable, Any]], drawn: np.ndarray, *, ax: Axes) -> None:
    """Label lines in the given order, and leave out labels that would overlap.

    A label is placed above the part of the spectrum, `drawn` (n, 2) as order and amplitude, that lies within its width;
    the amplitude axis is extended to hold the labels.
    """
    apply_layout(ax)
    labels = [_name(line, ax=ax) for line in lines]
    to_fraction = ax.transScale + ax.transLimits
    to_orders = ax.transData.inverted()
    for label in labels:
        extent = label.get_window_extent().padded(point_size(ax))
        left, right = to_orders.transform([(extent.x0, 0.0), (extent.x1, 0.0)])[:, 0]
        under = drawn[(drawn[:, 0] > left) & (drawn[:, 0] < right), 1]
        label.xy = (label.xy[0], max(label.xy[1], under.max(initial=0.0)))
        # with a tenth to spare, since labels of other axes may yet shrink these
        available = 1 - (1.1 * extent.height + _NAME_GAP * point_size(ax)) / ax.bbox.height
        low, _ = ax.get_ybound()
        # scale the axis so that the name just fits between this amplitude and the top
        share = to_fraction.transform(label.xy)[1] / max(available, 0.2)
        if share > 1:
            high = to_fraction.inverted().transform((0.0, share))[1]
            ax.set_ylim(low, high)
    apply_layout(ax)
    space, named = LabelSpace(), 0
    most = 14
    for label in labels:
        extent = label.get_window_extent().padded(0.5 * point_size(ax))
        if named < most and space.free(extent):
            label.set_in_layout(True)
            space.occupy(extent)
            named += 1
        else:
            label.remove()


def _name(line: dict[Hashable, Any], *, ax: Axes) -> Annotation:
    """Write the label of a line above its peak in a spectrum."""
    return ax.annotate(
        line_label(line),
        (line["order_found"], line["line_amplitude"]),
        xytext=(0, _NAME_GAP),
        textcoords="offset points",
        rotation=90,
        ha="center",
        va="bottom",
        fontsize=7,
        color=KIND_COLOURS.get(line["kind"], INK),
        in_layout=False,  # until it is known to stay
    )


def _column_maxima(orders: np.ndarray, amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reduce a spectrum for drawing to the maximum of each column, so that no line is lost."""
    columns = 1600  # of a drawn spectrum, each showing its largest value
    step = max(1, orders.size // columns)
    size = orders.size // step * step
    blocks = amplitude[:size].reshape(-1, step)
    at = np.argmax(blocks, axis=1) + np.arange(blocks.shape[0]) * step
    return orders[at], amplitude[at]


def _lines(group: xr.Dataset, channel: str) -> list[dict[Hashable, Any]]:
    """Return the lines of one channel, fundamentals first, then by amplitude; sidebands only if identified."""
    table = group[[name for name in group.data_vars if group[name].dims == ("line",)]].to_dataframe()
    mine = table[(table["line_channel"] == channel) & ((table["sideband"] == 0) | (table["claimed"] == 1))]
    plain = (mine["harmonic"] == 1) & (mine["sideband"] == 0) & (mine["kind"] != "shaft")
    order = np.lexsort((-mine["line_amplitude"], ~plain))
    return mine.iloc[order].to_dict("records")

"""Figures of gear dynamics: mode shapes, Campbell diagram, stability map.

They accept any object with the stated attributes, such as the results of `data_synth`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb

from hums.plots.labels import name_right_ends
from hums.plots.style import FAINT, INK, LINE, MARK


def plot_mode_shape(modes: Any, number: int, *, ax: Axes, energy: Mapping[str, float] | None = None) -> Axes:  # noqa: ANN401
    """Draw one mode shape as a bar per degree of freedom.

    Translations and rotations are each scaled to their own largest value, since they have different units.

    Parameters
    ----------
    modes : object with ``frequencies_hz`` (mode,), ``shapes`` (dof, mode), ``kinds`` (mode,) and ``names`` (dof,)
        Natural frequencies in Hz, mode shapes, the kind of each mode, and the name of each degree of freedom.
    number : int
        Index of the mode, from 0; the title numbers modes from 1.
    ax : matplotlib.axes.Axes
        Axes to draw on.
    energy : mapping of str to float, optional
        Share of the kinetic energy by part, for the title.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_mode_shape
    >>> modes = SimpleNamespace(
    ...     frequencies_hz=np.array([0.0, 450.0]),
    ...     shapes=np.array([[1.0, 2.0], [1.0, -1.0]]),
    ...     kinds=("rigid", "rotational"),
    ...     names=("pinion rotation", "gear rotation"),
    ... )
    >>> ax = plot_mode_shape(modes, 1, ax=Figure().add_subplot())
    >>> [float(bar.get_width()) for bar in ax.patches]  # over the largest rotation
    [1.0, -0.5]
    """
    shape = modes.shapes[:, number]
    turns = np.array([name.endswith("rotation") or " tilt " in name for name in modes.names])
    # values due to rounding alone must not be scaled up to 1
    scaled = np.zeros_like(shape)
    for chosen in (turns, ~turns):
        if chosen.any() and np.abs(shape[chosen]).max() > 1e-9 * np.abs(shape).max():
            scaled[chosen] = shape[chosen] / np.abs(shape[chosen]).max()
    places = np.arange(shape.size)
    ax.barh(places[~turns], scaled[~turns], color=LINE, height=0.6, label="translation")
    ax.barh(places[turns], scaled[turns], color=MARK, height=0.6, label="rotation")
    ax.axvline(0, color=INK, lw=0.8)
    ax.set_yticks(places, modes.names, fontsize=7)
    ax.set(xlim=(-1.08, 1.08), ylim=(shape.size - 0.4, -0.6), xticks=(-1, -0.5, 0, 0.5, 1))
    ax.set_xlabel("relative to the largest translation or rotation", fontsize=7)
    shares = ", ".join(f"{part} {share:.0%}" for part, share in (energy or {}).items())
    heading = f"mode {number + 1}: {modes.frequencies_hz[number]:.5g} Hz, {modes.kinds[number]}"
    ax.set_title(f"{heading}\n{shares}".rstrip(), loc="left", fontsize=8, color=INK)
    ax.legend(fontsize=7, ncols=1, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    return ax


def plot_campbell(diagram: Any, *, ax: Axes, harmonics: int = 1) -> Axes:  # noqa: ANN401
    """Draw a Campbell diagram: natural frequencies against speed, and mesh harmonics as dashed lines.

    Modes are numbered from 1, rigid-body modes included. The frequency axis ends above the highest mesh harmonic.

    Parameters
    ----------
    diagram : object with ``speeds_rad_s`` (speed,), ``frequencies_hz`` (speed, mode) and ``orders``
        Speeds of the reference in rad/s, natural frequencies in Hz, and mesh orders.
    ax : matplotlib.axes.Axes
        Axes to draw on; their current height limits the number of labels.
    harmonics : int
        Number of harmonics drawn for each mesh order.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_campbell
    >>> diagram = SimpleNamespace(
    ...     speeds_rad_s=2 * np.pi * np.array([0.0, 10.0]), frequencies_hz=np.full((2, 1), 150.0), orders=(23.0,)
    ... )
    >>> ax = plot_campbell(diagram, ax=Figure().add_subplot())
    >>> [text.get_text() for text in ax.texts]
    ['order 23', 'mode 1, 150 Hz']
    """
    rates = diagram.speeds_rad_s / (2 * np.pi)
    rays = sorted({multiple * order for order in diagram.orders for multiple in range(1, harmonics + 1)})
    natural = np.where(diagram.frequencies_hz > 0, diagram.frequencies_hz, np.nan)
    top = 1.25 * max([order * rates[-1] for order in rays] or [float(diagram.frequencies_hz.max())])
    shown = [number for number in range(natural.shape[1]) if np.nanmin(natural[:, number], initial=np.inf) <= top]
    ax.plot(60 * rates, natural[:, shown], color=LINE, lw=1.2)
    for order in rays:
        ax.plot(60 * rates, order * rates, color=MARK, lw=0.8, ls=(0, (4, 2.5)))
    ax.set(xlabel="speed of the reference, rpm", ylabel="frequency, Hz", xlim=60 * rates[[0, -1]], ylim=(0, top))
    of_modes = [(natural[-1, number], f"mode {number + 1}, {natural[-1, number]:.4g} Hz", LINE) for number in shown]
    name_right_ends(
        [*((order * rates[-1], f"order {order:.4g}", MARK) for order in rays), *(m for m in of_modes if m[0] <= top)],
        ax=ax,
    )
    return ax


def plot_stability_map(map_: Any, *, ax: Axes, parameter: str = "") -> Axes:  # noqa: ANN401
    """Draw instability regions against speed in rpm and a parameter, or the multiplier for a single parameter value.

    Parameters
    ----------
    map_ : object with ``speeds_rad_s`` (speed,), ``parameters`` (parameter,) and ``growth`` (parameter, speed)
        Speeds of the reference in rad/s, values of the parameter, and magnitudes of the largest Floquet multiplier.
    ax : matplotlib.axes.Axes
        Axes to draw on.
    parameter : str
        Name of the parameter with its unit, for the axis.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_stability_map
    >>> one = SimpleNamespace(
    ...     speeds_rad_s=np.array([10.0, 20.0]), parameters=np.zeros(1), growth=np.array([[1.0, 1.3]])
    ... )
    >>> ax = plot_stability_map(one, ax=Figure().add_subplot())
    >>> ax.lines[0].get_xdata().round(1).tolist()  # rpm
    [95.5, 191.0]
    """
    rates = 30 / np.pi * map_.speeds_rad_s
    ax.set(xlabel="speed of the reference, rpm", xlim=(rates[0], rates[-1]))
    if map_.parameters.size == 1:
        ax.plot(rates, map_.growth[0], color=LINE, lw=1.2)
        ax.axhline(1, color=FAINT, lw=0.8)
        ax.set_ylabel("largest Floquet multiplier")
        return ax
    growth_tolerance = 1e-6  # of a multiplier above 1, for rounding
    excess = np.where(map_.growth > 1 + growth_tolerance, map_.growth - 1, np.nan)
    ax.set_facecolor("white")
    full = np.array(to_rgb(MARK))
    single_hue = ListedColormap(1 - np.linspace(0.25, 1, 64)[:, None] * (1 - full))  # of rising saturation
    drawn = ax.pcolormesh(rates, map_.parameters, excess, cmap=single_hue, shading="nearest", rasterized=True, vmin=0)
    ax.figure.colorbar(drawn, ax=ax, label="growth per period")
    ax.set_ylabel(parameter or "parameter")
    return ax

"""Figures of gear dynamics: mesh stiffness, mode shapes, Campbell diagram, stability map.

They accept any object with the stated attributes, such as the results of `data_synth`.
"""

from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb
from numpy.typing import ArrayLike, NDArray

from hums.plots.style import FAINT, INK, LINE, MARK, TRACK_COLOURS

Array = NDArray[np.float64]
_GROWTH_TOLERANCE = 1e-6  # of a multiplier above 1, for rounding
_POINTS = 400  # of a drawn cycle
_KIND_COLOURS = {
    "rigid": FAINT,
    "rotational": TRACK_COLOURS[0],
    "translational": TRACK_COLOURS[1],
    "planet": TRACK_COLOURS[2],
    "mixed": TRACK_COLOURS[3],
}


class MeshStiffness(Protocol):
    """Mesh stiffness as a function of the mesh phase."""

    @property
    def mean(self) -> float:
        """Mean over a period in N/m."""

    @property
    def period(self) -> int:
        """Period in mesh cycles."""

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases of its discontinuities in mesh cycles, in [0, period)."""

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return the stiffness in N/m at phases in mesh cycles."""


class ModeShapes(Protocol):
    """Natural frequencies and mode shapes."""

    @property
    def frequencies_hz(self) -> Array:
        """Natural frequencies in Hz, (mode,)."""

    @property
    def shapes(self) -> Array:
        """Mass-normalised mode shapes, (dof, mode)."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each mode."""

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each degree of freedom."""


class CampbellDiagram(Protocol):
    """Natural frequencies over speed, and the orders of the meshes."""

    @property
    def speeds_rad_s(self) -> Array:
        """Speeds of the reference in rad/s, (speed,)."""

    @property
    def frequencies_hz(self) -> Array:
        """Natural frequencies in Hz, (speed, mode)."""

    @property
    def orders(self) -> tuple[float, ...]:
        """Mesh orders in cycles per revolution of the reference."""


class StabilityMap(Protocol):
    """Magnitude of the largest Floquet multiplier over speed and a parameter."""

    @property
    def speeds_rad_s(self) -> Array:
        """Speeds of the reference in rad/s, (speed,)."""

    @property
    def parameters(self) -> Array:
        """Values of the parameter in any unit, (parameter,)."""

    @property
    def growth(self) -> Array:
        """Magnitude of the largest Floquet multiplier, (parameter, speed)."""


def plot_mesh_stiffness(stiffness: MeshStiffness, *, ax: Axes, cycles: tuple[float, float] | None = None) -> Axes:
    """Draw a mesh stiffness against the mesh phase, with its mean as a dashed line.

    Parameters
    ----------
    stiffness : callable with ``mean`` (N/m), ``period`` and ``jumps`` (mesh cycles)
        Returns the stiffness in N/m at mesh phases in cycles.
    ax : matplotlib.axes.Axes
        Axes to draw on.
    cycles : (float, float), optional
        First and last mesh phase to draw, in cycles; default one period.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_mesh_stiffness
    >>> class Rectangular:
    ...     mean, period, jumps = 2e6, 1, (0.0, 0.5)
    ...     def __call__(self, phase_cycles):
    ...         return np.where(np.mod(phase_cycles, 1) < 0.5, 3e6, 1e6)
    >>> ax = plot_mesh_stiffness(Rectangular(), ax=Figure().add_subplot())
    >>> float(ax.lines[0].get_ydata().max())  # N/um
    3.0
    """
    start, stop = cycles or (0.0, float(stiffness.period))
    first, last = int(start // stiffness.period), int(stop // stiffness.period) + 1
    jumps = [jump + turn * stiffness.period for turn in range(first, last) for jump in stiffness.jumps]
    even = np.linspace(start, stop - 1e-9, round(_POINTS * max(1.0, stop - start)))  # a jump at the end is not drawn
    sides = np.array([jump + side for jump in jumps if start < jump < stop for side in (-1e-9, 1e-9)])
    phases = np.unique(np.concatenate([even, sides]))
    ax.plot(phases, stiffness(phases) / 1e6, color=LINE, lw=1.2)
    ax.axhline(stiffness.mean / 1e6, color=FAINT, lw=0.8, ls=(0, (4, 2.5)))
    ax.set(xlabel="mesh phase, cycles", ylabel="mesh stiffness, N/µm", xlim=(start, stop))
    ax.set_ylim(bottom=0)
    return ax


def plot_mode_shape(modes: ModeShapes, number: int, *, ax: Axes) -> Axes:
    """Draw one mode shape as a bar per degree of freedom.

    Translations and rotations are each scaled to their own largest value, since they have different units.

    Parameters
    ----------
    modes : object with ``frequencies_hz`` (mode,), ``shapes`` (dof, mode), ``kinds`` (mode,) and ``names`` (dof,)
        Natural frequencies in Hz, mode shapes, the kind of each mode, and the name of each degree of freedom.
    number : int
        Index of the mode.
    ax : matplotlib.axes.Axes
        Axes to draw on.

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
    ax.set(xlim=(-1.08, 1.08), ylim=(shape.size - 0.4, -0.6), xlabel="relative to the largest of its kind")
    ax.set_title(f"{modes.frequencies_hz[number]:.5g} Hz, {modes.kinds[number]}", loc="left", fontsize=8, color=INK)
    ax.legend(fontsize=7, ncols=2, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    return ax


def plot_frequencies(modes: ModeShapes, *, ax: Axes) -> Axes:
    """Draw the natural frequencies as vertical lines, one row per kind of mode.

    Parameters
    ----------
    modes : object with ``frequencies_hz`` (mode,), ``shapes`` (dof, mode), ``kinds`` (mode,) and ``names`` (dof,)
        Natural frequencies in Hz, mode shapes, the kind of each mode, and the name of each degree of freedom.
    ax : matplotlib.axes.Axes
        Axes to draw on.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from hums.plots import plot_frequencies
    >>> modes = SimpleNamespace(
    ...     frequencies_hz=np.array([0.0, 450.0]),
    ...     shapes=np.array([[1.0, 2.0], [1.0, -1.0]]),
    ...     kinds=("rigid", "rotational"),
    ...     names=("pinion rotation", "gear rotation"),
    ... )
    >>> ax = plot_frequencies(modes, ax=Figure().add_subplot())
    >>> [label.get_text() for label in ax.get_yticklabels()]
    ['rigid', 'rotational']
    """
    kinds = [kind for kind in _KIND_COLOURS if kind in modes.kinds]
    for row, kind in enumerate(kinds):
        chosen = [rate for rate, of in zip(modes.frequencies_hz, modes.kinds, strict=True) if of == kind]
        ax.vlines(chosen, row - 0.35, row + 0.35, color=_KIND_COLOURS[kind], lw=1.6)
    ax.set_yticks(range(len(kinds)), kinds)
    ax.set(xlabel="natural frequency, Hz", ylim=(len(kinds) - 0.5, -0.5))
    return ax


def plot_campbell(diagram: CampbellDiagram, *, ax: Axes, harmonics: int = 1) -> Axes:
    """Draw a Campbell diagram: natural frequencies against speed, and mesh harmonics as dashed lines.

    Parameters
    ----------
    diagram : object with ``speeds_rad_s`` (speed,), ``frequencies_hz`` (speed, mode) and ``orders``
        Speeds of the reference in rad/s, natural frequencies in Hz, and mesh orders.
    ax : matplotlib.axes.Axes
        Axes to draw on.
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
    >>> ax.lines[1].get_ydata().tolist()  # order 23 at 0 and 10 rev/s, in Hz
    [0.0, 230.0]
    """
    rates = diagram.speeds_rad_s / (2 * np.pi)
    ax.plot(rates, np.where(diagram.frequencies_hz > 0, diagram.frequencies_hz, np.nan), color=LINE, lw=1.2)
    top = 1.08 * float(diagram.frequencies_hz.max())
    ax.set(xlabel="speed of the reference, rev/s", ylabel="frequency, Hz", xlim=(rates[0], rates[-1]), ylim=(0, top))
    rays = sorted({multiple * order for order in diagram.orders for multiple in range(1, harmonics + 1)})
    for order in rays:
        ax.plot(rates, order * rates, color=MARK, lw=0.8, ls=(0, (4, 2.5)))
        leaves = min(float(rates[-1]), top / order)
        if leaves > rates[0]:
            over = leaves < rates[-1]
            ax.annotate(
                f"{order:.4g}",
                (leaves, order * leaves),
                xytext=(0, 3) if over else (3, 0),
                textcoords="offset points",
                ha="center" if over else "left",
                va="bottom" if over else "center",
                fontsize=7,
                color=MARK,
            )
    return ax


def plot_stability_map(map_: StabilityMap, *, ax: Axes, cycles_per_rev: float = 1.0, parameter: str = "") -> Axes:
    """Draw the instability regions over mesh frequency and a parameter; for one parameter value, the multiplier.

    Parameters
    ----------
    map_ : object with ``speeds_rad_s`` (speed,), ``parameters`` (parameter,) and ``growth`` (parameter, speed)
        Speeds of the reference in rad/s, values of the parameter, and magnitudes of the largest Floquet multiplier.
    ax : matplotlib.axes.Axes
        Axes to draw on.
    cycles_per_rev : float
        Mesh cycles per revolution of the reference: the axis is the mesh frequency in rad/s.
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
    >>> ax = plot_stability_map(one, ax=Figure().add_subplot(), cycles_per_rev=36)
    >>> ax.lines[0].get_xdata().tolist()  # mesh frequency in rad/s
    [360.0, 720.0]
    """
    rates = cycles_per_rev * map_.speeds_rad_s
    ax.set(xlabel="mesh frequency, rad/s", xlim=(rates[0], rates[-1]))
    if map_.parameters.size == 1:
        ax.plot(rates, map_.growth[0], color=LINE, lw=1.2)
        ax.axhline(1, color=FAINT, lw=0.8)
        ax.set_ylabel("largest Floquet multiplier")
        return ax
    excess = np.where(map_.growth > 1 + _GROWTH_TOLERANCE, map_.growth - 1, np.nan)
    ax.set_facecolor("white")
    full = np.array(to_rgb(MARK))
    single_hue = ListedColormap(1 - np.linspace(0.25, 1, 64)[:, None] * (1 - full))  # of rising saturation
    drawn = ax.pcolormesh(rates, map_.parameters, excess, cmap=single_hue, shading="nearest", rasterized=True, vmin=0)
    ax.figure.colorbar(drawn, ax=ax, label="growth per period")
    ax.set_ylabel(parameter or "parameter")
    return ax

"""Figures of a gearbox in motion: mesh stiffness, mode shapes, Campbell diagram, multipliers, stability map.

They draw anything that has the named attributes, as the results of `data_synth` do.
"""

from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from numpy.typing import ArrayLike, NDArray

from hums.plots.style import FAINT, INK, LINE, MARK, TRACK_COLOURS

Array = NDArray[np.float64]
_GROWS = 1e-6  # of a multiplier above 1: what rounding explains
_POINTS = 400  # of a drawn cycle
_KIND_COLOURS = {
    "rigid": FAINT,
    "rotational": TRACK_COLOURS[0],
    "translational": TRACK_COLOURS[1],
    "planet": TRACK_COLOURS[2],
    "mixed": TRACK_COLOURS[3],
}


class OfPhase(Protocol):
    """A stiffness over the mesh phase."""

    @property
    def mean(self) -> float:
        """N/m."""

    @property
    def period(self) -> int:
        """Mesh cycles."""

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases at which it jumps."""

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """N/m."""


class ModeShapes(Protocol):
    """Frequencies (mode,), shapes (dof, mode), the kind of each mode and the name of each degree of freedom."""

    @property
    def frequencies_hz(self) -> Array:
        """Hz."""

    @property
    def shapes(self) -> Array:
        """Mass-normalised."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Of the modes."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the degrees of freedom."""


class OverSpeed(Protocol):
    """Frequencies (speed, mode) over speeds of the reference, and the orders of the meshes."""

    @property
    def speeds_rad_s(self) -> Array:
        """rad/s."""

    @property
    def frequencies_hz(self) -> Array:
        """Hz."""

    @property
    def orders(self) -> tuple[float, ...]:
        """Cycles per revolution."""


class OfParameter(Protocol):
    """Largest multiplier (parameter, speed)."""

    @property
    def speeds_rad_s(self) -> Array:
        """rad/s."""

    @property
    def parameters(self) -> Array:
        """Any unit."""

    @property
    def growth(self) -> Array:
        """A period."""


def plot_mesh_stiffness(stiffness: OfPhase, *, ax: Axes, cycles: tuple[float, float] | None = None) -> Axes:
    """Draw a mesh stiffness over its phase, jumps upright, its mean dashed; one period or the given cycles."""
    start, stop = cycles or (0.0, float(stiffness.period))
    first, last = int(start // stiffness.period), int(stop // stiffness.period) + 1
    jumps = [jump + turn * stiffness.period for turn in range(first, last) for jump in stiffness.jumps]
    even = np.linspace(start, stop - 1e-9, round(_POINTS * max(1.0, stop - start)))  # what follows a jump is not drawn
    sides = np.array([jump + side for jump in jumps if start < jump < stop for side in (-1e-9, 1e-9)])
    phases = np.unique(np.concatenate([even, sides]))
    ax.plot(phases, stiffness(phases) / 1e6, color=LINE, lw=1.2)
    ax.axhline(stiffness.mean / 1e6, color=FAINT, lw=0.8, ls=(0, (4, 2.5)))
    ax.set(xlabel="mesh phase, cycles", ylabel="mesh stiffness, N/µm", xlim=(start, stop))
    ax.set_ylim(bottom=0)
    return ax


def plot_mode_shape(modes: ModeShapes, number: int, *, ax: Axes) -> Axes:
    """Draw one mode as a bar for each degree of freedom, translations and rotations each over their largest.

    Metres and radians share no axis, so the two are scaled apart. Bars of what stands still are left out.
    """
    shape = modes.shapes[:, number]
    turns = np.array([name.endswith("rotation") or " tilt " in name for name in modes.names])
    # a motion that rounding alone gives the mode stays nothing beside the other kind
    scaled = np.zeros_like(shape)
    for chosen in (turns, ~turns):
        if chosen.any() and np.abs(shape[chosen]).max() > 1e-9 * np.abs(shape).max():
            scaled[chosen] = shape[chosen] / np.abs(shape[chosen]).max()
    places = np.arange(shape.size)
    ax.barh(places[~turns], scaled[~turns], color=LINE, height=0.6, label="translation")
    ax.barh(places[turns], scaled[turns], color=MARK, height=0.6, label="rotation")
    ax.axvline(0, color=INK, lw=0.8)
    ax.set_yticks(places, modes.names, fontsize=7)
    ax.set(xlim=(-1.08, 1.08), ylim=(shape.size - 0.4, -0.6), xlabel="share of the largest of its kind")
    ax.set_title(f"{modes.frequencies_hz[number]:.5g} Hz, {modes.kinds[number]}", loc="left", fontsize=8, color=INK)
    ax.legend(fontsize=7, ncols=2, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    return ax


def plot_frequencies(modes: ModeShapes, *, ax: Axes) -> Axes:
    """Draw the natural frequencies as upright lines, one row for each kind of mode."""
    kinds = [kind for kind in _KIND_COLOURS if kind in modes.kinds]
    for row, kind in enumerate(kinds):
        chosen = [rate for rate, of in zip(modes.frequencies_hz, modes.kinds, strict=True) if of == kind]
        ax.vlines(chosen, row - 0.35, row + 0.35, color=_KIND_COLOURS[kind], lw=1.6)
    ax.set_yticks(range(len(kinds)), kinds)
    ax.set(xlabel="natural frequency, Hz", ylim=(len(kinds) - 0.5, -0.5))
    return ax


def plot_campbell(diagram: OverSpeed, *, ax: Axes, harmonics: int = 1) -> Axes:
    """Draw natural frequencies over speed in rev/s, and the harmonics of each mesh as dashed rays with their order."""
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


def plot_multipliers(multipliers: NDArray[np.complex128], *, ax: Axes) -> Axes:
    """Draw Floquet multipliers about the unit circle, those outside of it marked."""
    turn = np.linspace(0, 2 * np.pi, 361)
    ax.plot(np.cos(turn), np.sin(turn), color=FAINT, lw=0.8)
    outside = np.abs(multipliers) > 1 + _GROWS
    for chosen, colour in ((~outside, LINE), (outside, MARK)):
        ax.plot(multipliers[chosen].real, multipliers[chosen].imag, "o", ms=4, color=colour)
    reach = 1.15 * max(1.0, float(np.abs(multipliers).max()))
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="real part", ylabel="imaginary part", aspect="equal")
    return ax


def plot_stability_map(map_: OfParameter, *, ax: Axes, cycles_per_rev: float = 1.0, parameter: str = "") -> Axes:
    """Draw where motion grows, over mesh frequency and a parameter; with one parameter, the growth itself.

    Parameters
    ----------
    map_ : StabilityMap
    ax : Axes
    cycles_per_rev : float
        Mesh cycles per revolution of the reference: the axis is the mesh frequency in rad/s.
    parameter : str
        What the parameter is, with its unit.
    """
    rates = cycles_per_rev * map_.speeds_rad_s
    ax.set(xlabel="mesh frequency, rad/s", xlim=(rates[0], rates[-1]))
    if map_.parameters.size == 1:
        ax.plot(rates, map_.growth[0], color=LINE, lw=1.2)
        ax.axhline(1, color=FAINT, lw=0.8)
        ax.set_ylabel("largest multiplier")
        return ax
    excess = np.where(map_.growth > 1 + _GROWS, map_.growth - 1, np.nan)
    ax.set_facecolor("white")
    drawn = ax.pcolormesh(rates, map_.parameters, excess, cmap=_warm(), shading="nearest", rasterized=True, vmin=0)
    ax.figure.colorbar(drawn, ax=ax, label="growth in a period")
    ax.set_ylabel(parameter or "parameter")
    return ax


def _warm() -> ListedColormap:
    """Return colours from faint to full of one hue."""
    share = np.linspace(0.25, 1, 64)[:, None]
    full = np.array([int(MARK[place : place + 2], 16) / 255 for place in (1, 3, 5)])
    return ListedColormap(1 - share * (1 - full))

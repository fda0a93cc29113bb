"""Chart of defect frequencies against speed."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatter

from hums.gearbox.defect_orders import BEARING_KINDS, KINDS
from hums.plots.labels import name_right_ends
from hums.plots.style import FAINT, INK, KIND_COLOURS

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class _Line:
    """One order with its sources as (component, kind)."""

    order: float
    sources: tuple[tuple[str, str], ...]

    @property
    def kinds(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(kind for _, kind in self.sources))

    @property
    def label(self) -> str:
        """The order and as many of its sources as fit the longest name."""
        many = range(len(self.sources), 0, -1)
        longest = 48  # characters of a label, above which further components are only counted
        return next((label for most in many if len(label := self._label_of(most)) <= longest), self._label_of(1))

    def _label_of(self, most: int) -> str:
        """Return the order and `most` of its sources; a repeated component or kind is written once."""
        shown = self.sources[:most]
        names = []
        words = {"shaft": "", "gear_mesh": "mesh", "planet_pass": "", "planet_tooth": "tooth"}
        for number, (name, kind) in enumerate(shown):
            repeated = number > 0 and name == shown[number - 1][0]
            later = number + 1 < len(shown) and kind == shown[number + 1][1]
            word = "" if later else words.get(kind, kind.replace("_", " "))
            names.append(" ".join(part for part in ("" if repeated and word else name, word) if part))
        more = f" and {len(self.sources) - most} more" if len(self.sources) > most else ""
        return f"{self.order:.4g}  {' = '.join(names)}{more}"


def speed_order_chart(table: "pd.DataFrame", *, reference_rpm: tuple[float, float], ax: Axes) -> Axes:
    """Draw the frequency of every defect order against the speed of the reference.

    Lines are coloured by kind and labelled at their right end with order and component. Orders that coincide are one
    line, dashed in the colours of both kinds, with an equals sign in its label.

    Parameters
    ----------
    table : pandas.DataFrame
        Result of `hums.defect_orders`.
    reference_rpm : (float, float)
        Lowest and highest speed of the reference in rpm.
    ax : matplotlib.axes.Axes
        Axes to draw on; their current height limits the number of labels.

    Returns
    -------
    matplotlib.axes.Axes
        `ax`.

    Raises
    ------
    ValueError
        If the table is empty, or not ``0 < low < high``.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> import hums
    >>> from hums.plots import speed_order_chart
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("wijianto-pair"))
    >>> table = hums.defect_orders(kinematics)
    >>> ax = speed_order_chart(table, reference_rpm=(300, 3000), ax=Figure().add_subplot())
    >>> [text.get_text() for text in ax.texts if "mesh" in text.get_text()]
    ['36  pinion-gear mesh']
    """
    low, high = reference_rpm
    if not (0 < low < high < np.inf):
        raise ValueError(f"reference_rpm = ({low:g}, {high:g}): give (low, high) in rpm with 0 < low < high.")
    lines = _merged_lines(table)
    if not lines:
        raise ValueError("the table of defect orders is empty: no link of the gearbox rotates at these speeds.")
    ax.set_yscale("log")
    rpm = np.linspace(low, high, 64)
    for line in lines:
        first, *others = line.kinds
        width = 1.6 if len(line.sources) > 1 else 1.0
        style = "-." if first in BEARING_KINDS and not others else "-"
        ax.plot(rpm, line.order * rpm / 60, color=KIND_COLOURS[first], lw=width, ls=style)
        if others:
            second = (0, (4, 4))
            ax.plot(rpm, line.order * rpm / 60, color=KIND_COLOURS[others[0]], lw=width, ls=second)
    bottom, top = lines[0].order * low / 60 / 1.4, lines[-1].order * high / 60 * 1.4
    ax.set(xlim=(low, high), ylim=(bottom, top), xlabel="speed of the reference, rpm", ylabel="frequency, Hz")
    ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    ax.yaxis.set_minor_formatter(LogFormatter())
    ax.grid(visible=True, color=FAINT, alpha=0.3, lw=0.5)
    _legend(lines, ax=ax)
    ranked = sorted(lines, key=lambda line: KINDS.index(line.kinds[0]))
    unnamed = len(lines) - name_right_ends(
        [(line.order * high / 60, line.label, KIND_COLOURS[line.kinds[0]]) for line in ranked], ax=ax
    )
    if unnamed:
        note = f"{unnamed} lines not labelled; increase the height"
        ax.annotate(note, (1.0, -0.01), xycoords="axes fraction", ha="left", va="top", fontsize=6.5, color=INK)
    return ax


def _merged_lines(table: "pd.DataFrame") -> list[_Line]:
    """Return the orders of the table in ascending order, coinciding ones merged into one line."""
    rows = sorted(
        zip(table["order"], table["component"], table["kind"], strict=True),
        key=lambda row: (row[0], KINDS.index(row[2])),
    )
    groups: list[list[Any]] = []
    for row in rows:
        if groups and row[0] - groups[-1][0][0] <= 1e-9 * row[0]:
            groups[-1].append(row)
        else:
            groups.append([row])
    return [
        _Line(
            order=float(group[0][0]),
            sources=tuple((row[1], row[2]) for row in sorted(group, key=lambda row: KINDS.index(row[2]))),
        )
        for group in groups
    ]


def _legend(lines: list[_Line], *, ax: Axes) -> None:
    """Draw the legend of the kinds present and of the notation in labels."""
    present = {kind for line in lines for kind in line.kinds}
    handles: list[Any] = [
        Line2D(
            [], [], color=KIND_COLOURS[kind], ls="-." if kind in BEARING_KINDS else "-", label=kind.replace("_", " ")
        )
        for kind in KINDS
        if kind in present
    ]
    if any(len(line.sources) > 1 for line in lines):
        handles.append(Line2D([], [], ls="", label="=, and N more: orders coincide"))
    ax.legend(
        handles=handles, fontsize=6.5, ncols=4, frameon=False, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0
    )

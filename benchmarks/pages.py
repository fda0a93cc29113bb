"""Pictures of docs/dynamics.md and docs/wijianto.md, and the tables of the former and of docs/benchmarks/physics.md.

    python benchmarks/pages.py [FOLDER] [SUFFIX]

Runs the Python blocks of docs/dynamics.md and docs/benchmarks/physics.md from top to bottom, each in one namespace, as
the tests do, and the example of Wijianto's figures, draws the pages' pictures into FOLDER (default docs/pages; SUFFIX
svg or png), and writes the tables of known numbers between their marks.
"""

import re
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from runpy import run_path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

ROBUST_DIGITS = 10  # of a number: one more of ours is shown where the known one has no more
DOCS = Path(__file__).resolve().parents[1] / "docs"
TABLES = DOCS / "dynamics.md", DOCS / "benchmarks" / "physics.md"
BLOCK = re.compile(r"```python\n(.*?)```", flags=re.DOTALL)
STYLE = {"font.size": 8, "svg.fonttype": "none", "svg.hashsalt": "pages", "path.simplify": True, "lines.linewidth": 0.8}


def run(page: Path) -> dict[str, Any]:
    """Run the Python blocks of a page in one namespace and return it; lines are those of the page in a traceback."""
    text, found = page.read_text(encoding="utf-8"), {}
    for block in BLOCK.finditer(text):
        above = "\n" * text[: block.start(1)].count("\n")
        exec(compile(above + block[1], str(page), "exec"), found)  # noqa: S102 - our own page
    return found


def picture(path: Path, draw: Callable[[Figure], None], *, width: float, height: float) -> None:
    """Draw a figure into a file."""
    with rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        for axes in figure.axes:
            if axes.get_label() != "<colorbar>":
                axes.spines[["top", "right"]].set_visible(False)
        metadata = {"Date": None} if path.suffix == ".svg" else {}
        figure.savefig(path, dpi=100, metadata=metadata)


def draw_wijianto(path: Path) -> None:
    """Draw the figures of Wijianto's paper into a file, by the example that does."""
    with rc_context(STYLE):
        drawn = run_path(str(DOCS / "examples" / "machines" / "plot_61_wijianto_start_up.py"))["figure"]
        drawn.savefig(path, dpi=100, metadata={"Date": None} if path.suffix == ".svg" else {})


# ---- docs/dynamics.md ------------------------------------------------------------------------------------------------


def draw_campbell(figure: Figure, page: dict[str, Any]) -> None:
    """Draw natural frequencies over speed, the mesh order, and where they meet."""
    axes, diagram, order = figure.subplots(), page["diagram"], page["mesh_order"]
    speeds = diagram.speeds_rad_s
    axes.plot(speeds, diagram.frequencies_hz, color="C0")
    axes.plot(speeds, order * speeds / (2 * np.pi), color="C3", ls="--", label=f"mesh, order {order:.1f} of the sun")
    critical = page["critical"]
    axes.plot(critical, order * critical / (2 * np.pi), "o", color="C3", ms=3, label="critical speeds")
    axes.set(xlabel="speed of the sun, rad/s", ylabel="natural frequency, Hz", xlim=(0, 1000), ylim=(0, 3000))
    axes.legend(fontsize=7, frameon=False, loc="upper left")


def draw_stability(figure: Figure, page: dict[str, Any]) -> None:
    """Draw growth a period over mesh frequency and contact ratio."""
    axes, growth = figure.subplots(), page["growth"]
    shown = np.where(growth.unstable, growth.growth - 1, np.nan)
    image = axes.pcolormesh(growth.speeds_rad_s, growth.parameters, shown, cmap="viridis_r", rasterized=True)
    figure.colorbar(image, label="growth per period, minus 1")
    modes = page["pair_modes"].angular[1:]
    for rate, name in ((2 * modes[0], "2 w2"), (modes[0], "w2"), (modes[0] + modes[1], "w2 + w3")):
        axes.axvline(rate, color="0.4", lw=0.6, ls="--")
        axes.text(rate, 2.0, f" {name}", fontsize=7, va="bottom")
    axes.set(xlabel="mesh frequency, rad/s", ylabel="contact ratio", ylim=(1, 2))


def draw_backlash(figure: Figure, page: dict[str, Any]) -> None:
    """Draw the response with loss of contact over speed, swept up and down."""
    axes, speeds = figure.subplots(), page["sweep_rad_s"]
    axes.plot(speeds, page["up"], "o-", ms=2.5, label="swept up")
    axes.plot(speeds, page["down"], "s-", ms=2.5, mfc="none", label="swept down")
    for edge in (0.785, 0.950):
        axes.axvline(edge, color="0.5", lw=0.6, ls="--")
    axes.set(xlabel="mesh frequency over natural frequency", ylabel="peak to peak over static deflection")
    axes.legend(fontsize=7, frameon=False)


def draw_splitting(figure: Figure, page: dict[str, Any]) -> None:
    """Draw the splitting's error over its steps."""
    axes = figure.subplots()
    steps, errors = 20 * np.array(page["steps"]), np.array(page["errors"])
    axes.loglog(steps, errors, "o-", ms=3, label="splitting")
    axes.loglog(steps[:4], 3 * errors[0] * (steps[0] / steps[:4]) ** 4, color="0.5", ls="--", label="fourth order")
    axes.set(xlabel="steps per mesh period", ylabel="relative error of the state, worst entry")
    axes.set_xticks(steps, [str(each) for each in steps])
    axes.minorticks_off()
    axes.legend(fontsize=7, frameon=False)


DYNAMICS = {
    "campbell": (draw_campbell, 6.4, 3.6),
    "stability": (draw_stability, 6.4, 3.2),
    "backlash": (draw_backlash, 6.4, 3.0),
    "splitting": (draw_splitting, 6.4, 2.8),
}


def like(value: float, known: float) -> str:
    """Return a value with one digit more than a known one is given with, or as many where that has ten or more."""
    mantissa, exponent = [*repr(known).split("e"), ""][:2]
    decimals = len(mantissa.partition(".")[2])
    digits = len(mantissa.replace("-", "").replace(".", "").lstrip("0"))
    decimals += digits < ROBUST_DIGITS
    return f"{value:.{decimals}{'e' if exponent else 'f'}}"


def table(known: list[tuple[str, str, list[float], Any]]) -> str:
    """Return the table of known numbers and ours, in Markdown."""
    lines = ["| quantity | source | known | ours |", "|---|---|---|---|"]
    for quantity, source, values, ours in known:
        shown = ", ".join(like(one, other) for one, other in zip(ours, values, strict=True))
        lines.append(f"| {quantity} | {source} | {', '.join(map(repr, values))} | {shown} |")
    return "\n".join(lines)


def main(folder: Path, suffix: str) -> None:
    """Draw the pictures, and write the tables into their pages."""
    folder.mkdir(exist_ok=True)
    draw_wijianto(folder / f"wijianto.{suffix}")
    found = [run(page) for page in TABLES]
    for name, (draw, width, height) in DYNAMICS.items():
        picture(folder / f"{name}.{suffix}", partial(draw, page=found[0]), width=width, height=height)
    for page, names in zip(TABLES, found, strict=True):
        before, mark, rest = page.read_text(encoding="utf-8").partition("<!-- numbers -->\n")
        after = rest[rest.index("<!-- end of numbers -->") :]
        page.write_text(f"{before}{mark}{table(names['known'])}\n{after}", encoding="utf-8")


if __name__ == "__main__":
    main(*(Path(name) for name in sys.argv[1:2] or [DOCS / "pages"]), *(sys.argv[2:3] or ["svg"]))

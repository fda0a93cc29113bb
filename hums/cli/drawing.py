"""Command `hums drawing`."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hums.cli.options import FigureFormat, Force, LinkSpeeds, UsageError, echo, parse_speeds, save_picture, say

if TYPE_CHECKING:
    from hums.gearbox.kinematics import Kinematics, Speeds

_SIZES = {"mechanism": (9.0, 6.0), "velocities": (7.0, 5.0), "orders": (10.0, 7.0), "graph": (7.0, 6.0)}  # inches
_FIGURES = (".svg", ".png", ".pdf")


def drawing(
    gearbox: Annotated[str, typer.Argument(help="Gearbox file, .toml, or a catalogue name.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for all figures, or a single .svg, .png, .pdf or .html file."),
    ] = None,
    picture: Annotated[
        Literal["mechanism", "velocities", "orders", "graph"],
        typer.Option(help="Figure to write if --out is a single file; graph: the links with their pairs."),
    ] = "mechanism",
    speed: LinkSpeeds = None,
    kind: FigureFormat = "svg",
    force: Force = False,
) -> None:
    """Draw a gearbox: mechanism, velocity vectors and frequencies against speed, or an animated page."""
    from hums.drawing import write_drawing  # noqa: PLC0415
    from hums.gearbox.kinematics import solve_kinematics  # noqa: PLC0415
    from hums.gearbox.model import load_gearbox  # noqa: PLC0415
    from hums.records.outputs import check_outputs  # noqa: PLC0415

    if out is not None and out.suffix:
        check_outputs([out], inputs=[gearbox], force=force)
    kinematics = solve_kinematics(load_gearbox(gearbox))
    given = parse_speeds(speed, kinematics) if speed else None
    if out is not None and out.suffix.lower() == ".html":
        say("drawing the animated page")
        echo(f"wrote {write_drawing(kinematics, out, speeds_rpm=given, force=force)}")
        return
    if out is None:
        raise UsageError("--out is missing; name a folder, a figure such as m.svg, or an animated page such as m.html.")
    if out.suffix and out.suffix.lower() not in _FIGURES and not out.is_dir():
        raise UsageError(f"{out}: a figure ends in .svg, .png or .pdf, a page in .html; a folder has no suffix.")
    pictures = _pictures_of(kinematics, _drawn_speeds(kinematics, given))
    if out.suffix.lower() in _FIGURES:
        save_picture(pictures[picture], out, _SIZES[picture], force=force)
        return
    check_outputs((out / f"{name}.{kind}" for name in pictures), inputs=[gearbox], force=force)
    out.mkdir(parents=True, exist_ok=True)
    for name, draws in pictures.items():
        save_picture(draws, out / f"{name}.{kind}", _SIZES[name], force=force)


def _drawn_speeds(kinematics: "Kinematics", given: "Speeds | None") -> "Speeds":
    """Return the given speeds, or those an animated page starts with, printed if there was a choice."""
    from hums.drawing import START_RPM, free_links  # noqa: PLC0415

    if given:
        return given
    first, *others = free_links(kinematics)
    if others:
        echo(f"speeds: {', '.join([f'{first} {START_RPM} rpm', *(f'{link} 0 rpm' for link in others)])}", err=True)
    return {first: START_RPM} | dict.fromkeys(others, 0)


def _pictures_of(kinematics: "Kinematics", speeds: "Speeds") -> dict[str, list[Callable[..., object]]]:
    from hums.gearbox.defect_orders import defect_orders  # noqa: PLC0415
    from hums.gearbox.layout import layout_of  # noqa: PLC0415
    from hums.plots import draw_mechanism, mechanism_graph, speed_order_chart, velocity_diagram  # noqa: PLC0415

    gearbox = kinematics.gearbox

    views: tuple[Any, ...] = ("section", "axial") if layout_of(gearbox).planar else ("section",)

    def orders(ax: Any) -> None:  # noqa: ANN401
        reference = gearbox.reference or next(iter(speeds))
        top = abs(float(kinematics.relative_speed(reference, seen_from=gearbox.frame, speeds=speeds)))
        speed_order_chart(defect_orders(kinematics, speeds=speeds), reference_rpm=(top / 10, top), ax=ax)

    return {
        "mechanism": [partial(draw_mechanism, gearbox, view=view) for view in views],
        "velocities": [partial(velocity_diagram, kinematics, speeds)],
        "orders": [orders],
        "graph": [partial(mechanism_graph, kinematics)],
    }

"""Commands that draw: a mechanism, its dynamics; and the catalogue of bearings."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import typer

from hums.cli.options import parse_speeds

if TYPE_CHECKING:
    from data_synth.dynamics.system import System
    from hums.gearbox.kinematics import Kinematics

__all__ = ["bearings", "drawing", "dynamics"]

_SIZES = {"mechanism": (9.0, 6.0), "velocities": (7.0, 5.0), "orders": (10.0, 7.0)}  # inches
_SHOWN_MODES = 6
_SPEEDS = 31  # of a Campbell diagram and of the stability
_FIGURES = (".svg", ".png", ".pdf")

Picture = Literal["mechanism", "velocities", "orders"]
Kind = Annotated[Literal["svg", "png"], typer.Option("--format", help="Format of the pictures in a folder.")]


# ---- A mechanism: its drawing, velocity vectors and orders -----------------------------------------------------------


def drawing(
    gearbox: Annotated[str, typer.Argument(help="A .toml file or a catalogue name.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for all pictures; or one file, .svg, .png, .pdf or .html."),
    ] = None,
    picture: Annotated[Picture, typer.Option(help="The picture that goes into a single file.")] = "mechanism",
    html: Annotated[bool, typer.Option("--html", help="One offline page on which the mechanism turns.")] = False,
    speed: Annotated[list[str] | None, typer.Option(metavar="LINK=RPM", help="Speed of a link; repeat.")] = None,
    kind: Kind = "svg",
) -> None:
    """Draw a gearbox: the mechanism, velocity vectors, orders against speed; or a page on which it turns."""
    from hums.drawing import write_drawing  # noqa: PLC0415
    from hums.gearbox.kinematics import solve_kinematics  # noqa: PLC0415
    from hums.gearbox.model import load_gearbox  # noqa: PLC0415

    given = parse_speeds(speed)
    kinematics = solve_kinematics(load_gearbox(gearbox))
    if html or (out is not None and out.suffix.lower() == ".html"):
        page = write_drawing(kinematics, out or Path(f"{Path(gearbox).stem}.html"), speeds_rpm=given)
        typer.echo(f"wrote {page}")
        return
    if out is None:
        raise ValueError("--out is missing; name a folder, a picture as in -o mechanism.svg, or ask for --html.")
    pictures = _pictures_of(kinematics, _drawn_speeds(kinematics, given))
    if out.suffix.lower() in _FIGURES:
        _save(pictures[picture], out, _SIZES[picture])
        return
    out.mkdir(parents=True, exist_ok=True)
    for name, draw in pictures.items():
        _save(draw, out / f"{name}.{kind}", _SIZES[name])


def _drawn_speeds(kinematics: "Kinematics", given: dict[str, float] | None) -> dict[str, float]:
    """Return the speeds as given, or those a page begins with, and say so where they are a choice."""
    from hums.drawing import START_RPM, free_links  # noqa: PLC0415

    if given:
        return given
    first, *others = free_links(kinematics)
    chosen = {first: float(START_RPM)} | dict.fromkeys(others, 0.0)
    if others:
        typer.echo(f"speeds: {', '.join(f'{link} {rpm:g} rpm' for link, rpm in chosen.items())}", err=True)
    return chosen


def _pictures_of(kinematics: "Kinematics", speeds: Mapping[str, float]) -> dict[str, Callable[[Any], object]]:
    from hums.gearbox.layout import layout_of  # noqa: PLC0415
    from hums.gearbox.orders import defect_orders  # noqa: PLC0415
    from hums.plots import draw_mechanism, speed_order_chart, velocity_diagram  # noqa: PLC0415

    gearbox = kinematics.gearbox

    def mechanism(ax: Any) -> None:  # noqa: ANN401  - matplotlib stays in hums.plots
        if not layout_of(gearbox).planar:
            draw_mechanism(gearbox, ax=ax)
            return
        figure = ax.figure
        ax.remove()
        section, axial = figure.subplots(1, 2)
        draw_mechanism(gearbox, ax=section, view="section")
        draw_mechanism(gearbox, ax=axial, view="axial")

    def orders(ax: Any) -> None:  # noqa: ANN401
        reference = gearbox.reference or next(iter(speeds))
        top = abs(float(kinematics.relative_speed(reference, seen_from=gearbox.frame, speeds=speeds)))
        speed_order_chart(defect_orders(kinematics, speeds=speeds), reference_rpm=(top / 10, top), ax=ax)

    return {
        "mechanism": mechanism,
        "velocities": lambda ax: velocity_diagram(kinematics, speeds, ax=ax),
        "orders": orders,
    }


def _save(draw: Callable[[Any], object], path: Path, size: tuple[float, float]) -> None:
    from hums.plots import save_figure  # noqa: PLC0415

    save_figure(draw, path, width=size[0], height=size[1])
    typer.echo(f"wrote {path}")


# ---- Dynamics: modes, Campbell diagram, stability --------------------------------------------------------------------


def dynamics(
    source: Annotated[str, typer.Argument(metavar="GEARBOX_OR_SCENE", help="A .toml file or a catalogue name.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write into.")],
    top_rpm: Annotated[float, typer.Option("--rpm", help="Highest speed of the reference.")] = 3000.0,
    motions: Annotated[
        Literal["torsion", "plane", "space"] | None,
        typer.Option(
            help="Degrees of freedom of a gearbox's bodies. Default plane, space where axes are not parallel."
        ),
    ] = None,
    stability: Annotated[
        bool, typer.Option("--stability", help="Also the parametric stability of each mesh; it takes minutes.")
    ] = False,
    kind: Kind = "svg",
) -> None:
    """Draw natural frequencies, mode shapes, Campbell diagram and, asked for, stability of a gearbox or a scene."""
    import numpy as np  # noqa: PLC0415

    from data_synth.dynamics import campbell, solve_modes  # noqa: PLC0415
    from hums.plots import plot_campbell, plot_frequencies, plot_mode_shape  # noqa: PLC0415

    if not (math.isfinite(top_rpm) and top_rpm > 0):
        raise ValueError(f"--rpm {top_rpm:g}: give the highest speed of the reference, in rpm, above 0.")
    system_at = _system_source(source, motions)
    speeds = np.linspace(0, top_rpm * math.pi / 30, _SPEEDS)
    system = system_at(0.0)
    modes = solve_modes(system)
    typer.echo("natural frequencies, Hz")
    for number, (frequency, of) in enumerate(zip(modes.frequencies_hz, modes.kinds, strict=True)):
        typer.echo(f"{number + 1:4d} {frequency:12.3f}  {of}")
    out.mkdir(parents=True, exist_ok=True)
    _save(lambda ax: plot_frequencies(modes, ax=ax), out / f"frequencies.{kind}", (8.0, 3.0))
    elastic = [number for number, frequency in enumerate(modes.frequencies_hz) if frequency > 0][:_SHOWN_MODES]

    def shapes(ax: Any) -> None:  # noqa: ANN401
        figure = ax.figure
        ax.remove()
        for number, place in zip(
            elastic, figure.subplots(-(-len(elastic) // 3), 3, squeeze=False).ravel(), strict=False
        ):
            plot_mode_shape(modes, number, ax=place)

    _save(shapes, out / f"modes.{kind}", (14.0, 2.0 + 0.32 * system.dof * -(-len(elastic) // 3)))
    diagram = campbell(system_at, speeds_rad_s=speeds)
    _save(lambda ax: plot_campbell(diagram, ax=ax, harmonics=2), out / f"campbell.{kind}", (8.0, 5.0))
    if stability:
        _draw_stability(system, speeds[1:], out / f"stability.{kind}")


def _draw_stability(system: "System", speeds_rad_s: Any, path: Path) -> None:  # noqa: ANN401  - an array, numpy is not loaded
    """Draw the largest Floquet multiplier against speed, the meshes of one rate varying and all others at their mean.

    Meshes of unlike rates have a common period of thousands of cycles, which nobody could draw.
    """
    from dataclasses import replace  # noqa: PLC0415

    import numpy as np  # noqa: PLC0415

    from data_synth.dynamics import stability_map  # noqa: PLC0415
    from hums.plots import plot_stability_map  # noqa: PLC0415

    growths = {}
    for rate in dict.fromkeys(round(mesh.cycles_per_rev, 9) for mesh in system.meshes):
        resting = [mesh for mesh in system.meshes if round(mesh.cycles_per_rev, 9) != rate]
        springs = [mesh.stiffness.mean * np.outer(mesh.direction, mesh.direction) for mesh in resting]
        varying = replace(
            system,
            meshes=tuple(mesh for mesh in system.meshes if round(mesh.cycles_per_rev, 9) == rate),
            stiffness=sum(springs, start=system.stiffness),
        )
        names = ", ".join(mesh.name for mesh in system.meshes if round(mesh.cycles_per_rev, 9) == rate)
        try:
            growths[names] = (
                rate,
                stability_map(lambda _, varying=varying: varying, parameters=[0.0], speeds_rad_s=speeds_rad_s),  # type: ignore[misc]
            )
        except (ValueError, ArithmeticError) as error:
            typer.echo(f"note: no stability of {names}: {error}", err=True)
    for names, (_, growth) in growths.items():
        unstable = [f"{30 * rate / math.pi:.4g}" for rate in growth.speeds_rad_s[growth.unstable[0]]]
        typer.echo(f"stiffness of {names} makes unstable at, rpm: {', '.join(unstable) or 'none of these speeds'}")

    def pictures(ax: Any) -> None:  # noqa: ANN401
        figure = ax.figure
        ax.remove()
        for place, (names, (rate, growth)) in zip(
            figure.subplots(len(growths), 1, squeeze=False).ravel(), growths.items(), strict=True
        ):
            plot_stability_map(growth, ax=place, cycles_per_rev=rate)
            place.set_title(names, loc="left", fontsize=8)

    if growths:
        _save(pictures, path, (8.0, 2.6 * len(growths) + 0.4))


def _system_source(source: str, motions: Literal["torsion", "plane", "space"] | None) -> "Callable[[float], System]":
    """Return the function from the reference's speed in rad/s to the system of a gearbox or of a scene."""
    from data_synth.dynamics import assemble  # noqa: PLC0415
    from data_synth.scene.scene import catalogue as scene_catalogue  # noqa: PLC0415
    from data_synth.scene.scene import load_scene  # noqa: PLC0415
    from data_synth.vibration.run import scene_system  # noqa: PLC0415
    from hums.gearbox.layout import layout_of  # noqa: PLC0415
    from hums.gearbox.model import GearboxError, catalogue, load_gearbox, read_toml  # noqa: PLC0415

    is_file = source not in catalogue() and Path(source).suffix == ".toml"
    if source in scene_catalogue() or (is_file and "gearbox" in read_toml(Path(source), error=GearboxError)):
        if motions is not None:
            raise ValueError(f"--motions {motions}: a scene declares its own motions as its fidelity; leave it out.")
        return scene_system(load_scene(source))
    gearbox = load_gearbox(source)
    chosen = motions or ("plane" if layout_of(gearbox).planar else "space")
    return lambda speed: assemble(gearbox, motions=chosen, speed_rad_s=speed)


# ---- Bearings --------------------------------------------------------------------------------------------------------


def bearings(
    designation: Annotated[Optional[str], typer.Argument(help="Designation, or a part of one.")] = None,  # noqa: UP045
) -> None:
    """Print the catalogue of bearings by designation, with the source of each geometry."""
    from hums.gearbox.bearings import bearing_catalogue  # noqa: PLC0415

    rows = bearing_catalogue()
    shown = [row for row in rows if designation is None or designation.lower() in row.name.lower()]
    if not shown:
        raise ValueError(f'no bearing "{designation}" in the catalogue; it has {", ".join(row.name for row in rows)}.')
    for row in shown:
        typer.echo(
            f"{row.name}: {row.elements} elements of {row.element_diameter_mm:g} mm on {row.pitch_diameter_mm:g} mm, "
            f"contact angle {row.contact_angle_deg:g} degrees. {row.source}"
        )

"""Command `hums dynamics`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hums.cli.options import FigureFormat, save_picture

if TYPE_CHECKING:
    from collections.abc import Callable

    from data_synth.dynamics.system import System

__all__ = ["dynamics"]

_SHOWN_MODES = 6
_SPEEDS = 31  # of a Campbell diagram and of the stability


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
    kind: FigureFormat = "svg",
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
    save_picture(lambda ax: plot_frequencies(modes, ax=ax), out / f"frequencies.{kind}", (8.0, 3.0))
    elastic = [number for number, frequency in enumerate(modes.frequencies_hz) if frequency > 0][:_SHOWN_MODES]

    def shapes(ax: Any) -> None:  # noqa: ANN401
        figure = ax.figure
        ax.remove()
        for number, place in zip(
            elastic, figure.subplots(-(-len(elastic) // 3), 3, squeeze=False).ravel(), strict=False
        ):
            plot_mode_shape(modes, number, ax=place)

    save_picture(shapes, out / f"modes.{kind}", (14.0, 2.0 + 0.32 * system.dof * -(-len(elastic) // 3)))
    diagram = campbell(system_at, speeds_rad_s=speeds)
    save_picture(lambda ax: plot_campbell(diagram, ax=ax, harmonics=2), out / f"campbell.{kind}", (8.0, 5.0))
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
        save_picture(pictures, path, (8.0, 2.6 * len(growths) + 0.4))


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

"""Command `hums dynamics`."""

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hums.cli.options import FigureFormat, Force, UsageError, echo, parse_speeds, save_picture, say, several

if TYPE_CHECKING:
    from collections.abc import Callable

    from data_synth.dynamics.system import System

_PICTURES = ("modes", "campbell")
_SIZES = {"module_mm": 3.0, "face_width_mm": 30.0, "pressure_angle_deg": 20.0}  # of meshes that declare none
_LEAST_SHARE = 0.05  # of the kinetic energy, of a part that is named with a mode
_SHOWN_MODES = 6
_SPEEDS = 31  # of a Campbell diagram


def dynamics(
    source: Annotated[str, typer.Argument(metavar="GEARBOX_OR_SCENE", help="A .toml file or a catalogue name.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for the pictures. Default: none.")] = None,
    top_rpm: Annotated[float, typer.Option("--rpm", help="Highest speed of the reference in rpm.")] = 3000.0,
    motions: Annotated[
        Literal["torsion", "plane", "space"] | None,
        typer.Option(
            help="Degrees of freedom of a gearbox's bodies. Default: plane; space if the axes are not parallel."
        ),
    ] = None,
    speed: Annotated[list[str] | None, typer.Option(metavar="LINK=RPM", help="Speed of a link; repeatable.")] = None,
    kind: FigureFormat = "svg",
    force: Force = False,
) -> None:
    """Run the command."""
    import numpy as np  # noqa: PLC0415

    from data_synth.dynamics import campbell, solve_modes  # noqa: PLC0415
    from hums.plots import plot_campbell, plot_mode_shape  # noqa: PLC0415
    from hums.records.outputs import check_outputs  # noqa: PLC0415

    if not (math.isfinite(top_rpm) and top_rpm > 0):
        raise UsageError(f"--rpm {top_rpm:g}: give the highest speed of the reference, in rpm, above 0.")
    check_outputs((out / f"{name}.{kind}" for name in _PICTURES if out), inputs=[source], force=force)
    say("natural frequencies")
    system_at, assumed = _system_source(source, motions, speed)
    speeds = np.linspace(0, top_rpm * math.pi / 30, _SPEEDS)
    system = system_at(0.0)
    modes = solve_modes(system)
    energies = [_energy(system, shape) for shape in modes.shapes.T]
    echo("natural frequencies in Hz, and kinetic energy by part")
    for number, (frequency, of, energy) in enumerate(zip(modes.frequencies_hz, modes.kinds, energies, strict=True)):
        shares = ", ".join(f"{part} {share:.0%}" for part, share in energy.items())
        echo(f"{number + 1:4d} {frequency:12.3f}  {of:13} {shares}")
    echo(f"assumed: {assumed}")
    if out is None:
        return
    out.mkdir(parents=True, exist_ok=True)
    elastic = [number for number, frequency in enumerate(modes.frequencies_hz) if frequency > 0][:_SHOWN_MODES]
    draws = [partial(plot_mode_shape, modes, number, energy=energies[number]) for number in elastic]
    height = 2.0 + 0.32 * system.dof * -(-len(elastic) // 3)
    save_picture(several(draws, columns=3), out / f"modes.{kind}", (14.0, height), force=force)
    say(f"natural frequencies at {_SPEEDS} speeds")
    diagram = campbell(system_at, speeds_rad_s=speeds)
    save_picture(
        lambda ax: plot_campbell(diagram, ax=ax, harmonics=2), out / f"campbell.{kind}", (8.0, 5.0), force=force
    )


def _energy(system: "System", shape: Any) -> dict[str, float]:  # noqa: ANN401  - an array
    """Return the parts with most of the kinetic energy of a mode, largest first, each with its share."""
    from data_synth.dynamics.modes import body_motions  # noqa: PLC0415

    parts: dict[str, float] = {}
    for (body, _), share in zip(body_motions(system), shape * (system.mass @ shape), strict=True):
        parts[body] = parts.get(body, 0.0) + float(share)
    return {body: share for body, share in sorted(parts.items(), key=lambda part: -part[1]) if share >= _LEAST_SHARE}


def _system_source(
    source: str, motions: Literal["torsion", "plane", "space"] | None, speed: list[str] | None
) -> "tuple[Callable[[float], System], str]":
    """Return the function from the reference's speed in rad/s to the system of a gearbox or scene, and its guesses."""
    from data_synth.dynamics import SupportStiffness, assemble  # noqa: PLC0415
    from data_synth.scene.scene import catalogue as scene_catalogue  # noqa: PLC0415
    from data_synth.scene.scene import load_scene  # noqa: PLC0415
    from data_synth.vibration.run import scene_system  # noqa: PLC0415
    from hums.gearbox.components import read_toml  # noqa: PLC0415
    from hums.gearbox.kinematics import solve_kinematics  # noqa: PLC0415
    from hums.gearbox.layout import layout_of  # noqa: PLC0415
    from hums.gearbox.model import GearboxError, catalogue, load_gearbox  # noqa: PLC0415

    held = SupportStiffness()
    assumed = (
        "rigid shafts and frame; gears as steel discs; each bearing, or body without one, held by "
        f"{held.radial:.0e} N/m radially and axially and {held.tilt:.0e} N m/rad in tilt; the mean mesh stiffness of "
        "ISO 6336-1"
    )
    is_file = source not in catalogue() and Path(source).suffix == ".toml"
    if source in scene_catalogue() or (is_file and "gearbox" in read_toml(Path(source), error=GearboxError)):
        if motions or speed:
            raise UsageError("--motions and --speed: a scene has its own speeds and all motions that its teeth excite.")
        return scene_system(load_scene(source)), f"{assumed}; all where the scene declares nothing else"
    gearbox = load_gearbox(source)
    guessed = {mesh.name: {key: x for key, x in _SIZES.items() if not getattr(mesh, key)} for mesh in gearbox.meshes}
    gearbox = gearbox.changed(meshes=tuple(mesh.changed(**guessed[mesh.name]) for mesh in gearbox.meshes))
    if bare := [name for name, sizes in guessed.items() if sizes]:
        assumed += f"; {', '.join(f'{key} {x:g}' for key, x in _SIZES.items())} where {', '.join(bare)} declare none"
    chosen = motions or ("plane" if layout_of(gearbox).planar else "space")
    kinematics = solve_kinematics(gearbox)
    given = parse_speeds(speed, kinematics)
    speeds = {link: float(rpm) for link, rpm in given.items()} if given else None
    made = partial(assemble, kinematics, motions=chosen, speeds=speeds)
    return lambda speed: made(speed_rad_s=speed).system, assumed

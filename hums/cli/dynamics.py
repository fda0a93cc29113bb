"""Command `hums dynamics`."""

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hums.cli.options import FigureFormat, Force, LinkSpeeds, UsageError, echo, parse_speeds, save_picture, say

if TYPE_CHECKING:
    from collections.abc import Callable

    from data_synth.dynamics.system import System
    from data_synth.gears.mesh_stiffness import Stiffness

_SIZES = {"module_mm": 3.0, "face_width_mm": 30.0, "pressure_angle_deg": 20.0}  # assumed where a mesh declares none
_SPEEDS = 31  # of a Campbell diagram
_HARMONICS = 8  # of a mesh stiffness, for the stability


def dynamics(
    source: Annotated[str, typer.Argument(metavar="GEARBOX_OR_SCENE", help="A .toml file or a catalogue name.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder of the figures, drawn only if given.")] = None,
    top_rpm: Annotated[float, typer.Option("--rpm", help="Highest speed of the reference in rpm.")] = 3000.0,
    motions: Annotated[
        Literal["torsion", "plane", "space"] | None,
        typer.Option(
            help="Degrees of freedom of a gearbox's bodies. Default: plane; space if the axes are not parallel."
        ),
    ] = None,
    speed: LinkSpeeds = None,
    stability: Annotated[bool, typer.Option("--stability", help="Add the parametric stability of each mesh.")] = False,
    stability_speeds: Annotated[int, typer.Option(metavar="N", min=2, help="Number of speeds for --stability.")] = 40,
    kind: FigureFormat = "svg",
    force: Force = False,
) -> None:
    """Print natural frequencies; plot mode shapes and the Campbell diagram."""
    import numpy as np  # noqa: PLC0415

    from data_synth.dynamics import campbell, solve_modes  # noqa: PLC0415
    from hums.plots import plot_campbell, plot_mode_shape  # noqa: PLC0415
    from hums.records.outputs import check_outputs  # noqa: PLC0415

    if not (math.isfinite(top_rpm) and top_rpm > 0):
        raise UsageError(f"--rpm {top_rpm:g}: give the highest speed of the reference, in rpm, above 0.")
    if out is None and stability:
        raise UsageError("--out is missing; --stability draws a figure, so name a folder for it.")
    names = ("modes", "campbell", "stability")
    check_outputs((out / f"{name}.{kind}" for name in names if out), inputs=[source], force=force)
    say("computing natural frequencies")
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
    elastic = [number for number, frequency in enumerate(modes.frequencies_hz) if frequency > 0][:6]
    draws = [partial(plot_mode_shape, modes, number, energy=energies[number]) for number in elastic]
    height = 2.0 + 0.32 * system.dof * -(-len(elastic) // 3)
    save_picture(draws, out / f"modes.{kind}", (14.0, height), force=force, columns=3)
    say(f"computing natural frequencies at {_SPEEDS} speeds")
    diagram = campbell(system_at, speeds_rad_s=speeds)
    draw = partial(plot_campbell, diagram, harmonics=2)
    save_picture([draw], out / f"campbell.{kind}", (8.0, 5.0), force=force)
    if stability:
        _draw_stability(system, float(speeds[-1]), stability_speeds, out / f"stability.{kind}", force=force)


def _energy(system: "System", shape: Any) -> dict[str, float]:  # noqa: ANN401  - an array
    """Return the share of the kinetic energy of a mode by part, largest first, small ones left out."""
    from data_synth.dynamics.modes import body_motions  # noqa: PLC0415

    parts: dict[str, float] = {}
    for (body, _), share in zip(body_motions(system), shape * (system.mass @ shape), strict=True):
        parts[body] = parts.get(body, 0.0) + float(share)
    least_share = 0.05  # of the kinetic energy of a mode, for a part to be listed
    return {body: share for body, share in sorted(parts.items(), key=lambda part: -part[1]) if share >= least_share}


def _draw_stability(system: "System", top_rad_s: float, count: int, path: Path, *, force: bool) -> None:
    """Draw the largest Floquet multiplier against speed, with meshes of one rate varying and all others at their mean.

    The common period of meshes of different rates would be thousands of mesh cycles.
    """
    from dataclasses import replace  # noqa: PLC0415

    from data_synth.dynamics import Spring, stability_map  # noqa: PLC0415
    from hums.plots import plot_stability_map  # noqa: PLC0415

    growths = {}
    for rate in dict.fromkeys(round(mesh.cycles_per_rev, 9) for mesh in system.meshes):
        resting = [mesh for mesh in system.meshes if round(mesh.cycles_per_rev, 9) != rate]
        held = [Spring(direction=mesh.direction, stiffness=mesh.stiffness.mean) for mesh in resting]
        meshes = [mesh for mesh in system.meshes if round(mesh.cycles_per_rev, 9) == rate]
        names = ", ".join(mesh.name for mesh in meshes)
        varying = replace(
            system,
            meshes=tuple(replace(mesh, stiffness=_smooth(mesh.stiffness)) for mesh in meshes),
            springs=(*system.springs, *held),
        )
        say(f"computing the stability of {names}")
        speeds = _stability_speeds(varying, rate, top_rad_s, count)
        try:
            growth = stability_map(lambda _, system=varying: system, parameters=[0.0], speeds_rad_s=speeds)  # type: ignore[misc]
        except (ValueError, ArithmeticError) as error:
            echo(f"note: stability of {names} not computed: {error}", err=True)
            continue
        growths[names] = growth
        unstable = [f"{30 * speed / math.pi:.4g}" for speed in speeds[growth.unstable[0]]]
        echo(f"parametrically unstable speeds of {names} in rpm: {', '.join(unstable) or 'none'}")

    def picture(names: str, *, ax: Any) -> None:  # noqa: ANN401
        plot_stability_map(growths[names], ax=ax)
        ax.set_title(names, loc="left", fontsize=8)

    if growths:
        draws = [partial(picture, names) for names in growths]
        save_picture(draws, path, (8.0, 2.6 * len(growths) + 0.4), force=force, columns=1)


def _smooth(stiffness: "Stiffness") -> "Stiffness":
    """Return the first harmonics of a stiffness with many knots, and any other unchanged."""
    from data_synth.gears.mesh_stiffness import fourier_series  # noqa: PLC0415

    return stiffness if len(stiffness.jumps) <= _HARMONICS else fourier_series(stiffness, harmonics=_HARMONICS)


def _stability_speeds(system: "System", rate: float, top_rad_s: float, count: int) -> Any:  # noqa: ANN401  - an array
    """Return speeds up to the top: half of them evenly spaced, the others at principal parametric resonances.

    These lie where the mesh frequency is twice a natural frequency or the sum of two, and an even grid may miss them.
    """
    import numpy as np  # noqa: PLC0415

    from data_synth.dynamics import solve_modes  # noqa: PLC0415

    natural = 2 * np.pi * np.asarray(solve_modes(system).frequencies_hz)
    natural = natural[natural > 0]
    sums = [*(2 * natural), *(natural[:, None] + natural)[np.triu_indices(natural.size, 1)]]
    principal = [speed for speed in np.array(sums) / rate if 0 < speed <= top_rad_s][: count // 2]
    even = np.linspace(0, top_rad_s, count - len(principal) + 1)[1:]
    return np.unique(np.concatenate([even, principal]))


def _system_source(
    source: str, motions: Literal["torsion", "plane", "space"] | None, speed: list[str] | None
) -> "tuple[Callable[[float], System], str]":
    """Return the system of a gearbox or scene as a function of reference speed in rad/s, and what it assumes."""
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
        "rigid shafts and frame; gears are steel discs; support stiffness of each bearing, or body without one, "
        f"{held.radial:.0e} N/m radially and axially and {held.tilt:.0e} N m/rad in tilt; mean mesh stiffness by "
        "ISO 6336-1"
    )
    is_file = source not in catalogue() and Path(source).suffix == ".toml"
    if source in scene_catalogue() or (is_file and "gearbox" in read_toml(Path(source), error=GearboxError)):
        if motions or speed:
            raise UsageError("--motions and --speed: a scene defines its own speeds and motions; omit both options.")
        return scene_system(load_scene(source)), f"{assumed}; unless the scene declares otherwise"
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

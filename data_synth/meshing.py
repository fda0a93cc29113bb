"""The teeth of a scene whose gears vibrate: stiffness and transmission error of each mesh, damage included."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from data_synth.damage import gear_damage, mesh_name
from data_synth.dynamics import Dynamics
from data_synth.gear_geometry import GearPair
from data_synth.layout import Contact, contacts_of
from data_synth.mesh import Constant, Shifted, Stiffness, Trapezoidal
from data_synth.parts import MeshProperties
from data_synth.profile import Array
from data_synth.scene import GearFault, Scene, SceneError, ToothCrack
from data_synth.stage import Stage
from data_synth.teeth_in_mesh import Damaged, TeethInMesh, helical, teeth_in_mesh
from data_synth.tooth_changes import damaged_teeth, errors_of
from data_synth.tooth_stiffness import ToothPair
from data_synth.transmission_error import ProfileError, SumOfErrors, TransmissionError
from hums.kinematics import Kinematics, solve_kinematics

_UM = 1e-6
_NEAR = 1e-9  # cycles: knots nearer than this are one
_RAMP = 0.1  # cycles over which a pair takes its load up, where its teeth are not modelled
_HELICAL_HARMONICS = 8


@dataclass(frozen=True, kw_only=True)
class Teeth:
    """A mesh: its properties, and the mesh phases at which the damaged tooth of each fault is in the middle.

    `passes` holds (number of the fault from 0, phase of the first pass, cycles until the next, contact ratio).
    """

    properties: MeshProperties
    passes: tuple[tuple[int, float, int, float], ...]


def declared_of(scene: Scene) -> Dynamics:
    """Return what a scene declares of masses and stiffnesses, or the defaults."""
    return scene.dynamics or Dynamics()


def geared(scene: Scene) -> Kinematics:
    """Return the mechanism, its meshes with the geometry that `dynamics` adds."""
    dynamics, gearbox = declared_of(scene), scene.gearbox
    known = {mesh.name for mesh in gearbox.meshes}
    for name, _ in dynamics.meshes:
        if name not in known:
            raise SceneError(f'dynamics.meshes names "{name}", which is no mesh of gearbox "{gearbox.name}".')
    geometry = ("module_mm", "face_width_mm", "pressure_angle_deg")
    meshes = []
    for mesh in gearbox.meshes:
        declared = dynamics.mesh(mesh.name)
        given = {key: getattr(declared, key) for key in geometry if getattr(declared, key) is not None}
        meshes.append(mesh.changed(**given) if given else mesh)
    return solve_kinematics(gearbox.changed(meshes=tuple(meshes)))


@dataclass(frozen=True, kw_only=True)
class Gears:
    """What all motions of a scene's gears have in common: the mechanism with its geometry, and the teeth by mesh."""

    kinematics: Kinematics
    teeth: Mapping[str, Teeth] = field(repr=False)


def gears_of(stage: Stage, kinematics: Kinematics) -> Gears:
    """Return the gears with the teeth of every mesh.

    Each mesh is at a phase of its own at revolution zero, drawn like the phases of a kinematic scene.
    """
    try:
        contacts = contacts_of(kinematics, {})
    except ValueError as caught:
        words = str(caught).split(", without")[0]
        raise SceneError(
            f'{words}; declare it in the gearbox, or as dynamics.meshes = {{ "{stage.scene.gearbox.meshes[0].name}" = '
            "{ module_mm = ..., face_width_mm = ..., pressure_angle_deg = ... } }."
        ) from None
    return Gears(kinematics=kinematics, teeth={contact.mesh: _teeth(stage, contact) for contact in contacts})


def _teeth(stage: Stage, contact: Contact) -> Teeth:
    scene = stage.scene
    declared = declared_of(scene).mesh(contact.mesh)
    later = float(stage.draws("phase", "gear_mesh", contact.mesh, "teeth").random())
    damaged: list[Damaged] = []
    errors: list[TransmissionError] = []
    passes = []
    for number, fault in enumerate(scene.faults):
        if not isinstance(fault, ToothCrack | GearFault) or mesh_name(fault.component) != contact.mesh:
            continue
        if fault.growth is not None:
            raise SceneError(
                f"fault {number + 1}: {fault.kind} grows, but the teeth of gears that vibrate stay as they are; leave "
                'out its growth, or write fidelity = "kinematic".'
            )
        gear = contact.links.index(fault.component.rpartition("/")[2])
        teeth, half = abs(contact.teeth[gear]), contact.pair.contact_ratio / 2
        # the tooth in the middle of its mesh where the kinematic scene has its worst place, to the nearest tooth
        first = round(-stage.offsets[number] * teeth + later - half) % teeth
        changes = gear_damage(scene, number, draws=stage.draws).changes(1e-3 * fault.initial_mm, teeth=teeth)
        damaged += damaged_teeth(changes, gear=gear, first=first)
        errors += errors_of(changes, pair=contact.pair, first=first)
        passes.append((number, first + half - later, teeth, 2 * half))
    if declared.error_um:
        errors.append(ProfileError(harmonics_m=np.array([_UM * declared.error_um + 0j])))
    stiffness = _stiffness(scene, contact, damaged, by_cycles=later)
    return Teeth(
        properties=MeshProperties(
            stiffness=stiffness,
            error=SumOfErrors(parts=tuple(errors), by_cycles=(later,) * len(errors)) if errors else None,
            backlash_m=_UM * declared.backlash_um / 2,
            damping=declared.damping_n_s_m,
        ),
        passes=tuple(passes),
    )


def _stiffness(scene: Scene, contact: Contact, damaged: list[Damaged], *, by_cycles: float) -> Stiffness:
    declared, pair = declared_of(scene).mesh(contact.mesh), contact.pair
    plain = contact.teeth[0] * contact.teeth[1] > 0 and pair.teeth[1] > 0
    spur = plain and not pair.helix_angle_rad and not any(pair.profile_shift)
    shape = declared.shape or ("teeth" if spur else "trapezoid")
    if damaged and shape != "teeth":
        raise SceneError(
            f'mesh "{contact.mesh}": a tooth that is softer needs shape = "teeth", which is for spur gears with teeth '
            'outside and no profile shift; its shape is "' + shape + '".'
        )
    if shape == "teeth":
        teeth = _by_strain_energy(pair, declared.bore_share, declared.stiffness_n_m, damaged)
        return Knotted(of=teeth, by_cycles=by_cycles, period=teeth.period)
    mean = declared.stiffness_n_m or pair.mean_stiffness()
    if shape == "constant" or pair.contact_ratio % 1 == 0:
        return Constant(mean=mean)
    duty = pair.contact_ratio % 1
    ramp = min(_RAMP, duty, 1 - duty)
    trapezoid = Trapezoidal.by_contact_ratio(
        pair_stiffness=mean / pair.contact_ratio, contact_ratio=pair.contact_ratio, ramp=ramp
    )
    if not pair.helix_angle_rad:
        return Shifted(of=trapezoid, by_cycles=by_cycles)
    slices = helical(trapezoid, overlap_ratio=pair.overlap_ratio, harmonics=_HELICAL_HARMONICS)
    return Shifted(of=slices, by_cycles=by_cycles)


@dataclass(frozen=True, kw_only=True)
class Knotted:
    """`TeethInMesh`, later by some cycles, with its kinks among its jumps: between two of them it is smooth.

    So few cells tabulate it. `period` is that of the teeth.
    """

    of: TeethInMesh
    by_cycles: float
    period: int
    constant_between_jumps: bool = field(default=False, init=False)
    harmonics: None = field(default=None, init=False)

    @cached_property
    def mean(self) -> float:
        """Mean over a period in N/m."""
        return self.of.mean

    @cached_property
    def jumps(self) -> tuple[float, ...]:
        """Phases at which it or its slope jumps."""
        within = np.remainder(self.of.path_cycles, 1.0)
        kinks = (np.arange(self.period)[:, None] + within).ravel()
        every = np.concatenate([self.of.jumps, kinks])
        every = np.sort(np.remainder(every - self.by_cycles, self.period))
        apart = np.concatenate([[True], np.diff(every) > _NEAR])
        return tuple(every[apart].tolist())

    def __call__(self, phase_cycles: ArrayLike) -> Array:
        """Return N/m at phases in mesh cycles, any shape."""
        return self.of(np.asarray(phase_cycles, dtype=np.float64) + self.by_cycles)


def _by_strain_energy(pair: GearPair, bore_share: float, mean: float | None, damaged: list[Damaged]) -> TeethInMesh:
    one, two = pair.reference_radii_m
    try:
        teeth = teeth_in_mesh(ToothPair(gears=pair, bore_radii_m=(bore_share * one, bore_share * two)), damaged=damaged)
    except ValueError as caught:
        raise SceneError(str(caught)) from None
    if mean is None:
        return teeth
    softer = replace(teeth, damaged=()).mean / mean
    return replace(
        teeth,
        compliance=teeth.compliance * softer,
        damaged=tuple((count, tooth, edges, added * softer) for count, tooth, edges, added in teeth.damaged),
    )


def passes_s(stage: Stage, teeth: Teeth, *, cycles_per_rev: float, stop_s: float) -> Iterator[tuple[int, Array, float]]:
    """Yield, for each damaged tooth, its fault's number, when it is in the middle of its mesh, and half a pass, rev."""
    begin, end = stage.drive.angle.revolutions([0.0, stop_s]) * cycles_per_rev
    for number, first, every, ratio in teeth.passes:
        turns = np.arange(math.ceil((begin - first) / every), math.floor((end - first) / every) + 1)
        revolutions = (first + every * turns) / cycles_per_rev
        yield number, stage.drive.angle.times(revolutions), ratio / 2 / cycles_per_rev

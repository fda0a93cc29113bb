"""Mesh stiffness and transmission error of a scene's gears, tooth damage included."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from data_synth.dynamics.parts import MeshProperties, delayed, power_flow
from data_synth.dynamics.placement import Contact, contacts_of, opposite_mesh_lead, planet_of, planet_phase_lag
from data_synth.dynamics.system import MeshHistory
from data_synth.gears.lost_contact import LoadSharing, declared_errors, modification_errors, modified_teeth
from data_synth.gears.mesh_stiffness import (
    Constant,
    Fourier,
    Rectangular,
    Shifted,
    Stiffness,
    Trapezoidal,
)
from data_synth.gears.tooth_compliance import DamagedTooth, TeethInMesh, ToothPair, helical, teeth_in_mesh
from data_synth.gears.transmission_error import PitchError, SumOfErrors, TransmissionError
from data_synth.kinematic.imperfect_parts import gear_deviations_m, planet_displacements_m
from data_synth.operation.shaft_angle import Array
from data_synth.scene.faults import GearDamage, GearFault, damaged_teeth, transmission_errors
from data_synth.scene.gear_dynamics import MeshDynamics
from data_synth.scene.scene import Scene, SceneError
from data_synth.sources.families import damage_of, faulty_gear, mesh_name
from data_synth.sources.prepared import PreparedScene
from hums.gearbox.kinematics import Kinematics, solve_kinematics

_UM = 1e-6
_ROUNDING = 1e-6  # digits of a stiffness in a message
_NEAR = 1e-9  # cycles: closer phases are merged
_BORE = 0.4  # of the reference radius: bore of the gear body
_RAMP = 0.1  # cycles over which a tooth pair takes up its load, if the teeth are not modelled
_HELICAL_HARMONICS = 8
_PHASES = 64  # points per period of the shortest term of a series, for its minimum
_INSTANTS = 8193  # at which growth is evaluated
_STAGES = 17  # of a growing fault, equally spaced in size, with linear growth between them


@dataclass(frozen=True, kw_only=True)
class Teeth:
    """Properties of a mesh, and the mesh phases at which damaged teeth are in the middle of their contact.

    `passes` holds (number of the fault from 0, phase of the first pass, cycles between passes, contact ratio),
    `history` the teeth against time if damage grows, with the phase of the contact's planet; `properties` are the
    initial ones.
    """

    properties: MeshProperties
    passes: tuple[tuple[int, float, int, float], ...]
    history: MeshHistory | None = None


def kinematics_of(scene: Scene) -> Kinematics:
    """Return the kinematics of a scene, with the mesh geometry given under `dynamics`."""
    dynamics, gearbox = scene.dynamics_or_default, scene.gearbox
    known = {mesh.name for mesh in gearbox.meshes}
    for name, _ in dynamics.meshes:
        if name not in known:
            raise SceneError(f'dynamics.meshes names "{name}", which is no mesh of gearbox "{gearbox.name}".')
    geometry = ("module_mm", "face_width_mm", "pressure_angle_deg", "profile_shift")
    meshes = []
    for mesh in gearbox.meshes:
        declared = dynamics.mesh(mesh.name)
        given = {key: getattr(declared, key) for key in geometry if getattr(declared, key) is not None}
        meshes.append(mesh.changed(**given) if given else mesh)
    return solve_kinematics(gearbox.changed(meshes=tuple(meshes)))


@dataclass(frozen=True, kw_only=True)
class Gears:
    """Kinematics of a scene with geometry, and the teeth of each contact by name: the same at every fidelity."""

    kinematics: Kinematics
    teeth: Mapping[str, Teeth] = field(repr=False)


def gears_of(stage: PreparedScene, kinematics: Kinematics, *, static_n: Mapping[str, float] | None = None) -> Gears:
    """Return the gears with the teeth of every mesh.

    The phase of each mesh at revolution zero is random, or zero with `mesh_rpm`. A planet's phase with its second
    central gear follows from that with the first. `static_n` has the static force of each contact, which determines
    where damaged teeth lose contact.
    """
    try:
        contacts = contacts_of(kinematics)
    except ValueError as caught:
        words = str(caught).split("; declare")[0]
        raise SceneError(
            f'{words}; declare it in the gearbox, or as dynamics.meshes = {{ "{stage.scene.gearbox.meshes[0].name}" = '
            "{ module_mm = ..., face_width_mm = ..., pressure_angle_deg = ... } }."
        ) from None
    cycles = _cycles_at_first(stage, kinematics, contacts)
    return Gears(
        kinematics=kinematics,
        teeth={
            contact.name: _teeth(
                stage, kinematics, contact, (static_n or {}).get(contact.name), at_first=cycles[contact.mesh]
            )
            for contact in contacts
        },
    )


def _cycles_at_first(stage: PreparedScene, kinematics: Kinematics, contacts: Sequence[Contact]) -> dict[str, float]:
    """Return the initial phase of each mesh: cycles since a tooth pair of its first contact engaged."""
    cycles, flow = dict[str, float](), power_flow(kinematics, contacts)
    of_planets = dict[tuple[str, int], tuple[Contact, int]]()  # by the planet and its teeth: the first that meets them
    for contact in contacts:
        if contact.mesh in cycles:
            continue
        planet = planet_of(kinematics, contact)
        drawn = float(stage.rng_for("phase", "gear_mesh", contact.mesh, "teeth").random())
        cycles[contact.mesh] = drawn if stage.scene.dynamics_or_default.mesh_rpm is None else 0.0
        if planet is not None:
            gear = contact.links[planet], contact.teeth[planet]
            first, place = of_planets.setdefault(gear, (contact, planet))
            if first is not contact:
                lead = opposite_mesh_lead(first, contact, gear[0], driven_by_first=flow[first.name] != place)
                cycles[contact.mesh] = cycles[first.mesh] + lead
    return cycles


def _gear(kinematics: Kinematics, contact: Contact, component: str) -> int | None:
    """Return the index of the gear in a contact named by, say, ``stage 1/pinion``; of planets, the first."""
    link = component.rpartition("/")[2]
    first = kinematics.gearbox.instances(link)[0]
    return contact.links.index(first) if first in contact.links else None


@dataclass(frozen=True, kw_only=True)
class _Broken:
    """A damaged gear of a contact: numbers of fault and gear, teeth, and phase at which the worst one engages."""

    number: int
    gear: int
    teeth: int
    first: int

    def damage(self, stage: PreparedScene, time_s: float) -> GearDamage:
        """Return the tooth damage at a time."""
        gear = faulty_gear(stage.scene, self.number, teeth=self.teeth, rng_for=stage.rng_for)
        grown = float(stage.scene.faults[self.number].relative_size(time_s))
        return damage_of(stage.scene, self.number, gear=gear, relative_size=grown, time_s=time_s)


def _teeth(
    stage: PreparedScene, kinematics: Kinematics, contact: Contact, static_n: float | None, *, at_first: float
) -> Teeth:
    """Return the mesh properties of a contact in gear dynamics, with its damaged teeth and their growth.

    `at_first` is the initial phase: cycles since a tooth pair engaged.
    """
    scene = stage.scene
    turned = stage.turns_before * scene.exact_orders("gear_mesh").get(contact.mesh, 0)
    declared = scene.dynamics_or_default.mesh(contact.mesh)
    later = at_first + float(turned % abs(math.prod(contact.teeth)))  # at revolution zero
    half = contact.equivalent_pair.contact_ratio / 2
    broken = []
    for number, fault in enumerate(scene.faults):
        if not isinstance(fault, GearFault) or mesh_name(fault.component) != contact.mesh:
            continue
        gear = _gear(kinematics, contact, fault.component)
        if gear is not None:
            teeth = abs(contact.teeth[gear])
            # the damaged tooth is in mid-contact where that of the kinematic scene is, to the nearest tooth
            first = round(-stage.offsets[number] * teeth + at_first - half) % teeth
            broken.append(_Broken(number=number, gear=gear, teeth=teeth, first=first))
    times_s = instants_of_growth(stage, [item.number for item in broken])
    stages = [[item.damage(stage, time_s) for item in broken] for time_s in times_s]
    shape = _shape(scene, contact)
    if shape != "teeth" and any(each.softens for damage in stages for each in damage):
        raise SceneError(
            f'mesh "{contact.mesh}": a tooth that is softer needs shape = "teeth", which is for straight teeth '
            f'without undercut or profile shift; its shape is "{shape}".'
        )
    sharing = _sharing(scene, contact, static_n) if static_n is not None else None
    healthy = _healthy_errors(stage, kinematics, contact, declared)
    overlap = contact.equivalent_pair.overlap_ratio
    healthy += modification_errors(sharing, stiffness_too=shape == "teeth", overlap_ratio=overlap)
    stiffnesses, errors = list[Stiffness](), list[SumOfErrors]()
    try:
        for damage in stages:
            damaged, parts = modified_teeth(sharing), [*healthy]
            for item, each in zip(broken, damage, strict=True):
                gear, first = item.gear, item.first
                damaged += damaged_teeth(each, gear=gear, first=first, sharing=sharing)
                parts[:0] = transmission_errors(
                    each,
                    pair=contact.equivalent_pair,
                    gear=gear,
                    first=first,
                    sharing=sharing,
                    stiffness_too=shape == "teeth",
                )
            stiffnesses.append(_stiffness(scene, contact, damaged, by_cycles=later))
            errors.append(SumOfErrors(parts=tuple(parts), by_cycles=later))
    except SceneError:
        raise
    except ValueError as caught:
        names = [f"fault {item.number + 1}, {scene.faults[item.number].kind}" for item in broken]
        raise SceneError(f'{" and ".join(names)} of mesh "{contact.mesh}": {caught}.') from None
    lag = planet_phase_lag(kinematics, contact)
    given = any(each.parts for each in errors)
    both = zip(stiffnesses, errors, strict=True)
    late = [delayed(stiffness, error if given else None, lag) for stiffness, error in both]
    history = None
    if len(stages) > 1:
        of_stages, errors_of_stages = zip(*late, strict=True)
        history = MeshHistory(times_s=times_s, stiffnesses=of_stages, errors=errors_of_stages)
    return Teeth(
        properties=MeshProperties(
            stiffness=stiffnesses[0],
            error=errors[0] if given else None,
            backlash_m=_backlash_m(declared, contact) / 2,
            friction_coefficient=declared.friction_coefficient,
            friction_cycles=later,
        ),
        passes=tuple((item.number, item.first + half - later + float(lag), item.teeth, 2 * half) for item in broken),
        history=history,
    )


def instants_of_growth(stage: PreparedScene, numbers: Sequence[int]) -> Array:
    """Return increasing times from zero, between which each fault grows by a sixteenth of its growth."""
    even, kept = np.linspace(0.0, stage.scene.duration_s, _INSTANTS), {0}
    for number in numbers:
        sizes = stage.scene.faults[number].relative_size(even)
        kept |= {*np.searchsorted(sizes, np.linspace(sizes[0], sizes[-1], _STAGES)).tolist()}
    return even[sorted(kept)]


def _sharing(scene: Scene, contact: Contact, static_n: float) -> LoadSharing:
    """Return the healthy tooth pairs of a contact under their static force."""
    declared, pair = scene.dynamics_or_default.mesh(contact.mesh), contact.equivalent_pair
    tooth_pair, scale = None, 1.0
    if _shape(scene, contact) == "teeth":
        tooth_pair = _tooth_pair(contact)
        teeth = _by_strain_energy(contact, declared.stiffness_n_m, [])
        if declared.stiffness_n_m is not None:
            scale = teeth_in_mesh(tooth_pair).mean / declared.stiffness_n_m

        def compliance(since: Array) -> Array:
            return np.interp(since, teeth.path_cycles, teeth.compliance)
    else:
        alike = pair.contact_ratio / (declared.stiffness_n_m or pair.mean_stiffness())

        def compliance(since: Array) -> Array:
            return np.full(since.shape, alike)

    most_m = _backlash_m(declared, contact) or math.inf
    sharing = LoadSharing(gears=pair, pair_compliance=compliance, static_n=static_n, most_m=most_m)
    return replace(sharing, teeth=tooth_pair, scale=scale, modification=declared.modification)


def _backlash_m(declared: MeshDynamics, contact: Contact) -> float:
    """Return the backlash of a contact along its line of action."""
    if declared.backlash_um is None:
        return contact.equivalent_pair.least_backlash_m
    return _UM * declared.backlash_um


def _healthy_errors(
    stage: PreparedScene, kinematics: Kinematics, contact: Contact, declared: MeshDynamics
) -> list[TransmissionError]:
    """Return the errors of a contact without damage: declared errors, pitch deviations, and planet position errors.

    Deviations along the pitch circle are multiplied by ``cos(alpha)`` along the line of action. A planet ahead of its
    position opens its meshes on both sides.
    """
    scene = stage.scene
    mesh = next(mesh for mesh in kinematics.gearbox.meshes if mesh.name == contact.mesh)
    found = declared_errors(_UM * declared.error_um, declared.transmission_error)
    cosine, ratio = math.cos(contact.pair.transverse_angle_rad), contact.equivalent_pair.contact_ratio
    for number, gear in enumerate(mesh.gears):
        link = next(link for link in contact.links if link in kinematics.gearbox.instances(gear.link))
        deviation_m = gear_deviations_m(scene, mesh, number, instance=link, rng_for=stage.rng_for)
        if deviation_m.any():
            found.append(PitchError(teeth_m=cosine * deviation_m, handover=min(max(ratio - 1, 0.0), 1.0)))
    planet = planet_of(kinematics, contact)
    link = contact.links[planet] if planet is not None else ""
    for named in (each for each in scene.gearbox.copied if link in scene.gearbox.instances(each)):
        axis = next(axis for axis in scene.gearbox.axes if named in axis.links)
        ahead_m = planet_displacements_m(scene, axis, rng_for=stage.rng_for)[scene.gearbox.instances(named).index(link)]
        if ahead_m:
            found.append(PitchError(teeth_m=np.array([cosine * ahead_m]), handover=0.0))
    return found


def _shape(scene: Scene, contact: Contact) -> str:
    """Return the stiffness model of a contact: as declared, or by the tooth geometry if possible."""
    pair = contact.equivalent_pair
    known = contact.parallel or contact.cone is not None
    undercut = min(map(abs, pair.teeth)) * math.sin(pair.pressure_angle_rad) ** 2 < 2 * pair.addendum
    spur = known and not undercut and not pair.helix_angle_rad and not any(pair.profile_shift)
    return scene.dynamics_or_default.mesh(contact.mesh).shape or ("teeth" if spur else "trapezoid")


def _stiffness(scene: Scene, contact: Contact, damaged: list[DamagedTooth], *, by_cycles: float) -> Stiffness:
    declared, pair, shape = (
        scene.dynamics_or_default.mesh(contact.mesh),
        contact.equivalent_pair,
        _shape(scene, contact),
    )
    if shape == "teeth":
        teeth = _by_strain_energy(contact, declared.stiffness_n_m, damaged)
        return Knotted(of=teeth, by_cycles=by_cycles)
    mean = declared.stiffness_n_m or pair.mean_stiffness()
    ratio = declared.contact_ratio or pair.contact_ratio
    if shape in ("rectangular", "fourier"):
        return Shifted(of=_declared_wave(declared, contact.mesh, mean=mean, ratio=ratio), by_cycles=by_cycles)
    if shape == "constant" or ratio % 1 == 0:
        return Constant(mean=mean)
    duty = ratio % 1
    ramp = min(_RAMP, duty, 1 - duty)
    trapezoid = Trapezoidal.by_contact_ratio(pair_stiffness=mean / ratio, contact_ratio=ratio, ramp=ramp)
    if not pair.helix_angle_rad:
        return Shifted(of=trapezoid, by_cycles=by_cycles)
    slices = helical(trapezoid, overlap_ratio=pair.overlap_ratio, harmonics=_HELICAL_HARMONICS)
    return Shifted(of=slices, by_cycles=by_cycles)


def _declared_wave(declared: MeshDynamics, mesh: str, *, mean: float, ratio: float) -> Stiffness:
    """Return the rectangular stiffness of a mesh, or a Fourier series, as declared."""
    if declared.harmonics_n_m is not None:
        lines = np.array([complex(cosine, -sine) for cosine, sine in declared.harmonics_n_m])
        series = Fourier(mean=mean, harmonics=lines)
        least = float(np.min(series(np.linspace(0, 1, _PHASES * lines.size, endpoint=False))))
        if least < 0:
            raise SceneError(f'mesh "{mesh}": harmonics_n_m: the stiffness falls to {least:.4g} N/m; lower its lines.')
        return series
    duty = ratio % 1
    if duty == 0:
        raise SceneError(
            f'mesh "{mesh}": contact_ratio = {ratio:g}: a whole number of pairs is always in contact; give another '
            'contact_ratio, or shape = "constant".'
        )
    step = declared.step_n_m or mean / ratio
    low = mean - duty * step
    if low < -_ROUNDING * mean:
        raise SceneError(
            f'mesh "{mesh}": step_n_m = {step:.7g} takes the stiffness below zero; keep it at most '
            f"{mean / duty:.7g}, the mean over the stiff part of a cycle."
        )
    return Rectangular(low=max(low, 0.0), high=mean + (1 - duty) * step, duty=duty)


@dataclass(frozen=True, kw_only=True)
class Knotted(Shifted):
    """`TeethInMesh` shifted in phase, with kinks listed among its jumps: it is smooth between them.

    A table with few cells therefore suffices.
    """

    of: TeethInMesh

    @property
    def jumps(self) -> tuple[float, ...]:
        """Phases of jumps of the value or its slope."""
        within = np.remainder(self.of.path_cycles, 1.0)
        kinks = (np.arange(self.period)[:, None] + within).ravel()
        every = np.concatenate([self.of.jumps, kinks])
        every = np.sort(np.remainder(every - self.by_cycles, self.period))
        apart = np.concatenate([[True], np.diff(every) > _NEAR])
        return tuple(every[apart].tolist())


def _tooth_pair(contact: Contact) -> ToothPair:
    one, two = contact.equivalent_pair.reference_radii_m
    return ToothPair(gears=contact.equivalent_pair, bore_radii_m=(_BORE * one, _BORE * two))


def _by_strain_energy(contact: Contact, mean: float | None, damaged: list[DamagedTooth]) -> TeethInMesh:
    """Return the stiffness of the teeth in contact from their strain energy, scaled to a given mean."""
    try:
        teeth = teeth_in_mesh(_tooth_pair(contact), damaged=damaged, teeth=contact.teeth)
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

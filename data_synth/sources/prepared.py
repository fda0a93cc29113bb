"""A scene prepared for simulation: its drive, sources, impacts and transfer paths, but for gears that vibrate."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from data_synth.kinematic.bearing_faults import bearing_impact_trains, settling_time_s
from data_synth.kinematic.gear_faults import ImpactTrain, damage_trains, gear_damage_family
from data_synth.kinematic.harmonics import ComplexArray, HarmonicFamily, add_lines
from data_synth.kinematic.imperfect_parts import (
    imbalance_family,
    imperfect_families,
    imperfections_of,
    in_units,
    with_drawn_sensors,
)
from data_synth.kinematic.planet_pass import ring_meshes, with_planet_pass
from data_synth.kinematic.ring_bending import RingLoad, kinematic_ring_loads, ring_bending_lines
from data_synth.kinematic.shaft_faults import (
    ShaftExcitation,
    bent_shaft,
    imbalance,
    shaft_fault_family,
    shaft_misalignment,
)
from data_synth.operation.drive import Drive, build_drive
from data_synth.operation.piecewise import PiecewiseLinear
from data_synth.operation.shaft_angle import Array
from data_synth.operation.tachometer import Pulses, recorded_pulses, with_pick_up
from data_synth.scene.faults import ROW_OF, Chipping, Fault, FaultyGear, GearDamage, GearFault, Misalignment
from data_synth.scene.random_streams import RandomStreams
from data_synth.scene.scene import BearingFault, Scene, SceneError, ShaftFault, declared_size_mm
from data_synth.scene.sensors import Sensor
from data_synth.transfer.acquisition import AllPoleFilter, linear_chain
from data_synth.transfer.housing import force_response, sensitive_direction
from data_synth.transfer.paths import (
    TransferPaths,
    line_amplitudes,
    longest_ringing_s,
    path_of_bearing,
    ringing_time_s,
    sensor_gains,
    transfer_paths,
)
from hums.gearbox.torques import solve_torques

_CORNER = 1e-3  # of the largest speed or torque, by which straight lines between instants may miss a corner
_JUMP = 1e-3  # of a sample, from a jump to the instants before and behind it
_LITTLE, _SLOW = 0.01, 0.3
"""Of the speed, between two instants; of the top speed, below which it is that of so much: a line passes a mode in as
much of the speed as the mode's damping, but slow speeds have weak lines."""

# ---- Harmonics and impacts of the faults that a scene declares -------------------------------------------------------


def last_s(scene: Scene) -> float:
    """Return the time of the last sample."""
    return (scene.samples - 1) / scene.rate_hz


def harmonic_families(
    scene: Scene, drive: Drive, *, offsets: Sequence[float], relative_sizes: Sequence[Array], rng_for: RandomStreams
) -> list[HarmonicFamily]:
    """Return the harmonics of the healthy gearbox, then those that each fault adds.

    Two faults of one mesh do not modulate each other. `relative_sizes` has, for each fault, its size over the initial
    one: (instant,), or (1,) for a fault that does not grow.
    """
    healthy, top_speed_hz = healthy_families(scene, rng_for=rng_for), drive.angle.top_speed_hz(0.0, scene.duration_s)
    meshes = {family.component: family for family in healthy if family.kind == "gear_mesh"}
    teeth = scene.exact_orders("tooth")
    added = []
    for number, (fault, offset, relative_size) in enumerate(zip(scene.faults, offsets, relative_sizes, strict=True)):
        size = fault.initial_mm * relative_size
        if isinstance(fault, GearFault):
            effect = fault.effect_mm(np.minimum(size, _most_mm(scene, fault)))
            mesh, tooth = meshes[mesh_name(fault.component)], teeth[fault.component]
            gear = faulty_gear(scene, number, teeth=float(mesh.base_order / tooth), rng_for=rng_for)
            if gear.face_width_m is not None or not isinstance(fault, Chipping | Misalignment):
                damage_of(scene, number, gear=gear, relative_size=float(np.max(relative_size)), time_s=scene.duration_s)
            family = gear_damage_family(
                fault,
                gear=gear,
                mesh=mesh,
                tooth=tooth,
                offset=offset,
                rise=effect * fault.amplitude_per_mm,
                lag_rad=effect * fault.phase_rad_per_mm,
                reference_speed_hz=top_speed_hz,
            )
            added.append(family)
        elif isinstance(fault, ShaftFault) and fault.rotor_kg is not None:
            family = imbalance_family(
                scene,
                fault.component,
                mass_kg=fault.rotor_kg,
                eccentricity_m=1e-3 * size,
                top_speed_hz=top_speed_hz,
                offset=offset,
            )
            added.append(family)
        elif isinstance(fault, ShaftFault):
            family = shaft_fault_family(
                _EXCITATIONS[fault.kind](),
                component=fault.component,
                order=scene.exact_orders("shaft")[fault.component],
                amplitude=size * fault.amplitude_per_mm,
                reference_speed_hz=top_speed_hz,
                offset=offset,
            )
            added.append(family)
    imperfect = imperfect_families(scene, healthy, top_speed_hz=top_speed_hz, rng_for=rng_for)
    return with_planet_pass(scene, healthy, rng_for=rng_for) + imperfect + added


_EXCITATIONS: dict[str, Callable[[], ShaftExcitation]] = {
    "imbalance": imbalance,
    "bent_shaft": bent_shaft,
    "shaft_misalignment": shaft_misalignment,
}


def _most_mm(scene: Scene, fault: GearFault) -> float:
    """Return the size in mm beyond which a fault does not change, infinite where no module is declared."""
    module_mm = declared_size_mm(scene, mesh_name(fault.component), "module_mm")
    return fault.most_mm(math.inf if module_mm is None else module_mm)


def faulty_gear(scene: Scene, number: int, *, teeth: float, rng_for: RandomStreams) -> FaultyGear:
    """Return the properties of the gear of fault `number` (from 0) on which the fault depends."""
    mesh = mesh_name(scene.faults[number].component)
    width_mm, module_mm = (declared_size_mm(scene, mesh, key) for key in ("face_width_mm", "module_mm"))
    return FaultyGear(
        teeth=teeth,
        face_width_m=None if width_mm is None else 1e-3 * width_mm,
        module_m=math.inf if module_mm is None else 1e-3 * module_mm,
        rng=lambda: rng_for("pits", str(number)),
    )


def damage_of(scene: Scene, number: int, *, gear: FaultyGear, relative_size: float, time_s: float = 0.0) -> GearDamage:
    """Return what a fault, of a size over its initial one, changes of a gear's teeth.

    Raises
    ------
    SceneError
        A size that the gear does not have.
    """
    fault = scene.faults[number]
    assert isinstance(fault, GearFault)  # noqa: S101 - the caller has seen it
    try:
        return fault.damage(1e-3 * fault.initial_mm * relative_size, gear)
    except ValueError as caught:
        when = "" if fault.growth is None else f" at {time_s:g} s"
        raise SceneError(f'fault {number + 1}, {fault.kind} of "{fault.component}"{when}: {caught}.') from None


def mesh_name(component: str) -> str:
    """Return the mesh of a gear such as ``stage 1/pinion``."""
    return component.rpartition("/")[0]


def impact_trains(
    scene: Scene,
    drive: Drive,
    families: Sequence[HarmonicFamily],
    *,
    offsets: Sequence[float],
    rng_for: RandomStreams,
) -> list[tuple[int, ImpactTrain]]:
    """Return the number of the fault and the impacts of each train whose response reaches into the record."""
    bases = {family.component: float(family.base_order) for family in families if family.kind == "gear_mesh"}
    trains: list[tuple[int, ImpactTrain]] = []
    for number, (fault, offset) in enumerate(zip(scene.faults, offsets, strict=True)):
        if isinstance(fault, BearingFault):
            before_s = max(longest_ringing_s(scene, fault.component), settling_time_s(scene, fault))
            found = bearing_impact_trains(
                scene,
                number,
                drive=drive,
                span_rev=_span_rev(scene, drive, ringing_time_s(scene.resonance)),
                since_rev=_span_rev(scene, drive, before_s)[0],
                rng=rng_for("impacts", str(number)),
            )
        elif isinstance(fault, ShaftFault):
            continue
        else:
            mesh, tooth = mesh_name(fault.component), scene.exact_orders("tooth")[fault.component]
            found = damage_trains(
                fault,
                gear=faulty_gear(scene, number, teeth=bases[mesh] / float(tooth), rng_for=rng_for),
                source=mesh,
                tooth=tooth,
                offset=offset,
                span_rev=_span_rev(scene, drive, longest_ringing_s(scene, mesh)),
            )
        trains += [(number, train) for train in found]
    return trains


def _span_rev(scene: Scene, drive: Drive, before_s: float) -> tuple[float, float]:
    """Return the revolutions at `before_s` before the record, or the first known, and at its last sample."""
    first_rev, last_rev = drive.angle.revolutions([max(-before_s, drive.start_s), last_s(scene)])
    return float(first_rev), float(last_rev)


def healthy_families(scene: Scene, *, rng_for: RandomStreams) -> list[HarmonicFamily]:
    """Return one family for each shaft that rotates in the frame and one for each mesh."""
    families = []
    for kind in ("shaft", "gear_mesh"):
        for component, order in scene.exact_orders(kind).items():
            harmonics = np.arange(scene.excitation.harmonics)
            turns = rng_for("phase", kind, component).random(harmonics.size)
            families.append(
                HarmonicFamily(
                    component=component,
                    kind=kind,
                    source=component,
                    base_order=order,
                    coefficients=scene.excitation.amplitude(kind, component)
                    * scene.excitation.decay**harmonics
                    * np.exp(2j * np.pi * turns),
                    load_dependent=kind == "gear_mesh",
                )
            )
    return families


# ---- Prepared --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class PreparedScene:
    """The drive, sources, impacts and transfer paths of a scene.

    Attributes
    ----------
    scene : Scene
    rng_for : callable
        Returns the random generator that belongs to its words.
    drive : Drive
    instants_s, speed_hz : (instant,) array
        Time axis of the truth in s, and the reference shaft's speed there in rev s-1.
    load : (instant,) array
        Tooth load relative to full load.
    families : sequence of HarmonicFamily
    amplitudes : sequence of (sensor, line, instant) complex array
        Z of their harmonics in the channels, after the linear part of the chain.
    trains : sequence of (int, ImpactTrain)
        Impacts with the number of their fault, from 0.
    offsets : sequence of float
        Turns of each fault's component from its worst place, before the machine turned.
    gains : mapping of source to (sensor,) complex array
        Drawn gains to the sensors.
    paths : mapping of (source, sensor) to ModalPath or MeasuredPath
        Declared transfer paths, which replace gains and modes.
    chains : sequence of AllPoleFilter
        The linear part of each sensor's chain.
    pulses : Pulses
    turns_before : int
        Whole turns of the reference shaft before revolution zero, since the phases of the machine were drawn.
    """

    scene: Scene
    rng_for: RandomStreams
    drive: Drive
    instants_s: Array
    speed_hz: Array
    load: Array
    families: Sequence[HarmonicFamily]
    amplitudes: Sequence[ComplexArray]
    trains: Sequence[tuple[int, ImpactTrain]]
    offsets: Sequence[float]
    gains: dict[str, ComplexArray]
    paths: TransferPaths
    chains: Sequence[AllPoleFilter]
    pulses: Pulses
    turns_before: int = 0

    def add_lines(
        self,
        signal: Array,
        *,
        first: int = 0,
        timing_errors_s: Array | None = None,
        only: tuple[str, str] | None = None,
    ) -> None:
        """Add the harmonics of all families, or of one component and kind, to samples from number `first` on.

        Parameters
        ----------
        signal : (sensor, n) array
            Changed in place.
        first : int
        timing_errors_s : (n,) array or None
            Errors of the sampling instants, s.
        only : pair of component and kind, optional
        """
        family_amplitudes = [
            (family, amplitudes)
            for family, amplitudes in zip(self.families, self.amplitudes, strict=True)
            if only in (None, (family.component, family.kind))
        ]
        if not family_amplitudes:
            return
        times_s = np.arange(first, first + signal.shape[1]) / self.scene.rate_hz
        if self.instants_s.size == self.scene.truth_times:
            position = times_s * ((self.scene.truth_times - 1) / self.scene.duration_s)
        else:
            position = np.interp(times_s, self.instants_s, np.arange(self.instants_s.size))
        revolutions = self.drive.angle.revolutions(times_s if timing_errors_s is None else times_s + timing_errors_s)
        for family, amplitudes in family_amplitudes:
            add_lines(signal, amplitudes, base_order=family.base_order, revolutions=revolutions, position=position)

    def with_bending_rings(self, loads: Sequence[RingLoad]) -> "PreparedScene":
        """Return the scene with the lines of rings that their planets bend, in the channels of sensors on them."""
        lines = ring_bending_lines(self.scene, loads, speed_hz=self.speed_hz)
        if not lines:
            raise SceneError("planet_pass.ring: no sensor is on a ring at rest; move one there, or leave it out.")
        unit = in_units(self.scene, 1.0)
        added = [_in_channels(family, unit * own, chains=self.chains, speed_hz=self.speed_hz) for family, own in lines]
        families = [*self.families, *(family for family, _ in lines)]
        return replace(self, families=families, amplitudes=[*self.amplitudes, *added])

    def impacts_at_source(self, number: int, train: ImpactTrain) -> tuple[Array, Array]:
        """Return the times (m,) in s of a train of fault `number`, and the amplitudes of its impacts at the source."""
        times_s = self.drive.angle.times(train.revolutions)
        return times_s, train.amplitudes * self.impact_factor(number, times_s)

    def impact_factor(self, number: int, times_s: Array) -> Array:
        """Return the factor of load, speed and growth in the impacts of a fault at `times_s` (m,)."""
        fault, share = self.scene.faults[number], self.drive.load(times_s)
        grown, exponent = fault.relative_size(times_s), self.scene.excitation.speed_exponent
        if isinstance(fault, GearFault):
            share, exponent = share**fault.load_exponent, exponent + fault.speed_exponent
            most = _most_mm(self.scene, fault)
            initial, later = (np.minimum(each, most) for each in (fault.initial_mm, fault.initial_mm * grown))
            grown = fault.effect_mm(later) / fault.effect_mm(initial)
        return np.asarray(share * _speed_factor(exponent, self.scene, self.drive, times_s) * grown)


def prepare_scene(scene: Scene, *, rng_for: RandomStreams, turns_before: int = 0) -> PreparedScene:
    """Prepare a scene for simulation.

    Parameters
    ----------
    scene : Scene
    rng_for : callable
        Returns the random generator that belongs to its words.
    turns_before : int
        See `PreparedScene`.
    """
    scene = with_drawn_sensors(scene, rng_for=rng_for)
    tachometer = scene.tachometer
    spacing = 1 / tachometer.pulses_per_rev
    turn = tachometer.offset_rev if tachometer.offset_rev is not None else spacing * rng_for("tachometer").random()
    drive = build_drive(scene, datum_turn=turn, speed_rng=rng_for("speed"), torque_rng=rng_for("torque"))
    instants_s = _instants(scene, drive)
    offsets = [_offset_at_first(fault, number, rng_for=rng_for) for number, fault in enumerate(scene.faults)]
    at_zero = [
        (offset + float(turns_before * _turn_order(scene, fault) % 1)) % 1.0
        for fault, offset in zip(scene.faults, offsets, strict=True)
    ]
    relative_sizes = [
        fault.relative_size(instants_s if fault.growth is not None else np.zeros(1)) for fault in scene.faults
    ]
    families = [
        family.later(turns_before)
        for family in harmonic_families(scene, drive, offsets=offsets, relative_sizes=relative_sizes, rng_for=rng_for)
    ]
    trains = impact_trains(scene, drive, families, offsets=at_zero, rng_for=rng_for)
    if scene.fidelity != "kinematic":  # what meshes do is then left to the mechanics
        meshes = {mesh.name for mesh in scene.gearbox.meshes}
        families = [family for family in families if family.source not in meshes]
        trains = [(number, train) for number, train in trains if train.source not in meshes]
    _check_rate(scene, families, drive)
    sources = dict.fromkeys([family.source for family in families] + [train.source for _, train in trains])
    gains, paths = _gains(scene, [*sources], rng_for=rng_for), transfer_paths(scene)
    chains = [linear_chain(sensor, rate_hz=scene.rate_hz) for sensor in scene.sensors]
    speed_hz, load = drive.angle.speed_hz(instants_s), drive.load(instants_s)
    amplitudes = [
        _line_amplitudes(
            scene,
            family,
            gains=gains[family.source],
            paths=paths,
            drive=drive,
            instants_s=instants_s,
            rng_for=rng_for,
        )
        for family in families
    ]
    prepared = PreparedScene(
        scene=scene,
        rng_for=rng_for,
        drive=drive,
        instants_s=instants_s,
        speed_hz=speed_hz,
        load=load,
        families=families,
        amplitudes=amplitudes,
        trains=trains,
        offsets=offsets,
        gains=gains,
        paths=paths,
        chains=chains,
        pulses=_pulses(scene, drive, rng_for=rng_for),
        turns_before=turns_before,
    )
    if scene.fidelity != "kinematic" or scene.planet_pass is None or scene.planet_pass.ring is None:
        return prepared
    rings = ring_meshes(scene, rng_for=rng_for)
    shares = {ring.mesh: _ring_torque(scene, ring.mesh) for ring in rings}
    history_nm = drive.torque.at(instants_s) if drive.torque is not None else np.zeros(instants_s.size)
    torques_nm = {mesh: share * history_nm for mesh, share in shares.items()}
    loads = [
        replace(load, place_rad=load.place_rad + 2 * math.pi * float(turns_before * scene.ratio(load.carrier) % 1))
        for load in kinematic_ring_loads(scene, rings, torques_nm=torques_nm)
    ]
    return prepared.with_bending_rings(loads)


def _instants(scene: Scene, drive: Drive) -> Array:
    """Return the instants of the truth in s, between which amplitudes are linear.

    They are even, 20 a second. Where gears vibrate, there are more: two at a jump of speed or torque, one where they
    have a corner, and so many that the speed changes little between two of them.
    """
    instants_s = np.linspace(0.0, scene.duration_s, scene.truth_times)
    if scene.fidelity == "kinematic":
        return instants_s
    for history in (scene.speed, scene.torque):
        if history is not None and len(history.knots) > 1:
            times, values = np.array(history.knots).T
            within, bound = (times > 0) & (times < scene.duration_s), _CORNER * np.max(np.abs(values))
            between = np.interp(times, instants_s, PiecewiseLinear(times_s=times, values=values).at(instants_s))
            corners = times[within & (np.abs(values - between) > bound)]
            jumps = times[1:][(np.diff(times) == 0) & (np.abs(np.diff(values)) > bound) & within[1:]]
            if corners.size <= scene.truth_times:  # a measured history may be corners alone
                sides = np.add.outer([-_JUMP / scene.rate_hz, _JUMP / scene.rate_hz], jumps).ravel()
                instants_s = np.unique(np.concatenate([instants_s, np.setdiff1d(corners, jumps), sides]))
    speed_hz = np.abs(drive.angle.speed_hz(instants_s))
    faster_hz = np.maximum(np.maximum(speed_hz[1:], speed_hz[:-1]), _SLOW * np.max(speed_hz, initial=1e-300))
    parts = np.ceil(np.abs(np.diff(speed_hz)) / (_LITTLE * faster_hz)).astype(int)
    parts[np.diff(instants_s) < 1 / scene.rate_hz] = 1
    shares = [np.arange(count) / count for count in np.maximum(parts, 1).tolist()]
    steps = np.repeat(np.diff(instants_s), [share.size for share in shares])
    firsts = np.repeat(instants_s[:-1], [share.size for share in shares])
    return np.concatenate([firsts + steps * np.concatenate(shares), instants_s[-1:]])


def _offset_at_first(fault: Fault, number: int, *, rng_for: RandomStreams) -> float:
    """Return the turns of a fault's component from its worst place before the machine turned."""
    if not isinstance(fault, BearingFault) and fault.offset_rev is not None:
        return fault.offset_rev
    return float(rng_for("offset", str(number)).random())


def _turn_order(scene: Scene, fault: Fault) -> Fraction:
    """Return the order at which a fault's offset turns; 0 for a bearing, whose elements slip."""
    if isinstance(fault, BearingFault):
        return Fraction(0)
    return scene.exact_orders(ROW_OF[fault.kind])[fault.component]


def _ring_torque(scene: Scene, mesh: str) -> float:
    """Return the torque of one planet on the ring of a mesh for 1 N m of the scene's torque, in N m, by statics."""
    if scene.torque is None:
        raise SceneError(
            "planet_pass.ring: without load no ring bends; add torque = { link = ..., nm = ... }, or leave it out."
        )
    link, reference = scene.torque.link, str(scene.gearbox.reference)
    bodies, load_on = scene.kinematics.bodies, scene.dynamics.load_on if scene.dynamics is not None else None
    drives = bodies[link] == bodies[reference]
    other = load_on if drives else reference
    if other is None:
        raise SceneError(
            f'planet_pass.ring: torque acts on "{link}", and the reference "{reference}" drives; name the link that '
            "takes the power out as dynamics.load_on."
        )
    against = math.copysign(1.0 if drives else -1.0, scene.ratio(link))
    loads = solve_torques(scene.kinematics, {link: against, other: None}).tooth_loads
    load = next(load for load in loads if load.mesh == mesh)
    torque = max(load.torques_nm, key=abs)  # the ring has more teeth than the planet
    if not math.isfinite(torque):
        raise SceneError(
            f'planet_pass.ring: statics does not determine the load of mesh "{mesh}"; write fidelity = "lateral".'
        )
    return torque


def ratio_of(scene: Scene, link: str) -> float:
    """Return the absolute speed ratio of a link to the reference shaft."""
    return float(abs(scene.ratio(link)))


def _pulses(scene: Scene, drive: Drive, *, rng_for: RandomStreams) -> Pulses:
    link = scene.tachometer.link
    pulses = recorded_pulses(
        drive.angle, scene.tachometer, turns_per_rev=ratio_of(scene, link), stop_s=last_s(scene), rng=rng_for("pulses")
    )
    electrical = imperfections_of(scene).electrical
    if electrical is not None and electrical.tachometer is not None:
        pulses = with_pick_up(
            pulses,
            electrical.tachometer,
            mains_hz=electrical.mains_hz,
            stop_s=last_s(scene),
            rng=rng_for("imperfection", "tachometer"),
        )
    if pulses.times_s.size < 2:  # noqa: PLR2004 - a speed is a difference
        turned = float(np.ptp(drive.angle.revolutions(np.array([0.0, last_s(scene)])))) * ratio_of(scene, link)
        remedy = "lengthen the scene" if turned else "let a torque start it"
        raise SceneError(
            f"duration_s = {scene.duration_s:g} holds {pulses.times_s.size} pulse(s) of the tachometer, but a speed "
            f"needs 2, and its link turns {turned:.3g} times; {remedy}."
        )
    return pulses


def _speed_factor(exponent: float, scene: Scene, drive: Drive, times_s: Array) -> Array:
    """Return the speed over the top speed to a power, at times (n,)."""
    if exponent == 0:
        return np.ones(np.shape(times_s))
    top = drive.angle.top_speed_hz(0.0, scene.duration_s)
    return np.asarray((np.abs(drive.angle.speed_hz(times_s)) / top) ** exponent)


def _gains(scene: Scene, sources: list[str], *, rng_for: RandomStreams) -> dict[str, ComplexArray]:
    """Return the gain of each source to each sensor, with the transverse motion of the sensor."""
    along = sensor_gains(sources, sensors=len(scene.sensors), rng_for=rng_for)
    shares = np.array([_cross_axis_share(sensor) for sensor in scene.sensors])
    if not shares.any():
        return along
    # one sensor more, whose gain is not held at 1
    across = sensor_gains(sources, sensors=shares.size + 1, rng_for=lambda *words: rng_for(*words, "across"))
    return {source: gains + shares * across[source][1:] for source, gains in along.items()}


def _cross_axis_share(sensor: Sensor) -> float:
    """Return the transverse sensitivity of a sensor."""
    return sensor.cross_axis.share if sensor.cross_axis is not None else 0.0


def _line_amplitudes(
    scene: Scene,
    family: HarmonicFamily,
    *,
    gains: ComplexArray,
    paths: TransferPaths,
    drive: Drive,
    instants_s: Array,
    rng_for: RandomStreams,
) -> ComplexArray:
    """Return Z (sensor, line, instant) of a family in the channels.

    Beside gears in motion a force on bearings moves the housing, or acts on the declared path of its bearing, as theirs
    do, in the direction of each sensor.
    """
    at_source = {"speed_hz": drive.angle.speed_hz(instants_s), "load": drive.load(instants_s)}
    frequency_hz = np.outer([float(order) for order in family.orders], at_source["speed_hz"])
    found = line_amplitudes(family, gains=gains, mode=scene.path, **at_source)
    force = family.force if scene.fidelity != "kinematic" else None
    for row, sensor in enumerate(scene.sensors):
        own = paths.get((family.source, sensor.name))
        path = own if own is not None or force is None else path_of_bearing(scene, paths, force.link, sensor.name)
        if path is not None or force is not None:
            found[row] = line_amplitudes(family, gains=np.ones(1), mode=path, **at_source)[0]
        if own is None and force is not None:  # then an amplitude of 1 is that of the rigid housing
            found[row] *= scene.dynamics_or_default.housing_kg / in_units(scene, 1.0)
        if path is not None and force is not None:
            found[row] *= force.direction @ sensitive_direction(sensor, rng_for=rng_for)
        if path is None and force is not None:
            found[row] *= force_response(scene, sensor, force, frequency_hz=frequency_hz, rng_for=rng_for)
        else:
            found[row] *= linear_chain(sensor, rate_hz=scene.rate_hz).response(frequency_hz)
    # a scene's exponent is that of its declared amplitudes, a force has its own
    declared = scene.excitation.speed_exponent if family.force is None else 0.0
    return np.asarray(found * _speed_factor(declared, scene, drive, instants_s))


def _in_channels(
    family: HarmonicFamily, amplitudes: ComplexArray, *, chains: Sequence[AllPoleFilter], speed_hz: Array
) -> ComplexArray:
    """Return the amplitudes of a family after the linear chain of each channel."""
    frequencies = np.outer([float(order) for order in family.orders], speed_hz)
    family_amplitudes = [chain.response(frequencies) for chain in chains]
    return np.asarray(amplitudes * np.stack(family_amplitudes))


def _check_rate(scene: Scene, families: Sequence[HarmonicFamily], drive: Drive) -> None:
    """Raise SceneError where the highest line is above half the sampling rate."""
    top_hz = drive.angle.top_speed_hz(0.0, scene.duration_s)
    highest = max((float(family.orders[-1]) for family in families), default=0.0)
    what, lower = f"highest line, order {highest:g}", "excitation.harmonics"
    if scene.fidelity != "kinematic":
        mesh, order = max(scene.exact_orders("gear_mesh").items(), key=lambda item: item[1])
        if order > highest:
            highest, what, lower = float(order), f'order of "{mesh}", {float(order):g}', "the speed"
    need = 2 * highest * top_hz
    if scene.rate_hz <= need:
        raise SceneError(
            f"rate_hz = {scene.rate_hz:g} is not above {need:.0f} Hz, twice the {what}, at top speed; raise rate_hz, "
            f"or lower {lower}: the highest order that fits is {scene.rate_hz / 2 / top_hz:.4g}."
        )

"""A scene prepared for simulation: its drive, sources, impacts and transfer paths, except vibrating gears."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.kinematic.harmonics import ComplexArray, HarmonicFamily, add_lines
from data_synth.kinematic.imperfect_parts import imperfections_of, in_units, with_drawn_sensors
from data_synth.kinematic.planet_pass import ring_meshes
from data_synth.kinematic.ring_bending import RingLoad, kinematic_ring_loads, ring_bending_lines
from data_synth.operation.drive import Drive, build_drive
from data_synth.operation.piecewise import PiecewiseLinear
from data_synth.operation.shaft_angle import Array
from data_synth.operation.tachometer_pulses import Pulses, recorded_pulses, with_pick_up
from data_synth.scene.faults import ROW_OF, Fault, GearFault
from data_synth.scene.machine_faults import BearingFault
from data_synth.scene.random_streams import RandomStreams
from data_synth.scene.scene import Scene, SceneError
from data_synth.sources.families import harmonic_families, impact_trains, last_s, ratio_of, turning_ratios
from data_synth.transfer.acquisition import linear_chain
from data_synth.transfer.housing import force_response, sensitive_direction
from data_synth.transfer.paths import (
    AnalogFilter,
    TransferPaths,
    line_amplitudes,
    mode_filter,
    path_of_bearing,
    sensor_gains,
    transfer_paths,
)
from hums.gearbox.torques import solve_torques
from hums.records.validation import MIN_SAMPLES_PER_PULSE

_CORNER = 1e-3  # of the largest speed or torque, the error allowed at a corner by linear interpolation between instants
_JUMP = 1e-3  # samples between a jump and the instants on either side of it
_LITTLE, _SLOW = 0.01, 0.3
"""Largest relative change of speed between two instants, since a line crosses a mode within a change equal to the
damping ratio; and the fraction of the top speed below which the change is relative to that, since slow speeds have weak
lines."""
_FEWEST, _MOST_PER_REV, _RAMP_KNOTS = 20, 4, 2
"""Intervals between the instants of a ramp, at least; per revolution of the fastest shaft, at most; and the knots of
its history."""
_STANDSTILL_HZ, _ROUNDING = 1e-9, 1e-9  # of a shaft; and of a number of intervals

# ---- Prepared --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class PreparedScene:
    """The drive, sources, impacts and transfer paths of a scene.

    Attributes
    ----------
    scene : Scene
    rng_for : callable
        Function that returns the random generator of given words.
    drive : Drive
    instants_s, speed_hz : (instant,) arrays
        Time axis of the truth in s, and speed of the reference shaft in rev s-1.
    load : (instant,) array
        Tooth load relative to full load.
    families : sequence of HarmonicFamily
    amplitudes : sequence of (sensor, line, instant) complex array
        Z of their harmonics in the channels, after the linear part of the chain.
    trains : sequence of (int, ImpactTrain)
        Impacts with the index of their fault, from 0.
    offsets : sequence of float
        Angle in revolutions of the component of each fault from its most damaged place, before the machine turned.
    gains : mapping of source to (sensor,) complex array
        Drawn gains to the sensors.
    paths : mapping of (source, sensor) to ModalPath or MeasuredPath
        Declared transfer paths, which replace gains and modes.
    chains : sequence of AnalogFilter
        Linear part of the chain of each sensor.
    pulses : Pulses
    turns_before : int
        Whole revolutions of the reference shaft before revolution zero, since the phases of the machine were drawn.
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
    chains: Sequence[AnalogFilter]
    pulses: Pulses
    turns_before: int = 0

    def add_lines(self, signal: Array, *, first: int = 0, only: tuple[str, str] | None = None) -> None:
        """Add the harmonics of all families, or of one component and kind, to samples starting at index `first`.

        Parameters
        ----------
        signal : (sensor, n) array
            Modified in place.
        first : int
            Index of the first sample.
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
        position = np.interp(times_s, self.instants_s, np.arange(self.instants_s.size))
        revolutions = self.drive.angle.revolutions(times_s)
        for family, amplitudes in family_amplitudes:
            add_lines(signal, amplitudes, base_order=family.base_order, revolutions=revolutions, position=position)

    @property
    def sources(self) -> list[tuple[str, str]]:
        """Component and kind of each source of lines or impacts."""
        lines = [(family.component, family.kind) for family in self.families]
        return list(dict.fromkeys(lines + [(train.component, train.kind) for _, train in self.trains]))

    def without_faults(self) -> "PreparedScene":
        """Return the scene without its faults, for the motion of healthy gears."""
        return replace(self, scene=self.scene.changed(faults=()), offsets=())

    def with_bending_rings(self, loads: Sequence[RingLoad]) -> "PreparedScene":
        """Return the scene with the lines of bending rings in the channels of sensors on them."""
        lines = ring_bending_lines(self.scene, loads, speed_hz=self.speed_hz)
        if not lines:
            raise SceneError("planet_pass.ring: no sensor is on a stationary ring; place one there, or leave it out.")
        unit = in_units(self.scene, 1.0)
        families, amplitudes = [*self.families], [*self.amplitudes]
        for family, own in lines:
            frequencies_hz = np.outer([float(order) for order in family.orders], self.speed_hz)
            families.append(family)
            amplitudes.append(unit * own * np.stack([chain.response(frequencies_hz) for chain in self.chains]))
        return replace(self, families=families, amplitudes=amplitudes)

    def impacts_at_source(self, number: int, train: ImpactTrain) -> tuple[Array, Array]:
        """Return the times (m,) in s of the impacts of a train of fault `number`, and their source amplitudes."""
        times_s = self.drive.angle.times(train.revolutions)
        return times_s, train.amplitudes * self.impact_factor(number, times_s)

    def impact_factor(self, number: int, times_s: Array) -> Array:
        """Return the factor (m,) of load, speed and growth in the impacts of a fault at `times_s` (m,)."""
        fault, share = self.scene.faults[number], self.drive.load(times_s)
        grown, exponent = fault.relative_size(times_s), self.scene.excitation.speed_exponent
        if isinstance(fault, GearFault):
            share, grown = share**fault.load_exponent, fault.effect_mm(grown)
        return np.asarray(share * _speed_factor(exponent, self.scene, self.drive, times_s) * grown)


def prepare_scene(scene: Scene, *, rng_for: RandomStreams, turns_before: int = 0) -> PreparedScene:
    """Prepare a scene for simulation.

    Parameters
    ----------
    scene : Scene
    rng_for : callable
        Function that returns the random generator of given words.
    turns_before : int
        See `PreparedScene`.

    Raises
    ------
    SceneError
        A scene that cannot be simulated.
    """
    scene = with_drawn_sensors(scene, rng_for=rng_for)
    tachometer = scene.tachometer
    spacing = 1 / tachometer.pulses_per_rev
    turn = tachometer.offset_rev if tachometer.offset_rev is not None else spacing * rng_for("tachometer").random()
    drive = build_drive(scene, datum_turn=turn, speed_rng=rng_for("speed"), torque_rng=rng_for("torque"))
    instants_s = truth_instants(scene, drive)
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
    if scene.fidelity != "kinematic":  # meshes are then simulated by their dynamics
        meshes = {mesh.name for mesh in scene.gearbox.meshes}
        families = [family for family in families if family.source not in meshes]
        trains = [(number, train) for number, train in trains if train.source not in meshes]
    check_rate(scene, families, drive)
    sources = dict.fromkeys([family.source for family in families] + [train.source for _, train in trains])
    gains, paths = _gains(scene, [*sources], rng_for=rng_for), transfer_paths(scene)
    chains = [linear_chain(sensor, rate_hz=scene.rate_hz) for sensor in scene.sensors]
    speed_hz, load = drive.angle.speed_hz(instants_s), drive.load(instants_s)
    amplitudes = [
        _line_amplitudes(
            scene, family, gains=gains[family.source], paths=paths, drive=drive, instants_s=instants_s, rng_for=rng_for
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


def truth_instants(scene: Scene, drive: Drive) -> Array:
    """Return the instants of the truth in s, between which amplitudes are linear.

    They are uniform, 20 per second. In gear dynamics, constant conditions need both ends only, and ramps 21 instants at
    equal angles, which leaves room for more lines; others are added: two at a jump of speed or torque, one at a corner,
    and enough for the speed to change little between them, except where neighbouring lines could not be resolved.
    """
    instants_s = np.linspace(0.0, scene.duration_s, scene.truth_times)
    if scene.fidelity == "kinematic":
        return instants_s
    histories = [history for history in (scene.speed, scene.torque) if history is not None]
    varies = any(len({value for _, value in history.knots}) > 1 for history in histories)
    grows = any(fault.growth is not None for fault in scene.faults)
    # growth changes no instants of a ramp, so that lines without the fault are the same
    ramps = not (imperfections_of(scene).temperature or scene.speed.run_up or (grows and not varies)) and all(
        len(history.knots) <= _RAMP_KNOTS and not history.turbulence for history in histories
    )
    if ramps:
        instants_s = np.array([0.0, scene.duration_s])
    for history in histories:
        if len(history.knots) > 1:
            times, values = np.array(history.knots).T
            within, bound = (times > 0) & (times < scene.duration_s), _CORNER * np.max(np.abs(values))
            between = np.interp(times, instants_s, PiecewiseLinear(times_s=times, values=values).at(instants_s))
            corners = times[within & (np.abs(values - between) > bound)]
            jumps = times[1:][(np.diff(times) == 0) & (np.abs(np.diff(values)) > bound) & within[1:]]
            if corners.size <= scene.truth_times:  # a measured history may consist of corners
                sides = np.add.outer([-_JUMP / scene.rate_hz, _JUMP / scene.rate_hz], jumps).ravel()
                instants_s = np.unique(np.concatenate([instants_s, np.setdiff1d(corners, jumps), sides]))
    steps_s, speed_hz = np.diff(instants_s), np.maximum(np.abs(drive.angle.speed_hz(instants_s)), _STANDSTILL_HZ)
    first_hz, last_hz = speed_hz[:-1], speed_hz[1:]
    turned = steps_s * (first_hz + last_hz) / 2
    slow_hz = np.maximum(np.maximum(first_hz, last_hz), _SLOW * np.max(speed_hz))
    fastest = max(map(abs, turning_ratios(scene).values()))
    parts = np.minimum(np.abs(last_hz - first_hz) / (_LITTLE * slow_hz), np.floor(_MOST_PER_REV * fastest * turned))
    if ramps and varies:
        parts = np.maximum(parts, min(_FEWEST, scene.truth_times - 1) * turned / np.sum(turned))
    counts = np.maximum(np.ceil(parts - _ROUNDING), 1).astype(int)
    numbers = np.repeat(np.arange(counts.size), counts)
    shares = np.concatenate([np.arange(count) / count for count in counts.tolist()])
    first_hz, last_hz = first_hz[numbers], last_hz[numbers]
    in_angle = shares * (first_hz + last_hz) / (first_hz + np.sqrt(first_hz**2 + shares * (last_hz**2 - first_hz**2)))
    return np.append(instants_s[numbers] + steps_s[numbers] * in_angle, instants_s[-1])


def _offset_at_first(fault: Fault, number: int, *, rng_for: RandomStreams) -> float:
    """Return the angle in revolutions from the most damaged place of a fault, before the machine turned."""
    if not isinstance(fault, BearingFault) and fault.offset_rev is not None:
        return fault.offset_rev
    return float(rng_for("offset", str(number)).random())


def _turn_order(scene: Scene, fault: Fault) -> Fraction:
    """Return the order of rotation of the offset of a fault; 0 for a bearing, whose elements slip."""
    if isinstance(fault, BearingFault):
        return Fraction(0)
    return scene.exact_orders(ROW_OF[fault.kind])[fault.component]


def _ring_torque(scene: Scene, mesh: str) -> float:
    """Return the static torque in N m of one planet on the ring of a mesh, for 1 N m of the scene's torque."""
    if scene.torque is None:
        raise SceneError(
            "planet_pass.ring: a ring bends only under load; add torque = { link = ..., nm = ... }, or leave it out."
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
            f'planet_pass.ring: the load of mesh "{mesh}" is statically indeterminate; use fidelity = "dynamic".'
        )
    return torque


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
    given, most = scene.tachometer.pulses_per_rev, scene.samples / MIN_SAMPLES_PER_PULSE
    if pulses.times_s.size > most + 1:
        raise SceneError(
            f"tachometer: pulses_per_rev = {given} makes {pulses.times_s.size} pulses in {scene.samples} samples, and "
            f"a record may have at most one per {MIN_SAMPLES_PER_PULSE:g}; give at most "
            f"{int(given * most / pulses.times_s.size)}, or raise rate_hz."
        )
    if pulses.times_s.size < 2:  # noqa: PLR2004 - a speed is a difference
        turned = float(np.ptp(drive.angle.revolutions(np.array([0.0, last_s(scene)])))) * ratio_of(scene, link)
        remedy = "lengthen the scene" if turned else "raise the torque to start it"
        raise SceneError(
            f"duration_s = {scene.duration_s:g}, tachometer pulses within it: {pulses.times_s.size}; a speed needs 2. "
            f"The link makes {turned:.3g} revolutions: {remedy}."
        )
    return pulses


def _speed_factor(exponent: float, scene: Scene, drive: Drive, times_s: Array) -> Array:
    """Return the ratio of the speed to the top speed, to a power, at times (n,)."""
    if exponent == 0:
        return np.ones(np.shape(times_s))
    top = drive.angle.top_speed_hz(0.0, scene.duration_s)
    return np.asarray((np.abs(drive.angle.speed_hz(times_s)) / top) ** exponent)


def _gains(scene: Scene, sources: list[str], *, rng_for: RandomStreams) -> dict[str, ComplexArray]:
    """Return the gain of each source to each sensor, with the transverse motion of the sensor."""
    along = sensor_gains(sources, sensors=len(scene.sensors), rng_for=rng_for)
    shares = np.array([sensor.cross_axis.share if sensor.cross_axis else 0.0 for sensor in scene.sensors])
    if not shares.any():
        return along
    # one more sensor, since the gain of the first is fixed at 1
    across = sensor_gains(sources, sensors=shares.size + 1, rng_for=lambda *words: rng_for(*words, "across"))
    return {source: gains + shares * across[source][1:] for source, gains in along.items()}


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

    With gears in motion a force on bearings moves the housing, or acts through the declared path of its bearing, like
    their forces, in the direction of each sensor.
    """
    at_source = {"speed_hz": drive.angle.speed_hz(instants_s), "load": drive.load(instants_s)}
    frequency_hz = np.outer([float(order) for order in family.orders], at_source["speed_hz"])
    common = AnalogFilter() if scene.path is None else mode_filter(scene.path)
    found = line_amplitudes(family, gains=gains, path=common, **at_source)
    force = family.force if scene.fidelity != "kinematic" else None
    for row, sensor in enumerate(scene.sensors):
        own = paths.get((family.source, sensor.name))
        path = own if own is not None or force is None else path_of_bearing(scene, paths, force.link, sensor.name)
        if path is not None or force is not None:
            found[row] = line_amplitudes(family, gains=np.ones(1), path=path or AnalogFilter(), **at_source)[0]
        if own is None and force is not None:  # amplitudes refer to the rigid housing
            found[row] *= scene.dynamics_or_default.housing_kg / in_units(scene, 1.0)
        if path is not None and force is not None:
            found[row] *= force.direction @ sensitive_direction(sensor, rng_for=rng_for)
        if path is None and force is not None:
            found[row] *= force_response(scene, sensor, force, frequency_hz=frequency_hz, rng_for=rng_for)
        else:
            found[row] *= linear_chain(sensor, rate_hz=scene.rate_hz).response(frequency_hz)
    # the exponent of the scene applies to declared amplitudes; a force has its own
    declared = scene.excitation.speed_exponent if family.force is None else 0.0
    return np.asarray(found * _speed_factor(declared, scene, drive, instants_s))


def check_rate(scene: Scene, families: Sequence[HarmonicFamily], drive: Drive) -> None:
    """Raise SceneError if the highest line is above half the sampling rate."""
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

"""Kinematic factors of a damaged gear from gears in motion.

The peak that damage adds to a turn of its gear, faulty minus healthy, follows in motion a power of the size, one of the
load and one of the speed, nearly:

    peak = c min(size, largest) ** p (torque / reference) ** q (speed / reference) ** r

A crack or a chipped face makes the tooth softer, so that q is 1; a spall or a broken tooth is a way to sink in, as far
as the load presses at all, so that q is near 0. `fit_factors` runs the scene at some sizes, two torques and eight
speeds, fits p, q and r by least squares of the logarithms, and finds the impact with which the kinematic scene has that
peak; for damage all round a gear, which strikes nowhere, the modulation of its mesh.

A kinematic scene has no resonances of gears. Where speed moves mesh harmonics over those of a scene in motion, its peak
swings about the power of the speed; c is in the middle of that.
"""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from data_synth.dynamics.placement import contacts_of
from data_synth.gears.lost_contact import spall_gap
from data_synth.operation.shaft_angle import Array
from data_synth.scene.faults import Pitting, Spall
from data_synth.scene.scene import GearFault, Scene, SceneError
from data_synth.simulation import NoiseFree, noise_free
from data_synth.sources.families import mesh_name
from data_synth.vibration.meshes import kinematics_of

_TURNS = 2  # of the damaged gear that are simulated, or as many as it takes to meet all planets
_LOADS = (1.0, 0.5)  # of the scene's torque, at which it is run
_SPEEDS = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3)  # of the scene's speed
_LEAST_EXPONENT = 1e-3  # of the size: a scene takes none of zero
_PULSES = 60  # a turn of the tachometer's link: a speed needs two in a short scene
_FINER = (0.1, 0.01)  # times the error of a record: what a fault adds is a small difference of two
_FAR = 30.0  # times the error of a record, which is an RMS: a peak that is large enough to be known to 1 dB
_KEPT = 64  # channels of a few turns without a fault: those of one fit are some 24, and the next may be of other faults
_SMALL_MM = 0.01  # a size that every gear has
_WHOLE = 1.0  # m: deeper than any spall
_NO_FACTORS = {"amplitude_per_mm": 0.0, "phase_rad_per_mm": 0.0, "impact_per_mm": 0.0}
_ALL_ROUND = ("eccentricity", "misalignment", "wear")


@dataclass(frozen=True, kw_only=True)
class FactorFit:
    """Factors of a damaged gear in a kinematic scene, as gears in motion have them.

    Attributes
    ----------
    kind, component : str
    factor : str
        What is fitted: ``impact_per_mm``, or ``amplitude_per_mm`` of damage all round a gear.
    per_mm : float
        The factor at 1 mm, reference torque and speed: of an impact in the units of the first sensor.
    size_exponent, load_exponent, speed_exponent : float
        p, q and r.
    largest_effect_mm : float or None
        A larger size adds nothing.
    torque_nm, rpm : float
        Reference torque, and reference speed of the link whose speed the scene declares.
    scatter_db : float
        Largest deviation of the fitted runs.
    """

    kind: str
    component: str
    factor: str
    per_mm: float
    size_exponent: float
    load_exponent: float
    speed_exponent: float
    largest_effect_mm: float | None
    torque_nm: float
    rpm: float
    scatter_db: float

    def table(self, *, size_mm: float, torque_nm: float, rpm: float) -> dict[str, Any]:
        """Return the fault as a kinematic scene declares it, with this factor alone.

        Parameters
        ----------
        size_mm : float
        torque_nm : float
            Full load of that scene.
        rpm : float
            Its top speed.
        """
        of_load, of_speed = torque_nm / self.torque_nm, rpm / self.rpm
        found = {
            "kind": self.kind,
            "component": self.component,
            _size_key(self.kind): size_mm,
            **_NO_FACTORS,
            self.factor: self.per_mm * of_load**self.load_exponent * of_speed**self.speed_exponent,
            "size_exponent": self.size_exponent,
            "load_exponent": self.load_exponent,
            "speed_exponent": self.speed_exponent,
        }
        return found if self.largest_effect_mm is None else {**found, "largest_effect_mm": self.largest_effect_mm}


def fit_factors(scene: Scene, *, sizes_mm: Sequence[float], seed: int = 0) -> FactorFit:
    """Return the kinematic factors of the one fault of a scene in motion.

    Parameters
    ----------
    scene : Scene
        At one speed and one torque, its fidelity not kinematic, its one fault of a gear. Its size is not used.
    sizes_mm : sequence of float
        Two or more sizes at which the scene is run.
    seed : int

    Raises
    ------
    SceneError
        For a scene without gears in motion, a torque or speed that is no single number, another fault, too few sizes,
        or a size without effect.
    """
    fault = scene.faults[0] if len(scene.faults) == 1 else None
    if not isinstance(fault, GearFault) or scene.fidelity == "kinematic":
        raise SceneError(
            f"{len(scene.faults)} faults, fidelity = {scene.fidelity!r}: a fit needs one fault of a gear in a scene "
            "whose gears vibrate."
        )
    if len(set(sizes_mm)) < 2 or scene.torque is None or len(scene.torque.rows) != 1:  # noqa: PLR2004
        raise SceneError(f"sizes_mm = {list(sizes_mm)}: two different sizes are needed, and a constant torque.nm.")
    if scene.speed.run_up is not None or len(scene.speed.rows) != 1:
        raise SceneError("speed: a fit needs one constant speed.rpm.")
    runs, most_mm = DamageRuns(scene, fault, seed=seed), _largest_effect_mm(scene, fault)
    at = [(size, load, speed) for speed in _SPEEDS for load in _LOADS for size in sizes_mm]
    peaks = np.log([runs.peak(scene.fidelity, runs.of_size(size), load=load, speed=speed) for size, load, speed in at])
    units = {speed: math.log(runs.peak("kinematic", runs.of_unit_effect(), speed=speed)) for speed in _SPEEDS}
    wanted = peaks - [units[speed] for *_, speed in at]
    powers = np.log([(min(size, most_mm or math.inf), load, speed) for size, load, speed in at])
    slopes, *_ = np.linalg.lstsq(powers - np.mean(powers, axis=0), wanted - np.mean(wanted), rcond=None)
    exponents = np.maximum(slopes, [_LEAST_EXPONENT, 0.0, 0.0])
    rest = wanted - powers @ exponents
    middle, half = (np.max(rest) + np.min(rest)) / 2, np.ptp(rest) / 2
    return FactorFit(
        kind=runs.kind,
        component=fault.component,
        factor=runs.factor,
        per_mm=math.exp(middle),
        size_exponent=float(exponents[0]),
        load_exponent=float(exponents[1]),
        speed_exponent=float(exponents[2]),
        largest_effect_mm=most_mm,
        torque_nm=runs.torque_nm,
        rpm=runs.rpm,
        scatter_db=20 / math.log(10) * float(half),
    )


def _size_key(kind: str) -> str:
    return "depth_mm" if kind == "tooth_crack" else "size_mm"


class DamageRuns:
    """Short runs of a scene, noise aside, with its fault and without.

    Parameters
    ----------
    scene : Scene
        At one speed and one torque.
    fault : GearFault
    seed : int
    """

    def __init__(self, scene: Scene, fault: GearFault, *, seed: int) -> None:
        assert scene.torque is not None  # noqa: S101 - the caller asks
        self._seed, self._own = seed, fault.model_dump(mode="json", exclude_none=True)
        self.kind = str(self._own["kind"])
        self.factor = "amplitude_per_mm" if self.kind in _ALL_ROUND else "impact_per_mm"
        self.torque_nm, self.rpm = abs(scene.torque.rows[0][1]), abs(scene.speed.rows[0][1])
        order = float(scene.exact_orders("tooth")[fault.component])
        self._turn_s = float(abs(scene.ratio(scene.speed.link))) * 60 / self.rpm / order
        self._turns = max(_TURNS, math.ceil(order / _carrier_order(scene, fault)))
        short = scene.changed(faults=(), tachometer=scene.tachometer.changed(pulses_per_rev=_PULSES))
        self._dynamics = scene.dynamics_or_default
        self._table = short.model_dump(mode="json", by_alias=True, exclude_none=True)

    def of_size(self, size_mm: float) -> dict[str, Any]:
        """Return the fault with another size."""
        return {**self._own, _size_key(self.kind): size_mm}

    def of_unit_effect(self) -> dict[str, Any]:
        """Return a small fault whose factor times its size is 1, as a kinematic scene declares it."""
        unit = {**self.of_size(_SMALL_MM), **_NO_FACTORS, self.factor: 1 / _SMALL_MM}
        unit |= {"size_exponent": 1.0, "speed_exponent": 0.0}
        return {key: value for key, value in unit.items() if key != "largest_effect_mm"}

    def peak(self, fidelity: str, fault: dict[str, Any], *, load: float = 1.0, speed: float = 1.0) -> float:
        """Return the mean over turns of the peak that a fault adds to the first channel.

        Parameters
        ----------
        fidelity : str
        fault : dict
            Its table.
        load, speed : float
            Shares of the scene's torque and speed.
        """
        found = 0.0
        for finer in _FINER:
            error = finer * self._dynamics.error
            sound = _sound(self._scene(fidelity, load, speed, error, []).to_toml(), self._seed)
            damaged = self._scene(fidelity, load, speed, error, [fault])
            # in as many steps, so that both err alike
            faulty = noise_free(damaged, seed=self._seed, steps=sound.steps)
            found = self._peak(faulty.signal[0] - sound.signal[0], speed)
            if fidelity == "kinematic" or found > _FAR * error * float(np.std(sound.signal[0])):
                break
        if found == 0:
            hint = "; raise excitation.mesh_amplitude" if fidelity == "kinematic" else "; give a larger size"
            size_mm = fault[_size_key(self.kind)]
            raise SceneError(f"{self.kind} of {size_mm:g} mm, fidelity = {fidelity!r}, adds nothing to a record{hint}.")
        return found

    def _peak(self, added: Array, speed: float) -> float:
        turn = self._turn_s / speed * self._table["rate_hz"]
        spline, places = CubicSpline(np.arange(added.size), added), np.arange(turn / 2, 3 * turn / 2)
        return float(np.mean([np.max(np.abs(spline(places + number * turn))) for number in range(self._turns)]))

    def _scene(self, fidelity: str, load: float, speed: float, error: float, faults: list[dict[str, Any]]) -> Scene:
        changes = {
            "fidelity": fidelity,
            "duration_s": (self._turns + 0.6) * self._turn_s / speed,
            "torque": {**self._table["torque"], "nm": load * self.torque_nm},
            "speed": {**self._table["speed"], "rpm": speed * self.rpm},
            "dynamics": self._dynamics.changed(error=error).model_dump(mode="json", exclude_none=True),
            "fault": faults,
        }
        return Scene.from_mapping({**self._table, **changes})


@lru_cache(maxsize=_KEPT)
def _sound(scene_toml: str, seed: int) -> NoiseFree:
    """Return the channels of a scene without faults, which are those of every fault."""
    return noise_free(Scene.from_mapping(tomllib.loads(scene_toml)), seed=seed)


def _carrier_order(scene: Scene, fault: GearFault) -> float:
    """Return the order of the carrier of a damaged gear's mesh; infinite where planets do not pass."""
    mesh, frame = mesh_name(fault.component), scene.kinematics.mechanism.frame
    carriers = {contact.carrier for contact in scene.kinematics.contacts if contact.mesh == mesh}
    return min((abs(float(scene.ratio(carrier))) for carrier in carriers - {frame}), default=math.inf)


def _largest_effect_mm(scene: Scene, fault: GearFault) -> float | None:
    """Return the depth from which on a spall lets the mating flank sink in no further; None for other faults."""
    if not isinstance(fault, Spall | Pitting):
        return None
    mesh, _, link = fault.component.rpartition("/")
    contact = next(each for each in contacts_of(kinematics_of(scene), {}) if each.mesh == mesh)
    pair, gear = contact.equivalent_pair, contact.links.index(scene.gearbox.instances(link)[0])
    gap = spall_gap(pair, gear, depth_m=_WHOLE, length_pitches=fault.length_pitches)
    return 1e3 * float(gap(np.array([pair.contact_ratio / 2]))[0])

"""Kinematic factors of a damaged gear from gears in motion.

The peak that damage adds to the synchronous average of its gear, faulty minus healthy, follows in motion a power of the
size and one of the load, nearly:

    peak = c min(size, largest) ** p (torque / reference) ** q

A crack or a chipped face makes the tooth softer, so that q is 1; a spall or a broken tooth is a way to sink in,
whatever the load, so that q is near 0. `fit_factors` runs the scene at some sizes and two torques, fits c, p and q by
least squares of the logarithms, and finds the impact with which the kinematic scene has that peak; for damage all round
a gear, which strikes nowhere, the modulation of its mesh. Away from resonances of the gears speed matters little to
impacts; in the neighbourhood of one the fit holds for its speed alone. Lines of damage all round a gear meet one mode
after the other as speed changes, 3 dB up and down, so that c is the mean over speeds about that of the scene.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from data_synth.dynamics.placement import contacts_of
from data_synth.gears.lost_contact import spall_gap
from data_synth.scene.faults import Pitting, Spall
from data_synth.scene.scene import GearFault, Noise, Scene, SceneError
from data_synth.simulation import simulate
from data_synth.vibration.meshes import kinematics_of

_TURNS = 2  # of the damaged gear that are simulated
_LOADS = (1.0, 0.5)  # of the scene's torque, at which it is run
_SPEEDS = (0.8, 0.9, 1.1, 1.2)  # of the scene's speed, at which damage all round a gear is run as well
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
        The factor at 1 mm and the reference torque: of an impact in the units of the first sensor.
    size_exponent, load_exponent : float
        p and q.
    largest_effect_mm : float or None
        A larger size adds nothing.
    torque_nm : float
        Reference torque.
    scatter_db : float
        Largest deviation of the fitted runs.
    """

    kind: str
    component: str
    factor: str
    per_mm: float
    size_exponent: float
    load_exponent: float
    largest_effect_mm: float | None
    torque_nm: float
    scatter_db: float

    def table(self, *, size_mm: float, torque_nm: float) -> dict[str, Any]:
        """Return the fault as a kinematic scene declares it, with this factor alone.

        Parameters
        ----------
        size_mm : float
        torque_nm : float
            Full load of that scene.
        """
        found = {
            "kind": self.kind,
            "component": self.component,
            "depth_mm" if self.kind == "tooth_crack" else "size_mm": size_mm,
            **_NO_FACTORS,
            self.factor: self.per_mm * (torque_nm / self.torque_nm) ** self.load_exponent,
            "size_exponent": self.size_exponent,
            "load_exponent": self.load_exponent,
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
        For a scene without gears in motion, a torque that is no single number, another fault, or too few sizes.
    """
    fault = scene.faults[0] if len(scene.faults) == 1 else None
    if not isinstance(fault, GearFault) or scene.fidelity == "kinematic":
        raise SceneError(
            f"{len(scene.faults)} faults, fidelity = {scene.fidelity!r}: a fit needs one fault of a gear in a scene "
            "whose gears vibrate."
        )
    if len(set(sizes_mm)) < 2 or scene.torque is None or len(scene.torque.rows) != 1:  # noqa: PLR2004
        raise SceneError(f"sizes_mm = {list(sizes_mm)}: two different sizes are needed, and a constant torque.nm.")
    table, torque_nm, all_round = _quiet(scene, fault), abs(scene.torque.rows[0][1]), fault.kind in _ALL_ROUND
    most_mm, turn = _largest_effect_mm(scene, fault), scene.rate_hz / _turn_hz(scene, fault)
    runs = [(size, load) for size in sizes_mm for load in _LOADS]
    healthy = {load: _channels(table, torque_nm=load * torque_nm, fault=None, seed=seed) for load in _LOADS}
    key = "depth_mm" if fault.kind == "tooth_crack" else "size_mm"
    own = fault.model_dump(mode="json", exclude_none=True)
    peaks = [
        _peak(_channels(table, torque_nm=load * torque_nm, fault={**own, key: size}, seed=seed) - healthy[load], turn)
        for size, load in runs
    ]
    effects = [min(size, most_mm) if most_mm is not None else size for size, _ in runs]
    matrix = np.column_stack([np.ones(len(runs)), np.log(effects), np.log([load for _, load in runs])])
    constant, size_exponent, load_exponent = np.linalg.lstsq(matrix, np.log(peaks), rcond=None)[0]
    deviation = matrix @ [constant, size_exponent, load_exponent] - np.log(peaks)
    if all_round:
        size_mm, at_scene = sizes_mm[-1], peaks[-len(_LOADS)]  # at full load
        ratios = [1.0]
        for share in _SPEEDS:
            other = {**table, "speed": {**table["speed"], "rpm": share * scene.speed.rows[0][1]}}
            faults = ({**own, key: size_mm}, None)
            with_fault, without = (_channels(other, torque_nm=torque_nm, fault=one, seed=seed) for one in faults)
            ratios.append(_peak(with_fault - without, turn / share) / at_scene)
        constant += np.mean(np.log(ratios))
    kinematic = {**table, "fidelity": "kinematic"}
    factor = "amplitude_per_mm" if all_round else "impact_per_mm"
    unit = {**own, key: 1.0, **_NO_FACTORS, factor: 1.0}
    with_unit = _channels(kinematic, torque_nm=torque_nm, fault=unit, seed=seed)
    unit_peak = _peak(with_unit - _channels(kinematic, torque_nm=torque_nm, fault=None, seed=seed), turn)
    if unit_peak == 0:
        raise SceneError(f"{fault.kind}: the kinematic scene has no mesh to modulate; raise excitation.mesh_amplitude.")
    return FactorFit(
        kind=str(own["kind"]),
        component=fault.component,
        factor=factor,
        per_mm=math.exp(constant) / unit_peak,
        size_exponent=max(float(size_exponent), 1e-3),
        load_exponent=max(float(load_exponent), 0.0),
        largest_effect_mm=most_mm,
        torque_nm=torque_nm,
        scatter_db=float(20 / math.log(10) * np.max(np.abs(deviation))),
    )


def _quiet(scene: Scene, fault: GearFault) -> dict[str, Any]:
    """Return the table of a scene that is a few turns of the damaged gear long, without noise."""
    duration_s = (_TURNS + 0.6) / _turn_hz(scene, fault) / min(_SPEEDS)
    short = scene.changed(faults=(), noise=Noise(rms=0.0), duration_s=duration_s)
    return short.model_dump(mode="json", by_alias=True, exclude_none=True)


def _turn_hz(scene: Scene, fault: GearFault) -> float:
    """Return the speed of the damaged gear of a scene, rev/s."""
    return float(scene.exact_orders("tooth")[fault.component]) * _speed_hz(scene)


def _speed_hz(scene: Scene) -> float:
    """Return the speed of the reference of a scene at one speed, rev/s."""
    if scene.speed.run_up is not None or len(scene.speed.rows) != 1:
        raise SceneError("speed: a fit needs one constant speed.rpm.")
    return abs(scene.speed.rows[0][1] / 60 / float(scene.ratio(scene.speed.link)))


def _channels(table: dict[str, Any], *, torque_nm: float, fault: dict[str, Any] | None, seed: int) -> Any:  # noqa: ANN401
    """Return the channels (sensor, n) of a scene at a torque with a fault."""
    made = Scene.from_mapping(
        {**table, "torque": {**table["torque"], "nm": torque_nm}, "fault": [] if fault is None else [fault]}
    )
    record = simulate(made, seed=seed)
    return np.array([record[sensor.name].values for sensor in made.sensors])


def _peak(added: Any, turn: float) -> float:  # noqa: ANN401
    """Return the largest value of the mean turn of the first channel, `turn` samples long, behind its first half."""
    at = np.arange(turn / 2, 3 * turn / 2)
    spline = CubicSpline(np.arange(added.shape[1]), added[0])
    return float(np.max(np.abs(np.mean([spline(at + number * turn) for number in range(_TURNS)], axis=0))))


def _largest_effect_mm(scene: Scene, fault: GearFault) -> float | None:
    """Return the depth from which on a spall lets the mating flank sink in no further; None for other faults."""
    if not isinstance(fault, Spall | Pitting):
        return None
    mesh, _, link = fault.component.rpartition("/")
    contact = next(each for each in contacts_of(kinematics_of(scene), {}) if each.mesh == mesh)
    pair, gear = contact.equivalent_pair, contact.links.index(scene.gearbox.instances(link)[0])
    gap = spall_gap(pair, gear, depth_m=_WHOLE, length_pitches=fault.length_pitches)
    return 1e3 * float(gap(np.array([pair.contact_ratio / 2]))[0])

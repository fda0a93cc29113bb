"""Kinematic factors of a damaged tooth from gears in motion.

The peak that a damaged tooth adds to the synchronous average of its gear, faulty minus healthy, follows in motion a
power of the size and one of the load, nearly:

    peak = c min(size, largest) ** p (torque / reference) ** q

A crack or a chipped face makes the tooth softer, so that q is 1; a spall or a broken tooth is a way to sink in,
whatever the load, so that q is near 0. `fit_impact` runs the scene at some sizes and two torques, fits c, p and q by
least squares of the logarithms, and finds the impact with which the kinematic scene has that peak. Away from resonances
of the gears speed matters little; in the neighbourhood of one the fit holds for its speed alone.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from data_synth.dynamics.placement import contacts_of
from data_synth.gears.lost_contact import spall_gap
from data_synth.scene.faults import Pitting, Spall
from data_synth.scene.scene import GearFault, Noise, Scene, SceneError
from data_synth.simulation import simulate
from data_synth.vibration.meshes import kinematics_of

_TURNS = 2  # of the damaged gear that are simulated
_LOADS = (1.0, 0.5)  # of the scene's torque, at which it is run
_WHOLE = 1.0  # m: deeper than any spall
_LOCAL = ("tooth_crack", "chipping", "missing_tooth", "spall", "pitting")


@dataclass(frozen=True, kw_only=True)
class ImpactFit:
    """Factors of the impacts of a damaged tooth in a kinematic scene, as gears in motion have them.

    Attributes
    ----------
    kind, component : str
    impact_per_mm : float
        Impact at 1 mm and the reference torque, in the units of the first sensor.
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
    impact_per_mm: float
    size_exponent: float
    load_exponent: float
    largest_effect_mm: float | None
    torque_nm: float
    scatter_db: float

    def table(self, *, size_mm: float, torque_nm: float) -> dict[str, Any]:
        """Return the fault as a kinematic scene declares it, impacts alone.

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
            "amplitude_per_mm": 0.0,
            "phase_rad_per_mm": 0.0,
            "impact_per_mm": self.impact_per_mm * (torque_nm / self.torque_nm) ** self.load_exponent,
            "size_exponent": self.size_exponent,
            "load_exponent": self.load_exponent,
        }
        return found if self.largest_effect_mm is None else {**found, "largest_effect_mm": self.largest_effect_mm}


def fit_impact(scene: Scene, *, sizes_mm: Sequence[float], seed: int = 0) -> ImpactFit:
    """Return the impact factors of the one fault of a scene in motion.

    Parameters
    ----------
    scene : Scene
        At one speed and one torque, its fidelity not kinematic, its one fault of one tooth or some. Its size is not
        used.
    sizes_mm : sequence of float
        Two or more sizes at which the scene is run.
    seed : int

    Raises
    ------
    SceneError
        For a scene without gears in motion, a torque that is no single number, another fault, or too few sizes.
    """
    fault = scene.faults[0] if len(scene.faults) == 1 else None
    if not isinstance(fault, GearFault) or fault.kind not in _LOCAL or scene.fidelity == "kinematic":
        raise SceneError(
            f"{len(scene.faults)} faults, fidelity = {scene.fidelity!r}: a fit needs one fault of {', '.join(_LOCAL)} "
            "in a scene whose gears vibrate."
        )
    if len(set(sizes_mm)) < 2 or scene.torque is None or len(scene.torque.rows) != 1:  # noqa: PLR2004
        raise SceneError(f"sizes_mm = {list(sizes_mm)}: two different sizes are needed, and a constant torque.nm.")
    table, torque_nm = _quiet(scene, fault), abs(scene.torque.rows[0][1])
    most_mm = _largest_effect_mm(scene, fault)
    runs = [(size, load) for size in sizes_mm for load in _LOADS]
    healthy = {load: _channels(table, torque_nm=load * torque_nm, fault=None, seed=seed) for load in _LOADS}
    key = "depth_mm" if fault.kind == "tooth_crack" else "size_mm"
    own = fault.model_dump(mode="json", exclude_none=True)
    peaks = [
        _peak(_channels(table, torque_nm=load * torque_nm, fault={**own, key: size}, seed=seed) - healthy[load])
        for size, load in runs
    ]
    effects = [min(size, most_mm) if most_mm is not None else size for size, _ in runs]
    matrix = np.column_stack([np.ones(len(runs)), np.log(effects), np.log([load for _, load in runs])])
    constant, size_exponent, load_exponent = np.linalg.lstsq(matrix, np.log(peaks), rcond=None)[0]
    deviation = matrix @ [constant, size_exponent, load_exponent] - np.log(peaks)
    kinematic = {**table, "fidelity": "kinematic"}
    unit = {**own, key: 1.0, "amplitude_per_mm": 0.0, "phase_rad_per_mm": 0.0, "impact_per_mm": 1.0}
    struck = _channels(kinematic, torque_nm=torque_nm, fault=unit, seed=seed)
    still = _channels(kinematic, torque_nm=torque_nm, fault=None, seed=seed)
    return ImpactFit(
        kind=str(own["kind"]),
        component=fault.component,
        impact_per_mm=math.exp(constant) / _peak(struck - still),
        size_exponent=max(float(size_exponent), 1e-3),
        load_exponent=max(float(load_exponent), 0.0),
        largest_effect_mm=most_mm,
        torque_nm=torque_nm,
        scatter_db=float(20 / math.log(10) * np.max(np.abs(deviation))),
    )


def _quiet(scene: Scene, fault: GearFault) -> dict[str, Any]:
    """Return the table of a scene that is a few turns of the damaged gear long, without noise."""
    turn_hz = float(scene.exact_orders("tooth")[fault.component]) * _speed_hz(scene)
    short = scene.changed(faults=(), noise=Noise(rms=0.0), duration_s=(_TURNS + 0.5) / turn_hz)
    return short.model_dump(mode="json", by_alias=True, exclude_none=True)


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


def _peak(added: Any) -> float:  # noqa: ANN401
    """Return the largest value of the first channel."""
    return float(np.max(np.abs(added[0])))


def _largest_effect_mm(scene: Scene, fault: GearFault) -> float | None:
    """Return the depth from which on a spall lets the mating flank sink in no further; None for other faults."""
    if not isinstance(fault, Spall | Pitting):
        return None
    mesh, _, link = fault.component.rpartition("/")
    contact = next(each for each in contacts_of(kinematics_of(scene), {}) if each.mesh == mesh)
    pair, gear = contact.equivalent_pair, contact.links.index(scene.gearbox.instances(link)[0])
    gap = spall_gap(pair, gear, depth_m=_WHOLE, length_pitches=fault.length_pitches)
    return 1e3 * float(gap(np.array([pair.contact_ratio / 2]))[0])

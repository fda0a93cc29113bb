"""What a benchmark draws for each record beside its gearbox: operation, imperfections of healthy machines, the fault.

`IMPERFECTIONS` is the one list of what healthy machines have: each entry returns changes of a scene, which `merged`
adds to it. All ranges are ours and illustrative where no source is named.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from data_synth.benchmark.gearboxes import DrawnGearbox

__all__ = ["FAULTS", "IMPERFECTIONS", "FaultFamily", "Operation", "draw_operation", "merged"]

Table: TypeAlias = dict[str, Any]

STEEL_KG_M3 = 7850.0
UNLOADED_SHARE = 0.3
"""Of the impacts of a bearing without load; the rest goes with the torque."""
_SPALL_PITCHES = (0.005, 0.8)
"""Length of a spall of severity 0 and 1: a mating flank bridges a short one, however deep, and passes it at once."""
IMPACT_N_S_MM = 0.015
"""Of a defect of a race at full load, for each mm of its length; ours: 0.5 mm then rings a mode of 3 kHz and 5 kg to
some 30 m/s2, the order of what seeded defects of motor bearings of that length do."""
_FAST = 0.3
"""Least speed over that of the input of a shaft that is out of balance: the force of a slow one is hidden."""


# ---- Operation -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Operation:
    """Speed and torque of one record.

    Attributes
    ----------
    speed_kind, torque_kind : str
        ``steady``, ``wander``, ``ramp`` or ``step``.
    rpm : float
        Of the input, at the beginning.
    load_share : float
        Torque over full torque, at the beginning.
    speed, torque : dict
        Tables of a scene.
    """

    speed_kind: str
    torque_kind: str
    rpm: float
    load_share: float
    speed: Table
    torque: Table


SPEED_SHARES = (0.4, 1.0)
LOAD_SHARES = (0.15, 1.0)
KINDS = ("steady", "wander", "ramp", "step")


def draw_operation(gearbox: DrawnGearbox, *, duration_s: float, rng: np.random.Generator) -> Operation:
    """Return speed and torque of a record: steady, wandering, a ramp or a step, each by itself.

    Parameters
    ----------
    gearbox : DrawnGearbox
    duration_s : float
    rng : numpy.random.Generator

    Returns
    -------
    Operation

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.benchmark.conditions import draw_operation
    >>> from data_synth.benchmark.gearboxes import draw_gearbox
    >>> rng = np.random.default_rng(1)
    >>> drawn = draw_operation(draw_gearbox("one", stages=1, rng=rng), duration_s=10, rng=rng)
    >>> drawn.speed["link"], drawn.torque["link"]
    ('input', 'output')
    """
    speed_kind, torque_kind = (str(rng.choice(KINDS)) for _ in range(2))
    rpm, rpm_later = gearbox.top_rpm * rng.uniform(*SPEED_SHARES, 2)
    share, share_later = rng.uniform(*LOAD_SHARES, 2)
    nm, nm_later = gearbox.full_torque_nm * np.array([share, share_later])
    when_s = float(rng.uniform(0.2, 0.6)) * duration_s
    return Operation(
        speed_kind=speed_kind,
        torque_kind=torque_kind,
        rpm=float(rpm),
        load_share=float(share),
        speed={"link": "input"} | _history("rpm", speed_kind, float(rpm), float(rpm_later), when_s, duration_s),
        torque={"link": "output", "full_load_nm": gearbox.full_torque_nm, "unloaded_share": UNLOADED_SHARE}
        | _history("nm", torque_kind, float(nm), float(nm_later), when_s, duration_s),
    )


def _history(key: str, kind: str, first: float, later: float, when_s: float, duration_s: float) -> Table:
    if kind == "ramp":
        return {key: [[0.0, first], [duration_s, later]]}
    if kind == "step":
        return {"steps": [[0.0, first], [when_s, later]], "rise_s": 0.1 * duration_s}
    # a machine is never quite steady
    rms = (0.03 if kind == "wander" else 0.002) * first
    return {key: first, "turbulence": {"rms": rms, "time_scale_s": 1.0}}


# ---- Imperfections ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Machine:
    """What an imperfection may depend on.

    Attributes
    ----------
    gearbox : DrawnGearbox
    operation : Operation
    rng : numpy.random.Generator
        Of this record.
    rng_of_gearbox : numpy.random.Generator
        In the same state in every record of a gearbox.
    """

    gearbox: DrawnGearbox
    operation: Operation
    rng: np.random.Generator
    rng_of_gearbox: np.random.Generator


def gear_quality(machine: Machine) -> Table:
    """Return run-out and pitch deviations of every gear: the tolerances of grade 5 to 8 (ISO 1328-1:2013)."""
    return {"imperfections": {"gears": {"grade": int(machine.rng_of_gearbox.integers(5, 9))}}}


def profile_errors(machine: Machine) -> Table:
    """Return the transmission error of every mesh at its first harmonic, and the damping of the modes."""
    rng = machine.rng_of_gearbox
    meshes = {stage.name: {"error_um": float(rng.uniform(0.3, 2.0))} for stage in machine.gearbox.stages}
    return {"dynamics": {"meshes": meshes, "damping_ratio": float(rng.uniform(0.03, 0.07))}}


def residual_imbalance(machine: Machine) -> Table:
    """Return the imbalance of every shaft, of quality G 0.4 to G 6.3 at the top speed (ISO 21940-11, 2016)."""
    gearbox = machine.gearbox
    masses = {link: shaft_mass_kg(gearbox, link) for link in gearbox.links}
    grade = _log_uniform(machine.rng_of_gearbox, 0.4, 6.3)
    return {"imperfections": {"imbalance": {"grade": grade, "rated_rpm": gearbox.top_rpm, "rotor_kg": masses}}}


def race_waviness(machine: Machine) -> Table:
    """Return the waviness of both races of every bearing: 0.005 to 0.05 um."""
    return {"imperfections": {"bearings": {"waviness_um": _log_uniform(machine.rng_of_gearbox, 0.005, 0.05)}}}


def background_noise(machine: Machine) -> Table:
    """Return white noise of 0.03 to 1 m/s2 rms, whose level wanders as the generator's default."""
    return {"noise": {"rms": _log_uniform(machine.rng, 0.03, 1.0)}, "imperfections": {"noise": {}}}


def electrical(machine: Machine) -> Table:
    """Return the mains, 50 or 60 Hz, in the cables of sensor and tachometer; every other machine has an inverter."""
    rng = machine.rng_of_gearbox
    lines: Table = {"mains_hz": float(rng.choice([50.0, 60.0])), "tachometer": {}}
    if rng.random() < 1 / 2:
        lines["inverter"] = {}
    lines["amplitude_m_s2"] = _log_uniform(machine.rng, 0.01, 0.2)
    return {"imperfections": {"electrical": lines}}


def neighbour(machine: Machine) -> Table:
    """Return a machine nearby, of 10 to 50 rev/s: a shaft of 0.01 to 0.1 m/s2, its mesh and impacts."""
    rng, loud = machine.rng_of_gearbox, _log_uniform(machine.rng, 0.3, 3.0)
    drawn = {
        "speed_hz": float(rng.uniform(10, 50)),
        "teeth": int(rng.integers(17, 60)),
        "frequency_hz": _log_uniform(rng, 1000, 8000),
        "shaft_m_s2": 0.03 * loud,
        "mesh_m_s2": 0.06 * loud,
        "impact_m_s2": 0.3 * loud,
    }
    return {"imperfections": {"neighbour": drawn}}


def knocks(machine: Machine) -> Table:
    """Return knocks from outside: one in 1 to 20 s, 0.3 to 3 m/s2."""
    rng = machine.rng
    drawn = {"per_second": _log_uniform(rng, 0.05, 1.0), "mean_m_s2": _log_uniform(rng, 0.3, 3.0)}
    return {"imperfections": {"knocks": drawn}}


def temperature(machine: Machine) -> Table:
    """Return the temperature of the sensor, 15 to 70 degrees C, which changes its sensitivity, and its drift."""
    drawn = {"celsius": float(machine.rng.uniform(15, 70)), "drift_k_per_h": float(machine.rng.uniform(-10, 10))}
    return {"imperfections": {"temperature": drawn}}


def acquisition(machine: Machine) -> Table:
    """Return the chain: cross-axis motion, filter and converter, and a tachometer whose pulse times jitter."""
    return {
        "sensor": {
            "cross_axis": {"share": float(machine.rng.uniform(0.01, 0.05))},
            "anti_alias": {"frequency_hz": 10000.0, "order": 8},
            "quantisation": {"bits": 16, "full_scale": 1000.0},
        },
        "tachometer": {"jitter": {"std_s": float(machine.rng.uniform(1e-6, 2e-5))}},
    }


IMPERFECTIONS: tuple[Callable[[Machine], Table], ...] = (
    gear_quality,
    profile_errors,
    residual_imbalance,
    race_waviness,
    background_noise,
    electrical,
    neighbour,
    knocks,
    temperature,
    acquisition,
)
"""What every record has, healthy or not; each is drawn by a generator of its own, named after it."""


def merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> Table:
    """Return a table with changes: tables are merged, lists are joined, everything else is replaced.

    Parameters
    ----------
    base, change : mapping

    Returns
    -------
    dict

    Examples
    --------
    >>> from data_synth.benchmark.conditions import merged
    >>> merged({"fault": [1], "noise": {"rms": 1}}, {"fault": [2], "noise": {"colour": "white"}})
    {'fault': [1, 2], 'noise': {'rms': 1, 'colour': 'white'}}
    """
    result = dict(base)
    for key, value in change.items():
        there = result.get(key)
        if isinstance(there, Mapping) and isinstance(value, Mapping):
            result[key] = merged(there, value)
        elif isinstance(there, list) and isinstance(value, list):
            result[key] = [*there, *value]
        else:
            result[key] = value
    return result


def shaft_mass_kg(gearbox: DrawnGearbox, link: str) -> float:
    """Return the mass of the gears of a shaft, as discs of steel."""
    mass = 0.0
    for stage in gearbox.stages:
        for teeth, name in zip(stage.teeth, (stage.pinion, stage.wheel), strict=True):
            if name == link:
                radius_m = 5e-4 * stage.module_mm * teeth
                mass += STEEL_KG_M3 * math.pi * radius_m**2 * 1e-3 * stage.face_width_mm
    return mass


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


# ---- Faults ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class FaultFamily:
    """A fault of a benchmark: what it may sit on, and its sizes.

    Attributes
    ----------
    kind : str
        As a scene names it.
    of : str
        ``gear``, ``shaft`` or ``bearing``.
    unit : str
        What sizes are shares of: ``mm``; ``module``; ``face``, the face width; ``grade``, a balance quality in mm/s.
    sizes : (float, float)
        Of severity 0 and 1; between them the logarithm is linear.
    """

    kind: str
    of: str
    unit: str
    sizes: tuple[float, float]

    def draw(self, machine: Machine, *, severity: float, rng: np.random.Generator) -> Table:
        """Return the fault as a scene declares it.

        Parameters
        ----------
        machine : Machine
        severity : float
            From 0 to 1.
        rng : numpy.random.Generator

        Returns
        -------
        dict
        """
        gearbox, low, high = machine.gearbox, *self.sizes
        size = low * (high / low) ** severity
        if self.of == "gear":
            return self._of_gear(gearbox, size, severity, rng)
        if self.of == "shaft":
            fast = [link for link in gearbox.links if gearbox.speed_ratio(link) >= _FAST]
            link = str(rng.choice(fast))
            rated_rad_s = gearbox.top_rpm * math.pi / 30 * gearbox.speed_ratio(link)
            return {
                "kind": self.kind,
                "component": link,
                "size_mm": size / rated_rad_s,
                "rotor_kg": shaft_mass_kg(gearbox, link),
                "offset_rev": float(rng.random()),
            }
        return {
            "kind": self.kind,
            "component": f"{rng.choice(gearbox.links)} bearing",
            "size_mm": size,
            "impact_per_mm": IMPACT_N_S_MM,
            "slip_std": float(rng.uniform(0.005, 0.02)),
            "mean_slip": float(rng.uniform(0.0, 0.01)),
        }

    def _of_gear(self, gearbox: DrawnGearbox, size: float, severity: float, rng: np.random.Generator) -> Table:
        component = str(rng.choice(gearbox.components))
        stage = gearbox.stage_of(component)
        key = "depth_mm" if self.kind == "tooth_crack" else "size_mm"
        table: Table = {
            "kind": self.kind,
            "component": component,
            key: size * {"mm": 1.0, "module": stage.module_mm, "face": stage.face_width_mm}[self.unit],
            "offset_rev": float(rng.random()),
        }
        if self.kind == "spall":
            table["length_pitches"] = _SPALL_PITCHES[0] * (_SPALL_PITCHES[1] / _SPALL_PITCHES[0]) ** severity
        return table


_BEARING: dict[str, Any] = {"of": "bearing", "unit": "mm", "sizes": (0.002, 5.0)}

FAULTS: dict[str, FaultFamily] = {
    "crack": FaultFamily(kind="tooth_crack", of="gear", unit="module", sizes=(0.05, 2.4)),
    "chipping": FaultFamily(kind="chipping", of="gear", unit="face", sizes=(0.002, 0.8)),
    "missing tooth": FaultFamily(kind="missing_tooth", of="gear", unit="module", sizes=(2.25, 2.25)),
    "spall": FaultFamily(kind="spall", of="gear", unit="mm", sizes=(0.0005, 0.1)),
    "wear": FaultFamily(kind="wear", of="gear", unit="mm", sizes=(1e-6, 0.03)),
    "eccentricity": FaultFamily(kind="eccentricity", of="gear", unit="mm", sizes=(0.001, 0.3)),
    "imbalance": FaultFamily(kind="imbalance", of="shaft", unit="grade", sizes=(0.1, 250.0)),
    "misalignment": FaultFamily(kind="misalignment", of="gear", unit="face", sizes=(0.0001, 0.8)),
    "inner race": FaultFamily(kind="inner_race", **_BEARING),
    "outer race": FaultFamily(kind="outer_race", **_BEARING),
    "element": FaultFamily(kind="rolling_element", **_BEARING),
    "cage": FaultFamily(kind="cage", **_BEARING),
}
"""By class. A missing tooth has one size, the whole tooth; the size of an imbalance is its eccentricity in mm.

The ends are ours: by the matched filter, the least is hidden in the noise of most records, and the greatest is gross
(`docs/benchmarks/dataset.md` has what was measured). Wear, imbalance and misalignment begin far below what any machine
has, since they add whole lines, of which a filter that knows the healthy machine to the last digit misses nothing.
Some middles: a spall of severity 0.5 covers 4 % of its flank, the limit of pitting on hardened teeth (ISO 6336-2);
healthy shafts have up to G 6.3, which an imbalance has at 0.53, and healthy gears a run-out of an eccentricity of 0.57;
seeded defects of the bearings of Case Western Reserve University, 0.18 to 1 mm, lie at 0.57 to 0.8; a crack of 2.4
modules has gone through 85 % of its root.
"""

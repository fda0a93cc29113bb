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
IMPACT_N_S_MM = 0.0015
"""Of a defect at full load; illustrative."""


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
        torque={"link": "output"} | _history("nm", torque_kind, float(nm), float(nm_later), when_s, duration_s),
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
    mass_kg : float
        Of the housing.
    operation : Operation
    rng : numpy.random.Generator
        Of this record.
    rng_of_gearbox : numpy.random.Generator
        In the same state in every record of a gearbox.
    """

    gearbox: DrawnGearbox
    mass_kg: float
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
    """Return the line of every shaft, of balance quality G 0.4 to G 6.3 (ISO 21940-11, 2016) at the first speed."""
    rng, shafts = machine.rng_of_gearbox, {}
    for link in machine.gearbox.links:
        grade_mm_s = math.exp(rng.uniform(math.log(0.4), math.log(6.3)))
        speed = _speed_rad_s(machine, link)
        shafts[link] = 1e-3 * grade_mm_s * speed * shaft_mass_kg(machine.gearbox, link) / machine.mass_kg
    return {"excitation": {"shafts": shafts, "shaft_amplitude": 0.0}}


def background_noise(machine: Machine) -> Table:
    """Return white noise of 0.03 to 1 m/s2 rms, whose level wanders as the generator's default."""
    rms = float(math.exp(machine.rng.uniform(math.log(0.03), math.log(1.0))))
    return {"noise": {"rms": rms}, "imperfections": {"noise": {}}}


def mains(machine: Machine) -> Table:
    """Return lines of the mains in the sensor's cable, 50 or 60 Hz."""
    frequency_hz = float(machine.rng_of_gearbox.choice([50.0, 60.0]))
    return {"sensor": {"hum": {"frequency_hz": frequency_hz, "amplitude": float(machine.rng.uniform(0.01, 0.2))}}}


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
    background_noise,
    mains,
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


def _speed_rad_s(machine: Machine, link: str) -> float:
    return machine.operation.rpm * math.pi / 30 * machine.gearbox.speed_ratio(link)


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
        table: Table = {"kind": self.kind}
        if self.of == "gear":
            table["component"] = str(rng.choice(gearbox.components))
            stage = gearbox.stage_of(table["component"])
            size *= {"mm": 1.0, "module": stage.module_mm, "face": stage.face_width_mm}[self.unit]
            table["depth_mm" if self.kind == "tooth_crack" else "size_mm"] = size
            return table | (
                {"length_pitches": _SPALL_PITCHES[0] * (_SPALL_PITCHES[1] / _SPALL_PITCHES[0]) ** severity}
                if self.kind == "spall"
                else {}
            )
        link = str(rng.choice(gearbox.links))
        if self.of == "shaft":
            speed = _speed_rad_s(machine, link)
            force_n_mm = 1e-3 * shaft_mass_kg(gearbox, link) * speed**2
            return table | {
                "component": link,
                "size_mm": size / speed,
                "amplitude_per_mm": force_n_mm / machine.mass_kg,
            }
        load = UNLOADED_SHARE + (1 - UNLOADED_SHARE) * machine.operation.load_share
        return table | {
            "component": f"{link} bearing",
            "size_mm": size,
            "impact_per_mm": IMPACT_N_S_MM * load,
            "slip_std": float(rng.uniform(0.005, 0.02)),
            "mean_slip": float(rng.uniform(0.0, 0.01)),
        }


_BEARING: dict[str, Any] = {"of": "bearing", "unit": "mm", "sizes": (0.005, 5.0)}

FAULTS: dict[str, FaultFamily] = {
    "crack": FaultFamily(kind="tooth_crack", of="gear", unit="module", sizes=(0.05, 1.2)),
    "chipping": FaultFamily(kind="chipping", of="gear", unit="face", sizes=(0.002, 0.8)),
    "missing tooth": FaultFamily(kind="missing_tooth", of="gear", unit="module", sizes=(2.25, 2.25)),
    "spall": FaultFamily(kind="spall", of="gear", unit="mm", sizes=(0.0005, 0.1)),
    "wear": FaultFamily(kind="wear", of="gear", unit="mm", sizes=(1e-6, 0.03)),
    "eccentricity": FaultFamily(kind="eccentricity", of="gear", unit="mm", sizes=(0.0005, 0.15)),
    "imbalance": FaultFamily(kind="imbalance", of="shaft", unit="grade", sizes=(0.02, 400.0)),
    "misalignment": FaultFamily(kind="misalignment", of="gear", unit="face", sizes=(0.0002, 0.8)),
    "inner race": FaultFamily(kind="inner_race", **_BEARING),
    "outer race": FaultFamily(kind="outer_race", **_BEARING),
    "element": FaultFamily(kind="rolling_element", **_BEARING),
    "cage": FaultFamily(kind="cage", **_BEARING),
}
"""By class. A missing tooth has one size, the whole tooth; the size of an imbalance is its eccentricity in mm.

The ends are ours: by the matched filter, the least is hidden in the noise of most records, and the greatest is gross
(`docs/benchmarks/dataset.md` has what was measured). Wear, imbalance and misalignment begin far below what any machine
has, since they add whole lines, of which a filter that knows the healthy machine to the last digit misses nothing.
"""

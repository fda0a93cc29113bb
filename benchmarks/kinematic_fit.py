"""Kinematic factors fitted to gears in motion, and how far they carry: python benchmarks/kinematic_fit.py [FOLDER].

Writes kinematic_fit.md into FOLDER (default docs/benchmarks).
"""

import math
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from data_synth import Scene, load_scene
from data_synth.dynamics.placement import contacts_of
from data_synth.gears.lost_contact import spall_gap
from data_synth.operation.shaft_angle import Array
from data_synth.scene.faults import GearFault, Pitting, Spall
from data_synth.simulation import NoiseFree, noise_free
from data_synth.sources.families import mesh_name
from data_synth.vibration.meshes import kinematics_of

SEED = 1
GEARS = (
    ("gears-in-motion", "stage 1/pinion"),
    ("gears-in-motion", "stage 2/output"),
    ("planets-in-motion", "sun-planet/sun"),
)
SIZES = {  # mm: fitted, and three others
    "tooth_crack": ((1, 2, 3), (0.7, 1.5, 2.5)),
    "chipping": ((3, 6, 12), (2, 4, 15)),
    "missing_tooth": ((6, 7), (6.5, 8, 10)),
    "spall": ((0.003, 0.006, 0.02), (0.004, 0.01, 1)),
    "pitting": ((0.003, 0.006, 0.02), (0.004, 0.01, 1)),
    "eccentricity": ((0.02, 0.1), (0.03, 0.05, 0.15)),
    "misalignment": ((3, 6, 12), (4, 10, 15)),
    "wear": ((0.002, 0.004, 0.008), (0.003, 0.006, 0.01)),
}
AMONG_PLANETS = ("tooth_crack", "chipping", "missing_tooth", "spall")
CASES = (  # shares of torque and speed, and which of the three sizes
    (1.0, 1.0, 1),
    (0.6, 1.0, 0),
    (1.5, 0.75, 2),
    (0.4, 1.15, 1),
    (0.7, 0.65, 2),
    (1.0, 1.25, 1),
    (0.7, 0.85, 0),
)
NOTE = """\
Made by `python benchmarks/kinematic_fit.py` on the shipped scenes: at some sizes, two torques and eight speeds, the
factor with which a kinematic scene has the same peak in a turn of the damaged gear, faulty minus healthy, as gears in
motion, and the powers of size, load and speed with which it goes. `factor` is that of 1 mm at the scene's torque and
speed, of an impact in the units of its sensor, of a relative amplitude of the mesh in 1 where damage is all round the
gear. `apart` are those peaks, kinematic over motion in dB, at seven torques (0.4 to 1.5 of the scene's), speeds (0.65
to 1.25) and sizes, most of which were not fitted: mean, and the two farthest. These scenes have seven natural
frequencies below 2.6 kHz, so that at every speed some harmonic of a mesh is within a tenth of one; a kinematic scene
has no resonances of gears."""
_TURNS = 2  # of the damaged gear that are simulated, or as many as it takes to meet all planets
_LOADS = (1.0, 0.5)  # of the scene's torque, at which it is run
_SPEEDS = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3)  # of the scene's speed
_PULSES = 60  # a turn of the tachometer's link: a speed needs two in a short scene
_FINER = (0.1, 0.01)  # times the error of a record: what a fault adds is a small difference of two
_FAR = 30.0  # times the error of a record, which is an RMS: a peak that is large enough to be known to 1 dB
_SMALL_MM = 0.01  # a size that every gear has
_NO_FACTORS = {"amplitude_per_mm": 0.0, "phase_rad_per_mm": 0.0, "impact_per_mm": 0.0}
_ALL_ROUND = ("eccentricity", "misalignment", "wear")


def size_key(kind: str) -> str:
    """Return the key that declares the size of a fault."""
    return "depth_mm" if kind == "tooth_crack" else "size_mm"


class DamageRuns:
    """Short runs of a scene of one speed and one torque, noise aside, with its fault and without."""

    def __init__(self, scene: Scene, fault: GearFault) -> None:
        assert scene.torque is not None  # noqa: S101 - shipped scenes in motion have one
        self._own = fault.model_dump(mode="json", exclude_none=True)
        self.kind = str(self._own["kind"])
        self.factor = "amplitude_per_mm" if self.kind in _ALL_ROUND else "impact_per_mm"
        self.torque_nm, self.rpm = abs(scene.torque.rows[0][1]), abs(scene.speed.rows[0][1])
        order = float(scene.exact_orders("tooth")[fault.component])
        self._turn_s = float(abs(scene.ratio(scene.speed.link))) * 60 / self.rpm / order
        self._turns = max(_TURNS, math.ceil(order / carrier_order(scene, fault)))
        short = scene.changed(faults=(), tachometer=scene.tachometer.changed(pulses_per_rev=_PULSES))
        self._dynamics = scene.dynamics_or_default
        self._table = short.model_dump(mode="json", by_alias=True, exclude_none=True)

    def of_size(self, size_mm: float) -> dict[str, Any]:
        """Return the fault with another size."""
        return {**self._own, size_key(self.kind): size_mm}

    def of_unit_effect(self) -> dict[str, Any]:
        """Return a small fault whose factor times its size is 1, as a kinematic scene declares it."""
        unit = {**self.of_size(_SMALL_MM), **_NO_FACTORS, self.factor: 1 / _SMALL_MM}
        unit |= {"size_exponent": 1.0, "speed_exponent": 0.0}
        return {key: value for key, value in unit.items() if key != "largest_effect_mm"}

    def peak(self, fidelity: str, fault: dict[str, Any], *, load: float = 1.0, speed: float = 1.0) -> float:
        """Return the mean over turns of the peak that a fault adds, at shares of the scene's torque and speed."""
        found = 0.0
        for finer in _FINER:
            error = finer * self._dynamics.error
            healthy = healthy_channels(self._scene(fidelity, load, speed, error, []).to_toml())
            damaged = self._scene(fidelity, load, speed, error, [fault])
            # in as many steps, so that both err alike
            faulty = noise_free(damaged, seed=SEED, steps=healthy.steps)
            found = self._peak(faulty.signal[0] - healthy.signal[0], speed)
            if fidelity == "kinematic" or found > _FAR * error * float(np.std(healthy.signal[0])):
                break
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


@lru_cache(maxsize=64)
def healthy_channels(scene_toml: str) -> NoiseFree:
    """Return the channels of a scene without faults, which are those of every fault."""
    return noise_free(Scene.from_mapping(tomllib.loads(scene_toml)), seed=SEED)


def carrier_order(scene: Scene, fault: GearFault) -> float:
    """Return the order of the carrier of a damaged gear's mesh; infinite where planets do not pass."""
    mesh, frame = mesh_name(fault.component), scene.kinematics.mechanism.frame
    carriers = {contact.carrier for contact in scene.kinematics.contacts if contact.mesh == mesh}
    return min((abs(float(scene.ratio(carrier))) for carrier in carriers - {frame}), default=math.inf)


def largest_effect_mm(scene: Scene, fault: GearFault) -> float | None:
    """Return the depth from which on a spall lets the mating flank sink in no further; None for other faults."""
    if not isinstance(fault, Spall | Pitting):
        return None
    mesh, _, link = fault.component.rpartition("/")
    contact = next(each for each in contacts_of(kinematics_of(scene), {}) if each.mesh == mesh)
    pair, gear = contact.equivalent_pair, contact.links.index(scene.gearbox.instances(link)[0])
    gap = spall_gap(pair, gear, depth_m=1.0, length_pitches=fault.length_pitches)
    return 1e3 * float(gap(np.array([pair.contact_ratio / 2]))[0])


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Factor of a damaged gear at 1 mm, the scene's torque and speed, and its powers of size, load and speed."""

    per_mm: float
    exponents: Array
    largest_effect_mm: float | None
    scatter_db: float


def fitted(scene: Scene, runs: DamageRuns, sizes_mm: tuple[float, ...]) -> Fit:
    """Fit ``peak = c min(size, largest) ** p (torque / reference) ** q (speed / reference) ** r`` by least squares."""
    fault = scene.faults[0]
    assert isinstance(fault, GearFault)  # noqa: S101 - as made
    most_mm = largest_effect_mm(scene, fault)
    at = [(size, load, speed) for speed in _SPEEDS for load in _LOADS for size in sizes_mm]
    peaks = np.log([runs.peak(scene.fidelity, runs.of_size(size), load=load, speed=speed) for size, load, speed in at])
    units = {speed: math.log(runs.peak("kinematic", runs.of_unit_effect(), speed=speed)) for speed in _SPEEDS}
    wanted = peaks - [units[speed] for *_, speed in at]
    powers = np.log([(min(size, most_mm or math.inf), load, speed) for size, load, speed in at])
    slopes, *_ = np.linalg.lstsq(powers - np.mean(powers, axis=0), wanted - np.mean(wanted), rcond=None)
    exponents = np.maximum(slopes, [1e-3, 0.0, 0.0])
    rest = wanted - powers @ exponents
    return Fit(
        # a kinematic scene has no resonances of gears: its peak swings about the power of the speed
        per_mm=math.exp((np.max(rest) + np.min(rest)) / 2),
        exponents=exponents,
        largest_effect_mm=most_mm,
        scatter_db=20 / math.log(10) * float(np.ptp(rest) / 2),
    )


def scene_of(name: str, kind: str, component: str) -> Scene:
    """Return a shipped scene with one fault."""
    scene = load_scene(name)
    fault = {"kind": kind, "component": component, size_key(kind): 1.0}
    across = {"width_mm": 40.0 if component == "stage 2/output" else 30.0}  # of the face: or nothing sinks in
    return scene.changed(faults=(fault | (across if kind in ("spall", "pitting") else {}),))


def apart_db(scene: Scene, runs: DamageRuns, fit: Fit, sizes_mm: tuple[float, ...]) -> list[float]:
    """Return the kinematic peak over that of motion for each of the cases, dB."""
    found = []
    for load, speed, number in CASES:
        size_mm = sizes_mm[number]
        size, of_load, of_speed = fit.exponents.tolist()
        table = {
            **runs.of_size(size_mm),
            **_NO_FACTORS,
            runs.factor: fit.per_mm * load**of_load * speed**of_speed,
            "size_exponent": size,
            "load_exponent": of_load,
            "speed_exponent": of_speed,
            "largest_effect_mm": fit.largest_effect_mm,
        }
        kinematic = runs.peak("kinematic", table, load=load, speed=speed)
        motion = runs.peak(scene.fidelity, runs.of_size(size_mm), load=load, speed=speed)
        found.append(20 * math.log10(kinematic / motion))
    return found


def rows() -> Iterator[str]:
    """Yield the rows of the table."""
    for name, component in GEARS:
        for kind, (sizes_mm, others) in SIZES.items():
            if component.startswith("sun") and kind not in AMONG_PLANETS:
                continue
            scene = scene_of(name, kind, component)
            fault = scene.faults[0]
            assert isinstance(fault, GearFault)  # noqa: S101 - as made
            runs = DamageRuns(scene, fault)
            fit = fitted(scene, runs, sizes_mm)
            apart = apart_db(scene, runs, fit, others)
            most = "" if fit.largest_effect_mm is None else f"{fit.largest_effect_mm:.4f}"
            cells = (
                f"`{name}`, {component}",
                f"`{kind}`",
                f"{fit.per_mm:.3g}",
                *(f"{exponent:.2f}" for exponent in fit.exponents),
                most,
                f"{fit.scatter_db:.1f}",
                f"{sum(apart) / len(apart):+.1f}, {min(apart):+.1f} to {max(apart):+.1f}",
            )
            yield "| " + " | ".join(cells) + " |"


def main(folder: Path) -> int:
    """Fit, and write the table."""
    head = ("gear", "fault", "factor", "size", "load", "speed", "largest effect, mm", "scatter, dB", "apart, dB")
    lines = ["# Kinematic factors of damaged gears from gears in motion", "", NOTE, ""]
    lines += ["| " + " | ".join(head) + " |", "|---" * len(head) + "|", *rows()]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "kinematic_fit.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "benchmarks"))

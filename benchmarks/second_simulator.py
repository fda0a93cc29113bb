"""Records of machines in plain numpy, made with other choices than those of `data_synth`, of which nothing is imported.

What one generator taught must hold on records of another. Here sources are lists of strikes and lines in the angle of
the input shaft, sent through modes of the machine; healthy machines have run-out, pitch deviations, knocks once or
twice per revolution, drives that change, loads that wander, inverters, mains, shocks and neighbours. A fault is added
to such a machine, scaled to a detectability: the signal-to-noise ratio in dB of a matched filter that knows its
waveform, in the noise that is left where lines of the sound machine are ignored.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums import Gearbox, PulseTimes, make_record

RATE_HZ = 20_000.0
RACES = ("inner_race", "outer_race", "rolling_element")
TEETH = ("chip", "crack", "pits")
KINDS = (*RACES, *TEETH)
LEVELS_DB = (20.0, 60.0)
_LINE = 8.0  # times the median of their neighbours, from which bins of a spectrum hold a line
_NEIGHBOURS = 200  # bins

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Bearing:
    """A bearing: the order of the shaft in it, its number of elements, d / D, and the contact angle."""

    name: str
    shaft: float
    elements: int
    diameter: float
    angle_rad: float
    slip: float

    @property
    def ratio(self) -> float:
        """Part of the pitch diameter that the elements take in the plane of the bearing."""
        return float(self.diameter * np.cos(self.angle_rad))

    @property
    def cage(self) -> float:
        """Order of its cage, slip included."""
        return self.shaft * (1 - self.ratio) / 2 * (1 - self.slip)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A record, its drawing, shafts that knock, and the fault in it: none where `kind` is empty."""

    record: xr.Dataset
    gearbox: Gearbox
    knocks: tuple[str, ...]
    kind: str
    component: str
    level_db: float


class Plant:
    """A machine that runs: its angle in revolutions at each sample, and the modes that every source rings."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.times = np.arange(int(rng.uniform(8, 14) * RATE_HZ)) / RATE_HZ
        self.speed = self._speed(float(np.exp(rng.uniform(np.log(8), np.log(45)))))
        self.angle = np.cumsum(self.speed) / RATE_HZ
        count = int(rng.integers(3, 7))
        self.modes_hz = np.exp(rng.uniform(np.log(500), np.log(0.45 * RATE_HZ), count))
        self.damping = np.exp(rng.uniform(np.log(0.01), np.log(0.06), count))
        self.knocks: list[float] = []  # orders of shafts

    def wander(self, seconds: float) -> Floats:
        """Return a smooth normal process of unit variance that changes over so many seconds."""
        knots = self.rng.standard_normal(int(self.times[-1] / seconds) + 4)
        made = np.interp(self.times / seconds, np.arange(knots.size), knots)
        return made / made.std()

    def _speed(self, mean_hz: float) -> Floats:
        drive, span = self.rng.choice(["steady", "ramp", "steps", "swing"], p=[0.5, 0.2, 0.15, 0.15]), self.times[-1]
        change = self.rng.uniform(0.03, 0.3)
        shape = {
            "steady": np.zeros(self.times.size),
            "ramp": change * (self.times / span - 0.5),
            "steps": change * np.clip((self.times / span - self.rng.uniform(0.3, 0.6)) / 0.03, 0, 1),
            "swing": 0.3 * change * np.sin(2 * np.pi * self.times / self.rng.uniform(3, 9)),
        }[str(drive)]
        return mean_hz * (1 + shape + np.exp(self.rng.uniform(np.log(1e-4), np.log(3e-3))) * self.wander(0.7))

    def rung(self, force: Floats) -> Floats:
        """Return what a force makes at the sensor, on a path of its own through the modes."""
        lag = np.arange(int(0.05 * RATE_HZ)) / RATE_HZ
        gains = self.rng.lognormal(0, 0.8, self.modes_hz.size)
        path = sum(
            gain * np.exp(-2 * np.pi * hz * damping * lag) * np.sin(2 * np.pi * hz * lag + self.rng.uniform(0, 6.3))
            for gain, hz, damping in zip(gains, self.modes_hz, self.damping, strict=True)
        )
        size = force.size + lag.size
        return np.fft.irfft(np.fft.rfft(force, size) * np.fft.rfft(path, size), size)[: force.size]

    def struck(self, turns: Floats, sizes: Floats) -> Floats:
        """Return strikes at some angles of the input, each shared by the two samples beside it."""
        place = np.interp(turns, self.angle, np.arange(self.times.size), left=-1, right=-1)
        kept = (place >= 0) & (place < self.times.size - 1)
        below, sizes = np.floor(place[kept]).astype(int), sizes[kept]
        part, made = place[kept] - below, np.zeros(self.times.size)
        np.add.at(made, below, sizes * (1 - part))
        np.add.at(made, below + 1, sizes * part)
        return made

    def passes(self, order: float, scatter: float) -> Floats:
        """Return the angles at which something of an order passes, each scattered by a part of their distance."""
        count = np.arange(int(self.angle[-1] * order) + 1)
        return (count + self.rng.uniform() + scatter * self.rng.standard_normal(count.size)) / order

    def scaled(self, signal: Floats, rms: float) -> Floats:
        """Return a signal at a level."""
        return signal * rms / max(float(np.sqrt(np.mean(signal**2))), 1e-12)


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """A mesh: teeth of both gears, the orders of their shafts, and the force without and per tooth of each."""

    name: str
    gears: Sequence[tuple[str, int, float]]
    force: Floats


def _drawing(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, float], list[Bearing]]:
    """Return the drawing of a machine of no, one or two stages, the orders of its shafts, and its bearings."""
    stages = int(rng.choice([0, 1, 2], p=[0.2, 0.45, 0.35]))
    names = ("input", "middle", "output")[: stages + 1]
    orders, meshes = {"input": 1.0}, []
    for driving, driven in pairwise(names):
        pinion, wheel = int(rng.integers(17, 38)), int(rng.integers(38, 90))
        meshes.append({"teeth": {driving: pinion, driven: wheel}})
        orders[driven] = orders[driving] * pinion / wheel
    bearings, tables = [], []
    for shaft in names:
        for end in ("DE", "NDE"):
            elements, pitch = int(rng.integers(7, 18)), 40.0
            diameter = float(rng.uniform(0.45, 0.8) * np.pi * pitch / elements)
            diameter, contact = min(diameter, 0.33 * pitch), float(rng.choice([0.0, 15.0]))
            tables.append({"names": [f"{shaft} {end}"], "inner_ring": shaft, "outer_ring": "housing"})
            tables[-1] |= {"elements": elements, "element_diameter_mm": diameter, "pitch_diameter_mm": pitch}
            tables[-1] |= {"contact_angle_deg": contact}
            sizes = {
                "diameter": diameter / pitch,
                "angle_rad": float(np.radians(contact)),
                "slip": rng.uniform(0, 0.012),
            }
            made = Bearing(name=f"{shaft} {end}", shaft=orders[shaft], elements=elements, **sizes)
            bearings.append(made)
    axes = {name: ["housing", name] for name in names}
    table = {"name": "plant", "frame": "housing", "reference": "input", "axes": axes}
    return table | {"bearing": tables} | ({"mesh": meshes} if meshes else {}), orders, bearings


def _mesh(plant: Plant, teeth: dict[str, int], orders: dict[str, float]) -> Mesh:
    """Return a mesh whose harmonics fall, modulated by run-out and by the deviation of each tooth of both gears."""
    rng, gears = plant.rng, [(link, count, orders[link]) for link, count in teeth.items()]
    size, phase = np.ones(plant.times.size), 2 * np.pi * gears[0][1] * gears[0][2] * plant.angle
    for _, count, order in gears:
        for turn in (1, 2):
            size += rng.lognormal(np.log(0.06 / turn), 0.6) * np.cos(2 * np.pi * turn * order * plant.angle + turn)
        deviations = rng.standard_normal(count) * np.exp(rng.uniform(np.log(0.01), np.log(0.06)))
        size += np.interp(
            order * plant.angle * count % count, np.arange(count + 1), np.append(deviations, deviations[0])
        )
        phase = phase + rng.uniform(0, 0.15) * np.sin(2 * np.pi * order * plant.angle)
    levels = rng.lognormal(0, 0.7, 5) / np.arange(1, 6)
    harmonics = (level * np.cos(k * phase + rng.uniform(0, 6.3)) for k, level in enumerate(levels, 1))
    return Mesh(name="-".join(teeth), gears=gears, force=size * sum(harmonics))


def _knock(plant: Plant, shafts: Sequence[float]) -> Floats:
    """Return strikes of something loose on a shaft, once or twice per revolution."""
    rng = plant.rng
    plant.knocks.append(float(rng.choice(shafts)))
    turns = plant.passes(plant.knocks[-1] * int(rng.choice([1, 1, 2])), rng.uniform(0.001, 0.01))
    force = plant.struck(turns, rng.lognormal(0, rng.uniform(0.05, 0.5), turns.size))
    return plant.scaled(plant.rung(force), np.exp(rng.uniform(np.log(0.1), np.log(2))))


def _inverter(plant: Plant, _: Sequence[float]) -> Floats:
    """Return a carrier with sidebands of the supply's frequency and of the speed."""
    rng, x = plant.rng, np.zeros(plant.times.size)
    carrier, supply = rng.uniform(2000, 8000), rng.uniform(20, 80)
    for side in range(-4, 5):
        turns = carrier * plant.times + side * supply * plant.times + (side % 2) * plant.angle
        x += rng.uniform(0, 0.5) * np.cos(2 * np.pi * turns + rng.uniform(0, 6.3))
    return x


def _mains(plant: Plant, _: Sequence[float]) -> Floats:
    """Return harmonics of 50 Hz."""
    rng, angle = plant.rng, 2 * np.pi * 50 * plant.times
    return sum((rng.uniform(0, 0.3) * np.cos(k * angle + rng.uniform(0, 6.3)) for k in range(1, 7)), 0 * angle)


def _neighbour(plant: Plant, _: Sequence[float]) -> Floats:
    """Return the gears, or the strikes, of another machine at a speed of its own."""
    rng = plant.rng
    rate_hz = np.exp(rng.uniform(np.log(5), np.log(200)))
    turns = rate_hz * (1 + 2e-4 * plant.wander(1.0)).cumsum() / RATE_HZ
    if rng.integers(2):
        force = sum((np.cos(2 * np.pi * k * int(rng.integers(17, 60)) * turns) for k in (1, 2, 3)), 0 * turns)
    else:
        force = np.diff(np.floor(turns), prepend=0.0) * rng.lognormal(0, 0.2, turns.size)
    return plant.scaled(plant.rung(force), np.exp(rng.uniform(np.log(0.1), np.log(1.5))))


def _shocks(plant: Plant, _: Sequence[float]) -> Floats:
    """Return shocks at random times."""
    rng, size = plant.rng, plant.times.size
    force = (rng.uniform(size=size) < rng.uniform(0.2, 3) / RATE_HZ) * rng.lognormal(0, 1, size)
    return plant.scaled(plant.rung(force), rng.uniform(0.1, 0.5))


OTHERS = {_knock: 0.4, _inverter: 0.3, _mains: 0.4, _neighbour: 0.3, _shocks: 0.3}  # and how many machines have them


def _sound(plant: Plant, shafts: Sequence[float], meshes: Sequence[Mesh], bearings: Sequence[Bearing]) -> Floats:
    """Return what a sound machine makes, its noise about one."""
    rng, load = plant.rng, np.exp(plant.rng.uniform(0, 0.25) * plant.wander(0.5))
    rolling = rng.standard_normal(plant.times.size)
    for bearing in bearings:  # loads that turn, and races that are not perfect, modulate the noise of rolling
        turn, race = rng.uniform(0, 0.2), rng.uniform(0, 0.02)
        rolling *= 1 + turn * np.cos(2 * np.pi * bearing.shaft * plant.angle + rng.uniform(0, 6.3))
        rolling *= 1 + race * np.cos(2 * np.pi * bearing.elements * bearing.cage * plant.angle)
    x = plant.scaled(plant.rung(rolling), 1.0) + rng.uniform(0.1, 0.6) * rng.standard_normal(rolling.size)
    for mesh in meshes:
        x += plant.scaled(plant.rung(mesh.force * load), np.exp(rng.uniform(np.log(0.5), np.log(5))))
    for order in shafts:
        for turn in range(1, 5):
            angle = 2 * np.pi * turn * order * plant.angle + rng.uniform(0, 6.3)
            x += rng.lognormal(-1.5, 1) / turn * np.cos(angle) * (plant.speed / plant.speed.mean()) ** 2
    for source, share in OTHERS.items():
        if rng.uniform() < share:
            x += source(plant, shafts)
    return x


def _race(plant: Plant, bearing: Bearing, kind: str) -> Floats:
    """Return the strikes of a spot on a race or an element, through the load zone that carries it."""
    rng, load_deg = plant.rng, plant.rng.uniform(0, 360)
    spin = bearing.shaft / (2 * bearing.diameter) * (1 - bearing.ratio**2) * (1 - bearing.slip)
    order, carried = {
        "inner_race": (bearing.elements * (bearing.shaft - bearing.cage), bearing.shaft),
        "outer_race": (bearing.elements * bearing.cage, 0.0),
        "rolling_element": (2 * spin, bearing.cage),
    }[kind]
    turns = plant.passes(order, np.exp(rng.uniform(np.log(0.002), np.log(0.02))))
    sizes = rng.lognormal(0, rng.uniform(0.1, 0.4), turns.size)
    sizes *= np.clip(np.cos(2 * np.pi * carried * turns + np.radians(load_deg)), 0, None) ** 1.5 if carried else 1.0
    if kind == "rolling_element":
        sizes[1::2] *= rng.uniform(0.3, 1)
    return plant.rung(plant.struck(turns, sizes))


def _tooth(plant: Plant, mesh: Mesh, gear: tuple[str, int, float], kind: str) -> Floats:
    """Return what a damaged tooth adds: a mesh that is weaker there, with strikes if chipped, or strikes of several."""
    rng, (_, count, order), made = plant.rng, gear, np.zeros(plant.times.size)
    first = rng.uniform()
    away = ((order * plant.angle - first + 0.5) % 1 - 0.5) * count
    weaker = -mesh.force * np.exp(-0.5 * (away / rng.uniform(0.7, 1.5)) ** 2)
    if kind == "crack":
        return plant.rung(weaker)
    for tooth in range(1 if kind == "chip" else int(rng.integers(3, 7))):
        turns = (np.arange(int(plant.angle[-1] * order) + 1) + first + tooth * int(rng.integers(1, 4)) / count) / order
        turns += 0.05 / count / order * rng.standard_normal(turns.size)
        made += plant.struck(turns, rng.lognormal(0, 0.4) * rng.lognormal(0, 0.2, turns.size))
    struck, weaker = plant.rung(made), plant.rung(weaker)
    return struck + plant.scaled(weaker, rng.uniform(0.5, 1.5) * struck.std()) if kind == "chip" else struck


def detectability_db(fault: Floats, rest: Floats) -> float:
    """Return the signal-to-noise ratio of a matched filter for a fault, bins with lines of the rest left out."""
    power, wanted = np.abs(np.fft.rfft(rest)) ** 2, np.abs(np.fft.rfft(fault)) ** 2
    whole = power.size // _NEIGHBOURS * _NEIGHBOURS
    level = np.repeat(np.median(power[:whole].reshape(-1, _NEIGHBOURS), axis=1) / np.log(2), _NEIGHBOURS)
    used = power[:whole] < _LINE * level
    return float(10 * np.log10(2 * np.sum(wanted[:whole][used] / level[used])))


def case(number: int, *, faulty: bool) -> Case:
    """Return the machine of a number, sound or with a fault; a number has one machine of each."""
    rng = np.random.default_rng([77, number, faulty])
    plant = Plant(rng)
    table, orders, bearings = _drawing(rng)
    meshes = [_mesh(plant, mesh["teeth"], orders) for mesh in table.get("mesh", [])]
    x, kind, component, level_db = _sound(plant, list(orders.values()), meshes, bearings), "", "", 0.0
    if faulty:
        kinds: Sequence[str] = KINDS if meshes else RACES
        kind, level_db = kinds[number % len(kinds)], rng.uniform(*LEVELS_DB)
        if kind in RACES:
            bearing = bearings[int(rng.integers(len(bearings)))]
            fault, component = _race(plant, bearing, kind), bearing.name
        else:
            mesh = meshes[int(rng.integers(len(meshes)))]
            gear = mesh.gears[int(rng.integers(2))]
            fault, component = _tooth(plant, mesh, gear, kind), f"{mesh.name}/{gear[0]}"
        x += fault * 10 ** ((level_db - detectability_db(fault, x)) / 20)
    turns = np.arange(1, int(plant.angle[-1]))
    pulses = np.interp(turns, plant.angle, plant.times) + 2e-6 * rng.standard_normal(turns.size)
    angle = PulseTimes(times_s=pulses, shaft="input", pulses_per_rev=1)
    record = make_record({"housing": 0.1 * x}, rate_hz=RATE_HZ, units="g", angle=angle)
    return Case(
        record=record,
        gearbox=Gearbox.model_validate(table),
        knocks=tuple(name for name, order in orders.items() if order in plant.knocks),
        kind=kind,
        component=component,
        level_db=level_db,
    )

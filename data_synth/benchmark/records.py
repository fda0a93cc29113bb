"""The records of a benchmark: splits, classes, gearboxes and paths in a shuffled order, and the scene of each record.

Gearboxes and paths belong to the version of the benchmark, and are the same for every seed; the seed draws the records.
A record depends on the version, the seed and its number alone.
"""

import math
import zlib
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import tomli_w

from data_synth.benchmark.conditions import FAULTS, IMPERFECTIONS, Machine, Operation, draw_operation, merged
from data_synth.benchmark.gearboxes import DrawnGearbox, draw_bearing, draw_gearbox
from data_synth.benchmark.paths import DrawnPath, draw_path
from data_synth.scene.random_streams import derived_seed, random_stream
from data_synth.scene.scene import Scene

__all__ = ["CLASSES", "FURTHER", "SPLITS", "BenchmarkRecords", "Split", "gearboxes", "paths"]

NAME, VERSION = "benchmark-1", "2.8"
RATE_HZ, DURATION_S = 25600.0, 10.0
SENSOR = "input vertical"
ERROR = 1e-2
"""Relative RMS error of steps in time, -40 dB: below the noise of every record, and half the time of 1e-3."""
TRIAL_S = 2.0
"""Length of the beginning from which the detectability of the fault follows, scaled to 10 s."""
_POOL = 20261  # of gearboxes and paths: of the version, not of the seed
_SHARD_RECORDS, _FEWEST_SHARDS = 14, 4  # of a megabyte each: little is lost with a kill

FURTHER = ("element", "cage")
"""Labels beside the eleven classes."""
CLASSES = ("healthy", *(name for name in FAULTS if name not in FURTHER))
SHARES = {"healthy": 3} | dict.fromkeys(CLASSES[1:], 2) | dict.fromkeys(FURTHER, 1)
_CLASS_CYCLE = tuple(name for name, share in SHARES.items() for _ in range(share))


@dataclass(frozen=True, kw_only=True)
class Split:
    """A split: its gearboxes and paths, which no other split has, and its part of every 20 records."""

    gearboxes: tuple[str, ...]
    paths: tuple[str, ...]
    share: int


def _names(letter: str, first: int, last: int) -> tuple[str, ...]:
    return tuple(f"{letter}{number:02d}" for number in range(first, last + 1))


SPLITS = {
    "train": Split(gearboxes=_names("g", 1, 10), paths=_names("p", 1, 20), share=12),
    "validation": Split(gearboxes=_names("g", 11, 12), paths=_names("p", 21, 24), share=3),
    "test": Split(gearboxes=_names("g", 13, 16), paths=_names("p", 25, 32), share=5),
}
_SPLIT_CYCLE = tuple(name for name, split in SPLITS.items() for _ in range(split.share))
_STAGES = (1, 2, 2, 3)
_BLOCK = len(_SPLIT_CYCLE) * len(_CLASS_CYCLE)


@lru_cache(maxsize=1)
def gearboxes() -> dict[str, DrawnGearbox]:
    """Return the gearboxes of the benchmark, by name.

    Returns
    -------
    dict of str to DrawnGearbox

    Examples
    --------
    >>> from data_synth.benchmark.records import gearboxes
    >>> len(gearboxes()), len(gearboxes()["g01"].stages)
    (16, 1)
    """
    names = [name for split in SPLITS.values() for name in split.gearboxes]
    return {
        name: draw_gearbox(name, stages=_STAGES[number % len(_STAGES)], rng=random_stream(_POOL, name))
        for number, name in enumerate(names)
    }


@lru_cache(maxsize=1)
def paths() -> dict[str, DrawnPath]:
    """Return the transfer paths of the benchmark, by name.

    Returns
    -------
    dict of str to DrawnPath

    Examples
    --------
    >>> from data_synth.benchmark.records import paths
    >>> len(paths())
    32
    """
    names = [name for split in SPLITS.values() for name in split.paths]
    return {name: draw_path(name, rng=random_stream(_POOL, name)) for name in names}


@dataclass(frozen=True, kw_only=True)
class _Draw:
    """What a record is, before its scene."""

    split: str
    class_name: str
    severity: float
    machine: Machine
    path: DrawnPath

    @property
    def operation(self) -> Operation:
        return self.machine.operation


@dataclass(frozen=True, kw_only=True)
class BenchmarkRecords:
    """The scene, seed and labels of every record of a benchmark. Built by `data_synth.load_plan`.

    Attributes
    ----------
    records : int
        Number of records.
    seed : int
    duration_s : float
        Of a record; the benchmark has 10 s, a trial may be shorter.

    Examples
    --------
    >>> from data_synth import load_plan
    >>> plan = load_plan("benchmark-1")
    >>> plan.records, plan.classes[:3]
    (1000, ('healthy', 'crack', 'chipping'))
    """

    records: int = 1000
    seed: int = 1
    duration_s: float = DURATION_S

    dtype = "float32"
    name = NAME
    classes = (*CLASSES, *FURTHER)

    @property
    def text(self) -> str:
        """The plan as TOML; plans of equal text are equal."""
        return tomli_w.dumps(
            {
                "benchmark": NAME,
                "version": VERSION,
                "records": self.records,
                "seed": self.seed,
                "duration_s": self.duration_s,
            }
        )

    @property
    def records_per_shard(self) -> int:
        """Records in one file."""
        return min(_SHARD_RECORDS, math.ceil(self.records / _FEWEST_SHARDS))

    @property
    def record_bytes(self) -> int:
        """Size of the samples of one record on disk, in bytes."""
        return round(self.duration_s * RATE_HZ) * np.dtype(self.dtype).itemsize

    @cached_property
    def _orders(self) -> dict[int, Any]:
        return {}

    def _slot(self, number: int) -> tuple[str, str, int]:
        """Return split and class of a record, and how many of both the plan has had before it."""
        block, place = divmod(number, _BLOCK)
        if block not in self._orders:
            self._orders[block] = random_stream(self.seed, "order", block).permutation(_BLOCK)
        split_place, class_place = divmod(int(self._orders[block][place]), len(_CLASS_CYCLE))
        split, class_name = _SPLIT_CYCLE[split_place], _CLASS_CYCLE[class_place]
        first_split, first_class = _SPLIT_CYCLE.index(split), _CLASS_CYCLE.index(class_name)
        shares = SHARES[class_name]
        rank = (block * SPLITS[split].share + split_place - first_split) * shares + class_place - first_class
        return split, class_name, rank

    def split_and_class(self, number: int) -> tuple[str, str]:
        """Return split and class of a record."""
        return self._slot(number)[:2]

    @lru_cache(maxsize=64)  # noqa: B019 - frozen, few and small
    def _draw(self, number: int) -> _Draw:
        if not 0 <= number < self.records:
            raise ValueError(f"no record {number}; the {self.records} of this plan count from 0.")
        split, class_name, rank = self._slot(number)
        pool = SPLITS[split]
        # every gearbox of a split has every class equally often
        gearbox = gearboxes()[pool.gearboxes[(rank + zlib.crc32(class_name.encode())) % len(pool.gearboxes)]]
        path = paths()[str(random_stream(self.seed, number, "path").choice(pool.paths))]
        operation = draw_operation(
            gearbox, duration_s=self.duration_s, rng=random_stream(self.seed, number, "operation")
        )
        machine = Machine(
            gearbox=gearbox,
            operation=operation,
            rng=random_stream(self.seed, number, "machine"),
            rng_of_gearbox=random_stream(_POOL, gearbox.name, "machine"),
        )
        severity = float(random_stream(self.seed, number, "severity").random())
        return _Draw(split=split, class_name=class_name, severity=severity, machine=machine, path=path)

    def seed_of(self, number: int) -> int:
        """Return the seed with which a record is simulated, derived from the plan's seed and `number`; below 2^63.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        int

        Examples
        --------
        >>> from data_synth import load_plan
        >>> plan = load_plan("benchmark-1")
        >>> plan.seed_of(0) == plan.seed_of(1)
        False
        """
        return derived_seed(self.seed, number)

    def machine_seed_of(self, number: int) -> int:
        """Return the seed of the gearbox of a record, the same in all its records; below 2^63.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        int

        Examples
        --------
        >>> from data_synth import load_plan
        >>> plan = load_plan("benchmark-1")
        >>> plan.machine_seed_of(0) == plan.machine_seed_of(1), plan.labels(0)["gearbox"] == plan.labels(1)["gearbox"]
        (False, False)
        """
        return derived_seed(_POOL, self._draw(number).machine.gearbox.name, "machine")

    def scene(
        self,
        number: int,
        *,
        healthy: bool = False,
        duration_s: float | None = None,
        severity: float | None = None,
    ) -> Scene:
        """Return the scene of a record.

        Parameters
        ----------
        number : int
            Number of the record, from 0.
        healthy : bool
            Without its fault.
        duration_s : float, optional
            Length of the scene, if not that of the record.
        severity : float, optional
            Of its fault, from 0 to 1, if not that of the record.

        Returns
        -------
        Scene

        Examples
        --------
        >>> from data_synth import load_plan
        >>> plan = load_plan("benchmark-1")
        >>> len(plan.scene(0).faults), len(plan.scene(0, healthy=True).faults)
        (1, 0)
        """
        drawn = self._draw(number)
        if severity is not None:
            drawn = replace(drawn, severity=severity)
        table = self._table(number, drawn)
        fault = self._fault(number, drawn)
        if fault and not healthy:
            table["fault"] = [*table["fault"], fault]
        if duration_s is not None:
            table["duration_s"] = duration_s
        return Scene.from_mapping(table, where=f'record {number}, class "{drawn.class_name}"')

    def scenes_of(self, number: int) -> tuple[Scene, ...]:
        """Return the scenes that are simulated for a record: its own; then a short healthy one, for the detectability.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        tuple of Scene
            One of a healthy record.
        """
        if self._slot(number)[1] == "healthy":
            return (self.scene(number),)
        return self.scene(number), self.scene(number, healthy=True, duration_s=min(TRIAL_S, self.duration_s))

    def _table(self, number: int, drawn: _Draw) -> dict[str, Any]:
        """Return the scene of a record without its fault."""
        machine, gearbox = drawn.machine, drawn.machine.gearbox
        rng = random_stream(self.seed, number, "bearings")
        bearings = {link: draw_bearing(rng) for link in gearbox.links}
        table: dict[str, Any] = {
            "gearbox": gearbox.table(bearings),
            "rate_hz": RATE_HZ,
            "duration_s": self.duration_s,
            "fidelity": "lateral",
            "speed": drawn.operation.speed,
            "torque": drawn.operation.torque,
            "tachometer": {"link": "input", "pulses_per_rev": 1},
            "dynamics": {"error": ERROR},
            "excitation": {"shaft_amplitude": 0.0},
            "transfer": drawn.path.transfers([f"{link} bearing" for link in gearbox.links], sensor=SENSOR),
            "sensor": {"name": SENSOR, "on": "input bearing", "direction": [0, 0, 1], "units": "m s-2"}
            | drawn.path.sensor(),
            "fault": [],
        }
        for imperfection in IMPERFECTIONS:
            word = imperfection.__name__
            own = replace(
                machine,
                rng=random_stream(self.seed, number, word),
                rng_of_gearbox=random_stream(_POOL, gearbox.name, word),
            )
            table = merged(table, imperfection(own))
        return table | {"sensor": [table["sensor"]]}

    def _fault(self, number: int, drawn: _Draw) -> dict[str, Any]:
        """Return the fault of a record as a scene declares it; an empty table for a healthy one."""
        if drawn.class_name == "healthy":
            return {}
        rng = random_stream(self.seed, number, "fault")
        return FAULTS[drawn.class_name].draw(drawn.machine, severity=drawn.severity, rng=rng)

    def labels(self, number: int) -> dict[str, Any]:
        """Return the class, the seed and all labels of a record but ``detectability_db``, which takes a simulation.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        dict
            The same keys for every record: NaN or "" where a healthy one has none.

        Examples
        --------
        >>> from data_synth import load_plan
        >>> sorted(load_plan("benchmark-1").labels(0))[:5]
        ['class', 'class_number', 'component', 'gearbox', 'load_share']
        """
        drawn = self._draw(number)
        fault = self._fault(number, drawn)
        missing = drawn.class_name == "missing tooth"
        severity = float("nan") if not fault else 1.0 if missing else drawn.severity
        return {
            "class": drawn.class_name,
            "class_number": CLASSES.index(drawn.class_name) if drawn.class_name in CLASSES else -1,
            "seed": self.seed_of(number),
            "machine_seed": self.machine_seed_of(number),
            "split": drawn.split,
            "gearbox": drawn.machine.gearbox.name,
            "stages": len(drawn.machine.gearbox.stages),
            "path": drawn.path.name,
            "component": fault.get("component", ""),
            "severity": severity,
            "size_mm": fault.get("size_mm", fault.get("depth_mm", float("nan"))),
            "speed_kind": drawn.operation.speed_kind,
            "torque_kind": drawn.operation.torque_kind,
            "rpm": drawn.operation.rpm,
            "load_share": drawn.operation.load_share,
        }

"""The plan of a dataset: a scene, what varies from record to record, and the classes. Frozen, read from TOML.

Wherever the scene has a value, a plan may have a distribution: ``{ uniform = [low, high] }``, ``{ log = [low, high] }``
(uniform in the logarithm) or ``{ choice = [a, b, c] }``. The value drawn is a label, named after its place in the scene
(``speed.rpm``, ``fault.1.depth_mm``) or by ``label = "..."`` in the distribution.
"""

import difflib
import json
import tomllib
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date, time
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from data_synth.benchmark.records import DURATION_S, NAME, VERSION, BenchmarkRecords
from data_synth.scene.machine_history import History
from data_synth.scene.random_streams import derived_seed, random_stream
from data_synth.scene.scene import Scene, SceneError, load_scene
from hums.gearbox.components import (
    MOST_PARTS,
    Declared,
    Name,
    Positive,
    closest,
    file_beside,
    named_file,
    parsed_toml,
    read_toml,
    validated,
)
from signals._validation import SentenceError, checked

__all__ = [
    "RANGES",
    "BenchmarkTable",
    "Choice",
    "Log",
    "Plan",
    "PlanError",
    "PlanTable",
    "Range",
    "Uniform",
    "load_plan",
    "parse_plan",
    "plans",
]


# ---- Distributions that a plan may have where the scene has a value --------------------------------------------------


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    if not low < high:
        raise ValueError(f"[{low:g}, {high:g}] does not rise; give [low, high]")
    return ends


class Uniform(Declared):
    """A uniform distribution from low to high."""

    uniform: Annotated[tuple[float, float], AfterValidator(_rising)]
    label: Name | None = None

    def at(self, share: float) -> float:
        """Return the quantile at probability `share`."""
        low, high = self.uniform
        return low + share * (high - low)


class Log(Declared):
    """A log-uniform distribution from low to high."""

    log: Annotated[tuple[Positive, Positive], AfterValidator(_rising)]
    label: Name | None = None

    def at(self, share: float) -> float:
        """Return the quantile at probability `share`."""
        low, high = self.log
        return float(low * (high / low) ** share)


class Choice(Declared):
    """A discrete distribution over listed values, equally likely; a value named twice is twice as likely."""

    choice: Annotated[tuple[Any, ...], Field(min_length=1)]
    label: Name | None = None

    def at(self, share: float) -> Any:  # noqa: ANN401
        """Return the quantile at probability `share`, in the order of the list."""
        return self.choice[min(int(share * len(self.choice)), len(self.choice) - 1)]


Range: TypeAlias = Uniform | Log | Choice

RANGES: dict[str, type[Range]] = {"uniform": Uniform, "log": Log, "choice": Choice}
"""By the key that a range is written with."""


# ---- Plan ------------------------------------------------------------------------------------------------------------


Place: TypeAlias = tuple[str | int, ...]
_OWN_LABELS = ("record", "class", "seed", "time")
_COMMON = ("rate_hz", "duration_s", "sensor")
_SHARD_BYTES = 32_000_000  # of samples in one file, which a worker holds in memory
_MOST_IN_SHARD, _FEWEST_SHARDS = 64, 16  # little is lost with a kill, and several workers have something to do


class PlanError(SentenceError):
    """A plan that cannot be read, or a dataset that cannot be made.

    Examples
    --------
    >>> from data_synth import PlanError, load_plan
    >>> try:
    ...     load_plan("clasification")
    ... except PlanError as error:
    ...     print('"classification"' in str(error))
    True
    """


class RecordClass(Declared):
    """One class of records: a scene written as JSON, and the distributions of the values that vary."""

    name: Name
    share: Annotated[int, Field(ge=1)]
    template: str
    ranges: tuple[tuple[str, Place, Range], ...]

    def scene(self, values: Mapping[str, Any], *, where: str = "scene") -> Scene:
        """Return the scene with the given values, one for each label."""
        table = json.loads(self.template)
        for label, path, _ in self.ranges:
            place: Any = table
            for part in path[:-1]:
                place = place[part]
            place[path[-1]] = values[label]
        return Scene.from_mapping(table, where=where)


class ClassTable(Declared):
    """A class as a plan file declares it; `share` records of it come in each cycle of the classes."""

    name: Name
    share: Annotated[int, Field(ge=1)] = 1
    change: dict[str, Any] = Field(default={})


class PlanTable(Declared):
    """The content of a plan file."""

    scene: str | dict[str, Any]
    records: Annotated[int, Field(ge=1)]
    seed: Annotated[int, Field(ge=0)]
    sampling: Literal["random", "sobol"] = "random"
    dtype: Literal["float32", "float64"] = "float32"
    records_per_shard: Annotated[int, Field(ge=1)] | None = None
    history: History | None = None
    change: dict[str, Any] = Field(default={})
    classes: tuple[ClassTable, ...] = Field(default=(), alias="class", max_length=MOST_PARTS)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The scene, seed and labels of every record of a dataset. Built by `load_plan` or `parse_plan`.

    Attributes
    ----------
    text : str
        The plan as TOML, its scene and every default written out; plans of equal text are equal.
    records : int
        Number of records.
    seed : int
        Seed of the dataset, from which those of the records follow.
    sampling : "random" or "sobol"
        Independent draws, or for each class the points of a scrambled Sobol sequence, which fill its ranges more evenly
        (Owen 1998, J. Complexity 14, 466-489).
    dtype : "float32" or "float64"
        Type in which samples are stored.
    records_per_shard : int
        Records in one file.
    record_bytes : int
        Size of the samples of one record on disk, in bytes.
    variants : tuple of RecordClass
        The classes, in the order of the plan.
    history : History or None
        What carries over from record to record.

    Examples
    --------
    >>> from data_synth import load_plan
    >>> plan = load_plan("classification")
    >>> plan.records, [variant.name for variant in plan.variants[:3]]
    (1000, ['healthy', 'crack', 'spall'])
    """

    text: str
    records: int
    seed: int
    sampling: str
    dtype: str
    records_per_shard: int
    record_bytes: int
    variants: tuple[RecordClass, ...]
    history: History | None = None

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes, in the order of the plan."""
        return tuple(variant.name for variant in self.variants)

    def scenes_of(self, number: int) -> tuple[Scene, ...]:
        """Return the scenes that are simulated for a record."""
        return (self.scene(number),)

    def variant_of(self, number: int) -> RecordClass:
        """Return the class of a record; the classes take turns, each as often in a cycle as its `share`.

        With several machines in the plan's history each has all classes in turn.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        RecordClass

        Examples
        --------
        Eight classes with one share each:

        >>> from data_synth import load_plan
        >>> plan = load_plan("classification")
        >>> plan.variant_of(1).name, plan.variant_of(9).name
        ('crack', 'crack')
        """
        return self.variants[self._cycle[self._turn(number) % len(self._cycle)]]

    def values(self, number: int) -> dict[str, Any]:
        """Return the values drawn for a record.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        dict
            Value by label.

        Examples
        --------
        >>> from data_synth import load_plan
        >>> 100 <= load_plan("classification").values(0)["torque_nm"] <= 500
        True
        """
        variant = self.variant_of(number)
        if self.sampling == "sobol" and variant.ranges:
            shares = self._sobol_point(number, variant)
        else:
            shares = np.array([random_stream(self.seed, number, label).random() for label, _, _ in variant.ranges])
        return {label: r.at(float(share)) for (label, _, r), share in zip(variant.ranges, shares, strict=True)}

    def scene(self, number: int) -> Scene:
        """Return the scene of a record.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        Scene

        Examples
        --------
        >>> from data_synth import load_plan
        >>> plan = load_plan("classification")
        >>> plan.scene(1).faults[0].kind, plan.scene(0).faults
        ('tooth_crack', ())
        """
        variant = self.variant_of(number)
        scene = variant.scene(self.values(number), where=f'record {number}, class "{variant.name}"')
        return scene if self.history is None else self.history.scene(scene, number, seed=self.seed)

    def seed_of(self, number: int) -> int:
        """Return the seed with which a record is simulated.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        int
            Derived from the plan's seed and `number` alone; below 2^63.

        Examples
        --------
        >>> from data_synth import load_plan
        >>> plan = load_plan("classification")
        >>> plan.seed_of(0) == plan.seed_of(0), plan.seed_of(0) == plan.seed_of(1)
        (True, False)
        """
        return derived_seed(self.seed, number)

    def machine_seed_of(self, number: int) -> int | None:
        """Return the seed of the machine of a record, which its records share; None where none carries over.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        int or None

        Examples
        --------
        >>> from data_synth import load_plan
        >>> load_plan("classification").machine_seed_of(0) is None
        True
        """
        if self.history is None:
            return None
        return derived_seed(self.seed, "machine", self.history.machine(number))

    def labels(self, number: int) -> dict[str, Any]:
        """Return the class, the seed and all labels of a record.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        dict
            The same keys for every record: NaN or "" where the record's class does not draw that label.

        Examples
        --------
        >>> from data_synth import load_plan
        >>> labels = load_plan("classification").labels(0)
        >>> labels["class"], labels["component"], labels["severity_mm"]
        ('healthy', '', nan)
        """
        values = self.values(number)
        found: dict[str, Any] = {"class": self.variant_of(number).name, "seed": self.seed_of(number)}
        for label, (kind, choices) in self._label_kinds().items():
            if label not in values:
                found[label] = "" if kind is str else float("nan")
            else:
                found[label] = kind(choices.index(values[label]) + 1 if choices else values[label])
        if self.history is not None:
            state = self.history.state(number, seed=self.seed)
            found["machine"], found["machine_seed"] = self.history.machine(number), self.machine_seed_of(number)
            found |= {f"history.{key}": x for key, x in state.items()}
        return found

    def _sobol_point(self, number: int, variant: RecordClass) -> NDArray[np.float64]:
        """Return the point of the Sobol sequence that belongs to a record, a coordinate for each label."""
        turns, place = divmod(self._turn(number), len(self._cycle))
        own = self.variants.index(variant)
        rank = turns * variant.share + self._cycle[:place].count(own)
        key = (self.seed, zlib.crc32(variant.name.encode()), len(variant.ranges))
        points = -(-self.records // (self._machines * len(self._cycle))) * self._machines * variant.share
        shares: NDArray[np.float64] = _sobol_points(*key, power=(points - 1).bit_length())[rank]
        return shares

    def _turn(self, number: int) -> int:
        """Return which turn of the classes a record takes: each of several machines has all classes in turn."""
        machines, classes = self._machines, len(self._cycle)
        block, place = divmod(number, machines * classes)
        turn, machine = divmod(place, machines)
        return (block * machines + machine) * classes + (turn + machine) % classes

    @property
    def _machines(self) -> int:
        """Number of machines whose records take turns."""
        return 1 if self.history is None else self.history.machines

    @property
    def _cycle(self) -> tuple[int, ...]:
        """One cycle of classes, by index, in the order in which records take them."""
        rounds = range(max(variant.share for variant in self.variants))
        return tuple(i for turn in rounds for i, variant in enumerate(self.variants) if variant.share > turn)

    def _label_kinds(self) -> dict[str, tuple[type, tuple[Any, ...]]]:
        return _label_kinds(self.variants)


@lru_cache(maxsize=64)
def _sobol_points(seed: int, stream: int, dimensions: int, *, power: int) -> NDArray[np.float64]:
    from scipy.stats.qmc import Sobol  # noqa: PLC0415 - only such plans need it

    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream,)))
    return np.asarray(Sobol(dimensions, scramble=True, seed=rng).random_base2(power))


@lru_cache(maxsize=16)
def _label_kinds(variants: tuple[RecordClass, ...]) -> dict[str, tuple[type, tuple[Any, ...]]]:
    """Return, by label, its type; and the choices where the label is the number of the one drawn."""
    kinds: dict[str, tuple[type, tuple[Any, ...]]] = {}
    for variant in variants:
        for label, _, drawn in variant.ranges:
            choices = drawn.choice if isinstance(drawn, Choice) else (0.0,)
            text = all(isinstance(value, str) for value in choices)
            number = all(isinstance(value, int | float) for value in choices)
            kind = (str, ()) if text else (float, () if number else choices)
            if kinds.setdefault(label, kind) != kind:
                raise PlanError(f'the label "{label}" is a number in one class and not in another; rename one.')
    return kinds


# ---- reading -----------------------------------------------------------------------------------------------


class BenchmarkTable(Declared):
    """The content of a plan file that names a versioned benchmark."""

    benchmark: Literal["benchmark-1"]
    version: str
    records: Annotated[int, Field(ge=1)] = 1000
    seed: Annotated[int, Field(ge=0)] = 1
    duration_s: Positive = DURATION_S


@checked
def load_plan(name_or_path: str | Path) -> Plan | BenchmarkRecords:
    """Load a plan from a TOML file, or from the catalogue by its name.

    Parameters
    ----------
    name_or_path : str or Path
        Path of a ``.toml`` file, or the name of a plan that ships with the package. A relative path of the scene in the
        file is looked up beside it first.

    Returns
    -------
    Plan or BenchmarkRecords
        The latter where the file names a versioned benchmark.

    Raises
    ------
    PlanError
        With one sentence: the key, its value, the bound and the remedy.

    Examples
    --------
    >>> from data_synth import load_plan
    >>> load_plan("classification").sampling
    'sobol'
    """
    path = named_file(name_or_path, shipped=plans(), thing="plan", error=PlanError)
    table = read_toml(path, error=PlanError)
    scene = table.get("scene")
    if isinstance(scene, str):
        table["scene"] = file_beside(path, scene)
    return _plan(table, where=str(path))


def parse_plan(text: str, *, where: str = "plan") -> Plan | BenchmarkRecords:
    """Return the plan of a TOML text; `where` names it in error sentences."""
    return _plan(parsed_toml(text, where=where, error=PlanError), where=where)


def plans() -> dict[str, Path]:
    """Return the plans that ship with the package, file by name."""
    folder = Path(str(files("data_synth"))) / "catalogue" / "plans"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def _benchmark(table: Mapping[str, Any], *, where: str) -> BenchmarkRecords:
    """Return a benchmark; refuse another version than that of this program."""
    declared = validated(BenchmarkTable, dict(table), where=where, error=PlanError)
    if declared.version != VERSION:
        raise PlanError(
            f'{where}: version = "{declared.version}" of {NAME}, but this program makes {VERSION}; '
            "install the release that has the other one, or name this one."
        )
    return BenchmarkRecords(records=declared.records, seed=declared.seed, duration_s=declared.duration_s)


def _plan(table: Mapping[str, Any], *, where: str) -> Plan | BenchmarkRecords:
    """Return the plan of a parsed plan file, after a check of every class."""
    import tomli_w  # noqa: PLC0415 - a plan is read seldom

    if "benchmark" in table:
        return _benchmark(table, where=where)
    declared = validated(PlanTable, dict(table), where=where, error=PlanError)
    base = _base(declared.scene, where)
    try:
        variants = tuple(_variants(declared, base))
        _label_kinds(variants)
        first = _checked(variants)
        if declared.history is not None:
            declared.history.scene(first, 0, seed=declared.seed)
    except (PlanError, SceneError) as error:
        raise PlanError(f"{where}: {error}") from None
    size = len(first.sensors) * first.samples * np.dtype(declared.dtype).itemsize
    fitting = min(_SHARD_BYTES // size, _MOST_IN_SHARD, -(-declared.records // _FEWEST_SHARDS))
    resolved = declared.model_dump(by_alias=True, exclude_none=True) | {"scene": base}
    resolved["records_per_shard"] = declared.records_per_shard or max(1, fitting)
    return Plan(
        text=tomli_w.dumps(dict(sorted(resolved.items(), key=lambda item: isinstance(item[1], dict | tuple)))),
        records=declared.records,
        seed=declared.seed,
        sampling=declared.sampling,
        dtype=declared.dtype,
        records_per_shard=resolved["records_per_shard"],
        record_bytes=size,
        variants=variants,
        history=declared.history,
    )


def _base(scene: str | Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the scene with every default written out."""
    try:
        loaded = load_scene(scene) if isinstance(scene, str) else Scene.from_mapping(scene)
    except ValueError as error:
        raise PlanError(f"{where}: {error}") from None
    return tomllib.loads(loaded.to_toml())


def _variants(declared: PlanTable, base: Mapping[str, Any]) -> Iterator[RecordClass]:
    """Yield the classes of a plan."""
    changed = _merged(base, declared.change)
    kinds = [table.get("kind", "fault") for table in changed.get("fault", ()) if isinstance(table, Mapping)]
    classes = declared.classes or (ClassTable(name=" + ".join(map(str, kinds)) or "healthy"),)
    names = [table.name for table in classes]
    for table in classes:
        if names.count(table.name) > 1:
            raise PlanError(f'two classes are called "{table.name}"; give each a name of its own.')
        found: list[tuple[str, Place, Range]] = []
        try:
            template = _split(_merged(changed, table.change), (), found)
        except PlanError as error:
            raise PlanError(f'class "{table.name}": {error}') from None
        _check_labels(table.name, found)
        yield RecordClass(name=table.name, share=table.share, template=json.dumps(template), ranges=tuple(found))


def _merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Return `base` with the values of `change`: nested tables are merged, everything else is replaced."""
    result = dict(base)
    for key, value in change.items():
        there = base.get(key)
        inner = isinstance(there, Mapping) and isinstance(value, Mapping) and not RANGES.keys() & value.keys()
        result[key] = _merged(there, value) if inner and isinstance(there, Mapping) else value
    return result


def _split(value: Any, path: Place, found: list[tuple[str, Place, Range]]) -> Any:  # noqa: ANN401
    """Return `value` with None in place of each distribution, and append those to `found`."""
    if isinstance(value, list | tuple):
        return [_split(item, (*path, number), found) for number, item in enumerate(value)]
    if isinstance(value, date | time):
        raise PlanError(f"{'.'.join(map(str, path))} = {value}: a date or a time is no value of a scene; leave it out.")
    if not isinstance(value, Mapping):
        return value
    place = ".".join(str(part + 1) if isinstance(part, int) else part for part in path)
    kinds = RANGES.keys() & value.keys()
    if not kinds:
        for key in value:
            near = difflib.get_close_matches(key, RANGES, n=1)
            if near and isinstance(value[key], list | tuple):
                raise PlanError(f'{place}: unknown kind of range "{key}"{closest(key, set(RANGES))}')
        return {key: _split(item, (*path, key), found) for key, item in value.items()}
    if len(kinds) > 1:
        raise PlanError(f"{place}: {' and '.join(sorted(kinds))} are both given; keep one.")
    if not path:
        raise PlanError(f"change: {kinds.pop()} is a kind of range, of a value; name the value, as in noise.rms.")
    if path[0] in _COMMON:
        raise PlanError(f"{place}: a range, but all records of a dataset have the same {path[0]}; give one value.")
    drawn = validated(RANGES[kinds.pop()], dict(value), where=place, error=PlanError)
    found.append((drawn.label or place, path, drawn))
    return None


def _check_labels(name: str, ranges: list[tuple[str, Place, Range]]) -> None:
    """Refuse a label that occurs twice in a class, or that the dataset uses itself."""
    labels = [label for label, _, _ in ranges]
    for label in labels:
        if labels.count(label) > 1:
            raise PlanError(f'class "{name}": two ranges have the label "{label}"; give each its own.')
        if label in _OWN_LABELS or label.startswith(("truth_", "pulse_", "time_")):
            raise PlanError(f'class "{name}": the label "{label}" has a meaning of its own; choose another.')


def _checked(variants: tuple[RecordClass, ...]) -> Scene:
    """Validate the scenes at both ends of all ranges, so that a plan fails before it is begun; return the first."""
    for variant in variants:
        where = f'class "{variant.name}"'
        for share in (0.0, 1.0):
            variant.scene({label: drawn.at(share) for label, _, drawn in variant.ranges}, where=where)
        lowest = {label: drawn.at(0.0) for label, _, drawn in variant.ranges}
        for label, _, drawn in variant.ranges:
            for value in drawn.choice if isinstance(drawn, Choice) else ():
                variant.scene(lowest | {label: value}, where=where)
        here, first = json.loads(variant.template), json.loads(variants[0].template)
        for field in _COMMON:
            if here[field] != first[field]:
                raise PlanError(
                    f'class "{variant.name}" changes {field}, but all records of a dataset have the same; '
                    "change it for all, in [change]."
                )
    return variants[0].scene({label: drawn.at(0.0) for label, _, drawn in variants[0].ranges})

"""Plans of datasets: a scene, its variation between records, machines and classes. Frozen, read from TOML.

A plan may have a distribution (`data_synth.draws`) in place of any value of the scene. The value drawn is a label,
named after its place in the scene (``speed.rpm``, ``fault.1.depth_mm``) or by ``label = "..."`` in the distribution.
The scene of a record is that of the plan, modified by ``[change]``, then by its machine, then by its class.
"""

import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from data_synth.draws import (
    DISTRIBUTIONS,
    AnyDistribution,
    Choice,
    Drawn,
    Draws,
    Named,
    PlanError,
    Tree,
    Uniform,
    labels_of,
    parsed,
    reached,
)
from data_synth.scene.machine_history import History
from data_synth.scene.random_streams import derived_seed, random_stream
from data_synth.scene.scene import Scene, load_scene
from hums.gearbox.components import (
    MOST_PARTS,
    Declared,
    Name,
    Positive,
    closest,
    named_file,
    parsed_toml,
    read_toml,
    sibling_file,
    validated,
)
from hums.gearbox.model import load_gearbox
from signals._validation import checked

_OWN_LABELS = ("record", "class", "class_number", "seed", "time", "machine", "machine_seed", "split")
_SHARD_BYTES = 32_000_000  # of samples in one file, which a worker holds in memory
_MOST_IN_SHARD, _FEWEST_SHARDS = 64, 16  # little is lost by an interruption, and several workers are kept busy


# ---- The plan file ---------------------------------------------------------------------------------------------------


class ClassTable(Declared):
    """A class of records, with `share` records in each cycle of the classes."""

    name: Name
    share: Annotated[int, Field(ge=1)] = 1
    change: dict[str, Any] = Field(default={})


class MachineTable(Declared):
    """Machines of one design, each of which draws its values once.

    `splits` states the number of machines per split, so that no machine is in two of them; by default there is one
    machine, without a split.
    """

    name: Name
    splits: dict[Name, Annotated[int, Field(ge=1, le=MOST_PARTS)]] | None = None
    draw: dict[Name, dict[str, Any]] = Field(default={})
    change: dict[str, Any] = Field(default={})


class PlanTable(Declared):
    """The content of a plan file.

    `splits` are the fractions of the records of each class in training, validation and test, or of the machines of a
    `history`; a `machine` of the plan has its own. With `parquet` the records are also written to ``records.parquet``.
    """

    title: str = ""
    scene: str | dict[str, Any]
    records: Annotated[int, Field(ge=1)]
    seed: Annotated[int, Field(ge=0)]
    machine_seed: Annotated[int, Field(ge=0)] | None = None
    dtype: Literal["float32", "float64"] = "float32"
    records_per_shard: Annotated[int, Field(ge=1)] | None = None
    labels: tuple[Name, ...] | None = None
    splits: dict[Name, Positive] = Field(default={"train": 0.7, "validation": 0.15, "test": 0.15}, min_length=1)
    parquet: bool = False
    detectability_s: Positive | None = None
    about: str = ""
    history: History | None = None
    draw: dict[Name, dict[str, Any]] = Field(default={})
    change: dict[str, Any] = Field(default={})
    machines: tuple[MachineTable, ...] = Field(default=(), alias="machine", max_length=MOST_PARTS)
    classes: tuple[ClassTable, ...] = Field(default=(), alias="class", max_length=MOST_PARTS)


@dataclass(frozen=True, kw_only=True)
class Machine:
    """One machine of a plan.

    Attributes
    ----------
    name, split : str
        Its name, and the split of its records; empty without splits.
    design : MachineTable
        Declaration of its design.
    """

    name: str
    split: str
    design: MachineTable


@dataclass(frozen=True, kw_only=True)
class _Template:
    """The scene of one design and one class, with distributions, and the draws to which it may refer."""

    tree: Tree
    named: Named
    of_class: Tree

    @cached_property
    def distributions(self) -> tuple[AnyDistribution, ...]:
        """Distinct distributions from which a record may draw."""
        return tuple({id(draw): draw for draw, _ in reached(self.tree, self.named)}.values())


# ---- Plan ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The scene, seed and labels of every record of a dataset. Built by `load_plan` or `parse_plan`.

    Attributes
    ----------
    text : str
        The plan as TOML, with its scene and every default written out; plans of equal text are equal.
    table : PlanTable
        Content of the text.

    Examples
    --------
    >>> from data_synth import load_plan
    >>> plan = load_plan("classification")
    >>> plan.records, plan.classes[:3]
    (1000, ('healthy', 'crack', 'spall'))
    """

    text: str
    table: PlanTable = field(repr=False, compare=False)

    @property
    def records(self) -> int:
        """Number of records."""
        return self.table.records

    @cached_property
    def record_bytes(self) -> int:
        """Size of the samples of one record on disk, in bytes."""
        scene = self.scene(0)
        return len(scene.sensors) * scene.samples * np.dtype(self.table.dtype).itemsize

    @property
    def records_per_shard(self) -> int:
        """Number of records per file."""
        fitting = min(_SHARD_BYTES // self.record_bytes, _MOST_IN_SHARD, -(-self.records // _FEWEST_SHARDS))
        return self.table.records_per_shard or max(1, fitting)

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes, in the order of the plan."""
        return tuple(each.name for each in self.table.classes)

    def changed(self, **keys: object) -> "Plan":
        """Return the plan with other values of its keys, such as `records` or `seed`; raise PlanError if invalid.

        Examples
        --------
        >>> from data_synth import load_plan
        >>> load_plan("classification").changed(records=8).records
        8
        """
        return _plan(tomllib.loads(self.text) | keys, where="plan")

    @cached_property
    def machines(self) -> tuple[Machine, ...]:
        """Machines declared by the plan, whose records alternate; empty if there are none."""
        found = list[Machine]()
        for design in self.table.machines:
            splits = [split for split, count in (design.splits or {"": 1}).items() for _ in range(count)]
            for number, split in enumerate(splits, start=1):
                name = design.name if len(splits) == 1 else f"{design.name} {number}"
                found.append(Machine(name=name, split=split, design=design))
        return tuple(found)

    def machine_of(self, number: int) -> Machine | None:
        """Return the machine of a record; None if the plan declares none."""
        return self.machines[number % len(self.machines)] if self.machines else None

    def class_of(self, number: int) -> str:
        """Return the class of a record; classes alternate, each appearing `share` times per cycle.

        With several machines each goes through all classes.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        str

        Examples
        --------
        Eight classes with one share each:

        >>> from data_synth import load_plan
        >>> plan = load_plan("classification")
        >>> plan.class_of(1), plan.class_of(9)
        ('crack', 'crack')
        """
        return self.table.classes[self._class_index(number)].name

    def values(self, number: int) -> dict[str, Any]:
        """Return the values drawn for a record, by label.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        dict

        Raises
        ------
        ValueError
            A number outside the plan.

        Examples
        --------
        >>> from data_synth import load_plan
        >>> 100 <= load_plan("classification").values(0)["torque_nm"] <= 500
        True
        """
        return self._resolved(number)[1]

    def scene(self, number: int, given: Mapping[str, Any] | None = None) -> Scene:
        """Return the scene of a record.

        Parameters
        ----------
        number : int
            Number of the record, from 0.
        given : mapping of str to value, optional
            Values of named draws of the plan to use instead of drawing.

        Returns
        -------
        Scene

        Raises
        ------
        ValueError
            A number outside the plan.
        SceneError
            Values that make the scene invalid.

        Examples
        --------
        >>> from data_synth import load_plan
        >>> plan = load_plan("classification")
        >>> plan.scene(1).faults[0].kind, plan.scene(0).faults
        ('tooth_crack', ())
        """
        table, _ = self._resolved(number, given)
        scene = Scene.from_mapping(table, where=f'record {number}, class "{self.class_of(number)}"')
        return scene if self._history is None else self._history.scene(scene, number, seed=self.table.seed)

    def seed_of(self, number: int) -> int:
        """Return the seed with which a record is simulated.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        int
            Derived from the seed of the plan and `number` alone; below 2^63.

        Examples
        --------
        >>> from data_synth import load_plan
        >>> plan = load_plan("classification")
        >>> plan.seed_of(0) == plan.seed_of(0), plan.seed_of(0) == plan.seed_of(1)
        (True, False)
        """
        return derived_seed(self.table.seed, number)

    def machine_seed_of(self, number: int) -> int | None:
        """Return the seed shared by all records of the machine of a record; None if the plan has no machines.

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
        machine = self.machine_of(number)
        if machine is not None:
            return derived_seed(self._machine_seed, machine.name)
        return (
            None if self._history is None else derived_seed(self.table.seed, "machine", self._history.machine(number))
        )

    def labels(self, number: int) -> dict[str, Any]:
        """Return class, seed and all labels of a record except ``detectability_db``, which requires a simulation.

        Parameters
        ----------
        number : int
            Number of the record, from 0.

        Returns
        -------
        dict
            The same keys for every record, with NaN or "" if the record does not draw that label.

        Examples
        --------
        >>> from data_synth import load_plan
        >>> labels = load_plan("classification").labels(0)
        >>> labels["class"], labels["component"], labels["severity_mm"]
        ('healthy', '', nan)
        """
        (table, values), machine = self._resolved(number), self.machine_of(number)
        damaged = " + ".join(fault["component"] for fault in table.get("fault", ()))
        found: dict[str, Any] = {"class": self.class_of(number), "class_number": self._class_index(number)}
        found |= {"component": damaged, "seed": self.seed_of(number)}
        if machine is None:
            found["split"] = self._split(number)
        else:
            found |= {"machine": machine.name, "machine_seed": self.machine_seed_of(number)}
            found |= {"split": machine.split} if any(each.split for each in self.machines) else {}
        for label, is_text in self.label_is_text.items():
            value = values.get(label, "" if is_text else math.nan)
            found[label] = value if is_text else float(value)
        if self._history is not None:
            state = self._history.state(number, seed=self.table.seed)
            found |= {"machine": self._history.machine(number)} if machine is None else {}
            found["machine_seed"] = self.machine_seed_of(number)
            found |= {f"history.{key}": x for key, x in state.items()}
        return found

    @cached_property
    def label_is_text(self) -> dict[str, bool]:
        """Whether the values of each label drawn are text."""
        found = dict[str, bool]()
        for template in self.templates.values():
            for draw in template.distributions:
                source = draw
                while isinstance(source, Drawn):
                    source = template.named[source.drawn]
                is_text = source.is_text and not draw.factors
                if draw.label is not None and found.setdefault(draw.label, is_text) != is_text:
                    raise PlanError(
                        f'the label "{draw.label}" is a number in one class and text in another; rename one.'
                    )
        for label in self.table.labels or ():
            if label not in found:
                raise PlanError(f'labels: no value drawn has the label "{label}"{closest(label, set(found))}')
        return found if self.table.labels is None else {label: found[label] for label in self.table.labels}

    @cached_property
    def templates(self) -> dict[tuple[str, str], _Template]:
        """Scenes with distributions, by the names of design and class."""
        found, plan = dict[tuple[str, str], _Template](), self.table
        for design in plan.machines or (_NO_MACHINE,):
            named = parsed(plan.draw, "", each="record") | parsed(design.draw, "", each="machine")
            for name, draw in named.items():
                if not isinstance(draw, AnyDistribution):
                    raise PlanError(f"draw.{name} is not a distribution{closest(name, set(DISTRIBUTIONS))}")
            base = plan.scene if isinstance(plan.scene, dict) else {}  # written out when the plan was read
            tree = _merged(base, parsed(plan.change, "", each="record"))
            tree = _merged(tree, parsed(design.change, "", each="machine"))
            for each in self.table.classes:
                try:
                    own = parsed(each.change, "", each="record")
                    template = _Template(tree=_merged(tree, own), named=named, of_class=own)
                    found[design.name, each.name] = _checked(template)
                except PlanError as error:
                    raise PlanError(f'class "{each.name}": {error}') from None
        return found

    def _resolved(self, number: int, given: Mapping[str, Any] | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the table of the scene of a record, and the values drawn by label."""
        if not 0 <= number < self.records:
            raise ValueError(f"no record {number}; this plan has records 0 to {self.records - 1}.")
        machine = self.machine_of(number)
        template = self.templates[(machine.design if machine else _NO_MACHINE).name, self.class_of(number)]
        of_machine = machine.name if machine else self._history.machine(number) if self._history else 0

        def probability(draw: AnyDistribution) -> float:
            label = str(draw.label)
            if draw.each == "machine":
                return float(random_stream(self._machine_seed, "machine", of_machine, label).random())
            return float(random_stream(self.table.seed, number, label).random())

        draws = Draws(template.named, probability, given)
        return draws.resolved(template.tree), draws.labels

    def _rank(self, number: int) -> int:
        """Return the index of a record among those of its class."""
        turns, place = divmod(self._turn(number), len(self._cycle))
        own = self._class_index(number)
        return turns * self.table.classes[own].share + self._cycle[:place].count(own)

    def _split(self, number: int) -> str:
        """Return the split of a record; each machine of a history is in one split."""
        which = self._history.machine(number) if self._machines > 1 and self._history else self._rank(number)
        ends = np.cumsum([*self.table.splits.values()])
        at = (which + 0.5) * (5**0.5 - 1) / 2 % 1 * ends[-1]  # multiples of the golden ratio are evenly spread
        return [*self.table.splits][int(np.searchsorted(ends, at, side="right"))]

    def _class_index(self, number: int) -> int:
        return self._cycle[self._turn(number) % len(self._cycle)]

    def _turn(self, number: int) -> int:
        """Return the position of a record in the sequence of classes, of which each machine goes through all."""
        machines, classes = self._machines, len(self._cycle)
        block, place = divmod(int(number), machines * classes)
        turn, machine = divmod(place, machines)
        return (block * machines + machine) * classes + (turn + machine) % classes

    @property
    def _history(self) -> History | None:
        history = self.table.history
        return history.changed(machines=len(self.machines)) if history is not None and self.machines else history

    @property
    def _machines(self) -> int:
        """Number of machines whose records alternate."""
        return len(self.machines) or (1 if self._history is None else self._history.machines)

    @property
    def _machine_seed(self) -> int:
        return self.table.seed if self.table.machine_seed is None else self.table.machine_seed

    @cached_property
    def _cycle(self) -> tuple[int, ...]:
        """One cycle of class indices, in the order of the records."""
        rounds = range(max(each.share for each in self.table.classes))
        return tuple(i for turn in rounds for i, each in enumerate(self.table.classes) if each.share > turn)


_NO_MACHINE = MachineTable(name="machine")


def _merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Return `base` with the values of `change`: nested tables are merged, everything else is replaced.

    A named gearbox replaces the other one.
    """
    result = dict(base)
    for key, value in change.items():
        there = base.get(key)
        inner = isinstance(there, Mapping) and isinstance(value, Mapping) and not (key == "gearbox" and "name" in value)
        result[key] = _merged(there, value) if inner else value  # type: ignore[arg-type]
    return result


def _checked(template: _Template) -> _Template:
    """Raise PlanError for duplicate or reserved labels, and for quantiles from draws outside [0, 1]."""
    counts = labels_of(template.tree)
    for draw in template.named.values():
        if any(draw is other for other in template.distributions):
            counts += labels_of(draw)
    for label, times in counts.items():
        if times > 1:
            raise PlanError(f'two distributions have the label "{label}"; give each its own.')
        if label in (*_OWN_LABELS, "detectability_db") or label.startswith(("truth_", "pulse_", "time_")):
            raise PlanError(f'the label "{label}" is reserved; choose another.')
    for draw in template.distributions:
        source = template.named[draw.by] if draw.by is not None else None
        if source is not None and not (
            isinstance(source, Uniform) and not source.factors and 0 <= source.uniform[0] <= source.uniform[1] <= 1
        ):
            raise PlanError(f'{draw.label}: by = "{draw.by}" must name a uniform draw within [0, 1]; change its range.')
    return template


# ---- Reading ---------------------------------------------------------------------------------------------------------


@checked
def load_plan(name_or_path: str | Path) -> Plan:
    """Load a plan from a TOML file, or from the catalogue by its name.

    Parameters
    ----------
    name_or_path : str or Path
        Path of a ``.toml`` file, or the name of a plan in the catalogue. A relative path of the scene or of the gearbox
        of a machine is first looked up in the folder of the file.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        With the key, its value, the bound and the remedy.

    Examples
    --------
    >>> from data_synth import load_plan
    >>> load_plan("classification").records
    1000
    """
    path = named_file(name_or_path, shipped=plans(), thing="plan", error=PlanError)
    table = read_toml(path, error=PlanError)
    scene, machines = table.get("scene"), table.get("machine")
    if isinstance(scene, str):
        table["scene"] = sibling_file(path, scene)
    for machine in machines if isinstance(machines, list) else ():
        change = machine.get("change") if isinstance(machine, dict) else None
        if isinstance(change, dict) and isinstance(change.get("gearbox"), str):
            change["gearbox"] = sibling_file(path, change["gearbox"])
    return _plan(table, where=str(path))


def parse_plan(text: str, *, where: str = "plan") -> Plan:
    """Return the plan of a TOML text, which `where` names in error messages; raise PlanError if it is invalid."""
    return _plan(parsed_toml(text, where=where, error=PlanError), where=where)


def plans() -> dict[str, Path]:
    """Return the plans of the catalogue, files by name."""
    folder = Path(str(files("data_synth"))) / "catalogue" / "plans"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def _plan(table: Mapping[str, Any], *, where: str) -> Plan:
    """Return the plan of a parsed plan file, after checking every class."""
    import tomli_w  # noqa: PLC0415 - rarely needed

    declared = validated(PlanTable, dict(table), where=where, error=PlanError)
    try:
        scene = load_scene(declared.scene) if isinstance(declared.scene, str) else Scene.from_mapping(declared.scene)
        resolved = declared.model_dump(by_alias=True, exclude_none=True) | {"scene": tomllib.loads(scene.to_toml())}
        for design in resolved["machine"]:
            if isinstance(name := design["change"].get("gearbox"), str):
                design["change"]["gearbox"] = tomllib.loads(load_gearbox(name).to_toml())
        if not declared.classes:  # named after its faults
            faults = _merged(resolved["scene"], declared.change).get("fault")
            listed = faults if isinstance(faults, list | tuple) else ()
            kinds = [str(table.get("kind", "fault")) for table in listed if isinstance(table, Mapping)]
            resolved["class"] = [{"name": " + ".join(kinds) or "healthy"}]
        text = tomli_w.dumps(dict(sorted(resolved.items(), key=lambda item: isinstance(item[1], dict | tuple))))
        plan = Plan(text=text, table=PlanTable.model_validate(resolved))
        _refuse_repeated("class", plan.classes)
        _refuse_repeated("machine", [machine.name for machine in plan.machines])
        first = _check_scenes(plan)
        if declared.history is not None:
            declared.history.scene(first, 0, seed=declared.seed)
    except ValueError as error:
        raise PlanError(f"{where}: {error}") from None
    return plan


def _refuse_repeated(what: str, names: tuple[str, ...] | list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise PlanError(f'two {what} tables are named "{name}"; give each its own name.')


def _check_scenes(plan: Plan) -> Scene:
    """Validate scenes at both ends of all ranges and at every choice, so that a plan fails early; return the first."""
    plan.label_is_text  # noqa: B018 - refuses labels of mixed types
    found, seen = list[tuple[Scene, dict[str, object]]](), set[str]()
    for (design, name), template in plan.templates.items():
        where = f'class "{name}"' + (f', machine "{design}"' if plan.machines else "")
        for table in _extremes(template, template.tree if design not in seen else template.of_class):
            scene = Scene.from_mapping(table, where=where)
            sensors = [(each.name, each.channel_units, each.sensitivity) for each in scene.sensors]
            alike = {"rate_hz": scene.rate_hz, "duration_s": scene.duration_s, "sensor": sensors}
            found.append((scene, alike))
            for key, own in alike.items():
                if own != found[0][1][key]:
                    raise PlanError(
                        f"{where} changes {key}, which must be the same in all records of a dataset; give one value, "
                        "in [change]."
                    )
        seen.add(design)
    return found[0][0]


def _extremes(template: _Template, of: Tree) -> Iterator[dict[str, Any]]:
    """Yield tables of the scene at both ends of its ranges, and with every option of the choices in `of`."""
    taken: list[dict[str, float]] = []
    once = {(id(draw), *chosen.items()): (draw, chosen) for draw, chosen in reached(of, template.named)}
    for draw, chosen in once.values():
        options = draw.choice if isinstance(draw, Choice) else ()
        for number in range(1, len(options)):
            option = {str(draw.label): (number + 0.5) / len(options)}
            # options of independent choices are combined
            free = (each for each in taken if chosen.items() <= each.items() and not option.keys() & each.keys())
            if (there := next(free, None)) is None:
                taken.append(chosen | option)
            else:
                there |= option
    for end, given in [(0.0, {}), (1.0, {}), *((0.0, each) for each in taken)]:
        draws = Draws(template.named, lambda draw: given.get(str(draw.label), end))  # noqa: B023 - called at once
        yield draws.resolved(template.tree)

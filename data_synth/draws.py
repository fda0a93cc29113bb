"""Distributions, which a plan may have in place of any value of a scene, and how a record draws from them.

``{ uniform = [low, high] }``, ``{ log = [low, high] }`` (uniform in the logarithm), ``{ choice = [a, b, c] }`` and
``{ drawn = "name" }``, the value of a named distribution in ``[draw]`` of the plan. Choices may be tables that contain
distributions.
"""

import difflib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from datetime import date, time
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from hums.gearbox.components import Declared, Name, Positive, closest, validated
from signals._validation import SentenceError


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


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    if not low < high:
        raise ValueError(f"[{low:g}, {high:g}] does not rise; give [low, high]")
    return ends


class Distribution(Declared):
    """Common options of all distributions.

    `label` names the value in the labels of the dataset (default: its place in the scene). `each` states whether every
    record draws, or every machine once. If a named draw `by` is given, it is the quantile, so that several values rise
    together. `times` multiplies the value by named draws and numbers.
    """

    label: Name | None = None
    each: Literal["record", "machine"] | None = None
    by: Name | None = None
    times: Name | float | tuple[Name | float, ...] = ()

    @property
    def factors(self) -> tuple[str | float, ...]:
        """Names and numbers of `times`."""
        return self.times if isinstance(self.times, tuple) else (self.times,)

    @property
    def is_text(self) -> bool:
        """Whether the label of a value is text."""
        return False


class Uniform(Distribution):
    """A uniform distribution from low to high."""

    uniform: Annotated[tuple[float, float], AfterValidator(_rising)]

    def at(self, probability: float) -> tuple[float, float]:
        """Return the quantile at a probability, and its label."""
        low, high = self.uniform
        value = low + probability * (high - low)
        return value, value


class Log(Distribution):
    """A log-uniform distribution from low to high."""

    log: Annotated[tuple[Positive, Positive], AfterValidator(_rising)]

    def at(self, probability: float) -> tuple[float, float]:
        """Return the quantile at a probability, and its label."""
        low, high = self.log
        value = float(low * (high / low) ** probability)
        return value, value


class Choice(Distribution):
    """A discrete distribution over equally likely listed values; a value listed twice is twice as likely.

    The label is the value; for tables and lists it is the name in `names`, or the position in the list, from 1.
    """

    choice: Annotated[tuple[Any, ...], Field(min_length=1)]
    names: tuple[Name, ...] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.names is not None and len(self.names) != len(self.choice):
            raise ValueError(f"{len(self.names)} names for {len(self.choice)} choices; give one name for each")
        return self

    @property
    def is_text(self) -> bool:
        """Whether the label of a value is text."""
        return self.names is not None or all(isinstance(value, str) for value in self.choice)

    def at(self, probability: float) -> tuple[Any, Any]:
        """Return the value at a probability, and its label: a name or number if values are not all text or numbers."""
        index = min(int(probability * len(self.choice)), len(self.choice) - 1)
        value = self.choice[index]
        if self.names is not None:
            return value, self.names[index]
        plain = self.is_text or all(isinstance(each, int | float) for each in self.choice)
        return value, value if plain else index + 1


class Drawn(Distribution):
    """The value of a named draw."""

    drawn: Name


AnyDistribution: TypeAlias = Uniform | Log | Choice | Drawn
DISTRIBUTIONS: dict[str, type[AnyDistribution]] = {"uniform": Uniform, "log": Log, "choice": Choice, "drawn": Drawn}
"""Distributions by the key with which they are written."""

Tree: TypeAlias = Any  # tables and lists with distributions in the place of values
Named: TypeAlias = Mapping[str, AnyDistribution]


def parsed(value: Any, place: str, *, each: str) -> Tree:  # noqa: ANN401
    """Return tables and lists with a distribution in place of each table that declares one.

    Raises
    ------
    PlanError
        An invalid distribution, with its place.
    """
    if isinstance(value, list | tuple):
        return [parsed(item, f"{place}.{number}", each=each) for number, item in enumerate(value, start=1)]
    if not isinstance(value, Mapping):
        if isinstance(value, date | time):
            raise PlanError(f"{place} = {value}: a scene has no dates or times; remove it.")
        return value
    kinds = DISTRIBUTIONS.keys() & value.keys()
    if not kinds:
        for key in (key for key, item in value.items() if isinstance(item, list | tuple)):
            if difflib.get_close_matches(key, DISTRIBUTIONS, n=1):
                raise PlanError(f'{place}: unknown distribution "{key}"{closest(key, set(DISTRIBUTIONS))}')
        return {key: parsed(item, f"{place}.{key}" if place else key, each=each) for key, item in value.items()}
    if len(kinds) > 1:
        raise PlanError(f"{place}: {' and '.join(sorted(kinds))} are both given; keep one.")
    if not place:
        raise PlanError(f"change: {kinds.pop()} is the distribution of a value; name the value, as in noise.rms.")
    found = validated(DISTRIBUTIONS[kinds.pop()], dict(value), where=place, error=PlanError)
    own: dict[str, Any] = {
        "each": found.each or each,
        "label": found.label or (None if isinstance(found, Drawn) else place),
    }
    if isinstance(found, Choice):
        own |= {"choice": tuple(parsed(item, place, each=each) for item in found.choice)}
    return found.model_copy(update=own)


def _children(tree: Tree) -> tuple[Tree, ...]:
    if isinstance(tree, Choice):
        return tree.choice
    return tuple(tree.values() if isinstance(tree, Mapping) else tree if isinstance(tree, list) else ())


def labels_of(tree: Tree) -> Counter[str]:
    """Return how many draws of one record may have each label; options of a choice are mutually exclusive."""
    counts = Counter[str]()
    for child in _children(tree):
        counts = counts | labels_of(child) if isinstance(tree, Choice) else counts + labels_of(child)
    if isinstance(tree, AnyDistribution) and tree.label is not None:
        counts[tree.label] += 1
    return counts


def reached(tree: Tree, named: Named) -> Iterator[tuple[AnyDistribution, dict[str, float]]]:
    """Yield each distribution that a record may draw from, with the probabilities of the choices that lead to it.

    Raises
    ------
    PlanError
        A name without a draw, or a draw that depends on itself.
    """
    done = set[tuple[str, frozenset[tuple[str, float]]]]()

    def within(tree: Tree, chosen: dict[str, float], path: tuple[str, ...]) -> Iterator[tuple[AnyDistribution, Any]]:
        if not isinstance(tree, AnyDistribution):
            for child in _children(tree):
                yield from within(child, chosen, path)
            return
        yield tree, chosen
        for name in (tree.by, getattr(tree, "drawn", None), *tree.factors):
            if not isinstance(name, str) or (name, frozenset(chosen.items())) in done:
                continue
            if name not in named:
                raise PlanError(f'there is no draw "{name}"{closest(name, set(named))}')
            if name in path:
                raise PlanError(f'the draw "{name}" depends on itself; give it its own range.')
            yield from within(named[name], chosen, (*path, name))
            done.add((name, frozenset(chosen.items())))
        options = tree.choice if isinstance(tree, Choice) else ()
        for number, option in enumerate(options):
            yield from within(option, chosen | {str(tree.label): (number + 0.5) / len(options)}, path)

    yield from within(tree, {}, ())


class Draws:
    """The values of one record, drawn when first needed, each named draw once.

    Parameters
    ----------
    named : mapping of str to Distribution
        Draws to which others refer.
    probability : callable
        Function that returns the probability, 0 to 1, at which a distribution is drawn.
    given : mapping of str to value
        Values of named draws to use instead of drawing.

    Attributes
    ----------
    labels : dict of str to value
        Values drawn to date, by label.
    """

    def __init__(
        self, named: Named, probability: Callable[[AnyDistribution], float], given: Mapping[str, Any] | None = None
    ) -> None:
        self.labels: dict[str, Any] = {}
        self._named, self._probability, self._values = named, probability, dict(given or {})
        self.labels |= self._values

    def resolved(self, tree: Tree) -> Any:  # noqa: ANN401
        """Return tables and lists with values in place of distributions."""
        if isinstance(tree, Mapping):
            return {key: self.resolved(item) for key, item in tree.items()}
        if isinstance(tree, list):
            return [self.resolved(item) for item in tree]
        return self._value(tree) if isinstance(tree, AnyDistribution) else tree

    def _of(self, name: str) -> Any:  # noqa: ANN401
        if name not in self._values:
            self._values[name] = self._value(self._named[name])
        return self._values[name]

    def _value(self, distribution: AnyDistribution) -> Any:  # noqa: ANN401
        if isinstance(distribution, Drawn):
            value = shown = self._of(distribution.drawn)
        else:
            at = self._of(distribution.by) if distribution.by is not None else self._probability(distribution)
            value, shown = distribution.at(at)
            value = self.resolved(value)
        for factor in distribution.factors:
            other = self._of(factor) if isinstance(factor, str) else factor
            if not (isinstance(value, int | float) and isinstance(other, int | float)):
                raise PlanError(f"times = {factor!r}: cannot multiply {value!r} by {other!r}; both must be numbers.")
            value *= other
        if distribution.label is not None:
            self.labels[distribution.label] = value if distribution.factors else shown
        return value

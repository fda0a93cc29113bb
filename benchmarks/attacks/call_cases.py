"""A valid call of every function that the packages export: that of its docstring's example, for `odd_calls`."""

from __future__ import annotations

import doctest
import importlib
import inspect
import io
import tempfile
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np

import data_synth
import hums
import signals
from hums import readers
from signals import harmonics, indicators

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

PACKAGES = (signals, harmonics, indicators, hums, readers, data_synth)
SAMPLES = {"x", "values", "waveform", "first", "second"}
LARGEST = 1000  # whole number of samples, which every type of 16 bits and more holds exactly


@dataclass(frozen=True)
class Case:
    """A valid call: function and arguments, and what other arguments are by default."""

    function: Callable[..., Any]
    arguments: Mapping[str, Any]
    also: Mapping[str, Any] = field(default_factory=dict)


def exported() -> set[Callable[..., Any]]:
    """Return the functions that the packages export."""
    things = (getattr(package, name) for package in PACKAGES for name in package.__all__)
    return {thing for thing in things if callable(thing) and not isinstance(thing, type)}


def all_cases(folder: Path) -> list[Case]:
    """Return a valid call of every exported function, and of the classes of which records are made.

    Files of the examples go to `folder` and stay there.
    """
    with (
        patch.object(tempfile, "tempdir", str(folder)),
        patch.object(tempfile.TemporaryDirectory, "__exit__", lambda *_: None),
        redirect_stdout(io.StringIO()),
    ):
        functions = sorted(exported(), key=lambda one: (one.__module__, one.__name__))
        return [*map(case_of, functions), *part_cases()]


def case_of(function: Callable[..., Any]) -> Case:
    """Return the first call of a function in its example, its samples as whole numbers."""
    name, module = function.__name__, importlib.import_module(function.__module__)
    calls: list[inspect.BoundArguments] = []

    def called(*given: Any, **named: Any) -> Any:  # noqa: ANN401
        calls.append(inspect.signature(function).bind(*given, **named))
        return function(*given, **named)

    places = [place for place in {*PACKAGES, module} if getattr(place, name, None) is function]
    for place in places:
        setattr(place, name, called)
    names = set_up(function.__module__)
    for example in doctest.DocTestParser().get_examples(function.__doc__ or ""):
        if not calls:
            exec(example.source, names)  # noqa: S102
    for place in places:
        setattr(place, name, function)
    arguments = {key: _whole(key, value) for key, value in calls[0].arguments.items()}
    for more in calls[0].signature.parameters.values():
        if more.kind is more.VAR_KEYWORD:
            arguments |= arguments.pop(more.name, {})
    also = {
        key: more.default
        for key, more in calls[0].signature.parameters.items()
        if more.default is not more.empty and key not in arguments
    }
    return Case(function, arguments, also)


def set_up(module: str) -> dict[str, Any]:
    """Return what a module's own docstring and those of the packages about it define for the examples in it."""
    parts = module.split(".")
    return {name: thing for end in range(len(parts)) for name, thing in _defined(".".join(parts[: end + 1])).items()}


@cache
def _defined(module: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    for example in doctest.DocTestParser().get_examples(importlib.import_module(module).__doc__ or ""):
        exec(example.source, names)  # noqa: S102
    return names


def _whole(name: str, value: object) -> object:
    if name == "blocks":
        blocks = [np.asarray(block) for block in value]
        whole = _whole("x", np.concatenate(blocks))
        return tuple(np.split(whole, np.cumsum([block.size for block in blocks])[:-1]))
    if name in SAMPLES and isinstance(value, np.ndarray):
        return np.round(value * (LARGEST / np.abs(value).max()))
    return value


def part_cases() -> Iterator[Case]:
    """Yield the classes of which records are made: what they take is checked when a record is made of them."""
    x, teeth = np.arange(1000.0) % 37, np.round(1000 * np.sin(np.arange(1000) / 20))

    def channel(**given: Any) -> object:  # noqa: ANN401
        return hums.make_record({"a": hums.Channel(**given)}, rate_hz=1000.0, angle=hums.UnknownAngle())

    def angle_of(kind: Callable[..., Any]) -> Callable[..., object]:
        return lambda **given: hums.make_record({"a": x}, rate_hz=1000.0, units="g", angle=kind(**given))

    yield Case(
        _called(channel, "Channel"),
        {"values": x, "units": "V"},
        {
            "rate_hz": 500.0,
            "sensitivity": 0.1,
            "measures": "g",
            "calibration_factor": 1.1,
            "delay_s": 1e-3,
            "sensor": "S 1",
            "direction": [1.0, 0.0, 0.0],
        },
    )
    yield Case(
        _called(angle_of(hums.PulseTimes), "PulseTimes"),
        {"times_s": np.arange(9) / 8, "shaft": "input", "pulses_per_rev": 1},
        {"name": "encoder"},
    )
    yield Case(
        _called(angle_of(hums.TachometerWaveform), "TachometerWaveform"),
        {"values": teeth, "shaft": "input", "pulses_per_rev": 1},
        {"units": "V", "name": "encoder", "rate_hz": 1000.0, "full_scale": 10.0},
    )
    yield Case(_called(angle_of(hums.NominalSpeed), "NominalSpeed"), {"rpm": 600.0, "shaft": "in"})


def _called(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Return a function under the name of a class of `hums.records`."""
    function.__name__, function.__module__ = name, "hums.records.record"
    return function

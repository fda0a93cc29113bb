"""Odd calls of every exported function: a result or a sentence; equal numbers have equal answers."""

import faulthandler
import inspect
import os
import re
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from types import UnionType
from typing import Literal, get_args, get_origin

import numpy as np
import pytest
from attacks.call_cases import all_cases, exported
from attacks.odd_calls import answers_that_differ, failure, odd_calls

from signals import (
    cepstrum_prewhitening,
    quadrature_direction,
    track_orders,
)

ROOT = Path.cwd()
SEED = 20
SAMPLE = 120  # of some 8,000, and of some 2,500; benchmarks/attack.py makes all of them
KILL_S = 60
PAIR = ("first", "second")


RATE_HZ = 2048
X = np.round(1000 * np.random.default_rng(SEED).standard_normal(6144))


@pytest.fixture(scope="module")
def every(tmp_path_factory):
    folder = tmp_path_factory.mktemp("calls")
    os.chdir(folder)  # some odd calls name files
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield all_cases(folder)
    os.chdir(ROOT)


@pytest.fixture(scope="module")
def cases(every):
    return [case for case in every if case.function.__module__.startswith("signals")]


@pytest.fixture(scope="module")
def labelled(every, cases):
    return [case for case in every if case not in cases]


@pytest.mark.usefixtures("every")  # its modules are imported
def test_names_of_types_are_known_where_arguments_are_checked():
    # under a name that type checkers alone import, `checked` would take a choice for a class and refuse its words
    choices = {
        name
        for at, module in sys.modules.items()
        if at.split(".")[0] in {"signals", "hums", "data_synth"}
        for name, thing in vars(module).items()
        if get_origin(thing) is Literal or (isinstance(thing, UnionType) and all(map(inspect.isclass, get_args(thing))))
    }
    assert {"Estimator", "Method", "Scaling", "Workers"} <= choices
    for function in exported():
        checked = getattr(function, "__wrapped__", function)
        named = choices & set(re.findall(r"\w+", str(inspect.signature(checked))))
        assert named <= checked.__globals__.keys(), function.__name__


@pytest.mark.parametrize("which", ["cases", "labelled"])
def test_odd_calls_give_a_result_or_a_sentence(which, request):
    calls = odd_calls(request.getfixturevalue(which))
    wrong = []
    for place in np.random.default_rng(SEED).choice(len(calls), SAMPLE, replace=False):
        odd = calls[place]
        faulthandler.dump_traceback_later(KILL_S, exit=True)
        if found := failure(odd):
            wrong.append(f"{odd}: {found}")
    faulthandler.cancel_dump_traceback_later()
    assert not wrong, "\n".join(wrong)


def shorter(case):
    """Return a call with a part of its signals, where each sample takes long."""
    if case.function is not quadrature_direction:
        return case
    return replace(case, arguments={**case.arguments, **{name: case.arguments[name][:1000] for name in PAIR}})


def test_types_layouts_and_units_do_not_change_the_answer(cases):
    assert not [wrong for case in cases for wrong in answers_that_differ(shorter(case))]


def test_a_masked_value_is_as_one_that_is_not_a_number(cases):
    """Whether refused or not; what lies beneath a mask is often -999."""

    def outcome(case, **changed):
        try:
            return case.function(**(case.arguments | changed)) and ""
        except ValueError as error:
            return str(error)

    wrong = []
    for case in map(shorter, cases):
        for name, values in case.arguments.items():
            if isinstance(values, np.ndarray) and values.dtype.kind == "f" and values.size > SAMPLE:
                mask = np.arange(values.size) == values.size // 2
                masked = np.ma.array(np.where(mask, -999, values), mask=mask)
                if outcome(case, **{name: masked}) != outcome(case, **{name: masked.filled(np.nan)}):
                    wrong.append(f"{case.function.__name__}, {name}")
    assert not wrong


def test_a_read_only_array_compiles_nothing():
    from numba.core import event  # noqa: PLC0415 - takes a second

    angle = 2 * np.pi * 8 * np.arange(X.size) / RATE_HZ
    settings = {"orders": [1.0], "bandwidth_hz": 1.0, "rate_hz": RATE_HZ}
    track_orders(X, phase_rad=angle, **settings)
    cepstrum_prewhitening(X)
    frozen = X.copy()
    frozen.flags.writeable = angle.flags.writeable = False
    with event.install_recorder("numba:compile") as compiled:
        track_orders(frozen, phase_rad=angle, **settings)
        cepstrum_prewhitening(frozen)
    assert not compiled.buffer

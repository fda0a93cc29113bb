"""Odd calls of every exported function of `signals`: a result or a sentence; equal numbers have equal answers."""

import faulthandler
import inspect
import re
import sys
from typing import Literal, get_origin

import numpy as np
import pytest
from attacks.call_cases import RATE_HZ, angle_cases, exported, phase, signal_cases, tachometer_cases, waveform
from attacks.odd_calls import answers_that_differ, failure, odd_calls

from signals import angular_blocks, angular_resample, cepstrum_prewhitening, stream_envelope, track_orders

SEED = 20
SAMPLE = 200  # of some 8,000; benchmarks/attack.py makes all of them
KILL_S = 60
NOT_ATTACKED = {"refine_declared_speed"}  # have no valid call in `call_cases` yet


@pytest.fixture(scope="module")
def cases():
    return [*signal_cases(), *tachometer_cases(), *angle_cases()]


def test_every_function_of_signals_is_attacked(cases):
    ours = {function for function in exported() if function.__module__.split(".")[0] == "signals"}
    assert {function.__name__ for function in ours - {case.function for case in cases}} <= NOT_ATTACKED


def test_words_of_a_choice_are_known_where_arguments_are_checked():
    # under a name that type checkers alone import, `checked` would take a choice for a class and refuse its words
    modules = [module for name, module in sys.modules.items() if name.split(".")[0] == "signals"]
    choices = {name for module in modules for name, thing in vars(module).items() if get_origin(thing) is Literal}
    assert {"Estimator", "Method", "Scaling"} <= choices
    for function in exported():
        checked = getattr(function, "__wrapped__", function)
        named = choices & set(re.findall(r"\w+", str(inspect.signature(checked))))
        assert named <= checked.__globals__.keys(), function.__name__


def test_odd_calls_give_a_result_or_a_sentence(cases):
    calls = odd_calls(cases)
    wrong = []
    for place in np.random.default_rng(SEED).choice(len(calls), SAMPLE, replace=False):
        odd = calls[place]
        faulthandler.dump_traceback_later(KILL_S, exit=True)
        if found := failure(odd):
            wrong.append(f"{odd}: {found}")
    faulthandler.cancel_dump_traceback_later()
    assert not wrong, "\n".join(wrong)


def test_types_layouts_and_units_do_not_change_the_answer(cases):
    assert not [wrong for case in cases for wrong in answers_that_differ(case)]


@pytest.mark.parametrize("size", [1, 100, 1000, 6144])
def test_streams_equal_whole_records(size):
    # ends included, and at every size of block
    x = waveform()
    blocks = [x[first : first + size] for first in range(0, x.size, size)]
    whole = angular_resample(x, rate_hz=RATE_HZ, phase=phase(), samples_per_rev=64)
    stream = angular_blocks(blocks, rate_hz=RATE_HZ, phase=phase(), samples_per_rev=64)
    np.testing.assert_array_equal(np.concatenate([turn.values for turn in stream]), whole.values)
    envelopes = [
        np.concatenate(list(stream_envelope(parts, rate_hz=RATE_HZ, band_hz=(400.0, 800.0)))) for parts in (blocks, [x])
    ]
    np.testing.assert_array_equal(*envelopes)


def test_a_read_only_array_compiles_nothing():
    from signals.harmonics import _block_kernels  # noqa: PLC0415 - loads numba

    angle = 2 * np.pi * 8 * np.arange(waveform().size) / RATE_HZ
    settings = {"orders": [1.0], "bandwidth_hz": 1.0, "rate_hz": RATE_HZ}
    track_orders(waveform(), phase_rad=angle, **settings)
    kernels = [kernel for kernel in vars(_block_kernels).values() if hasattr(kernel, "signatures")]
    before = [len(kernel.signatures) for kernel in kernels]
    frozen = waveform().copy()
    frozen.flags.writeable = angle.flags.writeable = False
    track_orders(frozen, phase_rad=angle, **settings)
    cepstrum_prewhitening(frozen)
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert any(before)

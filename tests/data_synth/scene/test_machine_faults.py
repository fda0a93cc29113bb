import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from data_synth import SceneError, load_scene
from data_synth.scene.faults import ToothCrack
from data_synth.scene.machine_faults import Growth


def linear(**changes):
    return Growth(**{"rate_mm_per_s": 0.5, "largest_mm": 3.0, **changes})


def paris(**changes):
    return linear(**{"exponent": 4.0, "largest_mm": 5.0, **changes})


def test_the_plain_laws():
    assert_allclose(linear().relative_size([0, 2, 4, 9], initial_mm=1.0), [1, 2, 3, 3])
    assert_allclose(linear().relative_size([0, 2, 4, 9], initial_mm=0.5), [1, 3, 5, 6])
    slow = Growth(rate_mm_per_s=0.05, exponent=2.0, largest_mm=1.0)
    assert_allclose(0.1 * slow.relative_size([0, 2, 1e6], initial_mm=0.1), [0.1, 0.1 * math.e, 1])


def test_a_fault_without_growth_stays():
    fault = ToothCrack(kind="tooth_crack", component="stage 1/pinion", depth_mm=2.0)
    assert_allclose(fault.relative_size(np.linspace(0, 10, 41)), 1)
    grown = fault.changed(growth=linear())
    assert_allclose(grown.initial_mm * grown.relative_size(1.0), 2.5)


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0, 4.2])
def test_a_crack_obeys_paris(exponent):
    # the law itself, cycle by cycle as a rate, against the closed form: mild steel in SI, 30 contacts a second

    def law(_, size):
        return 30 * 1e-11 / 1e6**exponent * (1.12 * 3e8 * np.sqrt(np.pi * size)) ** exponent

    rate = law(0.0, 1e-3)
    span = 0.9e-3 / rate / max(1.0, exponent / 2 - 1)
    times = np.linspace(0, span, 20)
    exact = solve_ivp(law, (0, span), [1e-3], t_eval=times, rtol=1e-11, atol=1e-16).y[0]
    crack = paris(rate_mm_per_s=1e3 * rate, exponent=exponent, largest_mm=1e3)
    assert_allclose(1e-3 * crack.relative_size(times, initial_mm=1.0), exact, rtol=1e-8)


def test_a_crack_that_runs_away_stays_at_its_largest():
    # with m = 4 the closed form is one over 1 - t / 2
    assert_allclose(paris().relative_size([0, 1, 1.5, 1.7, 2, 50], initial_mm=1.0), [1, 2, 4, 5, 5, 5])


@pytest.mark.parametrize("changes", [{"rate_mm_per_s": 0.0}, {"exponent": math.nan}, {"largest_mm": -1.0}])
def test_what_makes_no_sense_is_refused(changes):
    with pytest.raises(ValueError, match=next(iter(changes))):
        paris(**changes)


def test_growth_to_less_than_the_size_is_refused():
    grown = {"rate_mm_per_s": 1.0, "largest_mm": 0.5}
    with pytest.raises(SceneError, match=r"largest_mm = 0\.5 is less than the initial size, 1 mm"):
        load_scene("gears-in-motion").changed(
            faults=({"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": 1.0, "growth": grown},)
        )

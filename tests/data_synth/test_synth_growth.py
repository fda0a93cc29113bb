import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from data_synth.growth import ConstantSize, ExponentialGrowth, LinearGrowth, ParisGrowth, paris_rate

TIMES = np.linspace(0, 10, 41)


def test_the_plain_laws():
    assert_allclose(ConstantSize(initial=2.0).size(TIMES), 2)
    assert_allclose(LinearGrowth(initial=1, rate_per_s=0.5, largest=3).size([0, 2, 4, 9]), [1, 2, 3, 3])
    assert_allclose(LinearGrowth(initial=1, rate_per_s=-0.5).size([0, 2, 9]), [1, 0, 0])
    assert_allclose(
        ExponentialGrowth(initial=0.1, time_constant_s=2, largest=1).size([0, 2, 1e6]), [0.1, 0.1 * math.e, 1]
    )


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0, 4.2])
def test_a_crack_obeys_paris(exponent):
    # the law itself, cycle by cycle as a rate, against the closed form: mild steel in SI, 30 contacts a second
    steel = {"coefficient": 1e-11 / 1e6**exponent, "exponent": exponent}
    load = {"stress_range_pa": 3e8, "geometry": 1.12, "cycles_hz": 30.0}
    rate = paris_rate(size_m=1e-3, **steel, **load)
    span = 0.9e-3 / rate / max(1.0, exponent / 2 - 1)

    def law(_, size):
        return 30 * steel["coefficient"] * (1.12 * 3e8 * np.sqrt(np.pi * size)) ** exponent

    times = np.linspace(0, span, 20)
    exact = solve_ivp(law, (0, span), [1e-3], t_eval=times, rtol=1e-11, atol=1e-16).y[0]
    crack = ParisGrowth(initial=1e-3, rate_per_s=rate, exponent=exponent, largest=1.0)
    assert_allclose(crack.size(times), exact, rtol=1e-8)


def test_a_crack_that_runs_away_stays_at_its_largest():
    crack = ParisGrowth(initial=1.0, rate_per_s=0.5, exponent=4.0, largest=5.0)  # 1 / (1 - t / 2)
    assert_allclose(crack.size([0, 1, 1.5, 1.7, 2, 50]), [1, 2, 4, 5, 5, 5])


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: ConstantSize(initial=-1), "initial = -1"),
        (lambda: ConstantSize(initial=math.nan), "initial = nan"),
        (lambda: ExponentialGrowth(initial=1, time_constant_s=0, largest=1), "growth takes time"),
        (lambda: ParisGrowth(initial=0, rate_per_s=1, exponent=3, largest=1), "a crack grows from a crack"),
    ],
)
def test_what_makes_no_sense_is_refused(make, sentence):
    with pytest.raises(ValueError, match=sentence):
        make()

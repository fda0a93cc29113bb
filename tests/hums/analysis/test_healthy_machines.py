"""The probability over healthy machines against the law it is estimated from."""

import numpy as np
import pytest

from hums.analysis.healthy_machines import HealthyMachines, healthy_machines

DRAWS = np.random.default_rng(3).exponential(size=5000)
LIBRARY = HealthyMachines(records=500, parts=DRAWS.size, strengths=tuple(np.sort(DRAWS)[::-1][:400]))


def test_of_healthy_records_the_share_p_gets_p_or_less():
    records = np.random.default_rng(4).exponential(size=(4000, 10)).max(axis=1)
    chances = np.array([LIBRARY.probability(one, parts=10) for one in records])
    for stated in (0.01, 0.05):
        # the library's own scatter is that of 5 and 25 of its parts: 45 and 20 %
        assert np.mean(chances <= stated) == pytest.approx(stated, rel=0.6)


def test_nothing_below_one_in_the_records_is_stated():
    assert LIBRARY.probability(1e9) == pytest.approx(1 / 501)
    assert LIBRARY.probability(0.0) == 1.0


def test_the_strength_at_a_probability_is_its_inverse():
    for stated in (0.004, 0.02, 0.3):
        strength = LIBRARY.strength_at(stated, parts=4)
        assert LIBRARY.probability(strength, parts=4) <= stated
        assert LIBRARY.probability(strength * (1 - 1e-6), parts=4) >= stated * (1 - 1e-3)
    assert LIBRARY.strength_at(1e-6) == np.inf


# a strength of bearings is a depth of all harmonics; of teeth the exponent of a probability
@pytest.mark.parametrize(("parts", "most"), [("bearings", 2), ("teeth", 30)])
def test_the_shipped_library_is_sound(parts, most):
    shipped = healthy_machines(parts)
    assert shipped.records > 200  # so that the half of a stated 0.01, which gears and bearings share, is reached
    assert shipped.parts > shipped.records
    assert list(shipped.strengths) == sorted(shipped.strengths, reverse=True)
    assert all(0 < one < most for one in shipped.strengths)

"""Arguments of a type that agreed before are refused for what they hold."""

import numpy as np
import pytest

from signals import comb_gain, constant_speed, displacement, track_orders

X = np.ones(1000)


def tracked(orders):
    return track_orders(X, phase_rad=0.3 * np.arange(1000), orders=orders, bandwidth_hz=0.02, rate_hz=1.0)


@pytest.mark.parametrize(
    ("call", "name", "good", "bad"),
    [
        (lambda v: constant_speed(v, start_s=0, stop_s=1), "speed_hz", 3, 10**400),  # larger than a float
        (lambda v: constant_speed(v, start_s=0, stop_s=1), "speed_hz", 3.0, "3"),
        (lambda v: displacement(v, rate_hz=500, units="g", band_hz=(10, 100)), "x", X, [[1, 2], [3]]),
        (lambda v: displacement(X, rate_hz=500, units="g", band_hz=v), "band_hz", (10.0, 100.0), (10.0, "100")),
        (lambda v: displacement(X, rate_hz=500, units="g", band_hz=v), "band_hz", np.array([10, 100]), np.ones(3)),
        (tracked, "order", [1.0, 2.0], [1.0, "2"]),
        (lambda v: comb_gain(v, revolutions=2), "order", 1.5, [1.5, "2"]),
    ],
)
def test_a_value_of_a_type_that_agreed_is_refused_for_what_it_holds(call, name, good, bad):
    call(good)
    with pytest.raises((TypeError, ValueError), match=name):
        call(bad)

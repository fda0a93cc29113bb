"""The solver against rigid bodies that roll on each other: geometry only, written out here once more by hand."""

from fractions import Fraction as F  # noqa: N817

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from oracles import Gear, rolling_oracle

from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox


def _axis(draws):
    vector = np.array(draws)
    assume(np.linalg.norm(vector) > 0.3)
    return tuple((vector / np.linalg.norm(vector)).tolist())


directions = st.tuples(*[st.floats(-1, 1)] * 3).map(lambda v: tuple(round(c, 3) for c in v))
teeth = st.integers(10, 90).flatmap(lambda count: st.sampled_from([count, -count]))


def _apart(one, other):
    assume(np.linalg.norm(np.cross(one, other)) > 0.1)


@given(main=directions, slanted=directions, counts=st.tuples(teeth, teeth, teeth, teeth), carrier=st.booleans())
@settings(max_examples=20)
def test_any_bevel_planet_with_two_wheels(main, slanted, counts, carrier):
    main, slanted = _axis(main), _axis(slanted)
    _apart(main, slanted)
    first, planet_first, second, planet_second = counts
    # two drives must settle the motion: not the two wheels where these would turn as one with the planet
    assume(abs(F(first, planet_first) - F(second, planet_second)) > F(1, 100))
    driven = {"first": F(1), ("carrier" if carrier else "second"): F(-2, 3)}
    links = ["housing", "first", "second", "carrier", "planet"]
    kinematics = solve_kinematics(
        Gearbox.from_mapping(
            {
                "name": "bevel planet",
                "frame": "housing",
                "axes": {
                    "main": {"direction": main, "links": links[:4]},
                    "planet": {"direction": slanted, "links": ["carrier", "planet"]},
                },
                "mesh": [
                    {"teeth": {"first": first, "planet": planet_first}},
                    {"teeth": {"second": second, "planet": planet_second}},
                ],
            }
        )
    )
    assert kinematics.dof == 2
    expected = rolling_oracle(
        bodies=5,
        hinges=[*((0, k, main) for k in (1, 2, 3)), (3, 4, slanted)],
        contacts=[
            (Gear(body=wheel, teeth=count, axis=main), Gear(body=4, teeth=mate, axis=slanted))
            for wheel, count, mate in ((1, first, planet_first), (2, second, planet_second))
        ],
        drives=[(links.index(link), main, float(rate)) for link, rate in driven.items()],
    )
    found = kinematics.vectors(driven).sel(link=links)
    np.testing.assert_allclose(expected, found, rtol=0, atol=1e-8 * np.abs(found).max())

"""The solver against rigid bodies that roll on each other: geometry only, written out here once more by hand."""

import warnings
from dataclasses import dataclass
from fractions import Fraction as F  # noqa: N817
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from oracles import Gear, Hinge, rolling_oracle
from scipy.spatial.transform import Rotation

from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, GearboxWarning, load_gearbox

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A gearbox of the catalogue and its geometry: bodies by number, their names, the axis and carrier of each."""

    links: tuple[str, ...]
    axes: dict[str, tuple]  # link: (direction at the start, the link that carries this axis, a point of it)
    contacts: tuple[tuple[Gear, Gear], ...]
    speeds: dict[str, F]
    duration: float = 2 * np.pi

    def hinges(self):
        return [
            Hinge(bodies=(self.links.index(carrier), self.links.index(link)), direction=direction, point=point)
            for link, (direction, carrier, point) in self.axes.items()
        ]

    def drives(self):
        return [(self.links.index(link), self.axes[link][0], float(rate)) for link, rate in self.speeds.items()]


ORIGIN = (0, 0, 0)
DIFFERENTIAL = Case(
    links=("car", "drive shaft", "left wheel", "right wheel", "planet a", "planet b", "cage"),
    axes={
        "drive shaft": (X, "car", (0, 0, 39)),  # (13 + 65) / 2 beside the wheels
        "left wheel": (X, "car", ORIGIN),
        "right wheel": (X, "car", ORIGIN),
        "cage": (X, "car", ORIGIN),
        "planet a": (Y, "cage", ORIGIN),
        "planet b": (Y, "cage", ORIGIN),
    },
    contacts=(
        (Gear(body=1, teeth=13, axis=X, centre=(0, 0, 39)), Gear(body=6, teeth=65, axis=X)),
        *(
            (Gear(body=wheel, teeth=side * 14, axis=X), Gear(body=planet, teeth=above * 10, axis=Y))
            for wheel, side in ((2, -1), (3, 1))
            for planet, above in ((4, 1), (5, -1))
        ),
    ),
    speeds={"left wheel": F(-1), "right wheel": F(3, 2)},
    duration=4.0,
)
ALOUETTE = Case(
    links=(
        "housing",
        "input",
        "main shaft",
        "tail",
        "lower carrier",
        "lower planet",
        "upper carrier",
        "upper planet",
    ),
    axes={
        "input": (X, "housing", ORIGIN),
        "main shaft": (Y, "housing", ORIGIN),
        "tail": (X, "housing", (0, -90, 0)),
        "lower carrier": (Y, "housing", ORIGIN),
        "lower planet": (Y, "lower carrier", (0, 50, 36)),  # (51 + 21) / 2
        "upper carrier": (Y, "housing", ORIGIN),
        "upper planet": (Y, "upper carrier", (-36, 80, 0)),
    },
    contacts=(
        (Gear(body=1, teeth=20, axis=X), Gear(body=2, teeth=-41, axis=Y)),
        (
            Gear(body=2, teeth=-17, axis=Y, centre=(0, -90, 0)),
            Gear(body=3, teeth=20, axis=X, centre=(0, -90, 0)),
        ),
        *(
            (Gear(body=body, teeth=teeth, axis=Y, centre=(0, y, 0)), Gear(body=planet, teeth=21, axis=Y, centre=at))
            for planet, y, at, gears in (
                (5, 50, (0, 50, 36), ((2, 51), (0, -93))),
                (7, 80, (-36, 80, 0), ((4, 51), (0, -93))),
            )
            for body, teeth in gears
        ),
    ),
    speeds={"input": F(1)},
)


def _round(radius, degrees):
    angle = np.radians(degrees)
    return (0.0, radius * np.cos(angle), radius * np.sin(angle))


def _ravigneaux():
    # long planets at (36 + 18) / 2 from the middle, short ones at (30 + 18) / 2, their centres 18 apart
    lead = np.degrees(np.arccos((27**2 + 24**2 - 18**2) / (2 * 27 * 24)))
    links = ["housing", "small sun", "large sun", "ring", "carrier"]
    axes = dict.fromkeys(links[1:], (X, "housing", ORIGIN))
    contacts = []
    for number in range(3):
        short, long = len(links), len(links) + 1
        at_long, at_short = _round(27, 120 * number), _round(24, 120 * number + lead)
        for name, place in (("short", at_short), ("long", at_long)):
            links.append(f"{name} planet {number + 1}")
            axes[links[-1]] = (X, "carrier", place)
        small, wide = (
            Gear(body=body, teeth=18, axis=X, centre=place) for body, place in ((short, at_short), (long, at_long))
        )
        contacts += [
            (Gear(body=1, teeth=30, axis=X), small),
            (small, wide),
            (Gear(body=2, teeth=36, axis=X), wide),
            (Gear(body=3, teeth=-72, axis=X), wide),
        ]
    return Case(
        links=tuple(links),
        axes=axes,
        contacts=tuple(contacts),
        speeds={"small sun": F(1), "large sun": F(-1, 3)},
        duration=4.0,
    )


CASES = {
    "car-differential": DIFFERENTIAL,
    "alouette-iii": ALOUETTE,
    "ravigneaux": _ravigneaux(),
}


@pytest.mark.parametrize("name", CASES)
def test_the_catalogue_rolls_without_slip(name):
    case = CASES[name]
    duration = case.duration / 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GearboxWarning)  # of tooth numbers that fit no centre distance
        kinematics = solve_kinematics(load_gearbox(name))
    vectors = kinematics.vectors(case.speeds).sel(link=list(case.links))
    fastest = np.linalg.norm(vectors, axis=1).max()
    motion = rolling_oracle(
        bodies=len(case.links),
        hinges=case.hinges(),
        contacts=case.contacts,
        drives=case.drives(),
        duration=duration,
        # 0.05 rad a step: Runge-Kutta errs by 0.05^5 / 120 in each, less than 1e-6 in 300 of them
        steps=int(np.ceil(duration * fastest / 0.05)),
    )
    assert motion.open == 0
    assert motion.slip < 1e-9  # what least squares leaves, in teeth per unit of time

    np.testing.assert_allclose(motion.velocities, vectors, rtol=0, atol=1e-10)  # one solve, cond about 1e4

    # at the end: every turning pair has turned by its constant rate, planets round their moving axes
    poses = {case.links[0]: np.eye(3)}
    for link, (direction, carrier, _) in case.axes.items():
        turned = float(kinematics.relative_speed(link, seen_from=carrier, speeds=case.speeds)) * duration
        poses[link] = poses[carrier] @ Rotation.from_rotvec(turned * np.array(direction)).as_matrix()
    for number, link in enumerate(case.links):
        np.testing.assert_allclose(motion.poses[number], poses[link], rtol=0, atol=1e-6, err_msg=link)


def _axis(draws):
    vector = np.array(draws)
    assume(np.linalg.norm(vector) > 0.3)
    return tuple((vector / np.linalg.norm(vector)).tolist())


directions = st.tuples(*[st.floats(-1, 1)] * 3).map(lambda v: tuple(round(c, 3) for c in v))
teeth = st.integers(10, 90).flatmap(lambda count: st.sampled_from([count, -count]))


def _apart(one, other):
    assume(np.linalg.norm(np.cross(one, other)) > 0.1)


@given(axes=st.lists(directions, min_size=2, max_size=5), counts=st.lists(teeth, min_size=8, max_size=8))
@settings(max_examples=20)
def test_a_bevel_train_round_one_apex(axes, counts):
    axes = [_axis(vector) for vector in axes]
    for one, other in pairwise(axes):
        _apart(one, other)
    pairs = list(zip(counts[0::2], counts[1::2], strict=True))[: len(axes) - 1]
    kinematics = solve_kinematics(
        Gearbox.from_mapping(
            {
                "name": "train",
                "frame": "housing",
                "reference": "gear 0",
                "axes": {f"axis {k}": {"direction": a, "links": ["housing", f"gear {k}"]} for k, a in enumerate(axes)},
                "mesh": [{"teeth": {f"gear {k}": a, f"gear {k + 1}": b}} for k, (a, b) in enumerate(pairs)],
            }
        )
    )
    motion = rolling_oracle(
        bodies=len(axes) + 1,
        hinges=[Hinge(bodies=(0, k + 1), direction=axis) for k, axis in enumerate(axes)],
        contacts=[
            (Gear(body=k + 1, teeth=a, axis=axes[k]), Gear(body=k + 2, teeth=b, axis=axes[k + 1]))
            for k, (a, b) in enumerate(pairs)
        ],
        drives=[(1, axes[0], 1.0)],
    )
    found = kinematics.vectors().sel(link=["housing", *[f"gear {k}" for k in range(len(axes))]])
    assert motion.open == 0
    # ratios reach 9^4; relative to the fastest gear
    np.testing.assert_allclose(motion.velocities, found, rtol=0, atol=1e-9 * np.abs(found).max())


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
    motion = rolling_oracle(
        bodies=5,
        hinges=[
            *(Hinge(bodies=(0, k), direction=main) for k in (1, 2, 3)),
            Hinge(bodies=(3, 4), direction=slanted),
        ],
        contacts=[
            (Gear(body=wheel, teeth=count, axis=main), Gear(body=4, teeth=mate, axis=slanted))
            for wheel, count, mate in ((1, first, planet_first), (2, second, planet_second))
        ],
        drives=[(links.index(link), main, float(rate)) for link, rate in driven.items()],
    )
    found = kinematics.vectors(driven).sel(link=links)
    assert motion.open == 0
    np.testing.assert_allclose(motion.velocities, found, rtol=0, atol=1e-8 * np.abs(found).max())


class TestTheOracle:
    """What it says of mechanisms nobody needs a program for."""

    def test_a_coin_that_rolls_round_another_turns_twice(self):
        motion = rolling_oracle(
            bodies=3,
            hinges=[Hinge(bodies=(0, 1), direction=X), Hinge(bodies=(1, 2), direction=X, point=(0, 2, 0))],
            contacts=[(Gear(body=0, teeth=1, axis=X), Gear(body=2, teeth=1, axis=X, centre=(0, 2, 0)))],
            drives=[(1, X, 1.0)],
        )
        np.testing.assert_allclose(motion.velocities[2], [2, 0, 0], atol=1e-12)

    def test_three_wheels_in_a_ring_cannot_turn(self):
        corners = (ORIGIN, (0, 20, 0), (0, 10, np.sqrt(300)))
        gears = [Gear(body=k + 1, teeth=10, axis=X, centre=corner) for k, corner in enumerate(corners)]
        motion = rolling_oracle(
            bodies=4,
            hinges=[Hinge(bodies=(0, k + 1), direction=X, point=corner) for k, corner in enumerate(corners)],
            contacts=[(gears[0], gears[1]), (gears[1], gears[2]), (gears[2], gears[0])],
            drives=[(1, X, 1.0)],
        )
        assert motion.slip > 0.1  # driven all the same, something slips

"""Where the parts of a gearbox are drawn: the drawing has to obey the kinematics that is solved without it."""

import itertools
import warnings
from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.layout import layout_of, transverse_axes
from hums.gearbox.model import Gearbox, GearboxWarning, catalogue, load_gearbox

NAMES = tuple(catalogue())
SHIFTED = {"oh-58"}  # its planets roll on two pitch circles, sun and ring: drawn between them


@cache
def drawn(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GearboxWarning)
        gearbox = load_gearbox(name)
    return gearbox, layout_of(gearbox)


def speeds_of(kinematics):
    """Give speeds to as many links as there are degrees of freedom, each a different one."""
    given = {}
    for link in kinematics.links:
        body = kinematics.bodies[link]
        on_frame = body in kinematics.joints and kinematics.joints[body].carried_by == kinematics.mechanism.frame
        if not on_frame:
            continue
        try:
            kinematics.rates(given)
        except ValueError:
            trial = given | {link: Fraction(len(given) + 1)}
            try:
                kinematics.rates(trial)
            except ValueError as error:
                if "contradict" in str(error):
                    continue
            given = trial
    return given


def velocity_at(point, body, kinematics, layout, omega):
    """Velocity of a point of a body: that of its axis, which the carrier moves, and its own rotation about it."""
    pairs = {pair.body: pair for pair in layout.pairs}
    if body not in pairs:
        return np.zeros(3)
    pair = pairs[body]
    centre = np.array(pair.point)
    moved = velocity_at(centre, pair.carried_by, kinematics, layout, omega)
    return moved + np.cross(omega[body], point - centre)


@pytest.mark.parametrize("name", NAMES)
def test_gears_roll_on_each_other(name):
    # rolling without slip, from angular velocities alone: both gears move alike where they touch
    gearbox, layout = drawn(name)
    kinematics = solve_kinematics(gearbox)
    vectors = kinematics.vectors(speeds_of(kinematics))
    omega = {body: vectors.sel(link=body).to_numpy() for body in kinematics.joints}
    for contact, mesh in zip(kinematics.contacts, layout.meshes, strict=True):
        bodies = [kinematics.bodies[link] for link, _ in contact.gears]
        one, two = (velocity_at(np.array(mesh.point), body, kinematics, layout, omega) for body in bodies)
        scale = max(np.linalg.norm(one), np.linalg.norm(np.array(mesh.point)))
        np.testing.assert_allclose(one, two, atol=1e-9 * scale)  # rounding of a few products
        if name in SHIFTED:
            continue
        for link, teeth in contact.gears:
            gear = next(
                gear
                for gear in layout.gears
                if gear.link == link
                and gear.teeth == abs(teeth)
                and mesh.mesh in gear.meshes
                and np.isclose(np.linalg.norm(np.cross(np.array(mesh.point) - gear.centre, gear.axis)), gear.radius)
            )
            assert gear.radius > 0


def test_printed_diameters():
    # Wijianto, table 1: 128.81 and 225.43 mm
    _, layout = drawn("wijianto-pair")
    assert [round(2 * gear.radius, 2) for gear in layout.gears] == [128.81, 225.43]
    assert (layout.unit, layout.notes) == ("mm", ("Pitch circles are to scale.",))


def gap_of(normal, gear, point):
    """Part of a pitch from a tooth of a gear to the pitch point."""
    e1, e2 = (np.array(axis) for axis in transverse_axes(gear.axis, normal))
    arm = np.array(point) - gear.centre
    return (np.arctan2(arm @ e2, arm @ e1) - gear.tooth_rad) * gear.teeth / (2 * np.pi)


@pytest.mark.parametrize("name", ["two-stage", "planetary-27-36-99", "glinsky-planetary-3", "nelson-bevel-planet"])
def test_teeth_meet_gaps(name):
    # all round: (27 + 99) / 3 and (24 + 60) / 3 are whole, so evenly spaced planets fit both gears
    gearbox, layout = drawn(name)
    kinematics = solve_kinematics(gearbox)
    normal = tuple(np.cross(layout.across, layout.up))
    for contact, mesh in zip(kinematics.contacts, layout.meshes, strict=True):
        pasts, tangents = [], []
        for link, teeth in contact.gears:
            gear = next(g for g in layout.gears if (g.link, g.teeth) == (link, abs(teeth)))
            pasts.append(gap_of(normal, gear, mesh.point))
            tangents.append(np.cross(gear.axis, np.array(mesh.point) - gear.centre))
        along = np.sign(tangents[0] @ tangents[1])
        assert (pasts[1] - along * pasts[0]) % 1 == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_gears_of_one_axis_do_not_cover_each_other(name):
    _, layout = drawn(name)
    solid = [gear for gear in layout.gears if not gear.internal and not gear.cone_rad]
    for one, two in itertools.combinations(solid, 2):
        apart = np.array(two.centre) - one.centre
        if one.body != two.body and np.linalg.norm(np.cross(apart, one.axis)) < 1e-6:
            assert abs(apart @ one.axis) >= (one.face + two.face) / 2 - 1e-9


def declared(**changes):
    table = {
        "name": "pair",
        "frame": "box",
        "reference": "a",
        "axes": {
            "one": {"links": ["box", "a"], "through": [0, 0, 0]},
            "two": {"links": ["box", "b"], "through": [0, 0, 63]},
        },
        "mesh": [{"teeth": {"a": 20, "b": 40}, "module_mm": 2, "position_mm": 100}],
    }
    return layout_of(Gearbox.from_mapping(table | changes))


def test_declared_places_are_kept():
    layout = declared()
    assert [gear.centre for gear in layout.gears] == [(100, 0, 0), (100, 0, 63)]
    assert [gear.radius for gear in layout.gears] == pytest.approx([21, 42])  # the operating circles of 63 mm: 1 to 2


def test_a_belt_does_not_touch():
    layout = declared(
        axes={"one": ["box", "a"], "two": ["box", "b"]},
        mesh=[{"teeth": {"a": 20, "b": -40}, "kind": "belt", "module_mm": 5}],
    )
    one, two = layout.gears
    assert not two.internal
    assert np.linalg.norm(np.array(one.centre) - two.centre) > one.radius + two.radius
    assert any("schematic" in note for note in layout.notes)

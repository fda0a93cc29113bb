"""The assembler against published and independently computed systems; figures as printed where they come from."""

import itertools
import math

import numpy as np
import pytest
from mpmath import mp
from numpy.testing import assert_allclose
from published_systems import ALPHA, INERTIAS, MASSES, RADII, chaari, wijianto

from data_synth.dynamics.assembly import (
    MeshProperties,
    SupportStiffness,
    assemble,
)
from data_synth.dynamics.elements import Coupling, GearMesh, Shaft, Support, line_of_action_direction
from data_synth.dynamics.modes import eigenvalues, solve_modes
from data_synth.dynamics.system import SPACE, Body, MeshHistory, build_system
from data_synth.gears.friction import SlidingFriction
from data_synth.gears.geometry import GearPair
from data_synth.gears.mesh_stiffness import Constant
from hums.gearbox.model import load_gearbox


def test_wijianto_s_pair_to_every_printed_digit():
    system = wijianto()
    assert system.names == ("pinion x", "pinion rotation", "gear x", "gear rotation")
    assert_allclose(system.meshes[0].direction, [1, -RADII[0], -1, RADII[1]], rtol=1e-15)
    modes = solve_modes(system)
    # 12 printed digits
    assert_allclose(modes.angular, [0, 692.22774872, 2467.11467008, 4316.6385243], rtol=1e-11)
    assert_allclose(modes.shapes.T @ system.mass @ modes.shapes, np.eye(4), atol=1e-13)


@pytest.mark.parametrize("bearing", [1e8, 1e10, 1e12, 1e14, 1e16])
def test_soft_modes_keep_their_digits_beside_stiff_bearings(bearing):
    # the sum of matrices would leave 1e-16 * 1e16 / 1e6: nothing
    with mp.workdps(60):
        h = [1, -mp.mpf(RADII[0]), -1, mp.mpf(RADII[1])]
        weights = [mp.mpf(v) for v in (MASSES[0], INERTIAS[0], MASSES[1], INERTIAS[1])]
        matrix = mp.matrix(4, 4)
        for i, j in itertools.product(range(4), range(4)):
            stiffness = 10**6 * h[i] * h[j] + (mp.mpf(bearing) if i == j and i % 2 == 0 else 0)
            matrix[i, j] = stiffness / mp.sqrt(weights[i] * weights[j])
        exact = [float(mp.sqrt(abs(value))) for value in sorted(mp.eigsy(matrix, eigvals_only=True))]
    modes = solve_modes(wijianto(bearing=bearing))
    assert modes.frequencies_hz[0] == 0
    assert_allclose(modes.angular[1:], exact[1:], rtol=2e-15)  # some roundings of one product each


def test_chaari_s_eight_degrees_of_freedom():
    expected = [0, 517.2061, 1006.5842, 1055.6283, 1186.2709, 1203.597, 1958.4323, 4481.5958]
    assert_allclose(solve_modes(chaari()).frequencies_hz, expected, atol=5.1e-5)  # four decimals are printed


# ---- Lin and Parker 1999, J. Vib. Acoust. 121:316, table 1: from a declared gearbox -----------------------------


# ---- elements ------------------------------------------------------------------------------------------------


def test_a_spinning_rotor_whirls_as_euler_says():
    # a disc held against tilt alone: k - I w^2 +- J W w = 0
    body = Body(name="disc", mass_kg=1, inertia_kgm2=0.02, tilt_inertia_kgm2=0.012, motions=SPACE, speed_ratio=1.0)
    hold = Support(between=("disc", None), x=1e6, y=1e6, z=1e6, tilt_x=1e4, tilt_y=1e4, torsion=1e3)
    values = eigenvalues(build_system([body], [hold], speed_rad_s=800.0))
    gyro = 0.02 * 800
    whirl = [(sign * gyro + math.sqrt(gyro**2 + 4 * 0.012 * 1e4)) / (2 * 0.012) for sign in (-1, 1)]
    rates = np.sort(values.imag[values.imag > 0])
    for rate in whirl:
        assert np.min(np.abs(rates / rate - 1)) < 1e-12


@pytest.mark.parametrize("bore", [0.0, 0.02])
def test_a_shaft_is_timoshenko_s_beam(bore):
    length, diameter, young, poisson = 0.2, 0.04, 206e9, 0.3
    bodies = [
        Body(name="clamp", mass_kg=1, inertia_kgm2=1, tilt_inertia_kgm2=1, motions=SPACE),
        Body(name="end", mass_kg=1, inertia_kgm2=1, tilt_inertia_kgm2=1, motions=SPACE, centre_m=(0, 0, length)),
    ]
    system = build_system(bodies, [Shaft(between=("clamp", "end"), diameter_m=diameter, bore_m=bore)])
    free = np.array([name.startswith("end") for name in system.names])
    compliance = np.linalg.inv(system.stiffness[np.ix_(free, free)])
    names = [name.removeprefix("end ") for name in np.array(system.names)[free].tolist()]
    at = {name: number for number, name in enumerate(names)}
    area, second = math.pi / 4 * (diameter**2 - bore**2), math.pi / 64 * (diameter**4 - bore**4)
    shear = young / (2 * (1 + poisson))
    kappa = 6 * (1 + poisson) / (7 + 6 * poisson)
    tip = length**3 / (3 * young * second) + length / (kappa * shear * area)
    for name, value in {
        "x": tip,
        "y": tip,
        "z": length / (young * area),
        "rotation": length / (shear * 2 * second),
        "tilt x": length / (young * second),
    }.items():
        assert compliance[at[name], at[name]] == pytest.approx(value, rel=1e-11)
    # a force along x tips the end about +y, one along y about -x
    assert compliance[at["tilt y"], at["x"]] == pytest.approx(length**2 / (2 * young * second), rel=1e-11)
    assert compliance[at["tilt x"], at["y"]] == pytest.approx(-(length**2) / (2 * young * second), rel=1e-11)
    # six motions of the whole strain nothing
    assert np.linalg.matrix_rank(system.stiffness, tol=1e-6 * np.abs(system.stiffness).max()) == 6


@pytest.mark.parametrize("hand", ["left", "right"])
@pytest.mark.parametrize("flank", [1, -1])
def test_a_helical_mesh_follows_the_rules_of_the_thumb_and_of_conjugate_motion(flank, hand):
    pair = GearPair(
        teeth=(36, 63), module_m=3.5e-3, face_width_m=0.05, pressure_angle_rad=ALPHA, helix_angle_rad=math.radians(12)
    )
    radius, towards = pair.working_radii_m[0], 0.7
    away = np.array([math.cos(towards), math.sin(towards), 0])
    point, axis = tuple(radius * away), np.array([0.0, 0, 1])
    direction = line_of_action_direction(
        along=axis,
        away=away,
        pressure_angle_rad=pair.working_angle_rad,
        flank=flank,
        base_helix_rad=pair.base_helix_rad,
        hand=hand,
    )
    distance = pair.centre_distance_m
    bodies = [
        Body(name="a", mass_kg=1, inertia_kgm2=1, tilt_inertia_kgm2=1, motions=SPACE),
        Body(
            name="b",
            mass_kg=1,
            inertia_kgm2=1,
            tilt_inertia_kgm2=1,
            motions=SPACE,
            centre_m=(distance * math.cos(towards), distance * math.sin(towards), 0),
        ),
    ]
    mesh = GearMesh(name="m", gears=("a", "b"), direction=direction, point_m=point, stiffness=Constant(mean=1.0))
    (row,) = (mesh.direction for mesh in build_system(bodies, [mesh]).meshes)
    rotation = np.array([0, 0, 0, 0, 0, 63, 0, 0, 0, 0, 0, -36])
    assert abs(row @ rotation) < 1e-12  # turning as their teeth say, rigid gears press nothing
    assert row[5] == pytest.approx(flank * pair.base_radii_m[0])
    # thrust on the driver is -F g: a right-handed one is pushed where the thumb of the right hand points
    thrust = -row[2] * flank
    assert math.copysign(1, thrust) == (1 if hand == "right" else -1)
    assert abs(row[2]) == pytest.approx(math.tan(pair.base_helix_rad))
    # a screw by the lead, 2 pi r / tan(beta), leaves the flanks where they are: -z of the driver, right-handed
    lead = pair.reference_radii_m[0] / math.tan(math.radians(12)) * (1 if hand == "right" else -1)
    screw = np.zeros(12)
    screw[[2, 5]] = lead, 1.0
    assert abs(row @ screw) < 1e-12
    with pytest.raises(ValueError, match="hand = None"):
        line_of_action_direction(along=axis, away=away, pressure_angle_rad=0.3, flank=1, base_helix_rad=0.1, hand=None)


# ---- from a gearbox alone ----------------------------------------------------------------------------------------


def test_space_holds_the_modes_of_torsion_where_bearings_are_rigid():
    gearbox = load_gearbox("planetary-27-36-99")
    stiff = {
        "supports": {
            name: SupportStiffness(radial=1e18, axial=1e18, tilt=1e18)
            for name in ("sun", "carrier", "planet 1", "planet 2", "planet 3")
        }
    }
    torsion = solve_modes(assemble(gearbox, motions="torsion").system).frequencies_hz
    for motions in ("plane", "space"):
        modes = solve_modes(assemble(gearbox, motions=motions, **stiff).system).frequencies_hz
        # what is left of bearings is 1e9 / 1e18 of the compliance
        assert_allclose(modes[: torsion.size], torsion, rtol=1e-8)


def test_defaults_are_discs_of_steel_and_the_mean_stiffness_of_iso_6336():
    gearbox = load_gearbox("wijianto-pair")
    system = assemble(gearbox, motions="plane").system
    radius, width = RADII[0], 0.053
    mass = 7850 * math.pi * radius**2 * width
    # the pair's own table: 5.42 kg at 7850 kg/m3 is the disc of its pitch circle and width
    assert_allclose(np.diag(system.mass)[:3], [mass, mass, mass * radius**2 / 2], rtol=1e-12)
    assert mass == pytest.approx(MASSES[0], rel=5e-4)
    assert system.meshes[0].cycles_per_rev == 36
    pair = GearPair(
        teeth=(36, 63), module_m=3.5e-3, face_width_m=width, pressure_angle_rad=ALPHA, helix_angle_rad=math.radians(12)
    )
    assert system.meshes[0].stiffness.mean == pair.mean_stiffness()


def test_planets_that_mesh_with_each_other_stand_at_both_centre_distances():
    speeds = {"small sun": 1.0, "large sun": 0.0}
    found = solve_modes(assemble(load_gearbox("ravigneaux"), motions="plane", speeds=speeds).system).frequencies_hz
    assert np.sum(found == 0) == 2  # as many as degrees of freedom: turning strains no mesh
    # under a third of a turn, 4 central bodies and 6 planets have 10 single modes and 10 double ones (Kiracofe and
    # Parker 2007, J. Vib. Acoust. 129, 1)
    assert np.sum(np.isclose(found[3:], found[2:-1], rtol=1e-6)) == 10


DISC = Body(name="disc", mass_kg=1, motions=("x",))


def assembled(name, change=lambda gearbox: gearbox, **settings):
    return assemble(change(load_gearbox(name)), **{"motions": "plane", **settings})


def with_coarse_ring(gearbox):
    sun, ring = gearbox.meshes
    return gearbox.changed(meshes=(sun, ring.changed(module_mm=2.5)))


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")
@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: assembled("wijianto-pair", motions="flat"), 'motions = "flat" is not one of torsion, plane, space'),
        (lambda: assembled("wijianto-pair", meshes={"no": MeshProperties()}), 'meshes names "no"'),
        (
            lambda: assembled("wijianto-pair", supports={"pinoin": SupportStiffness()}),
            'supports names "pinoin".*pinion',
        ),
        # (99 - 36) / 2 times 2 and 2.5
        (lambda: assembled("planetary-27-36-99", with_coarse_ring), r"63 mm apart, but its teeth need 78\.75 mm"),
        (lambda: assembled("car-differential", speeds={"cage": 1.0, "left wheel": 0.5}), "needs parallel axes"),
        (lambda: Body(name="disc", mass_kg=1, motions=("x", "rotation")), r"inertia_kgm2 = 0\.0 must be positive"),
        (lambda: Body(name="disc", mass_kg=1, motions=("up",)), 'motion "up" is not one'),
        (lambda: build_system([DISC, DISC], []), 'two bodies are called "disc"'),
        (lambda: build_system([DISC], [Support(between=("disk", None), x=1.0)]), 'no body is called "disk"'),
        (
            lambda: build_system([DISC], [Coupling(motions={("disc", "y"): 1.0}, stiffness=1.0)]),
            'does not have the motion "y"',
        ),
        (
            lambda: MeshHistory(times_s=np.array([2.0, 1.0]), stiffnesses=(), errors=()),
            "must be two or more increasing instants",
        ),
        (
            lambda: MeshHistory(times_s=np.array([1.0, 2.0]), stiffnesses=(), errors=()),
            "2 instants need as many stiffnesses and errors",
        ),
    ],
)
def test_what_cannot_be_is_refused(build, words):
    with pytest.raises(ValueError, match=words):
        build()


# ---- friction ------------------------------------------------------------------------------------------------


def test_friction_turns_round_at_the_pitch_point_and_always_loses_power():
    pair = GearPair(teeth=(30, 50), module_m=3e-3, face_width_m=0.03, pressure_angle_rad=ALPHA)
    friction = SlidingFriction(gears=pair, coefficient=0.06)
    phase = np.linspace(0, 3, 3001)
    one, two = friction.moment_arms_m(phase)
    assert np.all(one * 1.0 + two * 30 / 50 <= 1e-18)
    # one pair in contact: the loss is mu F times the sliding speed, w1 |s - s_p| (1 + z1 / z2)
    begin, _ = pair.path_m
    single = (phase % 1 > pair.contact_ratio - 1) & (phase < 1)
    on_path = begin + phase[single] * pair.base_pitch_m
    slid = np.abs(on_path - pair.base_radii_m[0] * math.tan(ALPHA)) * (1 + 30 / 50)
    assert_allclose(-(one + two * 30 / 50)[single], 0.06 * slid, atol=1e-15)
    # the force along z x n acts at a distance along n
    assert_allclose(one[single], on_path * friction.sideways(phase[single]), rtol=1e-12)

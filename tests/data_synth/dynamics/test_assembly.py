"""The assembler against published and independently computed systems; figures as printed where they come from."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from gearboxes import without_sizes
from mpmath import mp
from numpy.testing import assert_allclose
from published_systems import ALPHA, INERTIAS, MASSES, RADII, chaari, planetary, wijianto
from scipy import linalg

from data_synth.dynamics.assembly import (
    Inertia,
    MeshProperties,
    SupportStiffness,
    assemble,
)
from data_synth.dynamics.elements import Coupling, GearMesh, Shaft, Support, line_of_action_direction
from data_synth.dynamics.modes import eigenvalues, solve_modes
from data_synth.dynamics.placement import contacts_of, direction_of, planet_angle
from data_synth.dynamics.system import SPACE, Body, build_system
from data_synth.gears.friction import SlidingFriction
from data_synth.gears.geometry import GearPair
from data_synth.gears.mesh_stiffness import Constant
from data_synth.gears.transmission_error import ProfileError
from data_synth.integrators.driver import integrate
from data_synth.integrators.problem import Load, Output, Problem, State
from data_synth.operation.shaft_angle import ShaftAngle
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox, load_gearbox


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


HOWARD = "0 383.1702 421.9928 583.1654 683.8766 764.1074 853.7006 1743.455 1743.455 1847.3756 1863.2594"
HOWARD += " 2054.6815 2054.6815 2254.9353 2371.223 4234.1812"
ENDS = [f"{side} {end}" for side in ("pinion", "gear") for end in ("left", "right")]


def howard():
    """Return motor, pinion, gear and load, and a block at each end of both shafts."""
    across, spin = ("x", "y"), ("rotation",)
    shafts = [
        Body(name=name, mass_kg=mass, inertia_kgm2=inertia, motions=(*across, *spin), centre_m=(0, place, 0), axis=axis)
        for name, mass, inertia, place, axis in zip(
            ("pinion", "gear"), MASSES, INERTIAS, (0.0, sum(RADII)), ((0, 0, 1), (0, 0, -1)), strict=True
        )
    ]
    blocks = [Body(name=end, mass_kg=1.8 if "pinion" in end else 2.5, motions=across) for end in ENDS]
    rotors = [
        Body(name=name, inertia_kgm2=inertia, motions=spin) for name, inertia in (("motor", 4.3e-3), ("load", 4.5e-3))
    ]
    rolling = [Support(between=(end.split()[0], end), x=2e8, y=2e8) for end in ENDS]
    feet = [Support(between=(end, None), x=1e8, y=1e8) for end in ENDS]
    twists = [
        Coupling(motions={(one, "rotation"): 1.0, (other, "rotation"): -1.0}, stiffness=1e5)
        for one, other in (("motor", "pinion"), ("gear", "load"))
    ]
    angle = math.atan(math.tan(ALPHA) / math.cos(math.radians(12)))  # across the shafts
    along = (math.cos(angle), math.sin(angle), 0.0)
    mesh = GearMesh(
        name="mesh", gears=("pinion", "gear"), direction=along, point_m=(0, RADII[0], 0), stiffness=Constant(mean=1e9)
    )
    return build_system([*shafts, *blocks, *rotors], [*rolling, *feet, *twists, mesh])


def test_sixteen_degrees_of_freedom_in_howard_s_layout():
    system = howard()
    assert system.dof == 16
    # four decimals are printed; the supports are the same in every direction, so that of the teeth does not matter
    expected = [float(text) for text in HOWARD.split()]
    assert_allclose(solve_modes(system).frequencies_hz, expected, atol=5.1e-5)


# ---- Lin and Parker 1999, J. Vib. Acoust. 121:316, table 1: from a declared gearbox -----------------------------


LIN_PARKER = {
    3: (
        [1475.7, 1930.3, 2658.3, 7462.8, 11775.3],
        [743.2, 1102.4, 1896.0, 2276.4, 6986.3, 9647.9],
        [],
    ),
    4: (
        [1536.6, 1970.6, 2625.7, 7773.6, 13071.1],
        # the two lowest are printed as 727.0 and 1091.0; two methods agree on these
        [727.27, 1091.16, 1892.8, 2342.5, 7189.9, 10437.6],
        [1808.1808820408, 5963.7600216085, 6981.705167044],
    ),
}


def reduced(count):
    """Rotational modes by hand: u_s, u_r, u_c and one planet's zeta, eta, u_n, all planets alike, in Hz."""
    sine, cosine = math.sin(math.radians(24.6)), math.cos(math.radians(24.6))
    springs = [
        (5e8, [1, 0, 0, -sine, -cosine, 1]),
        (5e8, [0, 1, 0, sine, -cosine, -1]),
        (1e8, [0, 0, 0, -1, 0, 0]),
        (1e8, [0, 0, 1, 0, -1, 0]),
    ]
    stiffness = count * sum(value * np.outer(row, row) for value, row in springs) + np.diag([0, 1e9, 0, 0, 0, 0])
    # a carrier that turns takes its planets along in eta and zeta alone
    mass = np.diag([0.39, 3.0, 6.29, *(count * np.array([0.66, 0.66, 0.61]))])
    return np.sqrt(np.abs(linalg.eigh(stiffness, mass, eigvals_only=True))) / (2 * np.pi)


@pytest.mark.parametrize("count", [3, 4])
def test_lin_and_parker_s_planetary_set(count):
    rotational, translational, planet = LIN_PARKER[count]
    modes = solve_modes(planetary(count), planets=[f"planet {number + 1}" for number in range(count)])
    found = {
        kind: [rate for rate, of in zip(modes.frequencies_hz, modes.kinds, strict=True) if of == kind]
        for kind in ("rigid", "rotational", "translational", "planet", "mixed")
    }
    assert found["rigid"] == [0]
    assert not found["mixed"]
    # one decimal is printed, and 1536.6 where the problem by hand gives 1536.535
    assert_allclose(found["rotational"], rotational, atol=0.065)
    assert_allclose(found["rotational"], reduced(count)[1:], rtol=1e-12)
    assert_allclose(found["translational"], np.repeat(translational, 2), atol=0.051)
    assert_allclose(found["translational"][::2], found["translational"][1::2], rtol=1e-12)
    assert_allclose(found["planet"], planet, rtol=1e-12)  # 14 digits are given


def test_the_meshes_of_planets_are_out_of_step_as_their_teeth_say():
    error = ProfileError(harmonics_m=np.array([1e-6j]))
    system = planetary(4, teeth=(25, 35, 95), error=error)
    by_name = {mesh.name: mesh for mesh in system.meshes}
    assert isinstance(by_name["sun-planet 1"].stiffness, Constant)
    # gamma_sn = z_s psi_n / 2 pi and gamma_rn = -z_r psi_n / 2 pi later than the first (Parker and Lin 2004)
    for number in (2, 3, 4):
        for name, late in (("sun-planet", 25 * (number - 1) / 4), ("planet-ring", -95 * (number - 1) / 4)):
            mesh = by_name[f"{name} {number}"]
            assert mesh.stiffness.by_cycles == -late % 1
            assert mesh.error(0.1) == pytest.approx(float(error(0.1 - late)))
    # the sun turns 1 + 95/25 = 4.8 times as fast as the carrier, so 25 (1 - 1/4.8) cycles pass in its turn
    assert {mesh.cycles_per_rev for mesh in system.meshes} == {475 / 24}


@pytest.mark.parametrize("harmonic", [1, 2, 3, 4])
def test_the_step_of_the_meshes_chooses_the_kind_of_mode(harmonic):
    # harmonic l excites rotational modes iff mod(l z_s, N) = 0, translational iff 1 or N - 1, else planet modes
    system = planetary(4, teeth=(25, 35, 95))
    modes = solve_modes(system, planets=[f"planet {number + 1}" for number in range(4)])
    chosen = {0: {"rigid", "rotational"}, 1: {"translational"}, 3: {"translational"}, 2: {"planet"}}[harmonic * 25 % 4]
    for which in ("sun-planet", "planet-ring"):
        force = sum(
            mesh.direction * np.exp(2j * np.pi * harmonic * getattr(mesh.stiffness, "by_cycles", 0.0))
            for mesh in system.meshes
            if mesh.name.startswith(which)
        )
        excited = np.abs(force @ modes.shapes)
        kinds = {kind for kind, size in zip(modes.kinds, excited, strict=True) if size > 1e-9 * excited.max()}
        # a translation of the whole carries no mesh force, nor does turning freely
        assert kinds - {"rigid"} == chosen - {"rigid"}


def test_a_turning_carrier_splits_translational_modes_and_keeps_the_others_real():
    system = planetary(3, speed_rad_s=500.0, rotating_coordinates=True)
    assert_allclose(system.gyroscopic, -system.gyroscopic.T, atol=0)
    place = system.names.index("sun x")
    # 2 m Omega, the carrier at a fifth of the sun's 500 rad/s
    assert system.gyroscopic[place, place + 1] == pytest.approx(-2 * 0.4 * 100)
    centripetal = system.stiffness - planetary(3).stiffness
    masses = np.diag(system.mass)
    expected = [
        -(100.0**2) * mass if name[-1] in "xy" else 0.0 for mass, name in zip(masses, system.names, strict=True)
    ]
    # entries of 1e8 are known to 1e-8
    assert_allclose(centripetal, np.diag(expected), atol=1e-6)


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


def with_geometry(gearbox):
    """Sizes for every mesh that declares none: gears of 3 mm teeth."""
    kinematics = solve_kinematics(gearbox)
    any_pair = GearPair(teeth=(20, 20), module_m=3e-3, face_width_m=0.03, pressure_angle_rad=ALPHA)
    contacts = contacts_of(kinematics, {mesh.name: any_pair for mesh in gearbox.meshes})
    return {
        contact.mesh: MeshProperties(
            geometry=GearPair(
                teeth=_signed(contact, kinematics), module_m=3e-3, face_width_m=0.03, pressure_angle_rad=ALPHA
            )
        )
        for contact in contacts
    }


def _signed(contact, kinematics):
    along = float(np.dot(*(direction_of(kinematics, link) for link in contact.links)))
    internal = contact.parallel and contact.teeth[0] * contact.teeth[1] * along < 0
    one, two = (abs(count) for count in contact.teeth)
    return (one, -two if internal else two)


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")
@pytest.mark.parametrize(
    "name",
    ["wijianto-pair", "two-stage", "planetary-27-36-99", "wind-turbine-3-stage", "alouette-iii", "glinsky-idler"],
)
def test_torsion_strains_nothing_at_the_speeds_of_the_kinematics(name):
    gearbox = load_gearbox(name)
    kinematics = solve_kinematics(gearbox)
    system = assemble(gearbox, motions="torsion", meshes=with_geometry(gearbox)).system
    speeds = np.array(
        [
            float(kinematics.relative_speed(body.removesuffix(" rotation"), seen_from=kinematics.mechanism.frame))
            for body in system.names
        ]
    )
    for mesh in system.meshes:
        assert np.abs(mesh.direction).max() > 1e-3
        assert abs(mesh.direction @ speeds) < 1e-12 * np.abs(mesh.direction * speeds).max()
    rates = solve_modes(system).frequencies_hz
    assert np.sum(rates == 0) == kinematics.dof


@pytest.mark.parametrize("motions", ["plane", "space"])
@pytest.mark.parametrize("name", ["wijianto-pair", "two-stage", "planetary-27-36-99", "glinsky-compound"])
def test_places_strain_nothing_at_the_speeds_of_the_kinematics_either(name, motions):
    gearbox = load_gearbox(name)
    kinematics = solve_kinematics(gearbox)
    system = assemble(gearbox, motions=motions, meshes=with_geometry(gearbox)).system
    motion = np.zeros(system.dof)
    places = {name: number for number, name in enumerate(system.names)}
    frame = kinematics.mechanism.frame
    for body in kinematics.joints:
        turn = float(kinematics.relative_speed(body, seen_from=frame))
        motion[places[f"{body} rotation"]] = turn
        held = kinematics.joints[body].carried_by
        if held != frame:  # a planet goes round as well
            carried = float(kinematics.relative_speed(held, seen_from=frame))
            psi, distance = planet_angle(gearbox, kinematics.joints[body].axis), (27 + 36) * 1.5e-3
            motion[places[f"{body} x"]] = -carried * distance * math.sin(psi)
            motion[places[f"{body} y"]] = carried * distance * math.cos(psi)
    strain = system.mean_stiffness() @ motion
    assert np.abs(strain).max() < 1e-11 * np.abs(system.mean_stiffness()).max() * np.abs(motion).max()
    assert np.sum(solve_modes(system).frequencies_hz == 0) == kinematics.dof


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")
def test_axes_where_teeth_do_not_reach_are_refused():
    gearbox = load_gearbox("planetary-27-36-99")
    sun, ring = gearbox.meshes
    with pytest.raises(ValueError, match=r"63 mm apart, but its teeth need 78\.75 mm"):  # (99 - 36) / 2 times 2 and 2.5
        assemble(gearbox.changed(meshes=(sun, ring.changed(module_mm=2.5))), motions="plane")


def test_a_planet_on_a_bevel_turns_about_its_carrier():
    gearbox = load_gearbox("car-differential")
    inertias = {"cage": Inertia(inertia_kgm2=0.1)}
    system = assemble(
        gearbox,
        motions="torsion",
        meshes=with_geometry(gearbox),
        inertias=inertias,
        speeds={"cage": 1.0, "left wheel": 0.5},
    ).system
    modes = solve_modes(system)
    # two ways to turn without strain: all together, and the wheels against each other
    assert np.sum(modes.frequencies_hz == 0) == 2
    with pytest.raises(ValueError, match="needs parallel axes"):
        assemble(gearbox, motions="plane", meshes=with_geometry(gearbox), speeds={"cage": 1.0, "left wheel": 0.5})


def test_space_holds_the_modes_of_torsion_where_bearings_are_rigid():
    gearbox = load_gearbox("planetary-27-36-99")
    meshes = with_geometry(gearbox)
    stiff = {
        "supports": {
            name: SupportStiffness(radial=1e18, axial=1e18, tilt=1e18)
            for name in ("sun", "carrier", "planet 1", "planet 2", "planet 3")
        }
    }
    torsion = solve_modes(assemble(gearbox, motions="torsion", meshes=meshes).system).frequencies_hz
    for motions in ("plane", "space"):
        modes = solve_modes(assemble(gearbox, motions=motions, meshes=meshes, **stiff).system).frequencies_hz
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


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"motions": "flat"}, 'motions = "flat" is not one of torsion, plane, space'),
        ({"motions": "plane", "meshes": {"no": MeshProperties()}}, 'meshes names "no"'),
        ({"motions": "plane", "supports": {"pinoin": SupportStiffness()}}, 'supports names "pinoin".*pinion'),
    ],
)
def test_what_is_not_there_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        assemble(load_gearbox("wijianto-pair"), **changes)


def test_planets_that_mesh_with_each_other_stand_at_both_centre_distances():
    speeds = {"small sun": 1.0, "large sun": 0.0}
    found = solve_modes(assemble(load_gearbox("ravigneaux"), motions="plane", speeds=speeds).system).frequencies_hz
    assert np.sum(found == 0) == 2  # as many as degrees of freedom: turning strains no mesh
    # under a third of a turn, 4 central bodies and 6 planets have 10 single modes and 10 double ones (Kiracofe and
    # Parker 2007, J. Vib. Acoust. 129, 1)
    assert np.sum(np.isclose(found[3:], found[2:-1], rtol=1e-6)) == 10


def test_missing_geometry_is_refused_by_name():
    with pytest.raises(ValueError, match='"stage 1" declares no module_mm and no face_width_mm'):
        assemble(Gearbox.model_validate(without_sizes("two-stage")), motions="torsion")


def test_bodies_and_elements_refuse_what_they_cannot_be():
    disc = Body(name="disc", mass_kg=1, motions=("x",))
    with pytest.raises(ValueError, match=r"inertia_kgm2 = 0\.0 must be positive"):
        Body(name="disc", mass_kg=1, motions=("x", "rotation"))
    with pytest.raises(ValueError, match='motion "up" is not one'):
        Body(name="disc", mass_kg=1, motions=("up",))
    with pytest.raises(ValueError, match='two bodies are called "disc"'):
        build_system([disc, disc], [])
    with pytest.raises(ValueError, match='no body is called "disk"'):
        build_system([disc], [Support(between=("disk", None), x=1.0)])
    with pytest.raises(ValueError, match='does not have the motion "y"'):
        build_system([disc], [Coupling(motions={("disc", "y"): 1.0}, stiffness=1.0)])


# ---- teeth that part ---------------------------------------------------------------------------------------------


def test_force_takes_gap_and_error_off_the_deflection():
    error = ProfileError(harmonics_m=np.array([2e-6]))
    system = wijianto(error=error)

    def force(drive, **changed):
        mesh = replace(system.meshes[0], **changed)
        start = State(displacement=np.array([drive, 0.0, 0, 0]), velocity=np.zeros(4))
        problem = Problem(
            system=replace(system, meshes=(mesh,)),
            reference=ShaftAngle(times_s=np.zeros(1), speeds_hz=np.ones(1)),
            load=Load(constant=np.zeros(4)),
            duration_s=1e-5,
            start=start,
        )
        read = Output(rate_hz=1e5, mesh_force=np.ones((1, 1)))
        return float(integrate(problem, output=read, steps=1).values[0, 0])

    sign = system.meshes[0].direction[0]
    drives = sign * np.array([15e-6, 5e-6, -5e-6, -30e-6])
    forces = [force(drive, backlash_m=10e-6) for drive in drives]
    assert_allclose(forces, 1e6 * np.array([3e-6, 0, 0, -22e-6]), atol=1e-9)
    assert_allclose([force(drive) for drive in drives], 1e6 * (sign * drives - 2e-6), rtol=1e-9)


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
    slid = np.abs(begin + phase[single] * pair.base_pitch_m - pair.base_radii_m[0] * math.tan(ALPHA)) * (1 + 30 / 50)
    assert_allclose(-(one + two * 30 / 50)[single], 0.06 * slid, atol=1e-15)
    assert_allclose(np.abs(friction.sideways(phase[single])), 0.06)

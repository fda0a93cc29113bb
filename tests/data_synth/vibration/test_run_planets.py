"""Scenes whose planets and bevel gears vibrate: published frequencies, statics, symmetry, and the textbook's forces."""

import math
from functools import partial

import numpy as np
import pytest
from gearboxes import held_planetary
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate
from data_synth.dynamics.assembly import assemble
from data_synth.dynamics.modes import solve_modes
from data_synth.dynamics.placement import contacts_of
from data_synth.gears.geometry import GearPair
from data_synth.gears.tooth_compliance import ToothPair, teeth_in_mesh
from data_synth.integrators.driver import integrate
from data_synth.integrators.problem import Output
from data_synth.scene.random_streams import random_stream
from data_synth.simulation import noise_free
from data_synth.sources.prepared import prepare_scene
from data_synth.vibration.meshes import kinematics_of
from data_synth.vibration.run import fault_passes, motion_of
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import load_gearbox
from hums.gearbox.torques import solve_torques
from hums.records.validation import check_record

SEED = 1


def gearbox(teeth=(20, 31, 82), copies=3, *, module=3.0, angle=20.0, **planets):
    sizes = {"module_mm": module, "face_width_mm": 30, "pressure_angle_deg": angle}
    return held_planetary(*teeth, copies=copies, sizes=sizes, **planets)


SCENE = {
    "gearbox": gearbox(),
    "rate_hz": 20_000,
    "duration_s": 0.5,
    "fidelity": "dynamic",
    "speed": {"link": "carrier", "rpm": 60 * 20_000 / (82 * 102)},  # 102 samples to a mesh cycle
    "torque": {"link": "carrier", "nm": 600},
    "tachometer": {"link": "sun", "pulses_per_rev": 4, "offset_rev": 0},
    "excitation": {"shaft_amplitude": 0},
    "noise": {"rms": 0},
    "planet_pass": {"half_width_deg": 40, "floor": 0.1},
    "dynamics": {"damping_ratio": 0.05},
    "sensor": [{"name": "ring", "on": "ring", "direction": [0, 0, 1], "units": "m s-2"}],
}
SCENE["sensor"][0]["anti_alias"] = {"frequency_hz": 3000, "order": 8}  # mesh harmonics have no end


def scene_of(**changes):
    table = {**SCENE, **changes}
    return Scene.from_mapping({key: value for key, value in table.items() if value is not None})


def moving(**changes):
    scene = scene_of(**changes)
    stage = prepare_scene(scene, rng_for=partial(random_stream, SEED))
    return motion_of(stage)


def at_rest(motion):
    """Return the static force of each mesh by its name."""
    strained = motion.drive_load.start(motion.system, motion.stage.drive, 0.0).displacement
    forces = {}
    for mesh in motion.system.meshes:
        delta = mesh.direction @ strained
        pressed = max(abs(delta) - mesh.backlash_m, 0.0)  # between its flanks a mesh carries nothing
        forces[mesh.name] = math.copysign(pressed, delta) * mesh.stiffness.mean
    return forces


def mesh_forces(motion, duration_s, *, rate_hz):
    """Return times and the force of every mesh, each the mean under a hat of two samples, (n,) and (n, meshes)."""
    output = Output(rate_hz=rate_hz, weighted_mesh_force=np.eye(len(motion.system.meshes)))
    problem = motion.problem(-motion.settling_time_s, motion.settling_time_s + duration_s)
    found = integrate(problem, output=output, steps=2)
    return found.times_s, found.values


# ---- frequencies -------------------------------------------------------------------------------------------------

# Lin and Parker 1999, J. Vib. Acoust. 121:316: rotational, translational (each twice) and planet modes, Hz
LIN_PARKER = {
    3: ([1475.7, 1930.3, 2658.3, 7462.8, 11775.3], [743.2, 1102.4, 1896.0, 2276.4, 6986.3, 9647.9], []),
    4: (
        [1536.6, 1970.6, 2625.7, 7773.6, 13071.1],
        [727.27, 1091.16, 1892.8, 2342.5, 7189.9, 10437.6],
        [1808.1808820408, 5963.7600216085, 6981.705167044],
    ),
}


@pytest.mark.parametrize("count", [3, 4])
def test_a_scene_has_the_frequencies_of_lin_and_parker(count):
    half = 1e-3 * math.cos(math.radians(24.6))
    base = {"sun": 24 * half, "planet": 36 * half, "ring": 96 * half, "carrier": 0.06}
    given = {"sun": (0.4, 0.39), "ring": (2.35, 3.0), "carrier": (5.43, 6.29), "planet": (0.66, 0.61)}
    motion = moving(
        gearbox=gearbox((24, 36, 96), count, module=2.0, angle=24.6),
        speed={"link": "sun", "rpm": 6},  # slow: a turning frame splits modes by its turns a second, 0.02 Hz
        tachometer={"link": "sun", "pulses_per_rev": 600},
        dynamics={
            "links": {
                name: {"mass_kg": mass, "inertia_kg_m2": inertia * base[name] ** 2}
                for name, (mass, inertia) in given.items()
            },
            "meshes": {name: {"shape": "constant", "stiffness_n_m": 5e8} for name in ("sun-planet", "planet-ring")},
            "bearings": {"ring": {"torsion_nm_rad": 1e9 * base["ring"] ** 2}},
        },
    )
    rotational, translational, planet = LIN_PARKER[count]
    modes = solve_modes(motion.system, planets=[f"planet {number + 1}" for number in range(count)])
    found = {kind: modes.frequencies_hz[np.array(modes.kinds) == kind] for kind in {*modes.kinds}}
    assert found.pop("rigid") == [0]
    # one decimal is printed, and 1536.6 where two methods give 1536.535
    for kind, expected in {"rotational": rotational, "translational": np.repeat(translational, 2)}.items():
        assert_allclose(found.pop(kind), expected, atol=0.066)
    assert_allclose(found.pop("planet", []), planet, rtol=1e-12)  # 14 digits are given
    assert not found
    # the carrier turns once in 5 of the sun: 2 m Omega couples x and y
    place = motion.system.names.index("sun x")
    assert motion.system.gyroscopic[place, place + 1] == pytest.approx(-2 * 0.4 * 2 * math.pi * 0.1 / 5)


# ---- statics ---------------------------------------------------------------------------------------------------

SIZE = {"module_mm": 3, "face_width_mm": 30, "pressure_angle_deg": 20}


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")
@pytest.mark.parametrize(
    ("name", "loaded"),
    [
        ("planetary-27-36-99", "carrier"),
        ("wind-turbine-3-stage", "main shaft"),
        ("nelson-bevel-planet", "carrier"),
        ("alouette-iii", "upper carrier"),
    ],
)
def test_teeth_carry_what_statics_asks_of_them(name, loaded):
    declared = load_gearbox(name)
    motion = moving(
        gearbox=name,
        speed={"link": declared.reference, "rpm": 10},
        tachometer={"link": declared.reference, "pulses_per_rev": 60},
        torque={"link": loaded, "nm": 500},
        planet_pass=None,
        dynamics={"meshes": {mesh.name: SIZE for mesh in declared.meshes}},
        sensor=[{"name": "a", "on": loaded, "direction": [0.3, 0.4, 0.5], "units": "g"}],
    )
    kinematics = solve_kinematics(declared)
    against = -math.copysign(500, kinematics.relative_speed(loaded, seen_from=declared.frame))
    torques = solve_torques(kinematics, {loaded: against, declared.reference: None})
    loads = torques.tooth_loads
    contacts = contacts_of(kinematics_of(motion.stage.scene))
    forces = at_rest(motion)
    assert len(loads) == len(contacts)
    for load, contact in zip(loads, contacts, strict=True):
        torque = abs(load.torques_nm[load.gears.index(contact.links[0])])
        # pressed on the flanks that drive; equal shares, as statics assumes, where all planets are alike
        assert forces[contact.name] * contact.pair.base_radii_m[0] == pytest.approx(torque, rel=1e-9)


@pytest.mark.parametrize(("radial", "alike"), [(1e2, True), (1e12, False)])
def test_a_sun_that_floats_shares_the_load(radial, alike):
    # three forces on a body that nothing else holds are equal, however soft one planet's bearing is
    planets = {"planet": {"radial_n_m": 1e8}, "planet 2": {"radial_n_m": 2e7}}
    motion = moving(dynamics={"bearings": {"sun": {"radial_n_m": radial}, **planets}})
    forces = [force for name, force in at_rest(motion).items() if name.startswith("sun-planet")]
    apart = np.ptp(forces) / np.mean(forces)
    assert (apart < 1e-4) if alike else (apart > 0.1)


# ---- which lines reach a sensor, which modes are excited ---------------------------------------------------------


def channel(made):
    """Return the first channel of a scene without noise, and without the truth of its record."""
    return noise_free(made, seed=SEED).signal[0]


def lines_of(values):
    """Return a channel's amplitude at every multiple of the carrier up to the fifth mesh harmonic, (m,)."""
    values = values[: 82 * 102]  # a turn of the carrier
    return np.abs(np.fft.rfft(values))[1 : 5 * 82]


def test_three_planets_alike_leave_only_every_third_line():
    heard = lines_of(channel(scene_of(dynamics={"error": 1e-4})))
    forbidden = np.arange(1, heard.size + 1) % 3 != 0
    near = np.zeros(heard.size, dtype=bool)
    near[82 - 12 : 82 + 11] = True  # lines 71 to 93
    assert heard[near & forbidden].max() < 1e-3 * heard[near].max()  # 60 dB
    assert heard[forbidden].max() < 1e-3 * heard.max()
    assert heard[81 - 1] > 10 * heard[82 - 1]  # 81 is a multiple of three, the mesh's own 82 is not


def test_planets_at_unequal_places_are_heard_as_their_phasors_sum():
    turns = np.array([0, 33, 67]) / 102  # where the teeth of sun and ring let planets in
    changes = {
        "gearbox": gearbox(spacing_deg=[360 * float(turn) for turn in turns]),
        "dynamics": {"error": 1e-4, "elsewhere": 0.0, "rigid_below_hz": 1e-6},  # the mesh has 196 Hz
    }
    heard = lines_of(channel(scene_of(**changes))) * 2 / (82 * 102)
    motion = moving(**changes)
    _, forces = mesh_forces(motion, 0.01, rate_hz=160_000)
    cycle = forces[-817:-1, 3:]  # of 102 x 8 samples
    first = np.fft.fft(cycle, axis=0)[1] / 816 * 2  # C_1 of each planet, on the clock of the cycle
    # the window's Fourier coefficients by direct sum, and one phasor for each planet
    angle = 2 * np.pi * np.arange(4096) / 4096
    window = 0.1 + 0.9 * np.exp(np.log(2) / (1 - np.cos(np.radians(40))) * (np.cos(angle) - 1))
    multiples = np.arange(82 - 9, 82 + 10)
    weights = [abs(np.mean(window * np.exp(-1j * (m - 82) * angle))) for m in multiples]
    force = weights * np.abs(np.exp(2j * np.pi * np.outer(multiples - 82, turns)) @ first)
    expected = force * np.abs(
        motion.sensor_forces.routes[0].response_in(motion.stage.scene)(multiples * 20_000 / (82 * 102))
    )
    # relative to the largest: 1e-3 of it is 60 dB
    assert_allclose(heard[multiples - 1], expected, atol=1e-3 * expected.max())
    assert heard[multiples[multiples % 3 != 0] - 1].max() > 0.05 * heard[multiples - 1].max()


EVEN_TEETH = {name: {"shape": "constant"} for name in ("sun-planet", "planet-ring")}


def test_a_static_tooth_force_moves_no_housing_where_planets_are_alike():
    # teeth of constant stiffness, without errors: nothing but the static force, 600 N m, passes the sensor
    values = channel(scene_of(dynamics={"damping_ratio": 0.05, "meshes": EVEN_TEETH}))
    force = max(at_rest(moving(dynamics={"meshes": EVEN_TEETH})).values())
    assert force > 1e3
    # 1e-9 of what that force would do to a housing of 20 kg
    assert np.std(values) < 1e-9 * force / 20


def test_unequal_shares_of_a_static_force_turn_with_the_carrier():
    # one soft planet: the line of the carrier is the sum of the ring forces as vectors, each with its planet's angle
    dynamics = {
        "damping_ratio": 0.05,
        "meshes": EVEN_TEETH,
        "bearings": {"planet 2": {"radial_n_m": 2e7}},
        "elsewhere": 0.0,
    }
    rigid = channel(scene_of(dynamics=dynamics))
    dynamics |= {"rigid_below_hz": 1e-6}
    elastic = channel(scene_of(dynamics=dynamics))
    motion = moving(dynamics=dynamics)
    forces = np.array([force for name, force in at_rest(motion).items() if name.startswith("planet-ring")])
    assert np.ptp(forces) > 0.1 * np.mean(forces)
    turned = abs(np.sum(forces * np.exp(2j * np.pi * np.arange(3) / 3)))
    way = abs(motion.sensor_forces.routes[0].response_in(motion.stage.scene)(np.array([20_000 / (82 * 102)])))
    heard = lines_of(elastic) * 2 / (82 * 102)
    assert heard[0] == pytest.approx(turned * way[0], rel=1e-3)
    assert heard[1:].max() < 1e-3 * heard[0]  # no window makes sidebands of it
    # at 2.4 Hz it bends the housing, which does not move: the bearings of sun and carrier press as much on it
    assert np.std(rigid) < 1e-3 * np.std(elastic)


def test_the_phasing_rule_chooses_the_modes_that_move():
    # 25 teeth on the sun, 4 planets: harmonic l moves the sun sideways where mod(25 l, 4) is 1 or 3, turns it where it
    # is 0, and leaves it alone where it is 2 (Parker and Lin 2004, J. Mech. Des. 126)
    motion = moving(
        gearbox=gearbox((25, 35, 95), 4),
        speed={"link": "carrier", "rpm": 60 * 200 / 95},
        dynamics={"damping_ratio": 0.1, "error": 1e-9},
    )
    names, rows = motion.system.names, np.zeros((3, motion.system.dof))
    for row, name in zip(rows, ("sun x", "sun y", "sun rotation"), strict=True):
        row[names.index(name)] = 1.0
    problem = motion.problem(-motion.settling_time_s, motion.settling_time_s + 0.1)
    output = Output(rate_hz=20_000, displacement=rows)
    found = integrate(problem, output=output, steps=4).values
    spectrum = np.abs(np.fft.rfft(found[-2000:] - found[-2000:].mean(axis=0), axis=0))[20::20]  # harmonics of 200 Hz
    moved = np.hypot(spectrum[:, 0], spectrum[:, 1]) / spectrum[:, :2].max()
    turned = spectrum[:, 2] / spectrum[:, 2].max()
    for harmonic in range(1, 9):
        # what has not died of the start is 1e-9, and rounding of absolute angles less
        assert (moved[harmonic - 1] > 1e-6) == (harmonic * 25 % 4 in (1, 3))
        assert (turned[harmonic - 1] > 1e-6) == (harmonic * 25 % 4 == 0)


# ---- teeth of rings ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("teeth", [(31, -82), (36, -99), (39, -99)])
def test_ring_teeth_are_nearly_as_stiff_as_iso_6336_has_them(teeth):
    pair = GearPair(teeth=teeth, module_m=3e-3, face_width_m=0.03, pressure_angle_rad=math.radians(20))
    one, two = pair.reference_radii_m
    met = ToothPair(gears=pair, bore_radii_m=(0.4 * one, 0.4 * two))
    # the standard counts a ring's tooth as a rack's and its formula is a fit; bodies of wheels are softer than rings
    assert teeth_in_mesh(met).mean == pytest.approx(pair.mean_stiffness(), rel=0.13)
    base = pair.base_radii_m
    pitch_point = (base[0] * math.tan(math.radians(20)) - pair.path_m[0]) / pair.base_pitch_m
    begin, middle, end = np.degrees(np.stack(met.angles_rad(np.array([0.0, pitch_point, pair.contact_ratio])), axis=1))
    assert_allclose(middle, 20, atol=1e-9)
    # contact begins at the tip of the ring's tooth, a module inside its reference circle, and ends at the planet's
    assert begin[1] == pytest.approx(math.degrees(math.acos(base[1] / (two + 3e-3))), rel=1e-9)
    assert end[0] == pytest.approx(math.degrees(math.acos(base[0] / (one + 3e-3))), rel=1e-9)


# ---- damage ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("component", "meshes"),
    [
        ("sun-planet/sun", ["sun-planet 1", "sun-planet 2", "sun-planet 3"]),
        ("planet-ring/ring", ["planet-ring 1", "planet-ring 2", "planet-ring 3"]),
        ("sun-planet/planet", ["sun-planet 1"]),
        ("planet-ring/planet", ["planet-ring 1"]),
    ],
)
def test_a_damaged_tooth_meets_the_right_planet_at_the_right_time(component, meshes):
    fault = {"kind": "tooth_crack", "component": component, "depth_mm": 3.0}
    broken, sound = moving(fault=[fault]), moving()
    changed = {}
    for one, two in zip(broken.system.meshes, sound.system.meshes, strict=True):
        phases = np.arange(0, one.stiffness.period, 0.02)
        softer = np.flatnonzero(one.stiffness(phases) < (1 - 1e-6) * two.stiffness(phases))
        if softer.size:
            period = one.stiffness.period
            changed[one.name] = np.angle(np.mean(np.exp(2j * np.pi * phases[softer] / period))) / 2 / np.pi * period
    assert [*changed] == meshes
    # where the wheel stands when its tooth is in mesh with a planet: always at that planet's place
    cycles_per_rev = 20 * (1 - 20 / 102)
    carrier, spin = 20 / 102, {"sun": 1.0, "ring": 0.0}.get(component.rpartition("/")[2])
    every = []
    for number, (name, phase) in enumerate(changed.items()):
        period = next(mesh.stiffness.period for mesh in broken.system.meshes if mesh.name == name)
        rev = (phase + period * np.arange(-9, 9)) / cycles_per_rev
        every += [rev]
        if spin is not None:
            tooth = spin * rev - carrier * rev - number / 3  # turns of the wheel from the planet
            assert_allclose(np.exp(2j * np.pi * tooth), np.exp(2j * np.pi * tooth[0]), atol=1e-9)
            if number == 0:
                place = np.exp(2j * np.pi * tooth[0])
            assert abs(np.exp(2j * np.pi * tooth[0]) - place) < 0.02 * 2 * np.pi / 20
    times_s, _ = fault_passes(broken)[0]
    expected = broken.stage.drive.angle.times(np.sort(np.concatenate(every)))
    expected = expected[(expected >= 0) & (expected <= 0.5)]
    assert_allclose(times_s, expected, atol=0.02 * 102 / 20_000)  # the grid of phases


def test_the_truth_tells_lines_and_passes_of_planets():
    fault = {"kind": "tooth_crack", "component": "sun-planet/sun", "depth_mm": 2.0}
    made = simulate(Scene.from_mapping({**SCENE, "fault": [fault], "duration_s": 2.1}), seed=SEED)
    # the sun meets three planets in a turn from one of them: 20 cycles of its teeth, 102 samples each
    assert_allclose(np.diff(made["truth_tooth_passes_1"].values), 20 * 102 / 20_000 / 3, rtol=1e-9)
    lines = made["truth_order"].values * 102 / 20
    heard = np.abs(made["truth_amplitude"].values[0, :, 0])
    loud = np.rint(lines[heard > 0.01 * heard.max()]).astype(int)
    meshes = loud[loud > 40]  # below are lines of the cracked tooth, which passes with the sun's 4.1 turns
    assert {81, 84, 165} <= set(meshes.tolist())
    assert set(meshes % 3) == {0}
    assert 3 not in loud  # the static force moves no housing
    check_record(made)
    # against a spectrum of five turns of the carrier
    spectrum = np.abs(np.fft.rfft(made["ring"].values[: 5 * 82 * 102])) * 2 / (5 * 82 * 102)
    for line in (81, 84, 165):
        found = heard[np.argmin(np.abs(lines - line))]
        assert found == pytest.approx(spectrum[5 * line], rel=2e-2)  # the tooth's own lines are near


# ---- axes that cross ---------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")
@pytest.mark.parametrize(
    ("motions", "name", "speeds"),
    [
        ("space", "alouette-iii", {"input": 1.0}),
        ("space", "nelson-bevel-planet", {"ring": 1.0}),
        ("space", "car-differential", {"cage": 1.0, "left wheel": 0.5}),
        ("space", "wind-turbine-3-stage", {"high speed shaft": 1.0}),
        ("plane", "planetary-27-36-99", {"sun": 1.0}),
        ("plane", "glinsky-compound", {"gear 1": 1.0}),
        ("torsion", "alouette-iii", {"input": 1.0}),
        ("torsion", "car-differential", {"cage": 1.0, "left wheel": 0.5}),
        ("torsion", "glinsky-idler", {"gear 1": 1.0}),
    ],
)
def test_rigid_gears_roll_without_strain(motions, name, speeds):
    declared = load_gearbox(name)
    declared = declared.changed(meshes=tuple(mesh.changed(**SIZE | {"face_width_mm": 20}) for mesh in declared.meshes))
    whole = assemble(declared, motions=motions, speeds=speeds)
    parts, system = whole.parts, whole.system
    joints, motion = parts.kinematics.joints, np.zeros(system.dof)
    spins = parts.kinematics.vectors(speeds)
    for body in whole.bodies:
        name = body.rotates_with or body.name
        holder = joints[name].carried_by
        own, held = (parts.space @ spins.sel(link=link).values for link in (name, holder))
        velocity = np.zeros(3)
        if holder != parts.frame and motions != "torsion":
            velocity = np.cross(held, np.array(body.centre_m) - parts.axis_point(holder, holder))
        for place, number in whole.coordinates.index.items():
            if place[0] != body.name or (place[1] == "rotation" and body.rotates_with):
                continue
            if place[1] in ("x", "y", "z"):
                motion[number] = velocity["xyz".index(place[1])]
            else:
                # tilts are those of the body that holds it, round its own axis it turns by itself
                motion[number] = body.rotation_axis(place[1]) @ (own if place[1] == "rotation" else held)
    for mesh in system.meshes:
        assert abs(mesh.direction @ motion) < 1e-12 * np.abs(mesh.direction * motion).max()
    strain = system.mean_stiffness() @ motion
    assert np.abs(strain).max() < 1e-11 * np.abs(system.mean_stiffness()).max() * np.abs(motion).max()
    assert np.sum(solve_modes(system).frequencies_hz == 0) == parts.kinematics.dof


# ---- bevel gears -------------------------------------------------------------------------------------------------

BEVEL = {
    **{key: value for key, value in SCENE.items() if key != "planet_pass"},
    "gearbox": {
        "name": "bevel drive",
        "frame": "housing",
        "reference": "input",
        "axes": {
            "input": {"direction": [1, 0, 0], "links": ["housing", "input"]},
            "output": {"direction": [0, 1, 0], "links": ["housing", "output"]},
        },
        "mesh": [
            {
                "name": "bevel",
                "teeth": {"input": 19, "output": 34},
                "module_mm": 4,
                "face_width_mm": 25,
                "pressure_angle_deg": 20,
            }
        ],
    },
    "duration_s": 0.2,
    "speed": {"link": "input", "rpm": 1500},
    "torque": {"link": "output", "nm": 100},
    "tachometer": {"link": "input", "pulses_per_rev": 2},
    "dynamics": {"elsewhere": 0.0},
    "sensor": [
        {"name": name, "on": "input", "direction": direction, "units": "m s-2"}
        for name, direction in (("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1]))
    ],
}


def test_a_bevel_pinion_presses_its_bearings_as_textbooks_say():
    motion = moving(**{**BEVEL, "planet_pass": None})
    cone, angle = math.atan(19 / 34), math.radians(20)
    middle = 19 * 2e-3 - 12.5e-3 * math.sin(cone)  # radius in the middle of the face
    tangential = 100 * 19 / 34 / middle
    force = at_rest(motion)["bevel"]
    assert force == pytest.approx(tangential / math.cos(angle), rel=1e-12)
    strained = motion.drive_load.start(motion.system, motion.stage.drive, 0.0).displacement
    maps = motion.output.maps
    pressed = sum(
        maps[name] @ value for name, value in (("displacement", strained), ("mesh_force", [force])) if name in maps
    )
    pressed = pressed[:3] + pressed[3:]  # as on a rigid housing, and as on an elastic one
    # away from the apex along its axis, away from the wheel across it, and round with the torque it passes on
    separating = tangential * math.tan(angle)
    assert_allclose(np.abs(pressed), [separating * math.sin(cone), separating * math.cos(cone), tangential], rtol=1e-9)
    assert pressed[0] > 0
    assert pressed[1] < 0
    assert motion.system.dof == 12


def test_a_cracked_bevel_tooth_passes_once_a_turn():
    fault = {"kind": "tooth_crack", "component": "bevel/input", "depth_mm": 2.0}
    made = simulate(Scene.from_mapping({**BEVEL, "fault": [fault]}), seed=SEED)
    assert_allclose(np.diff(made["truth_tooth_passes_1"].values), 1 / 25, rtol=1e-9)
    assert {19, 38, 57} < set(made["truth_order"].values.tolist())
    assert_allclose(made["truth_order"].values % 1, 0, atol=1e-9)  # the tooth, once a turn
    check_record(made)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"gearbox": {**BEVEL["gearbox"], "mesh": [BEVEL["gearbox"]["mesh"][0] | {"face_width_mm": 90}]}},
            "must be below its cone distance",
        ),
        ({"dynamics": {"bearings": {"housing": {}}}}, "rotates freely; give torsion_nm_rad"),
    ],
)
@pytest.mark.filterwarnings("ignore::hums.gearbox.model.GearboxWarning")
def test_what_cannot_be_is_refused(changes, words):
    with pytest.raises((SceneError, ValueError), match=words):
        simulate(Scene.from_mapping({**BEVEL, **changes}), seed=SEED)

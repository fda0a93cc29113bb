"""Bending of an elastic ring: Timoshenko's and Roark's rings, beams of a polygon, and the lines that planets make."""

from functools import partial

import numpy as np
import pytest
from gearboxes import held_planetary, without_sizes
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate
from data_synth.kinematic.ring_bending import ElasticRing
from data_synth.scene.random_streams import random_stream
from data_synth.sources.prepared import prepare_scene
from data_synth.vibration.gear_torques import mean_error_m, static_deflection
from data_synth.vibration.run import motion_of

THIN = ElasticRing(radius_m=0.2, tooth_radius_m=0.2, rim_m=4e-4, width_m=0.03)  # waves up to 1570
FLEXIBILITY = THIN.radius_m**3 / (THIN.young_pa * THIN.width_m * THIN.rim_m**3 / 12)  # R^3 / (E I)

# ---- one ring ----------------------------------------------------------------------------------------------------


def displacement_m(ring, angle_rad, *, radial_n, tangential_n):
    """Return the outward displacement at angles from the place of one load in its positive sense."""
    turns = np.multiply.outer(angle_rad, ring.waves)
    radial, tangential = ring.compliances
    return np.cos(turns) @ (radial * radial_n) + np.sin(turns) @ (tangential * tangential_n)


def under(ring, places_rad, angle_rad, **force):
    """Return the displacement at an angle under the same force at several places, over R^3 / (E I)."""
    return sum(float(displacement_m(ring, angle_rad - place, **force)) for place in places_rad) / FLEXIBILITY


def test_two_opposite_forces_stretch_a_ring_as_timoshenko_says():
    # Strength of Materials: diameters change by (pi / 4 - 2 / pi) and (2 / pi - 1 / 2) of P R^3 / (E I)
    pull = partial(under, THIN, [0.0, np.pi], radial_n=1.0, tangential_n=0.0)
    assert pull(0.0) == pytest.approx((np.pi / 4 - 2 / np.pi) / 2, rel=1e-7)  # n^-4 beyond 1570 waves
    assert pull(np.pi / 2) == pytest.approx(-(2 / np.pi - 1 / 2) / 2, rel=1e-7)


@pytest.mark.parametrize("planets", [3, 4, 5])
def test_even_forces_bend_a_ring_as_roark_says(planets):
    # Formulas for Stress and Strain, circular rings under equal radial loads 2 theta apart: at a load and halfway
    theta = np.pi / planets
    sine, cosine = np.sin(theta), np.cos(theta)
    at_load = ((theta + sine * cosine) / 2 - sine**2 / theta) / (2 * sine**2)
    halfway = -(2 / theta - 1 / sine - theta * cosine / sine**2) / 4
    push = partial(under, THIN, 2 * theta * np.arange(planets), radial_n=1.0, tangential_n=0.0)
    # smaller than the displacement by one force by N^-4, as are the waves left out: 1e-6 of it
    assert_allclose([push(0.0), push(theta)], [at_load, halfway], rtol=1e-5)


def polygon(ring, *, elements, planets, radial_n, tangential_n):
    """Outward displacement of the corners of a polygon of Euler beams under equal, even forces, waves 2 and more."""
    angles, length = 2 * np.pi * np.arange(elements) / elements, 2 * ring.radius_m * np.sin(np.pi / elements)
    bending = ring.young_pa * ring.width_m * ring.rim_m**3 / 12
    along = 1e3 * bending / ring.radius_m**2  # N for a unit of strain: hardly longer
    a, b, c, d = (factor * bending / length**power for factor, power in ((12, 3), (6, 2), (4, 1), (2, 1)))
    beam = np.zeros((6, 6))
    beam[np.ix_([0, 3], [0, 3])] = along / length * np.array([[1, -1], [-1, 1]])
    beam[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = [[a, b, -a, b], [b, c, -b, d], [-a, -b, a, -b], [b, d, -b, c]]
    stiffness = np.zeros((3 * elements, 3 * elements))
    for number, angle in enumerate(angles + np.pi / 2 + np.pi / elements):
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.kron(np.eye(2), [[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
        place = (3 * np.array([[number], [(number + 1) % elements]]) + np.arange(3)).ravel()
        stiffness[np.ix_(place, place)] += turn.T @ beam @ turn
    x, y = np.cos(angles), np.sin(angles)
    loaded = np.arange(elements) % (elements // planets) == 0
    outwards, sideways = radial_n * loaded, tangential_n * loaded
    offset_m = ring.radius_m - ring.tooth_radius_m
    # the support all round takes the torque
    evenly = sideways - planets * tangential_n * ring.tooth_radius_m / ring.radius_m / elements
    force = np.stack([outwards * x - evenly * y, outwards * y + evenly * x, -offset_m * sideways], axis=1)
    moved = np.linalg.lstsq(stiffness, force.ravel(), rcond=1e-12)[0].reshape(elements, 3)
    waves = np.fft.rfft(moved[:, 0] * x + moved[:, 1] * y)
    waves[:2] = 0
    return angles, np.fft.irfft(waves, elements)


@pytest.mark.parametrize(("radial_n", "tangential_n"), [(1000.0, 0.0), (0.0, 1000.0)])
def test_a_ring_bends_as_a_polygon_of_beams_under_offset_teeth(radial_n, tangential_n):
    ring = ElasticRing(radius_m=0.2, tooth_radius_m=0.18, rim_m=5e-3, width_m=0.03)
    force = {"radial_n": radial_n, "tangential_n": tangential_n}
    angles, expected = polygon(ring, elements=120, planets=3, **force)
    found = sum(displacement_m(ring, angles - place, **force) for place in 2 * np.pi * np.arange(3) / 3)
    # corners of 3 degrees, and 1e-3 of strain over bending
    assert_allclose(found, expected, atol=5e-3 * np.max(np.abs(expected)))


# ---- planets that pass a sensor ----------------------------------------------------------------------------------

SIZE = {"module_mm": 3, "face_width_mm": 30, "pressure_angle_deg": 20}
SCENE = {
    "gearbox": held_planetary(27, 36, 99, sizes=SIZE),
    "rate_hz": 8000,
    "duration_s": 0.5,
    "fidelity": "kinematic",
    "speed": {"link": "carrier", "rpm": 240},
    "torque": {"link": "carrier", "nm": 600},
    "tachometer": {"link": "sun", "pulses_per_rev": 1, "offset_rev": 0},
    "excitation": {"shaft_amplitude": 0, "mesh_amplitude": 0, "harmonics": 1},
    "planet_pass": {"half_width_deg": 40, "ring": {"rim_mm": 10}},
    "noise": {"rms": 0},
    "sensor": [{"name": "ring", "on": "ring", "direction": [0, 0, 1], "units": "m s-2", "anti_alias": "none"}],
}
CARRIER = 27 / 126  # turns of the carrier for one of the sun (Willis)


def scene(**changes):
    return Scene.from_mapping({**SCENE, **changes})


def bending_lines(record):
    """Return the multiples of the carrier at which a ring bends, and the first values of their amplitudes."""
    bent = record.isel(truth_order=record["truth_kind"].values == "ring_bending")
    return np.rint(bent["truth_order"].values / CARRIER).astype(int), bent["truth_amplitude"].values[0, :, 0]


def test_planets_alike_bend_the_ring_at_multiples_of_their_number_alone():
    made = simulate(scene(), seed=1)
    lines, sizes = bending_lines(made)
    assert lines.size > 8
    assert set(lines % 3) == {0}
    # 600 N m at three planets less what the sun takes, through 20 degrees (virtual work), on a rim of 30 x 10 mm
    force = 600 * 99 / 126 / 3 / 0.1485
    n, radius = 3, 0.1485 + 1.25 * 3e-3 + 5e-3
    flexibility = radius**3 / (np.pi * 206e9 * 30e-3 * 10e-3**3 / 12) / (n**2 - 1) ** 2
    sideways = (0.1485 / radius) / n + n * (1 - 0.1485 / radius)
    expected = 3 * force * flexibility * np.hypot(np.tan(np.radians(20)), sideways) * (2 * np.pi * n * 4) ** 2
    assert abs(sizes[0]) == pytest.approx(expected, rel=1e-9)
    # its truth is the record, which has nothing else
    revolutions = made["time"].values * 4 / CARRIER
    rebuilt = sum((z * np.exp(2j * np.pi * n * CARRIER * revolutions)).real for n, z in zip(lines, sizes, strict=True))
    assert_allclose(made["ring"].values, rebuilt, atol=1e-9 * np.max(np.abs(rebuilt)))


def test_unequal_planets_bring_the_other_lines_back():
    lines, _ = bending_lines(simulate(scene(imperfections={"planets": {}}), seed=1))
    assert set(lines % 3) == {0, 1, 2}


def test_gears_in_motion_bend_the_ring_as_statics_says():
    _, kinematic = bending_lines(simulate(scene(), seed=1))
    stage = prepare_scene(scene(fidelity="dynamic"), rng_for=partial(random_stream, 1))
    motion = motion_of(stage)
    moving = stage.with_bending_rings(motion.sensor_forces.ring_loads())
    kinds = [family.kind for family in moving.families]
    sizes = np.abs(moving.amplitudes[kinds.index("ring_bending")][0, :, 0])
    # the same loads, by virtual work and by the deflection of teeth
    assert_allclose(sizes[sizes > 0], np.abs(kinematic), rtol=1e-6)


def test_a_displaced_planet_takes_load_from_the_others():
    def ready(radial_n_m):
        bearings = {name: {"radial_n_m": radial_n_m} for name in ("sun", "carrier", "planet")}
        uneven = {"imperfections": {"planets": {"position_um": 5}}, "dynamics": {"bearings": bearings}}
        stage = prepare_scene(scene(fidelity="dynamic", **uneven), rng_for=partial(random_stream, 1))
        return motion_of(stage)

    motion = ready(1e13)
    force = motion.drive_load.forces(motion.stage.speed_hz, motion.stage.instants_s).T
    errors_m = np.array([mean_error_m(mesh) for mesh in motion.system.meshes])
    with_errors, without = (static_deflection(motion.system, force, errors_m=each)[1] for each in (errors_m, 0.0))
    ahead = np.array([float(motion.gears.teeth[f"planet-ring {number}"].properties.error(0.5)) for number in (1, 2, 3)])
    # sun and carrier turn alone: each planet is two springs in series, displaced by the errors of both its meshes
    sun, ring = (motion.system.meshes[number].stiffness.mean for number in (0, 3))
    expected = -2 * (ahead - np.mean(ahead)) * sun * ring / (sun + ring)
    assert_allclose(
        (with_errors - without)[:, 0], np.tile(expected, 2), rtol=1e-3
    )  # bearings are 1e4 times as stiff as teeth
    static_n = ready(1e8).sensor_forces.static_n
    # sun and planets on their bearings give way to it
    assert 100 < np.ptp([static_n[f"planet-ring {number}"][0] for number in (1, 2, 3)]) < np.ptp(expected)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"torque": None}, "a ring bends only under load; add torque"),
        ({"sensor": [{"name": "a", "on": "sun", "units": "g"}]}, "no sensor is on a stationary ring"),
        ({"gearbox": without_sizes("planetary-27-36-99")}, "planet_pass.ring needs pressure_angle_deg of mesh"),
        ({"torque": {"link": "sun", "nm": 10}}, "name the link that takes the power out as dynamics.load_on"),
    ],
)
def test_a_ring_that_cannot_bend_is_refused(changes, words):
    with pytest.raises(SceneError, match=words):
        simulate(scene(**changes), seed=1)

"""Modes, Campbell diagrams and stability against published frequencies, closed forms and brute force."""

import cmath
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from published_systems import RADII, chaari, wijianto
from scipy import integrate, linalg

from data_synth.dynamics.elements import GeneralMesh, Support
from data_synth.dynamics.modes import campbell, eigenvalues, solve_modes, with_modal_damping
from data_synth.dynamics.stability import floquet, instability_tongues, stability_map
from data_synth.dynamics.system import Body, System, build_system
from data_synth.gears.mesh_stiffness import Fourier, Rectangular, Shifted, Trapezoidal

STEPS = Rectangular(low=0.76e6, high=1.36e6, duty=0.4)


def oscillator(stiffness, *, damping=0.0, backlash=0.0):
    """One mass of 1 kg on a mesh."""
    mass = Body(name="mass", mass_kg=1.0, motions=("x",))
    mesh = GeneralMesh(
        name="k", motions={("mass", "x"): 1.0}, stiffness=stiffness, damping=damping, backlash_m=backlash
    )
    return build_system([mass], [mesh])


class TestModes:
    def test_a_full_mass_matrix(self):
        rng = np.random.default_rng(1)
        a, b = rng.standard_normal((2, 6, 6))
        mass, stiffness = a @ a.T + np.eye(6), b @ b.T
        system = System(
            mass=mass, damping=0 * mass, stiffness=stiffness, meshes=(), names=tuple(f"{one} x" for one in "abcdef")
        )
        wanted = np.sqrt(linalg.eigh(stiffness, mass, eigvals_only=True))
        assert_allclose(solve_modes(system).angular, wanted, rtol=1e-9)  # of scipy's own error

    def test_free_bodies_strain_nothing(self):
        bodies = [Body(name=name, mass_kg=1, inertia_kgm2=1, motions=("x", "rotation")) for name in "ab"]
        modes = solve_modes(build_system(bodies, []))
        assert_allclose(modes.frequencies_hz, 0, atol=0)
        assert modes.kinds == ("rigid",) * 4

    def test_modal_damping_gives_each_mode_its_ratio(self):
        system = with_modal_damping(chaari(), ratio=0.03)
        values = eigenvalues(system)
        swinging = values[values.imag > 1]
        assert_allclose(np.sort(np.abs(swinging)), solve_modes(system).angular[1:], rtol=1e-9)
        assert_allclose(-swinging.real / np.abs(swinging), 0.03, rtol=1e-7)

    def test_unknown_planets_are_refused(self):
        with pytest.raises(ValueError, match='planets names "moon"'):
            solve_modes(chaari(), planets=["moon"])


class TestCampbell:
    def test_a_mesh_line_meets_each_mode_at_its_critical_speed(self):
        diagram = campbell(lambda _: wijianto(), speeds_rad_s=np.linspace(0, 6000, 7))
        assert_allclose(diagram.frequencies_hz[3], solve_modes(wijianto()).frequencies_hz, rtol=1e-12)
        assert_allclose(diagram.critical_speeds(1.0), solve_modes(wijianto()).angular[1:], rtol=1e-9)
        assert np.isnan(diagram.damping_ratios[:, 0]).all()

    def test_a_mass_in_a_turning_frame_splits_by_the_speed(self):
        # |omega +- Omega|: in coordinates that turn, circular motion is seen faster and slower
        body = Body(name="mass", mass_kg=2.0, motions=("x", "y"), frame_ratio=0.5)
        hold = Support(between=("mass", None), x=2e6, y=2e6)
        for speed in (0.0, 100.0, 400.0):
            rates = np.abs(eigenvalues(build_system([body], [hold], speed_rad_s=speed)).imag)
            expected = np.repeat([1000 - speed / 2, 1000 + speed / 2], 2)
            assert_allclose(np.sort(rates), expected, rtol=1e-10)


class TestFloquet:
    def test_meissner_s_equation(self):
        # trace 2 cos cos - (a/b + b/a) sin sin, a^2 = 1.3, b^2 = 0.7, half of a period of pi each
        found = floquet(oscillator(Rectangular(low=0.7, high=1.3, duty=0.5)), speed_rad_s=2.0)
        assert found.period_s == pytest.approx(math.pi)
        assert np.trace(found.monodromy) == pytest.approx(-2.089829426306, abs=5e-13)  # 12 decimals are given

    def test_mathieu_s_equation_against_adaptive_integration(self):
        wave = Fourier(mean=1.0, harmonics=np.array([0.3 + 0.1j, 0.05j]))
        found = floquet(oscillator(wave, damping=0.04), speed_rad_s=1.9)

        def stiffness(angle):
            turn = cmath.exp(1j * angle)
            return 1.0 + ((0.3 + 0.1j) * turn + 0.05j * turn**2).real

        states = []
        for start in np.eye(2):
            path = integrate.solve_ivp(
                lambda t, z: [z[1], -stiffness(1.9 * t) * z[0] - 0.04 * z[1]],
                (0, 2 * np.pi / 1.9),
                start,
                method="DOP853",
                rtol=1e-12,
                atol=1e-14,
            )
            states.append(path.y[:, -1])
        assert_allclose(found.monodromy, np.transpose(states), atol=2e-9)
        # Liouville: the product of the multipliers is the damping's
        assert np.prod(found.multipliers).real == pytest.approx(math.exp(-0.04 * found.period_s), rel=1e-10)

    def test_the_tongue_at_twice_the_second_mode(self):
        # narrower ones, of sums of modes, lie beside it
        found = instability_tongues(wijianto(mesh=STEPS), speeds_rad_s=np.linspace(1200, 1560, 61))
        tongue = max(found, key=lambda one: one.growth)
        assert tongue.low_rad_s == pytest.approx(1256.6497, abs=6e-5)  # four decimals are printed
        assert tongue.high_rad_s == pytest.approx(1502.8244, abs=6e-5)
        speeds = np.linspace(1360, 1380, 201)  # a tenth of a rad/s apart: the top is missed by less than 1e-7
        growth = stability_map(lambda _: wijianto(mesh=STEPS), parameters=[0.0], speeds_rad_s=speeds).growth
        assert growth.max() == pytest.approx(1.326561, abs=6e-7)  # six decimals are printed

    def test_the_tongue_at_twice_the_third_mode(self):
        (tongue,) = instability_tongues(wijianto(mesh=STEPS), speeds_rad_s=np.linspace(4920, 4945, 51))
        assert tongue.low_rad_s == pytest.approx(4929.2252, abs=6e-5)
        assert tongue.high_rad_s == pytest.approx(4939.3872, abs=6e-5)
        assert tongue.growth == pytest.approx(1.00324, abs=6e-6)
        # first order: 2 w +- k1 phi^2 / (2 w), k1 the first line of the stiffness
        modes = solve_modes(wijianto(mesh=STEPS))
        rate = modes.angular[2]
        phi = wijianto().meshes[0].direction @ modes.shapes[:, 2]
        line = 2 / np.pi * 0.6e6 * math.sin(0.4 * np.pi)
        assert tongue.high_rad_s - tongue.low_rad_s == pytest.approx(line * phi**2 / rate, rel=0.02)

    def test_8334_is_stable(self):
        assert floquet(wijianto(mesh=STEPS), speed_rad_s=8334.0).largest == pytest.approx(1, abs=1e-12)

    def test_stiff_bearings_leave_the_torsional_mesh_alone(self):
        # one torsional freedom: x'' + k(t) x (r1^2 / I1 + r2^2 / I2), exact by Meissner's product
        inertia = 0.011246309345072218, 0.10547808100593123
        effective = 1 / sum(radius**2 / moment for radius, moment in zip(RADII, inertia, strict=True))
        alone = oscillator(Rectangular(low=STEPS.low / effective, high=STEPS.high / effective, duty=0.4))
        expected = floquet(alone, speed_rad_s=1380.0).largest
        found = floquet(wijianto(bearing=1e16, mesh=STEPS), speed_rad_s=1380.0).largest
        assert found == pytest.approx(expected, rel=1e-9)  # compliances of 2e-16 beside 1e-6

    def test_the_fine_product_of_a_steep_ramp_comes_to_the_exact_one(self):
        exact = floquet(wijianto(mesh=STEPS), speed_rad_s=1350.0).largest
        steep = Trapezoidal(low=STEPS.low, high=STEPS.high, duty=0.4, ramp=1e-4)
        assert floquet(wijianto(mesh=steep), speed_rad_s=1350.0).largest == pytest.approx(exact, rel=1e-6)

    def test_damping_closes_tongues(self):
        def damped(ratio):
            return with_modal_damping(wijianto(mesh=STEPS), ratio=ratio)

        growth = stability_map(damped, parameters=[0.0, 0.02, 0.2], speeds_rad_s=[1380.0, 3000.0])
        assert growth.growth[0, 0] > growth.growth[1, 0] > 1
        assert growth.unstable.tolist() == [[True, False], [True, False], [False, False]]

    def test_meshes_of_several_orders_repeat_together(self):
        mass = Body(name="mass", mass_kg=1.0, motions=("x",))
        meshes = [
            GeneralMesh(
                name=name,
                motions={("mass", "x"): 1.0},
                stiffness=Shifted(of=STEPS, by_cycles=0.3),
                cycles_per_rev=order,
            )
            for name, order in (("first", 23.0), ("second", 19 * 23 / 67))
        ]
        found = floquet(build_system([mass], meshes), speed_rad_s=50.0)
        # 23 and 437/67 cycles a turn are 67 and 19 cycles after 67/23 turns, and no fewer whole ones
        assert found.period_s == pytest.approx(67 / 23 * 2 * np.pi / 50)
        assert np.prod(found.multipliers).real == pytest.approx(1, rel=1e-8)

    @pytest.mark.parametrize(
        ("system", "speed", "words"),
        [
            (oscillator(STEPS), 0.0, "speed_rad_s = 0.0"),
            (build_system([Body(name="a", mass_kg=1, motions=("x",))], []), 1.0, "has no mesh"),
        ],
    )
    def test_what_has_no_period_is_refused(self, system, speed, words):
        with pytest.raises(ValueError, match=words):
            floquet(system, speed_rad_s=speed)

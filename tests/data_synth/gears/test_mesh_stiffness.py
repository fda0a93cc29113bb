"""Mesh stiffness, transmission errors and gear geometry against closed forms, standards, independent computations."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate
from scipy.integrate import quad

from data_synth.gears.geometry import GearPair
from data_synth.gears.lost_contact import LoadSharing, LostContact
from data_synth.gears.mesh_stiffness import Constant, Fourier, Rectangular, Shifted, Trapezoidal, fourier_series
from data_synth.gears.root_crack import RootCrack
from data_synth.gears.tooth_compliance import DamagedTooth, Tooth, ToothPair, helical, hertz_stiffness, teeth_in_mesh
from data_synth.gears.transmission_error import Eccentricity, PitchError, ProfileError, SumOfErrors

ALPHA = math.radians(20)
EQUAL = GearPair(teeth=(62, 62), module_m=2e-3, face_width_m=20e-3, pressure_angle_rad=ALPHA)
PAIR = ToothPair(
    gears=GearPair(teeth=(31, 62), module_m=2e-3, face_width_m=20e-3, pressure_angle_rad=ALPHA),
    bore_radii_m=(0.010, 0.0175),
)
PHASES = np.linspace(-3, 5, 1601) + 1e-4


class TestShapes:
    @pytest.mark.parametrize("duty", [0.1, 0.4, 0.79])
    def test_a_rectangle_has_the_lines_of_the_textbook(self, duty):
        wave = Rectangular(low=0.76e6, high=1.36e6, duty=duty)
        assert wave.mean == pytest.approx(0.76e6 + duty * 0.6e6)
        order = np.arange(1, 101)
        lines = np.abs(fourier_series(wave, harmonics=100).harmonics) / 0.6e6
        assert_allclose(lines, 2 / (np.pi * order) * np.abs(np.sin(np.pi * order * duty)), atol=1e-12)

    @pytest.mark.parametrize("ratio", [1.3, 1.7, 2.3, 2.79, 3.5])
    @pytest.mark.parametrize("ramp", [0.0, 0.1, 0.2])
    def test_at_any_contact_ratio_it_is_the_sum_over_all_pairs(self, ratio, ramp):
        # pair j begins to bear at phase j, bears in full a ramp later, and begins to shed its load at j + ratio
        pair = 2e8
        wave = (
            Trapezoidal.by_contact_ratio(pair_stiffness=pair, contact_ratio=ratio, ramp=ramp)
            if ramp
            else Rectangular.by_contact_ratio(pair_stiffness=pair, contact_ratio=ratio)
        )
        since = PHASES[:, None] - np.arange(-10, 10)
        if ramp:
            bearing = np.clip(since / ramp, 0, 1) - np.clip((since - ratio) / ramp, 0, 1)
        else:
            bearing = ((since >= 0) & (since < ratio)).astype(float)
        assert_allclose(wave(PHASES), pair * bearing.sum(axis=1), rtol=1e-11)
        assert wave.mean == pytest.approx(ratio * pair, rel=1e-12)
        assert (wave.low, wave.high) == pytest.approx((math.floor(ratio) * pair, math.ceil(ratio) * pair), rel=1e-12)

    def test_the_series_of_a_shifted_trapezium_is_its_own_turned(self):
        # integrated to rounding only where no segment goes across a corner: else to 1e-4
        wave, by = Trapezoidal(low=1.0, high=3.0, duty=0.6, ramp=0.15), 0.2345
        order = np.arange(1, 13)
        # a trapezium is a rectangle's series, 2 (high - low) / (pi h) sin(pi h duty), smoothed over the ramp
        lines = 4 / (np.pi * order) * np.sin(np.pi * order * 0.6) * np.sinc(0.15 * order)
        lines = lines * np.exp(-1j * np.pi * order * (0.6 + 0.15))
        found = fourier_series(Shifted(of=wave, by_cycles=by), harmonics=12)
        assert_allclose(found.harmonics, lines * np.exp(2j * np.pi * order * by), rtol=0, atol=1e-12)

    def test_a_series_is_its_own_series(self):
        wave = Fourier(mean=2e8, harmonics=np.array([3e7j, -1e7, 5e6 + 2e6j]), period=4)
        again = fourier_series(wave, harmonics=5)
        assert_allclose(again.harmonics, [3e7j, -1e7, 5e6 + 2e6j, 0, 0], atol=1e-5)
        direct = 2e8 + np.real(
            sum(c * np.exp(2j * np.pi * h * PHASES / 4) for h, c in zip((1, 2, 3), wave.harmonics, strict=True))
        )
        assert_allclose(wave(PHASES), direct, rtol=1e-13)

    @pytest.mark.parametrize(
        ("build", "words"),
        [
            (lambda: Constant(mean=math.nan), "mean = nan"),
            (lambda: Rectangular(low=1, high=2, duty=1.0), "duty = 1.0 must be above 0 and below 1"),
            (lambda: Trapezoidal(low=1, high=2, duty=0.3, ramp=0.4), "at most 0.3"),
            (lambda: Fourier(mean=1, harmonics=np.array([np.inf])), "finite numbers"),
        ],
    )
    def test_nonsense_is_refused(self, build, words):
        with pytest.raises(ValueError, match=words):
            build()


class TestGeometry:
    def test_contact_ratio_to_every_printed_digit(self):
        assert EQUAL.contact_ratio == pytest.approx(1.7897798668330458, rel=1e-14)

    def test_wijianto_s_helical_teeth(self):
        pair = GearPair(
            teeth=(36, 63),
            module_m=3.5e-3,
            face_width_m=0.053,
            pressure_angle_rad=ALPHA,
            helix_angle_rad=math.radians(12),
        )
        assert pair.contact_ratio == pytest.approx(1.687, abs=5e-4)  # three decimals are given; the paper takes 1.4
        assert_allclose(pair.base_radii_m, [0.060363908371477926, 0.10563683965008637], rtol=1e-14)
        assert_allclose(pair.reference_radii_m, [0.064407457476496844, 0.11271305058386948], rtol=1e-14)
        assert pair.overlap_ratio == pytest.approx(0.053 * math.sin(math.radians(12)) / (math.pi * 3.5e-3))

    def test_contact_by_rolling_two_involutes(self):
        # the tips' involutes meet the line of action where their radii say, with no formula for the path
        pair = GearPair(
            teeth=(20, 31), module_m=3e-3, face_width_m=0.03, pressure_angle_rad=ALPHA, profile_shift=(0.3, 0.2)
        )
        angle = pair.working_angle_rad
        distance = pair.centre_distance_m
        # backlash-free: tooth thicknesses on the pitch circles add up to the pitch
        widths = []
        for count, shift, reference, working in zip(
            pair.teeth, pair.profile_shift, pair.reference_radii_m, pair.working_radii_m, strict=True
        ):
            thick = math.pi / (2 * count) + 2 * shift * math.tan(ALPHA) / count
            involute = (math.tan(ALPHA) - ALPHA) - (math.tan(angle) - angle)
            widths.append(2 * working * (thick + involute))
            assert reference * math.cos(ALPHA) == pytest.approx(working * math.cos(angle))
        assert sum(widths) == pytest.approx(2 * math.pi * pair.working_radii_m[0] / 20, rel=1e-13)
        begin, end = pair.path_m
        foot = distance * math.sin(angle)
        assert math.hypot(pair.base_radii_m[0], end) == pytest.approx(pair.tip_radii_m[0])
        assert math.hypot(pair.base_radii_m[1], foot - begin) == pytest.approx(pair.tip_radii_m[1])

    def test_an_internal_pair_touches_for_longer_than_an_external_one(self):
        # the textbook 20 degrees: external gears approach a rack from below, internal ones from above
        ratio = {
            count: GearPair(teeth=(30, count), module_m=2e-3, face_width_m=0.02, pressure_angle_rad=ALPHA).contact_ratio
            for count in (90, 10**7, -(10**7), -90)
        }
        assert ratio[90] < ratio[10**7] < ratio[-90]
        assert ratio[10**7] == pytest.approx(ratio[-(10**7)], rel=1e-5)

    def test_iso_6336_for_a_pair_worked_by_hand(self):
        # z = 62/62 without shift: q' = 0.04723 + (0.15551 + 0.25791) / 62 = 0.0538981 mm um / N
        by_hand = 0.8 / (0.04723 + 0.41342 / 62)
        assert EQUAL.single_stiffness(rack_factor=1.0) == pytest.approx(by_hand * 1e9, rel=1e-14)
        mean = EQUAL.mean_stiffness(rack_factor=1.0)
        assert mean == pytest.approx(by_hand * 1e9 * (0.75 * EQUAL.contact_ratio + 0.25) * 0.02, rel=1e-14)
        assert EQUAL.rack_factor == pytest.approx(0.975)

    def test_impossible_gears_are_refused(self):
        shifted = GearPair(
            teeth=(20, 30), module_m=1e-3, face_width_m=0.01, pressure_angle_rad=ALPHA, profile_shift=(-1, -2)
        )
        with pytest.raises(ValueError, match="must have more teeth than the first"):
            GearPair(teeth=(40, -30), module_m=1e-3, face_width_m=0.01, pressure_angle_rad=ALPHA)
        with pytest.raises(ValueError, match="no common pitch point"):
            shifted.working_angle_rad  # noqa: B018


def published_tooth(**changes):
    """The tooth of a rotordynamics package's tests, with the root angle as its source prints it."""
    rounding = 0.25 / (1 - math.sin(ALPHA))
    root = (math.pi / 2 + 2 * math.tan(ALPHA) * (1 - rounding) + 2 * rounding / math.cos(ALPHA)) / 62
    settings = {
        "teeth": 62,
        "module_m": 2e-3,
        "face_width_m": 20e-3,
        "pressure_angle_rad": ALPHA,
        "bore_radius_m": 17.5e-3,
    }
    return Tooth(**{**settings, "root_half_angle_rad": root, **changes})


class TestStrainEnergy:
    def test_hertz(self):
        found = hertz_stiffness(young_pa=206e9, poisson=0.3, width_m=0.02)
        assert found == pytest.approx(3555868607.9093266, rel=1e-15)

    def test_a_pair_that_enters_to_every_printed_digit(self):
        # that package spaces contacts evenly in pressure angle, from the form circle to the tip, two pairs at first
        tooth = published_tooth()
        form, tip = tooth.form_angle_rad, math.acos(EQUAL.base_radii_m[0] / EQUAL.tip_radii_m[0])
        hertz = hertz_stiffness(young_pa=206e9, poisson=0.3, width_m=0.02)
        later = (tip - form) / EQUAL.contact_ratio
        one = tooth.compliance(np.array([form, form + later]))
        two = tooth.compliance(np.array([tip, tip - later]))
        # printed: 396622921.36, and 10 digits more in its tests
        assert np.sum(1 / (1 / hertz + one + two)) == pytest.approx(396622921.3581085, rel=1e-14)

    def test_the_mesh_is_the_sum_of_its_pairs(self):
        mesh, ratio = teeth_in_mesh(PAIR), PAIR.gears.contact_ratio
        exact = 1 / PAIR.compliance(PHASES % 1)
        exact += np.where(ratio > PHASES % 1 + 1, 1 / PAIR.compliance(np.minimum(PHASES % 1 + 1, ratio)), 0)
        # between 257 points a parabola leaves its chord by 1e-5
        assert_allclose(mesh(PHASES), exact, rtol=2e-5)
        path = np.linspace(0, ratio, 4001)
        assert mesh.mean == pytest.approx(integrate.simpson(1 / PAIR.compliance(path), path), rel=2e-5)
        assert mesh.jumps == (0.0, ratio - 1)
        # within a fifth of the standard's, which is for rims and loads of its own
        assert mesh.mean == pytest.approx(PAIR.gears.mean_stiffness(), rel=0.2)

    def test_a_whole_overlap_leaves_the_mean(self):
        mesh = teeth_in_mesh(PAIR)
        smooth = helical(mesh, overlap_ratio=2.0, harmonics=8)
        assert_allclose(smooth.harmonics, 0, atol=1e-9 * mesh.mean)
        half = helical(mesh, overlap_ratio=0.5, harmonics=400)
        slices = np.mean([mesh(PHASES[::40] - 0.5 * (i + 0.5) / 2000) for i in range(2000)], axis=0)
        assert_allclose(half(PHASES[::40]), slices, rtol=2e-4)  # lines beyond 400, and 2000 slices

    def test_undercut_teeth_are_refused(self):
        with pytest.raises(ValueError, match=r"below 17\.1 teeth"):
            published_tooth(teeth=16, bore_radius_m=5e-3)


def sharing(static_n):
    return LoadSharing(gears=PAIR.gears, pair_compliance=PAIR.compliance, static_n=static_n)


def damaged(fault, *, gear=0, tooth=3):
    return teeth_in_mesh(PAIR, damaged=[DamagedTooth(gear=gear, tooth=tooth, fault=fault)])


class TestFaults:
    @pytest.mark.parametrize("depth", [0.3e-3, 1e-3, 2.5e-3])
    def test_a_crack_turns_its_section_by_the_energy_that_its_growth_releases(self, depth):
        # theta / M = 2 W / E' int (K / M)^2 da, K of an edge crack in pure bending (Tada, Paris and Irwin), within 1 %
        tooth, angle = PAIR.teeth[0], math.radians(70)
        whole = 2 * RootCrack(depth_m=0.0, angle_rad=angle).section(tooth).remaining_m

        def intensity(a):
            x = math.pi * a / (2 * whole)
            shape = math.sqrt(math.tan(x) / x) * (0.923 + 0.199 * (1 - math.sin(x)) ** 4) / math.cos(x)
            return 6 / (whole**2 * tooth.face_width_m) * math.sqrt(math.pi * a) * shape

        modulus = tooth.young_pa / (1 - tooth.poisson**2)
        released, _ = quad(lambda a: intensity(a) ** 2, 1e-12, depth * math.sin(angle))
        crack = RootCrack(depth_m=depth, angle_rad=angle, model="fracture_mechanics")
        phases = np.array([0.2, 0.8, 1.4])
        arm = tooth.lever_arm_m(PAIR.angles_rad(phases)[0], height_m=crack.section(tooth).tip_m)
        expected = 2 * tooth.face_width_m / modulus * released * arm**2
        assert_allclose(crack.added_compliance(PAIR, 0, phases), expected, rtol=0.03)

    def test_a_crack_by_adaptive_quadrature(self):
        tooth, crack = PAIR.teeth[0], RootCrack(depth_m=1.5e-3, angle_rad=math.radians(60))
        left = crack.section(tooth)
        lean = math.tan(0.42) - tooth._base_half_angle
        at_half, at_height, _ = (float(value) for value in tooth.involute_at(np.array(lean)))

        def energy(half, height, rate):
            width = float(half + left(np.array(height), np.array(half)))
            arm = math.cos(lean) * (at_height - height) - at_half * math.sin(lean)
            return rate * (arm**2 / (206e9 * width**3 / 12) + 1.2 * math.cos(lean) ** 2 / (206e9 / 2.6 * width))

        def healthy(half, height, rate):
            arm = math.cos(lean) * (at_height - height) - at_half * math.sin(lean)
            return rate * (arm**2 / (206e9 * (2 * half) ** 3 / 12) + 0.6 * math.cos(lean) ** 2 / (206e9 / 2.6 * half))

        start = math.tan(tooth.form_angle_rad) - tooth._base_half_angle
        added = 0.0
        for curve, ends in ((tooth.fillet_at, (math.pi / 2, ALPHA)), (tooth.involute_at, (start, lean))):
            grid = np.linspace(*ends, 200001)
            values = np.array([energy(*curve(np.array(s))) - healthy(*curve(np.array(s))) for s in grid[::50]])
            added += integrate.trapezoid(values, grid[::50])
        phases = np.linspace(0, PAIR.gears.contact_ratio, 400001)
        phase = phases[np.argmin(np.abs(PAIR.angles_rad(phases)[0] - 0.42))]
        found = crack.added_compliance(PAIR, 0, np.array([phase]))[0]
        # 4000 steps across the edge of the crack here, a kink between Gauss nodes there
        assert found == pytest.approx(added / 0.02, rel=2e-3)

    def test_damage_comes_back_after_a_turn_of_its_gear(self):
        phase = np.linspace(0.003, 31, 997, endpoint=False)
        for gear, teeth in ((0, 31), (1, 62)):
            mesh = damaged(RootCrack(depth_m=1e-3, angle_rad=1.2), gear=gear)
            assert mesh.period == teeth
            assert_allclose(mesh(phase + teeth), mesh(phase), rtol=1e-9)
            touched = mesh(phase) < 0.9999 * teeth_in_mesh(PAIR)(phase)
            assert np.all((phase[touched] > 3) & (phase[touched] < 3 + PAIR.gears.contact_ratio))
            assert touched.any()

    def test_faults_of_one_tooth_and_of_others_add_up(self):
        small, large = (RootCrack(depth_m=depth, angle_rad=1.2) for depth in (1e-3, 2e-3))
        ratio, healthy = PAIR.gears.contact_ratio, teeth_in_mesh(PAIR)
        alone = np.linspace(ratio - 1 + 0.02, 0.98, 20)  # of each pair, in cycles since it entered
        both = teeth_in_mesh(
            PAIR,
            damaged=[
                DamagedTooth(gear=gear, tooth=tooth, fault=fault)
                for gear, tooth, fault in ((0, 3, small), (0, 3, large), (0, 5, large), (1, 34, small))
            ],
        )
        assert both.period == 62

        def added(mesh, cycle):
            return 1 / mesh(cycle + alone) - 1 / healthy(cycle + alone)

        of_small, of_large, of_other = (
            added(damaged(fault, gear=gear), 3) for gear, fault in ((0, small), (0, large), (1, small))
        )
        assert_allclose(added(both, 3), of_small + of_large, rtol=1e-7)
        assert_allclose(added(both, 34), of_small + of_large + of_other, rtol=1e-7)  # the wheel's tooth 34, a turn on
        assert_allclose(added(both, 5), of_large, rtol=1e-7)
        assert_allclose(added(both, 4), 0, atol=1e-15)

    def test_a_missing_tooth_leaves_its_neighbours(self):
        mesh = damaged(LostContact(sharing=sharing(1000.0), face_share=0.0))
        healthy = teeth_in_mesh(PAIR)
        # alone in contact: a neighbour off the path in its place
        assert mesh(3.9) == pytest.approx(healthy(3.9), rel=2e-5)
        assert mesh(3.2) == pytest.approx(1 / PAIR.compliance(np.array([1.2]))[0], rel=2e-5)
        assert mesh(10.2) == healthy(10.2)

    def test_what_the_teeth_do_not_have_is_refused(self):
        with pytest.raises(ValueError, match="tooth = 31"):
            damaged(RootCrack(depth_m=1e-3, angle_rad=1.5), tooth=31)
        with pytest.raises(ValueError, match="leaves nothing of a tooth"):
            damaged(RootCrack(depth_m=6e-3, angle_rad=1.5))


class TestErrors:
    def test_pitch_goes_from_tooth_to_tooth(self):
        error = PitchError(teeth_m=np.array([1.0, 3.0, -2.0]), handover=0.5)
        assert error.period == 3
        assert_allclose(error([0.0, 0.25, 0.5, 0.9, 1.25, 2.0, 2.5, 3.0, -0.5]), [-2, -0.5, 1, 1, 2, 3, -2, -2, -2])
        assert_allclose(PitchError(teeth_m=np.array([1.0, 3.0]), handover=0.0)([0.0, 0.99, 1.0]), [1, 1, 3])

    def test_parts_that_repeat_after_different_cycles_go_on_at_their_own_phase(self):
        # every part by its formula, cycle for cycle; the pitch error's teeth enter one after the other
        teeth = 1e-6 * np.array([1.0, 3.0, -2.0, 0.5, -1.0])
        inner = SumOfErrors(parts=(Eccentricity(teeth=4, eccentricity_m=5e-6),), by_cycles=0.75)
        parts = (
            ProfileError(harmonics_m=np.array([2e-6])),
            PitchError(teeth_m=teeth, handover=0.0),
            Eccentricity(teeth=7, eccentricity_m=4e-6),
            Eccentricity(teeth=3, eccentricity_m=2e-6, phase_rad=math.pi / 2),
            inner,
        )
        late = (0.3, 2.5, 0.0, 4.25, 1.0)
        later = [SumOfErrors(parts=(part,), by_cycles=by) for part, by in zip(parts, late, strict=True)]
        both = SumOfErrors(parts=tuple(later))
        phases = np.arange(-900, 900) * 0.7531  # some hundred cycles, of all fractions

        def expected(phase):
            return (
                2e-6 * np.cos(2 * np.pi * (phase + 0.3))
                + teeth[np.floor(phase + 2.5).astype(int) % 5]
                + 4e-6 * np.sin(2 * np.pi * phase / 7)
                + 2e-6 * np.cos(2 * np.pi * (phase + 4.25) / 3)
                + 5e-6 * np.sin(2 * np.pi * (phase + 1.75) / 4)
            )

        # sums of some 1e-5 at angles of some 1000 rad, each rounded to 1e-13 rad: 1e-18, and a hundred times that
        assert_allclose(both(phases), expected(phases), rtol=0, atol=1e-16)
        assert both.period == 5 * 7 * 3 * 4
        assert_allclose(both(phases + both.period), expected(phases), rtol=0, atol=1e-16)
        for shorter in (both.period // prime for prime in (2, 3, 5, 7)):
            assert np.abs(both(phases + shorter) - both(phases)).max() > 1e-6
        in_step = SumOfErrors(parts=parts)
        assert in_step.period == both.period
        assert_allclose(in_step(phases), sum(part(phases) for part in parts), rtol=0, atol=1e-19)

"""Doubtful speeds in the angle domain, on run-ups whose angle is known in closed form."""

import numpy as np
import pytest

from signals.shaft import tacholess
from signals.shaft._angle_confirmation import decide, follow, joint_evidence, strays
from signals.shaft.phase import ShaftPhase

RATE_HZ, SECONDS = 4096.0, 5.0
ORDERS = np.array([1.0, 5.7, 11.4, 16.0, 20.0, 32.0, 40.0])
RANGE_HZ = (10.0, 60.0)


def speed(t):
    return 15 + 2.5 * t


def revolutions(t):
    return 15 * t + 1.25 * t**2


def record(lines, *, noise=1.0):
    t = np.arange(int(RATE_HZ * SECONDS)) / RATE_HZ
    x = sum(height * np.cos(2 * np.pi * order * revolutions(t) + order) for order, height in lines)
    return x + noise * np.random.default_rng(4).standard_normal(t.size)


def phase(ratio=np.ones_like):
    """Return the phase of a speed in a ratio to the true one that may depend on time."""
    t = np.linspace(0, SECONDS, 501)
    fine = (t[1:] + t[:-1]) / 2
    return ShaftPhase(times_s=t, revolutions=np.concatenate([[0], np.cumsum(ratio(fine) * speed(fine) * np.diff(t))]))


def off(found):
    t = np.linspace(found.start_s + 0.05, found.stop_s - 0.05, 200)
    return np.abs(found.speed_hz(t) / speed(t) - 1)


TWO_MESHES = ((5.7, 0.6), (11.4, 0.4), (20, 0.8), (40, 0.5))


class TestFollow:
    def test_half_a_per_cent_off(self):
        """The highest order, within half a bin of 0.7 s at the mean of 21 Hz, gives 0.7 / 840: 0.0009 in each frame."""
        found = follow(record(TWO_MESHES), RATE_HZ, phase(lambda t: np.full_like(t, 1.005)), ORDERS, frame_s=0.7)
        assert np.median(off(found.phase)) < 0.001
        assert np.quantile(off(found.phase), 0.95) < 0.004
        assert set(ORDERS[found.scores > 10]) == {5.7, 11.4, 20, 40}

    def test_too_short_a_part(self):
        t = np.array([0.0, 0.5, 1.0, 1.5])
        short = ShaftPhase(times_s=t, revolutions=revolutions(t))
        assert follow(record(TWO_MESHES), RATE_HZ, short, ORDERS, frame_s=0.7) is None


class TestDecide:
    def test_a_rival_that_shares_a_line(self):
        """At 1.25 times the speed 20 and 40 are 16 and 32, but 5.7 and 11.4 are not there."""
        rough = [phase(lambda t: np.full_like(t, 1.25)), phase(lambda t: np.full_like(t, 1.003))]
        found = decide(record(TWO_MESHES), RATE_HZ, rough, ORDERS, range_hz=RANGE_HZ)
        assert np.quantile(off(found.refined.phase), 0.95) < 0.002
        assert found.probability > 0.9

    def test_a_speed_that_no_candidate_has_is_a_rival(self):
        found = decide(record(TWO_MESHES), RATE_HZ, [phase(lambda t: np.full_like(t, 1.25))], ORDERS, range_hz=RANGE_HZ)
        assert found is None

    def test_octaves_with_the_same_lines_are_not_decided(self):
        lines = ((11.4, 0.6), (32, 0.8), (40, 0.5))  # of twice the speed, 5.7, 16 and 20
        rough = [phase(), phase(lambda t: np.full_like(t, 2.0))]
        assert decide(record(lines), RATE_HZ, rough, ORDERS, range_hz=RANGE_HZ) is None

    @pytest.mark.parametrize("lines", [((20, 0.8),), ((1, 0.8), (20, 0.8))])
    def test_one_mesh_line_may_be_any(self, lines):
        assert decide(record(lines), RATE_HZ, [phase()], ORDERS, range_hz=RANGE_HZ) is None

    def test_a_path_that_strays_is_mended_by_one_that_does_not(self):
        early, late = (phase(lambda t, s=s: np.where((t > 2.5) == s, 1.0, 1.1)) for s in (False, True))
        found = decide(record(TWO_MESHES), RATE_HZ, [early, late], ORDERS, range_hz=RANGE_HZ)
        assert found is None or np.quantile(off(found.refined.phase), 0.95) < 0.01
        assert decide(record(TWO_MESHES), RATE_HZ, [early], ORDERS, range_hz=RANGE_HZ) is None

    def test_joint_evidence(self):
        # neither the strongest, nor the shaft, nor a slower one, nor what is below the least score
        assert joint_evidence(np.array([0.4, 1, 20, 40, 60]), np.array([50.0, 90, 30, 20, 2])) == 20


class TestStrays:
    @pytest.mark.parametrize("share", [0.08, 0.15])
    def test_a_start_without_lines(self, share):
        """A path that comes down to the shaft from a tenth above it, before its lines show; a sound one has none."""
        begins_s = share * SECONDS
        x = record(TWO_MESHES)
        quiet = np.arange(x.size) / RATE_HZ < begins_s
        x[quiet] = np.random.default_rng(7).standard_normal(np.count_nonzero(quiet))
        wrong = phase(lambda t: 1 + 0.1 * np.clip(1 - t / begins_s, 0, 1) ** 0.5)
        found = strays(x, RATE_HZ, wrong, ORDERS)
        assert found[0][0] < 0.1
        assert begins_s - 0.25 < max(last for _, last in found) < 2 * begins_s
        assert max(first for first, _ in found) < begins_s
        assert strays(x, RATE_HZ, phase(), ORDERS) == []


class TestSearches:
    def test_a_sure_speed_of_moving_lines_is_searched_once(self, monkeypatch):
        moving = []
        search = tacholess.search_speeds
        monkeypatch.setattr(
            tacholess,
            "search_speeds",
            lambda *given, **more: (moving.append(more["moving"]), search(*given, **more))[1],
        )
        found = tacholess.estimate_speed(
            record(TWO_MESHES), rate_hz=RATE_HZ, orders=ORDERS, speed_range_hz=RANGE_HZ, max_acceleration_hz_s=4
        )
        assert found.status == "ok"
        assert moving
        assert not any(moving)

"""The benchmarks run: the report on jobs cut short; and the jobs are what they say."""

import dataclasses

import numpy as np
import peers
import pytest
import trackers
from jobs import standard_job
from tracking import settings
from tracking.clock import Effort
from tracking.measuring import measure
from tracking.settings import our_settings, ours, streams
from tracking.slipping import ORDER, Slipping

from signals.harmonics import harmonic_model, track_orders

JOBS = ("J1 run-up", "J2 crossing", "J3 angle", "J4 close")


@pytest.mark.parametrize("name", JOBS[:3])
def test_a_job_is_its_amplitudes_in_unit_noise(name):
    job = standard_job(name, samples=100_000)
    at = np.arange(job.samples)
    harmonics = np.zeros(job.samples)
    for place, amplitude in enumerate(job.amplitude(at)):
        harmonics += np.abs(amplitude) * np.cos(job.angle_rad(place) + np.angle(amplitude))
    noise = job.x - harmonics
    assert abs(noise.mean()) < 0.02  # six standard deviations of the mean of 100,000
    assert abs(noise.std() - 1) < 0.014  # six of their standard deviation
    # White: six standard deviations of a correlation of 100,000.
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.02


def test_a_job_draws_in_the_documented_order():
    rng = np.random.default_rng(2)
    level, ripples, swing = rng.uniform(0.3, 1, 3), rng.uniform(2, 6, 3), rng.uniform(1, 4, 3)
    start = rng.uniform(0, 2 * np.pi, (3, 3))
    job = standard_job("J2 crossing", samples=1000)
    u = 999 / 1_000_000
    turn = start[1] + 0.5 * swing * np.sin(2 * np.pi * 1.3 * u + start[2])
    truth = level * (1 + 0.35 * np.sin(2 * np.pi * ripples * u + start[0])) * np.exp(1j * turn)
    np.testing.assert_allclose(job.amplitude(np.array([999]))[:, 0], truth, rtol=1e-14)
    t = 999 / 50_000
    run_up = 2 * np.pi * (10 * t + 0.75 * t**2)
    angles = np.array([20 * run_up, 20.2 * run_up, 2 * np.pi * 300 * t])
    sample = np.sum(truth * np.exp(1j * angles)).real + rng.standard_normal(1000)[999]
    assert job.x[999] == pytest.approx(sample, abs=1e-11)  # angles of some 100 rad


def test_error_counts_the_middle_of_the_outputs_alone():
    job = standard_job("J2 crossing", samples=2000)
    at = np.arange(0, 2000, 10)
    wrong = job.amplitude(at) * 1.25
    assert job.error(wrong, at) == pytest.approx(0.25, rel=1e-12)
    edges = job.amplitude(at)
    edges[:, :10] = edges[:, -10:] = 1e3
    assert job.error(edges, at) == 0


@pytest.mark.parametrize("peer", [peers.filterpy_filter, peers.compiled_filter])
@pytest.mark.parametrize("name", JOBS[1:3])
def test_causal_peers_run_the_model_of_the_trackers(name, peer):
    job = standard_job(name, samples=1500)
    bandwidth = 0.04 if job.per_revolution else 4.0
    amplitude, at = peer(job, bandwidth)
    settings = job.tracking(bandwidth) | {"noise_variance": 1.0}
    x, states = settings.pop("x"), []
    model = harmonic_model(**settings)
    kalman = model.as_filterpy()
    for n, value in enumerate(x):
        kalman.update(value, H=model.H(n))
        states.append(kalman.x[:, 0].copy())
        kalman.predict()
    np.testing.assert_array_equal(at, np.arange(x.size))
    # The first turn leaves orders open; after it, what rounding a prior of 1e6 costs is forgotten.
    np.testing.assert_allclose(amplitude[:, 1000:], model.amplitude(np.stack(states))[:, 1000:], atol=1e-4)


@pytest.mark.parametrize("poles", [1, 2])
def test_vold_kalman_on_sums_tends_to_the_smoother(poles):
    job = standard_job("J3 angle", samples=512 * 40)
    tracks = track_orders(**job.tracking(0.05), poles=poles, method="exact")

    def apart(block):
        amplitude, at = peers.vold_kalman_coupled(job, 0.05, poles=poles, block=block)
        exact = np.stack([np.interp(at, tracks.sample_index, z) for z in tracks.complex_amplitude])
        middle = slice(at.size // 8, -at.size // 8)
        return np.abs(amplitude - exact)[:, middle].max() / tracks.std.max()

    # What amplitudes do within a block falls at least with its length; at a 640th of 1 / bandwidth little is left.
    assert apart(32) < apart(128) / 3
    assert apart(32) < 0.03


def test_the_report_is_written(tmp_path, capsys, monkeypatch):
    # Other poles make rows of the same kinds.
    few = [setting for setting in our_settings() if setting.poles == (2 if setting.label.startswith("smoother") else 1)]
    monkeypatch.setattr(trackers, "our_settings", lambda: few)
    effort = Effort(
        samples=5000,
        excerpt=400,
        repeats=1,
        slow_repeats=1,
        search=1,
        with_peers=False,
        lengths=(5000, 10_000),
        separable=(1, 2),
        coupled=(2, 3),
        grown=50_000,
        channels=2,
        poles=(2,),
        kinds=("AM", "white"),
        records=2,
    )
    trackers.main(tmp_path, effort=effort)
    report = (tmp_path / "trackers.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == report.strip()
    rows = [line for line in report.splitlines() if line.startswith(("| smoother |", "| filter |"))]
    assert {row.split(" | ")[1] for row in rows} >= {"exact", "fast"}
    assert all(f"## {name}" in report for name in JOBS)
    sections = "Several channels", "Coverage of `std`", "A line that", "Scaling"
    for section in sections:
        assert f"## {section}" in report
    # Every estimator and setting has its row, and no number that is none gets into the report.
    for row in ("filter in blocks", "slip smoother", "slip filter"):
        assert f"| {row} |" in report
    assert " nan " not in report
    assert (tmp_path / "trackers.svg").read_text(encoding="utf-8").count("<svg") == 1


def test_a_smoother_that_passes_for_a_filter_is_left_out():
    true = ours("filter", "exact", poles=1)
    smoother = ours("smoother", "exact", poles=1)
    false = dataclasses.replace(true, run=smoother.run)
    effort = Effort(samples=3000, excerpt=3000, repeats=1, slow_repeats=1, search=2)
    rows, refusals = measure(["J2 crossing"], [true, false], effort)
    assert [row.setting for row in rows] == [true]
    assert len(refusals) == 1
    assert "samples that come after" in refusals[0]


def test_a_stream_in_blocks_is_the_filter_of_the_record(monkeypatch):
    monkeypatch.setattr(settings, "FED", 700)
    job = standard_job("J2 crossing", samples=3000)
    fed, _ = streams()
    amplitude, at = fed.run(job, 4.0)
    tracks = track_orders(**job.tracking(4.0), estimator="filter", method="exact", noise_variance=1.0)
    np.testing.assert_array_equal(at, tracks.sample_index)
    np.testing.assert_allclose(amplitude, tracks.complex_amplitude, atol=1e-9)  # of order 1, priors of 1e6


def test_the_record_that_slips_turns_as_its_slip_says():
    record = Slipping.of(50_000)
    turned = np.cumsum(ORDER * 0.5 * (record.slip[1:] + record.slip[:-1]) * np.diff(record.phase_rad))
    # Trapezia miss a twelfth of the change of the slope, 1e-7 a sample, and 50 rad are rounded at each of 50,000 steps.
    np.testing.assert_allclose(record.turn_rad[1:], turned, rtol=0, atol=1e-7)

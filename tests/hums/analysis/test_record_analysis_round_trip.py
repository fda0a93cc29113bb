"""What the generator puts into a record the analysis finds: every kind of fault, at its order, in its size.

The two share no code beyond the gearbox: the truth is the generator's own.
"""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth import Scene, simulate
from data_synth.scene.scene import FAULT_KINDS
from hums.analysis.record_analysis import AnalysisSettings, analyze
from hums.analysis.result import findings_table, group, line_table
from hums.gearbox.model import load_gearbox
from hums.scoring import score
from signals.demodulation.envelope import envelope
from signals.harmonics import track_orders

RATE_HZ = 16_000
BAND_HZ = (5000.0, 7000.0)
MILL = {
    "gearbox": "two-stage",
    "rate_hz": RATE_HZ,
    "duration_s": 6,
    "fidelity": "kinematic",
    "speed": {"link": "input", "rpm": [[0, 1350], [6, 1500]]},
    "torque": {"link": "output", "nm": [[0, 420], [3, 500], [6, 450]]},
    "tachometer": {"link": "input", "pulses_per_rev": 1},
    "excitation": {"shaft_amplitude": 0.1, "mesh_amplitude": 0.9},
    "path": {"frequency_hz": 2200, "damping_ratio": 0.1},
    "resonance": {"frequency_hz": 6000, "damping_ratio": 0.03},
    "noise": {"rms": 0.3},
    "sensor": [
        # the band that is demodulated reaches beyond rate / 2.56, where the default filter begins
        {"name": "housing", "on": "input bearing", "direction": [0, 0, 1], "units": "g", "anti_alias": "none"}
    ],
}
PINION, SHAFT, BEARING = "stage 1/pinion", "intermediate", "intermediate bearing"
LOCAL = ("tooth_crack", "chipping", "missing_tooth", "spall", "pitting")
ALL_ROUND = ("eccentricity", "misalignment")
VERDICTS = dict.fromkeys(LOCAL, "indicated") | dict.fromkeys(ALL_ROUND, "measured")
BEARINGS = ("inner_race", "outer_race", "rolling_element", "cage")
SHAFTS = {"imbalance": 1, "bent_shaft": 1, "shaft_misalignment": 2}  # and the harmonic that rises most
SIZES_MM = (2.0, 4.0)
GROWN = ("tooth_crack", "eccentricity", "imbalance", "inner_race", "cage")  # analysed in both sizes, the others in one
COMPONENT = dict.fromkeys((*VERDICTS, "wear"), PINION) | dict.fromkeys(SHAFTS, SHAFT)
COMPONENT |= dict.fromkeys(BEARINGS, BEARING)
# within the pinion's tooth and clearance: a spall and pits in half of its thickness, wear in a quarter
SIZES = dict.fromkeys(COMPONENT, SIZES_MM)
SIZES |= {"spall": (1.1, 2.2), "pitting": (1.1, 2.2), "eccentricity": (0.35, 0.7), "wear": (0.5, 1.0)}


def fault(kind, size_mm, **more):
    size = {"depth_mm" if kind == "tooth_crack" else "size_mm": size_mm}
    return {"kind": kind, "component": COMPONENT[kind], **size, **more}


@cache
def round_trip(kind, size_mm):
    record = simulate(Scene.from_mapping(MILL | {"fault": [fault(kind, size_mm)]}), seed=4)
    # a line that is left out disturbs those beside it; of a bearing nothing is tracked here
    tracks = 6 if kind in BEARINGS else 18
    settings = AnalysisSettings(envelope_band_hz=BAND_HZ, most_tracks=tracks, pictures=False)
    return record, analyze(record, load_gearbox("two-stage"), settings=settings)


def found_in(analysis):
    table = findings_table(analysis)
    return {(row.component, row.kind): row for row in table.itertuples()}


def track_of(analysis, order):
    tracks = group(analysis, "tracks")
    track = tracks.isel(track=int(np.argmin(np.abs(tracks["track_order"].to_numpy() - order))))
    assert track["track_order"].item() == pytest.approx(order, rel=1e-9)
    return track


def truth_at(record, order, times_s):
    line = record["truth_amplitude"].isel(truth_channel=0).sel(truth_order=order, method="nearest")
    assert line["truth_order"].item() == pytest.approx(order, rel=1e-9)
    values, knots = line.to_numpy(), record["truth_time"].to_numpy()
    return np.interp(times_s, knots, values.real) + 1j * np.interp(times_s, knots, values.imag)


def left_out(record, analysis, track):
    """Sum of the true amplitudes of the other lines within the bandwidth of a track that have no track themselves."""
    true, tracked = record["truth_order"].to_numpy(), group(analysis, "tracks")["track_order"].to_numpy()
    near = np.abs(true - track["track_order"].item()) < track["bandwidth_orders"].item()
    hidden = near & (np.abs(true[:, None] - tracked).min(axis=1) > 1e-6)
    return float(np.abs(record["truth_amplitude"].isel(truth_channel=0)).max("truth_time").to_numpy()[hidden].sum())


def assert_tracked(record, analysis, order):
    """Each quadrature within three standard deviations in the middle of the record, where no end is near.

    The third harmonic of the output shaft lies 0.02 orders from a line seventy times as large, which hides it: the
    track of that one has it as a beat.
    """
    track = track_of(analysis, order)
    estimate, std, times = (track[name].to_numpy() for name in ("complex_amplitude", "std", "time_s"))
    middle = times.size // 2
    error = (estimate[middle] - truth_at(record, order, times[middle])) / std[middle]
    largest = 3 + left_out(record, analysis, track) / std[middle]
    assert abs(error.real) < largest
    assert abs(error.imag) < largest
    return float(np.mean(np.abs(estimate)))


def test_every_kind_of_fault_is_here():
    assert set(COMPONENT) == set(FAULT_KINDS)


@pytest.mark.slow
@pytest.mark.parametrize("kind", VERDICTS)
def test_a_damaged_gear_is_named_and_its_sideband_tracked(kind):
    trips = [round_trip(kind, size_mm) for size_mm in (SIZES[kind] if kind in GROWN else SIZES[kind][1:])]
    sidebands = []
    for record, analysis in trips:
        found = found_in(analysis)
        # one tooth, or a few neighbours, is told from what goes all round the gear
        assert set(found) == ({(PINION, "tooth")} if kind in LOCAL else set())
        result = score(analysis, record)
        assert list(result.faults["verdict"]) == [VERDICTS[kind]]
        # errors are as large as their std says; of 18 tracks with few independent values each a median says it better
        # than a mean, which one with too narrow a bandwidth can spoil
        assert 0.6 < result.tracks["normalised_rms"].median() < 1.25
        tracks = result.tracks[result.tracks["component"] == PINION]
        sidebands.append(tracks.set_index("order")["true_amplitude"])
    order = sidebands[-1].loc[sidebands[0].index.intersection(sidebands[-1].index)].idxmax()
    heard = [assert_tracked(record, analysis, order) for record, analysis in trips]
    assert np.all(np.diff(heard) > 0)


@pytest.mark.slow
def test_wear_raises_the_mesh_and_names_no_tooth():
    heard = []
    for size_mm in SIZES["wear"]:
        record, analysis = round_trip("wear", size_mm)
        assert found_in(analysis) == {}
        assert list(score(analysis, record).faults["verdict"]) == ["measured"]
        heard.append([assert_tracked(record, analysis, 23 * harmonic) for harmonic in (1, 2, 3)])
    rise = np.array(heard[1]) / heard[0]
    # harmonic h rises by 0.2 h a mm; the smallest line stands over 50 stds high, so 2 % is one of its own
    small, large = (1 + 0.2 * size_mm * np.array([1, 2, 3]) for size_mm in SIZES["wear"])
    assert_allclose(rise, large / small, rtol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "harmonic"), list(SHAFTS.items()))
def test_the_lines_of_a_faulty_shaft_are_claimed_and_tracked(kind, harmonic):
    order, heard = harmonic * 23 / 67, []
    for size_mm in SIZES_MM if kind in GROWN else SIZES_MM[1:]:
        record, analysis = round_trip(kind, size_mm)
        # what every shaft has some of raises no finding; the line is claimed, and only its trend accuses the shaft
        assert found_in(analysis) == {}
        assert list(score(analysis, record).faults["verdict"]) == ["measured"]
        lines = line_table(analysis, "order_spectrum")
        (row,) = lines[(lines["component"] == SHAFT) & (lines["harmonic"] == harmonic)].itertuples()
        assert row.claimed
        heard.append(assert_tracked(record, analysis, order))
    assert np.all(np.diff(heard) > 0)


def struck_a_rev(record):
    """Mean rate of the impacts in the record, per revolution of the reference shaft."""
    times = record["truth_impact_times_1"].to_numpy()
    first, last = np.interp(times[[0, -1]], record["truth_time"], record["truth_revolutions"])
    return (times.size - 1) / (last - first)


@pytest.mark.slow
@pytest.mark.parametrize("kind", BEARINGS)
def test_a_bearing_defect_is_named_at_its_mean_rate(kind):
    heard = []
    for size_mm in SIZES_MM if kind in GROWN else SIZES_MM[1:]:
        record, analysis = round_trip(kind, size_mm)
        found = found_in(analysis)
        if kind != "cage" or size_mm == max(SIZES_MM):
            assert set(found) == {(BEARING, kind)}
            # impacts slip, so the line is where they were on average in this record, not at pure rolling
            assert found[BEARING, kind].order_found == pytest.approx(struck_a_rev(record), rel=0.005)
        lines = line_table(analysis, "envelope")
        mine = lines[(lines["component"] == BEARING) & (lines["kind"] == kind) & (lines["sideband"] == 0)]
        heard.append(mine.loc[mine["harmonic"] == 1, "amplitude"].item())
    # an element makes the line of the cage, too
    assert found[BEARING, kind].verdict == ("indicated" if kind == "cage" else "diagnosed")
    assert score(analysis, record).false_findings == ()
    assert np.all(np.diff(heard) > 0)


def tracked(values, turns):
    """Track the squared envelope's line at the phase of a defect; squared, since noise then adds to its mean alone."""
    power = envelope(values, rate_hz=RATE_HZ, band_hz=BAND_HZ) ** 2
    return track_orders(
        power - power.mean(),
        phase_rad=2 * np.pi * turns,
        orders=[1],
        bandwidth_hz=1.0,
        rate_hz=RATE_HZ,
        output_every=RATE_HZ // 4,
    )


def rolling(kind, size_mm, **more):
    scene = MILL | {"fault": [fault(kind, size_mm, **more)], "noise": {"rms": 0.05}, "duration_s": 4}
    return simulate(Scene.from_mapping(scene), seed=4, by_source=True, phases=True)


def pure(kind, size_mm):
    return rolling(kind, size_mm, slip_std=0.0)


def slipping(kind, size_mm):
    return rolling(kind, size_mm, slip_std=0.01, mean_slip=0.02)


@pytest.mark.parametrize(
    ("kind", "record_of", "size_mm"),
    [("inner_race", pure, 3.0), *((kind, slipping, 3.0) for kind in BEARINGS)],
)
def test_the_envelope_on_the_true_phase_of_the_rollers_is_that_of_the_clean_source(kind, record_of, size_mm):
    record = record_of(kind, size_mm)
    # slip and all: on this phase the line stands still
    turns = record["truth_roller_revolutions"].sel(truth_roller=f"{BEARING}/{kind} strike").to_numpy()
    heard = tracked(record["housing"].to_numpy(), turns)
    clean = tracked(record["truth_source"].sel(truth_source_name=f"{BEARING}, {kind}").to_numpy()[0], turns)
    error = (heard.complex_amplitude - clean.complex_amplitude)[0, 4:-4] / heard.std[0, 4:-4]
    assert np.abs([error.real, error.imag]).max() < 3
    # the defect's other lines, which the std rightly counts as noise, are in both: they differ by far less
    away = heard.complex_amplitude - clean.complex_amplitude
    assert np.abs(away[0, 4:-4]).max() < 0.1 * np.abs(clean.complex_amplitude[0, 4:-4]).min()


PLANETARY = {
    "gearbox": "planetary-27-36-99",
    "rate_hz": 8000,
    "duration_s": 20,
    "fidelity": "kinematic",
    "speed": {"link": "carrier", "rpm": 120},
    "tachometer": {"link": "carrier", "pulses_per_rev": 1},
    "planet_pass": {"half_width_deg": 40, "floor": 0.1},
    "excitation": {"shaft_amplitude": 0, "meshes": {"sun-planet": 0}, "harmonics": 2},
    "noise": {"rms": 0},
    "sensor": [{"name": "ring", "on": "ring", "units": "g"}],
}
RING_TEETH = 99
CARRIER = 27 / 126  # turns of the carrier for one of the sun (Willis)


def ring_lines(spacing_deg=None, **changes):
    """Return the multiples of the carrier about the ring's mesh, what the analysis reads there, and the analysis."""
    gearbox = load_gearbox("planetary-27-36-99").model_dump(mode="json", by_alias=True, exclude_none=True)
    if spacing_deg is not None:
        gearbox["axes"] = [a | {"spacing_deg": spacing_deg} if "copies" in a else a for a in gearbox["axes"]]
    scene = Scene.from_mapping(PLANETARY | {"gearbox": gearbox} | changes)
    settings = AnalysisSettings(
        envelope_band_hz=None, most_tracks=0, pictures=False, max_order=3 * RING_TEETH * CARRIER
    )
    analysis = analyze(simulate(scene, seed=2), scene.gearbox, settings=settings)
    spectrum = group(analysis, "order_spectrum")
    orders, amplitude = spectrum["order"].to_numpy(), spectrum["amplitude"].to_numpy()[0]
    multiples = np.arange(RING_TEETH - 9, RING_TEETH + 10)
    nearest = np.argmin(np.abs(orders - multiples[:, None] * CARRIER), axis=1)
    return multiples, amplitude[nearest], analysis


def test_three_planets_alike_leave_only_every_third_sideband():
    multiples, heard, _ = ring_lines()
    allowed = multiples % 3 == 0
    assert heard[~allowed].max() < 1e-3 * heard.max()  # 60 dB
    assert heard[allowed].min() > 10 * heard[~allowed].max()


def test_planets_that_pass_in_health_raise_no_finding():
    _, _, analysis = ring_lines(noise={"rms": 0.02})
    assert findings_table(analysis).empty


def test_planets_at_unequal_places_are_heard_as_their_phasors_sum():
    places = np.array([0.0, 41.0, 83.0]) / 126  # of a turn: where the teeth of sun and ring let planets in
    multiples, heard, _ = ring_lines(spacing_deg=[360 * float(place) for place in places])
    # the window's Fourier coefficients by direct sum, and one phasor for each planet
    angle = 2 * np.pi * np.arange(4096) / 4096
    window = 0.1 + 0.9 * np.exp(np.log(2) / (1 - np.cos(np.radians(40))) * (np.cos(angle) - 1))
    weights = [abs(np.mean(window * np.exp(-1j * (m - RING_TEETH) * angle))) for m in multiples]
    expected = weights * np.abs(np.exp(2j * np.pi * np.outer(multiples, places)).sum(axis=1))
    # relative to the largest: 1e-3 of it is 60 dB, the resampling of the record and the window of its spectrum
    assert_allclose(heard / heard.max(), expected / expected.max(), atol=1e-3)
    assert heard[multiples % 3 != 0].max() > 0.05 * heard.max()

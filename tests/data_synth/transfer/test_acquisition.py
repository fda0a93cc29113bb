import numpy as np
import pytest
import scipy.signal
from gearboxes import TWO_STAGE
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate
from data_synth.scene.sensors import AntiAlias, DropOuts, Mode, Quantisation, Sensor
from data_synth.transfer.acquisition import (
    add_ringing,
    butterworth_poles,
    clip,
    drop_outs,
    linear_chain,
    quantise,
)
from data_synth.transfer.paths import AnalogFilter, ringing

SENSOR = {"name": "a", "on": "input bearing", "units": "g", "anti_alias": "none"}
LINEAR = {
    "resonance": {"frequency_hz": 9000, "damping_ratio": 0.05},
    "sensitivity": {"value": -0.1, "units": "V"},
    "ac_coupling_hz": 20.0,
    "anti_alias": {"frequency_hz": 6000, "order": 5},
}
SCENE = {
    **TWO_STAGE,
    "tachometer": {"link": "input", "pulses_per_rev": 1, "offset_rev": 0.25},
    "sensor": [SENSOR],
}


def record(**changes):
    sensor = {key: changes.pop(key) for key in list(changes) if key in Sensor.model_fields}
    return simulate(Scene.from_mapping({**SCENE, "sensor": [{**SENSOR, **sensor}], **changes}), seed=5)


def oracle(frequency_hz):
    """The chain LINEAR, from scipy's filter design and the textbook's oscillator."""
    s = 2j * np.pi * np.asarray(frequency_hz)
    natural = 2 * np.pi * 9000
    mount = natural**2 / (s**2 + 2 * 0.05 * natural * s + natural**2)
    numerator, denominator = scipy.signal.butter(5, 2 * np.pi * 6000, analog=True)
    coupling = s / (s + 2 * np.pi * 20)  # as an RC high pass has it
    return -0.1 * coupling * mount * np.polyval(numerator, s) / np.polyval(denominator, s)


def test_the_linear_chain_is_that_of_the_textbook():
    chain = linear_chain(Sensor.model_validate({**SENSOR, **LINEAR}), rate_hz=20_000)
    frequency = np.array([-3000.0, 0.0, 50.0, 6000.0, 8999.0, 20000.0])
    assert_allclose(chain.response(frequency), oracle(frequency), rtol=1e-10)  # coefficients of degree 5 lose digits
    assert linear_chain(Sensor.model_validate(SENSOR), rate_hz=20_000).response(1e4) == 1


@pytest.mark.parametrize("order", [1, 2, 3, 8, 12])
def test_butterworth_is_3_db_down_at_its_frequency_and_flat_before(order):
    poles = np.array(butterworth_poles(AntiAlias(frequency_hz=1000.0, order=order), rate_hz=20_000))
    response = AnalogFilter(poles=poles).response([100.0, 1000.0, 3000.0])
    assert_allclose(np.abs(response) ** 2, 1 / (1 + np.array([0.1, 1, 3]) ** (2 * order)), rtol=1e-12)
    assert np.all(poles.real < 0)


@pytest.mark.parametrize("order", [1, 4, 5])
def test_impacts_ring_through_the_chain_as_its_impulse_response(order):
    mode = Mode(frequency_hz=8000.0, damping_ratio=0.03)
    changed = {**LINEAR, "anti_alias": {"frequency_hz": 6000.0, "order": order}}
    chain = linear_chain(Sensor.model_validate({**SENSOR, **changed}), rate_hz=20_000)
    poles, residues = ringing(mode).then(chain).residues("a")
    natural = 2 * np.pi * 8000
    own = np.roots([1, 2 * 0.03 * natural, natural**2])
    gain = np.abs(own[0].imag) * chain.gain * np.prod(-chain.poles).real
    times = np.linspace(0, 1e-3, 201)
    _, expected = scipy.signal.impulse((np.zeros(1), np.concatenate([own, chain.poles, chain.coupling]), gain), T=times)
    heard = (residues * np.exp(np.outer(times, poles))).sum(axis=1).real
    assert_allclose(heard, expected, atol=1e-6 * np.max(np.abs(expected)))  # scipy goes through polynomials
    assert heard[0] == pytest.approx(0, abs=1e-12)  # a chain of more than two poles answers smoothly


def test_ringing_is_exact_between_samples():
    poles, residues = np.array([-900 + 40000j, -3000.0]), np.array([0.5j, 0.2])
    struck, sizes = np.array([-1e-3, 0.00123456, 0.0300001]), np.array([1.0, -2.0, 0.5])
    signal = np.zeros(1000)
    add_ringing(signal, times_s=struck, amplitudes=sizes, poles=poles, residues=residues, rate_hz=2e4)
    since = np.arange(1000)[:, None] / 2e4 - struck
    rung = np.exp(np.maximum(since, 0)[..., None] * poles) @ residues
    expected = (np.where(since >= 0, rung.real, 0) * sizes).sum(axis=1)
    assert_allclose(signal, expected, atol=1e-12)


def test_poles_that_coincide_are_refused():
    same = {"frequency_hz": 8000.0, "damping_ratio": 0.03}
    chain = linear_chain(Sensor.model_validate({**SENSOR, "resonance": same}), rate_hz=20_000)
    with pytest.raises(SceneError, match=r'sensor "a": two of the modes, filters and mounts .* coincide at 8000 Hz'):
        ringing(Mode.model_validate(same)).then(chain).residues("a")


def stated_response(record, frequency_hz):
    """Return the frequency response of the first channel's chain as its truth defines it."""
    poles = record["truth_chain_poles"].values[0]
    s = 2j * np.pi * frequency_hz[:, None]
    coupling = frequency_hz * 1j / (frequency_hz * 1j + record.get("truth_chain_coupling", np.zeros(1))[0].item())
    return coupling * record["truth_chain_gain"].values[0] * np.prod(poles / (poles - s), axis=1)


def test_lines_pass_the_chain_and_the_truth_says_so():
    plain, chained = record(), record(**LINEAR)
    assert chained["a"].attrs["units"] == chained["truth_amplitude"].attrs["units"] == "V"
    assert (chained["a"].attrs["sensitivity"], chained["a"].attrs["measures"]) == (-0.1, "g")
    expected = oracle(25 * plain["truth_order"].values)
    assert_allclose(stated_response(chained, 25 * plain["truth_order"].values), expected, rtol=1e-9)
    assert_allclose(
        chained["truth_amplitude"].values[0, :, 3], plain["truth_amplitude"].values[0, :, 3] * expected, rtol=1e-9
    )
    turns = 25 * chained["time"].values - 0.25
    waves = np.exp(2j * np.pi * np.outer(turns, chained["truth_order"].values))
    assert_allclose(chained["a"].values, (waves @ chained["truth_amplitude"].values[0, :, 0]).real, atol=1e-12)
    assert "truth_chain_poles" not in plain


def test_the_converter_rounds_to_its_codes_and_saturates():
    values = np.array([-1.3, -1.0, -0.124, 0.126, 0.76, 0.9, 5.0])
    assert quantise(values, Quantisation(bits=3, full_scale=1.0)) == 3  # -1.3; 0.9 and 5.0 are nearest to code 4
    assert_allclose(values, [-1, -1, 0, 0.25, 0.75, 0.75, 0.75], atol=0)
    fine = record(quantisation={"bits": 12, "full_scale": 2.0})
    step = 2.0 / 2048
    error = fine["a"].values - record()["a"].values
    assert np.max(np.abs(error)) <= step / 2 * (1 + 1e-9)
    # 20000 errors, nearly even between minus and plus half a step (Bennett 1948): the rms is known to 0.5 %
    assert np.std(error) == pytest.approx(step / np.sqrt(12), rel=0.02)
    assert int(fine["truth_saturated_1"]) == 0


def test_clipping_counts_what_it_cut():
    values = np.array([-2.0, -1.0, 0.5, 1.5])
    assert clip(values, level=1.0) == 2
    assert_allclose(values, [-1, -1, 0.5, 1])
    whole = record()["a"].values
    cut = record(clipping={"level": 0.4})
    assert int(cut["truth_clipped_1"]) == np.count_nonzero(np.abs(whole) > 0.4) > 0
    assert_allclose(cut["a"].values, np.clip(whole, -0.4, 0.4), atol=0)


@pytest.mark.parametrize(("reads", "filled"), [("nan", np.nan), ("zero", 0.0)])
def test_drop_outs_are_where_the_truth_says(reads, filled):
    gappy = record(drop_outs={"per_second": 8.0, "duration_s": 0.01, "reads": reads})
    spans = gappy["truth_drop_outs_1"].values
    times, whole = gappy["time"].values, record()["a"].values
    lost = np.any((times[:, None] >= spans[:, 0] - 1e-9) & (times[:, None] < spans[:, 1] - 1e-9), axis=1)
    assert lost.any()
    assert_allclose(gappy["a"].values, np.where(lost, filled, whole), atol=0)


def test_a_recorder_that_holds_repeats_the_last_value_and_stretches_join():
    signal = np.arange(1000.0)
    rng = np.random.default_rng(1)
    spans = drop_outs(signal, DropOuts(per_second=20.0, duration_s=0.02, reads="hold"), rate_hz=1000.0, rng=rng)
    assert np.all(spans[1:, 0] > spans[:-1, 1])
    for begin, end in np.rint(spans * 1000).astype(int):
        assert np.all(signal[begin:end] == (begin - 1 if begin else 0))


def test_cross_axis_adds_its_share_of_another_motion():
    plain, tilted = record(), record(cross_axis={"share": 0.05})
    added = tilted["truth_amplitude"].values / plain["truth_amplitude"].values - 1
    # gains across the axis lie between a half and two
    assert np.all((np.abs(added) >= 0.025 - 1e-12) & (np.abs(added) <= 0.1 + 1e-12))
    assert len(np.unique(np.round(added[0, :, 0], 9))) == 5  # one for each source


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"anti_alias": {"frequency_hz": 12000}}, "anti_alias extends to 12000 Hz, which is not below half of rate_hz"),
        ({"drop_outs": {"per_second": 5, "duration_s": 0.5}}, "of 0.5 s each leave no samples"),
        ({"sensitivity": {"value": 0, "units": "V"}}, "value = 0: such a sensor measures nothing"),
        ({"quantisation": {"bits": 1, "full_scale": 1}}, "bits = 1"),
        ({"clipping": {"level": -1}}, "clipping.level = -1"),
        ({"cross_axis": {"share": 1.5}}, "cross_axis.share = 1.5"),
        ({"resonanse": {"frequency_hz": 1}}, 'unknown key "resonanse"; did you mean "resonance"?'),
    ],
)
def test_a_chain_that_makes_no_sense_reads_as_a_sentence(change, sentence):
    with pytest.raises(SceneError) as caught:
        Scene.from_mapping({**SCENE, "sensor": [{**SENSOR, **change}]})
    assert sentence in str(caught.value)


# ---- the filter that every channel has ---------------------------------------------------------------------------


def test_what_folds_is_attenuated_by_default_and_off_has_to_be_said():
    rate_hz = 12_000
    chain = linear_chain(Sensor.model_validate({**SENSOR, "anti_alias": {}}), rate_hz=rate_hz)
    plain = {key: value for key, value in SENSOR.items() if key != "anti_alias"}
    assert linear_chain(Sensor.model_validate(plain), rate_hz=rate_hz).response(900.0) == chain.response(900.0)
    cutoff_hz = rate_hz / 2.56
    folding = np.linspace(rate_hz - cutoff_hz, 5 * rate_hz, 200)
    decibels = 20 * np.log10(np.abs(chain.response(folding)))
    # Butterworth 1930: -10 log10(1 + (f / f_c)^(2 n)), order 16
    assert_allclose(decibels, -10 * np.log10(1 + (folding / cutoff_hz) ** 32), atol=1e-9)
    assert decibels.max() < -60
    assert np.abs(np.abs(chain.response(0.3 * rate_hz)) - 1) < 2.5e-4  # 0.002 dB


def test_an_impact_rings_through_the_default_filter_without_aliases():
    # a mode of 9 kHz at 20 kHz folds to 11 kHz and beyond; at four times the rate the filter alone does the work
    change = {
        "fault": [{"kind": "outer_race", "component": "input bearing", "size_mm": 1.0}],
        "excitation": {"shaft_amplitude": 0, "mesh_amplitude": 0},
        "resonance": {"frequency_hz": 9000, "damping_ratio": 0.3},
        "duration_s": 0.2,
    }
    cutoff = {"frequency_hz": 20_000 / 2.56}
    found = record(anti_alias={}, **change)["a"].values
    dense = record(anti_alias=cutoff, rate_hz=80_000, **change)["a"].values[::4]
    folded = record(**change)["a"].values
    assert_allclose(found, dense, atol=1e-9 * np.max(np.abs(dense)))  # the same filter, whatever the rate
    assert np.std(folded - dense) > 0.1 * np.std(dense)


@pytest.mark.parametrize("skew_s", [25e-6, -75e-6])
def test_a_skewed_channel_has_the_samples_between_those_of_the_others(skew_s):
    # an odd number of samples of twice the rate, of every kind of source
    faults = [
        {"kind": "tooth_crack", "component": "stage 1/pinion", "depth_mm": 1, "offset_rev": 0.2},
        {"kind": "outer_race", "component": "input bearing", "size_mm": 1, "pulse_share": 0.2},
    ]
    outside = {"electrical": {}, "neighbour": {}, "knocks": {"per_second": 20}}
    shared = {"fault": faults, "imperfections": outside, "resonance": LINEAR["resonance"]}
    skewed = record(**shared, skew_s=skew_s, duration_s=0.5)["a"].values
    fine = record(**shared, rate_hz=40_000, duration_s=0.5)["a"].values
    late = round(skew_s * 40_000)
    at = np.arange(10, 9_990)
    assert_allclose(skewed[at], fine[2 * at + late], atol=2e-6 * np.max(np.abs(fine)))

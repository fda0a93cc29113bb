"""What carries over from record to record."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data_synth import SceneError, load_scene
from data_synth.plan import parse_plan
from data_synth.scene.machine_history import History

PLAN = """
scene = "demo"
records = 40
seed = 3
change = { duration_s = 0.2, rate_hz = 20000, fault = [] }
[history]
"""


def states(name, count, *, seed=1, **declared):
    history = History(**declared)
    return np.array([history.state(number, seed=seed)[name] for number in range(count)])


def test_states_are_correlated_over_the_declared_records():
    records = 5
    found = states("gain_db", 3000, gain_db=0.5, short_records=records, long_records=records, season_share=0)
    # 3000 / (2 x 5) independent values: the deviation is known to 4 %, a correlation to 0.06
    assert np.std(found) == pytest.approx(0.5, rel=0.15)
    about = found - np.mean(found)
    correlation = np.mean(about[records:] * about[:-records]) / np.var(found)
    assert correlation == pytest.approx(np.exp(-1), abs=0.2)
    assert np.mean(about[1:] * about[:-1]) / np.var(found) == pytest.approx(np.exp(-1 / records), abs=0.05)


def test_a_season_comes_back():
    found = states("temperature_k", 100, temperature_k=3, season_share=1, season_records=50)
    assert_allclose(found[:50], found[50:], atol=1e-9)
    assert np.std(found) == pytest.approx(3, rel=1e-9)


def test_a_state_needs_no_earlier_record():
    history = History()
    late = history.state(123_456, seed=2)
    assert late == History().state(123_456, seed=2)
    assert late != history.state(123_456, seed=3)
    assert late != history.state(123_457, seed=2)


def test_machines_are_independent():
    history = History(machines=2)
    pairs = np.array([[history.state(2 * i + own, seed=1)["load"] for own in (0, 1)] for i in range(400)])
    assert abs(np.corrcoef(pairs.T)[0, 1]) < 0.6  # 8 independent values or so
    assert np.corrcoef(pairs[1:, 0], pairs[:-1, 0])[0, 1] > 0.7


def test_a_plan_s_records_carry_it():
    plan = parse_plan(PLAN)
    plain = parse_plan(PLAN.replace("[history]", ""))
    for number in (0, 7):
        labels, scene, before = plan.labels(number), plan.scene(number), plain.scene(number)
        assert labels["machine"] == 0
        assert scene.noise.rms == pytest.approx(before.noise.rms * 10 ** (labels["history.noise_db"] / 20))
        assert scene.sensors[0].gain == pytest.approx(10 ** (labels["history.gain_db"] / 20))
        assert scene.torque.rows[0][1] == pytest.approx(before.torque.rows[0][1] * (1 + labels["history.load"]))
        assert scene.torque.full_load_nm == max(nm for _, nm in before.torque.rows)
        celsius = scene.imperfections.temperature.celsius
        assert celsius == pytest.approx(45 + labels["history.temperature_k"])
        assert plan.seed_of(number) == plain.seed_of(number)
    assert plan.scene(7) == parse_plan(plan.text).scene(7)


def test_what_is_off_leaves_the_scene():
    off = "gain_db = 0\ntemperature_k = 0\nnoise_db = 0\nload_share = 0\n"
    assert parse_plan(PLAN + off).scene(3) == parse_plan(PLAN.replace("[history]", "")).scene(3)


def test_a_load_without_torque_is_refused():
    demo = load_scene("demo").changed(torque=None)
    with pytest.raises(SceneError, match=r"history\.load_share scales the torque, but the scene has none"):
        History().scene(demo, 0, seed=1)


def test_records_of_one_machine_have_its_teeth():
    plan = parse_plan(PLAN.replace("[history]", "[history]\nmachines = 2"))
    seeds = [plan.machine_seed_of(number) for number in range(4)]
    assert seeds[0] == seeds[2] != seeds[1] == seeds[3]
    assert plan.labels(2)["machine_seed"] == seeds[0]
    assert parse_plan(PLAN.replace("[history]", "")).machine_seed_of(0) is None


@pytest.mark.parametrize(("machines", "shares"), [(2, (1, 1)), (4, (1, 1)), (3, (2, 1)), (1, (1, 2))])
def test_every_machine_has_every_class(machines, shares):
    classes = "".join(
        f'[[class]]\nname = "{name}"\nshare = {share}\n' for name, share in zip("ab", shares, strict=True)
    )
    plan = parse_plan(PLAN + f"machines = {machines}\n" + classes)
    found = [(plan.labels(number)["machine"], plan.class_of(number)) for number in range(12 * sum(shares))]
    for machine in range(machines):
        own = [name for at, name in found if at == machine]
        assert own.count("a") * shares[1] == own.count("b") * shares[0], own

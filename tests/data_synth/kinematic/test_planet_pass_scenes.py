import numpy as np
import pytest
from gearboxes import held_planetary
from numpy.testing import assert_allclose

from data_synth import Scene, SceneError, simulate

SCENE = {
    "gearbox": "planetary-27-36-99",
    "rate_hz": 20_000,
    "duration_s": 0.25,
    "fidelity": "kinematic",
    "speed": {"link": "carrier", "rpm": 120},
    "tachometer": {"link": "carrier", "pulses_per_rev": 12, "offset_rev": 0.0},
    "noise": {"rms": 0},
    "excitation": {"shaft_amplitude": 0, "meshes": {"sun-planet": 0}, "harmonics": 2},
    "sensor": [{"name": "a", "on": "ring", "units": "g"}],
}
CARRIER = 27 / 126  # turns of the carrier for one of the sun (Willis)


def record(**changes):
    return simulate(Scene.from_mapping({**SCENE, **changes}), seed=2)


def test_the_truth_is_what_three_planets_sound_like_one_by_one():
    # at unequal places, but each planet meets the ring in step: 99 times its place is whole
    places = (0, 3 / 9, 7 / 9)
    uneven = {"gearbox": held_planetary(27, 36, 99, spacing_deg=[360 * place for place in places])}
    made, still = record(planet_pass={"half_width_deg": 40, "floor": 0.1}, **uneven), record(**uneven)
    turns = 2 * made["time"].values  # of the carrier
    harmonics = [
        still["truth_amplitude"].sel(truth_order=99 * CARRIER * h, method="nearest").values[0, 0] for h in (1, 2)
    ]
    # the turn at which planet 1 stands at the sensor is drawn: find it on a fine grid, then all samples have to agree
    kappa = np.log(2) / (1 - np.cos(np.radians(40)))

    def heard(offset, turns=turns):
        total = np.zeros(turns.size)
        for place in places:
            angle = turns + offset + place
            gain = 0.1 + 0.9 * np.exp(kappa * (np.cos(2 * np.pi * angle) - 1))
            total += gain * sum(
                (z / 3 * np.exp(2j * np.pi * 99 * h * angle)).real for h, z in enumerate(harmonics, start=1)
            )
        return total

    offsets = np.arange(0, 1, 1 / 99 / 40)
    few = slice(None, None, 10)  # samples tell which of the grid is nearest
    errors = [np.std(heard(offset, turns[few]) - made["a"].values[few]) for offset in offsets]
    best = offsets[np.argmin(errors)]
    fine = best + np.linspace(-1, 1, 201) / 99 / 40
    errors = [np.std(heard(offset) - made["a"].values) for offset in fine]
    # the grid leaves 2 pi 198 / 99 / 40 / 200 = 0.0016 of the larger harmonic
    assert min(errors) < 2e-3 * np.std(made["a"].values)


def test_a_gearbox_without_planets_has_none_to_pass():
    sensors = [{"name": "a", "on": "input", "units": "g"}]
    plain = {
        "gearbox": "two-stage", "speed": {"link": "input", "rpm": 600}, "sensor": sensors,
        "tachometer": {"link": "input", "pulses_per_rev": 1}, "excitation": {}, "planet_pass": {"half_width_deg": 30},
    }  # fmt: skip
    with pytest.raises(SceneError, match='planets on a ring at rest, but gearbox "two-stage" has none; leave it out'):
        record(**plain)
    with pytest.raises(SceneError, match="half_width_deg"):
        record(planet_pass={"half_width_deg": 180})


# ---- every mesh has the phase that its teeth give it -------------------------------------------------------------

HUNTING = held_planetary(20, 31, 82) | {"reference": "carrier"}
WINDOW = {"half_width_deg": 40, "floor": 0.1}


def lines(**changes):
    """Multiples of the carrier that are in the truth, with their amplitudes."""
    made = record(**{"gearbox": HUNTING, "excitation": {"shaft_amplitude": 0, "harmonics": 3}, **changes})
    heard = np.abs(made["truth_amplitude"].values[0, :, 0])
    orders = made["truth_order"].values
    assert_allclose(orders, np.rint(orders), atol=1e-9)
    return {round(order): size for order, size in zip(orders, heard, strict=True) if size > 1e-9}


@pytest.mark.parametrize("only", ["sun-planet", "planet-ring"])
def test_planets_alike_allow_multiples_of_their_number_alone(only):
    other = {"sun-planet": "planet-ring", "planet-ring": "sun-planet"}[only]
    heard = lines(planet_pass=WINDOW, excitation={"shaft_amplitude": 0, "meshes": {other: 0}, "harmonics": 3})
    assert heard
    assert all(line % 3 == 0 for line in heard)  # McFadden and Smith 1985; 82 is none
    assert {81, 84, 165, 246} <= set(heard)


def test_planets_at_unequal_places_bring_the_other_lines_back():
    turns = np.array([0, 33, 67]) / 102  # where the teeth of sun and ring let planets in
    planet = {"links": ["carrier", "planet"], "copies": 3, "spacing_deg": (360 * turns).tolist()}
    uneven = HUNTING | {"axes": HUNTING["axes"] | {"planet": planet}}
    for only in ("sun-planet", "planet-ring"):
        silent = {"meshes": {name: 0 for name in ("sun-planet", "planet-ring") if name != only}}
        heard = lines(gearbox=uneven, excitation={"shaft_amplitude": 0, "harmonics": 1} | silent)
        even = lines(
            gearbox=uneven | {"axes": HUNTING["axes"]}, excitation={"shaft_amplitude": 0, "harmonics": 1} | silent
        )
        # without a window a line is the mean of one phasor for each planet: z_r psi, or - z_s psi
        teeth = {"sun-planet": -20, "planet-ring": 82}[only]
        assert even == {}
        assert heard == {82: pytest.approx(0.5 * abs(np.mean(np.exp(2j * np.pi * teeth * turns))), rel=1e-9)}
        passed = lines(gearbox=uneven, planet_pass=WINDOW, excitation={"shaft_amplitude": 0, "harmonics": 1} | silent)
        assert {80, 82, 83} <= set(passed)

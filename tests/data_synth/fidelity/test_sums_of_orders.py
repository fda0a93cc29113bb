"""Forces at sums of orders against products of waveforms in angle."""

from fractions import Fraction

import numpy as np
import pytest

from data_synth.fidelity.excitation import Excitation
from data_synth.fidelity.sums_of_orders import Deflections, sums_of

TEETH, OTHER = 6, 10  # of a damaged gear and of its mate: they meet again after 30 cycles of the mesh
SPEEDS_HZ = np.array([7.0, 14.0])  # all lines are at frequencies of the gains


def random_lines(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def wave(lines, orders, turns):
    return sum(
        (amplitude * np.exp(2j * np.pi * float(order) * turns)).real
        for amplitude, order in zip(lines, orders, strict=True)
    )


@pytest.mark.parametrize("base", [Fraction(1, OTHER), Fraction(3, 7)], ids=["of the mate", "of another shaft"])
def test_a_damaged_tooth_makes_sums_of_its_orders_and_those_of_vibration(base):
    """The product of both waveforms, less its lines at multiples of their own orders that have other balances."""
    rng = np.random.default_rng(3)
    stiffness, errors = 0.1 * random_lines(rng, 40), random_lines(rng, 1, 1, 12).astype(np.complex64)
    forces, gains = random_lines(rng, 2, 1, 1, 12).astype(np.complex64), random_lines(rng, 1, 1, 2000)
    gains += np.linspace(0, 30, 2000)
    excitation = Excitation(order=Fraction(1), cycles=TEETH, varying=stiffness, errors_n={})
    deflections = Deflections(
        base=base,
        meshes=np.array([0]),
        forces=forces,
        errors_n=errors,
        gains=gains,
        steps_hz=float(base) * SPEEDS_HZ / 0.1,  # 0.1 Hz from each other
    )
    found = list(sums_of(deflections, [excitation], np.array([1.0])))

    turns = np.arange(1 << 14) / (1 << 14) * 7 * TEETH * OTHER
    damage = [Fraction(m, TEETH) for m in range(1, 41)]
    beside = [0 if order.denominator == 1 or (order / base).denominator == 1 else 1 for order in damage]
    multiples = base * np.arange(1, 13)
    for node, speed_hz in enumerate(SPEEDS_HZ):
        gain = gains[0, 0, np.round(multiples.astype(float) * speed_hz / 0.1).astype(int)]
        amplitudes = errors[0, 0] + gain * forces[node, 0, 0]
        product = wave(stiffness * beside, damage, turns) * wave(amplitudes, multiples, turns)
        total = sum(
            wave(
                each.forces[node, 0, 0],
                [each.base * k + each.offset for k in range(1, each.forces.shape[-1] + 1)],
                turns,
            )
            for each in found
        )
        # at orders up to those of the stiffness: beyond, the product's are above all lines that are asked for
        highest = int(40 / TEETH * 7 * TEETH * OTHER) - 7 * TEETH * OTHER // TEETH
        spectra = [np.fft.rfft(each)[1:highest] for each in (product, total)]
        assert np.linalg.norm(spectra[0]) > 1
        assert np.linalg.norm(spectra[1] - spectra[0]) < 1e-5 * np.linalg.norm(spectra[0])


def test_sound_teeth_make_none():
    """Harmonics of a mesh are in the balance of each of its gears."""
    stiffness = np.zeros(40, dtype=complex)
    stiffness[TEETH - 1 :: TEETH] = 0.1
    deflections = Deflections(
        base=Fraction(1, OTHER),
        meshes=np.array([0]),
        forces=np.ones((2, 1, 1, 12), dtype=np.complex64),
        errors_n=np.ones((1, 1, 12), dtype=np.complex64),
        gains=np.ones((1, 1, 2000), dtype=complex),
        steps_hz=SPEEDS_HZ,
    )
    sound = Excitation(order=Fraction(1), cycles=TEETH, varying=stiffness, errors_n={})
    assert not list(sums_of(deflections, [sound], np.array([1.0])))

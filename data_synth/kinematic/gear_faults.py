"""Sidebands and impacts added by gear faults in a kinematic scene."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.bearings.impacts import BearingImpacts
from data_synth.kinematic.harmonics import ComplexArray, HarmonicFamily, common_base
from data_synth.operation.shaft_angle import Array
from data_synth.scene.faults import FaultyGear, GearFault

SIDEBAND_CUTOFF = 1e-4
"""Sidebands below this fraction of the largest are not in the signal, so that the truth lists every one."""

_POINTS_PER_PITCH = 64  # or per width of the damage, if less; 8 would reduce the modulation spectrum to rounding
_PROBES = 9  # sizes of growing damage, from smallest to largest, that decide which sidebands are retained


@dataclass(frozen=True, kw_only=True)
class ImpactTrain:
    """The impacts of one fault.

    Attributes
    ----------
    component, kind : str
        Component struck, and kind of impact, as named by the defect orders.
    source : str
        Source of the transfer functions to the sensors.
    revolutions : (n,) array
        Angle of the reference shaft at each impact, in rev.
    amplitudes : (n,) array
        Amplitude of the impulse response at full load, in the units of the sensors.
    order : Fraction or None
        Impacts per revolution if they repeat exactly; None with slip.
    offset : float
        Phase of the train at revolution zero, in cycles: impacts occur where ``order * revolutions + offset`` is whole.
    bearing : BearingImpacts or None
        For a bearing, the exact position of its rolling elements, and the true mean rate.
    duration_rev : (n,) array or None
        Rotation of the reference shaft during each impact; None for an impulse.
    is_entry : bool
        Whether these are the entries into a spall, before its impacts.
    """

    component: str
    kind: str
    source: str
    revolutions: Array
    amplitudes: Array
    order: Fraction | None = None
    offset: float = 0.0
    bearing: BearingImpacts | None = None
    duration_rev: Array | None = None
    is_entry: bool = False


def gear_damage_family(
    fault: GearFault,
    *,
    gear: FaultyGear,
    mesh: HarmonicFamily,
    tooth: Fraction,
    offset: float,
    rise: ArrayLike,
    lag_rad: ArrayLike,
) -> HarmonicFamily:
    """Return the sidebands that a damaged gear adds to its mesh, at mesh harmonics +- multiples of its rotation.

    Harmonic h of the mesh is multiplied by ``(1 + a s_h w) exp(-j h b w)``, with w the modulation function over a
    revolution, a and b `rise` and `lag_rad`, and s_h the weight of the harmonic; the difference from 1 gives the
    sidebands. Their coefficients are those of a smooth periodic function of the gear angle, so that the discrete
    Fourier transform is exact to rounding. Negative orders are folded to positive ones; order zero, which no
    accelerometer measures, is left out. Growing damage retains the sidebands above the cutoff at any of its sizes.

    Parameters
    ----------
    fault : GearFault
    gear : FaultyGear
    mesh : HarmonicFamily
        The healthy mesh, with coefficients (k,).
    tooth : Fraction
        Order at which a tooth of the gear is in mesh.
    offset : float
        Revolutions of the gear at revolution zero; the most damaged place is in mesh where ``tooth * rev + offset`` is
        whole.
    rise, lag_rad : float or (instant,) array
        a (relative) and b in rad, for one size or at each instant of the truth as the damage grows.
    """
    base_order = common_base(mesh.base_order, tooth)
    harmonics = np.arange(1, mesh.coefficients.shape[0] + 1)
    # fine enough for its narrowest feature
    count = 1 << int(np.ceil(np.log2(_POINTS_PER_PITCH * gear.teeth / min(fault.width_pitches(), 1.0))))
    modulation, weights = fault.modulation(np.arange(count) / count, gear), fault.harmonic_weights(harmonics)
    sidebands = np.arange(-count // 2, count // 2)
    turned = mesh.coefficients[:, None] * np.exp(2j * np.pi * offset * sidebands)

    def lines_of(rise: float, lag_rad: float) -> ComplexArray:
        modulated = 1 + rise * np.outer(weights, modulation)
        phase_factor = np.exp(-1j * lag_rad * np.outer(harmonics, modulation))
        spectra = np.fft.fft(modulated * phase_factor - 1, axis=1) / count
        return np.asarray(turned * np.fft.fftshift(spectra, axes=1))

    pairs = np.stack(np.broadcast_arrays(np.atleast_1d(rise), np.atleast_1d(lag_rad)), axis=1).astype(np.float64)
    sizes, of_instant = np.unique(pairs, axis=0, return_inverse=True)
    probes = np.unique(np.linspace(0, len(sizes) - 1, _PROBES).round().astype(int))
    largest = np.max([np.abs(lines_of(*sizes[probe])) for probe in probes], axis=0)
    retained = (largest >= SIDEBAND_CUTOFF * np.max(largest)) & (largest > 0)
    lines = np.stack([lines_of(*size)[retained] for size in sizes], axis=1)
    multiples = int(mesh.base_order / base_order) * harmonics[:, None] + int(tooth / base_order) * sidebands
    coefficients = fold_negative_orders(multiples[retained], lines[:, of_instant.ravel()])
    return HarmonicFamily(
        component=fault.component,
        kind="tooth",
        source=mesh.source,
        base_order=base_order,
        coefficients=coefficients[:, 0] if coefficients.shape[1] == 1 else coefficients,
        load_dependent=mesh.load_dependent,
    )


def fold_negative_orders(multiples: NDArray[np.int_], lines: ComplexArray) -> ComplexArray:
    """Return lines (m, instant) at multiples (m,) of an order summed to (k, instant), negative ones conjugated."""
    coefficients = np.zeros((int(np.max(np.abs(multiples), initial=1)) + 1, lines.shape[1]), dtype=np.complex128)
    np.add.at(coefficients, np.abs(multiples), np.where(multiples[:, None] < 0, lines.conj(), lines))
    return coefficients[1:]


def damage_trains(
    fault: GearFault,
    *,
    gear: FaultyGear,
    source: str,
    tooth: Fraction,
    offset: float,
    span_rev: tuple[float, float],
) -> list[ImpactTrain]:
    """Return the impact trains of a damaged gear, one for each of its impacts per revolution.

    Parameters
    ----------
    fault : GearFault
    gear : FaultyGear
    source : str
        Its mesh.
    tooth, offset
        As in `gear_damage_family`.
    span_rev : (float, float)
        First and last revolution of the reference shaft.

    Returns
    -------
    list of ImpactTrain
        With the amplitudes of the initial size; if the damage grows, they are proportional to its effect.
    """
    effect_mm = float(fault.effect_mm(fault.initial_mm))
    trains, amplitude = [], effect_mm * fault.factors[2]
    for at, share in fault.impacts(gear):
        first, last = (float(tooth) * rev + offset - at for rev in span_rev)
        turns = np.arange(np.ceil(first), np.floor(last) + 1)
        trains.append(
            ImpactTrain(
                component=fault.component,
                kind="tooth",
                source=source,
                revolutions=(turns - (offset - at)) / float(tooth),
                amplitudes=np.full(turns.size, amplitude * share),
                order=tooth,
                offset=offset - at,
            )
        )
    return trains

"""What each fault changes, and nothing more: lines a cracked tooth adds, and the train of impacts of any fault."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_synth.bearings import impact_revolutions, impact_weights, load_zone_order
from data_synth.combs import Comb, ComplexArray, Draws, common_base
from data_synth.profile import Array
from data_synth.scene import BearingFault, Scene, ToothCrack

SIDEBAND_CUTOFF = 1e-4
"""Sidebands below this share of the largest are not in the signal at all, so the truth lists every one."""

_POINTS_PER_TOOTH = 64  # of the modulation over a turn: its spectrum has fallen to rounding by 8 per tooth


@dataclass(frozen=True, kw_only=True)
class ImpactTrain:
    """Impacts of one fault.

    Attributes
    ----------
    component, kind : str
        What is struck, in the words of the defect orders.
    source : str
        From where the impacts travel to the sensors.
    revolutions : (n,) array
        Angle of the reference shaft at each impact, in rev.
    amplitudes : (n,) array
        Amplitude of the ringing at full load, in the sensors' units.
    order : Fraction or None
        Impacts per revolution where they repeat exactly; None with slip.
    offset : float
        Turns of the train at revolution zero: impacts are where ``order * revolutions + offset`` is whole.
    """

    component: str
    kind: str
    source: str
    revolutions: Array
    amplitudes: Array
    order: Fraction | None = None
    offset: float = 0.0


def tooth_window(angle_rad: ArrayLike, *, teeth: float) -> Array:
    """Return ``exp(kappa (cos angle - 1))``: 1 where the tooth is in mesh, 1/2 half a tooth pitch away.

    Parameters
    ----------
    angle_rad : (n,) array
        Angle between two contacts of the tooth, 2 pi from one to the next, in rad.
    teeth : float
        Tooth pitches between two contacts.
    """
    kappa = np.log(2) / (1 - np.cos(np.pi / teeth))
    return np.asarray(np.exp(kappa * (np.cos(angle_rad) - 1)))


def crack_comb(scene: Scene, fault: ToothCrack, *, mesh: Comb, offset: float) -> Comb:
    """Return the lines that a cracked tooth adds to its mesh: at mesh harmonics +- multiples of the gear's turns.

    Harmonic h of the mesh is multiplied by ``(1 + a w) exp(-j h b w)``, w the window of the tooth, a and b the
    depth times `amplitude_per_mm` and `phase_rad_per_mm`; what comes on top of 1 is this comb. Its Fourier
    coefficients in the angle of the gear are those of a smooth periodic function, so the discrete transform
    gives them to rounding. Lines below order zero are folded to their positive order; the line at zero, which
    no accelerometer passes, is left out.

    Parameters
    ----------
    scene : Scene
    fault : ToothCrack
    mesh : Comb
        The healthy mesh.
    offset : float
        Turns of the cracked tooth at revolution zero; it is in mesh where ``order * rev + offset`` is whole.
    """
    tooth = scene.exact_orders("tooth")[fault.component]
    base = common_base(mesh.base, tooth)
    pitch, turn = int(mesh.base / base), int(tooth / base)
    harmonics = np.arange(1, mesh.coefficients.size + 1)
    sidebands, shares = _modulation(fault, teeth=float(mesh.base / tooth), harmonics=harmonics)
    lines = mesh.coefficients[:, None] * shares * np.exp(2j * np.pi * offset * sidebands)
    lines[np.abs(lines) < SIDEBAND_CUTOFF * np.max(np.abs(lines), initial=0.0)] = 0.0
    return Comb(
        component=fault.component,
        kind="tooth",
        source=mesh.source,
        base=base,
        coefficients=_folded(pitch * harmonics[:, None] + turn * sidebands, lines),
        loaded=True,
    )


def _modulation(
    fault: ToothCrack, *, teeth: float, harmonics: NDArray[np.int_]
) -> tuple[NDArray[np.int_], ComplexArray]:
    """Return sideband numbers (m,) and the Fourier coefficients (h, m) of the modulation of each harmonic."""
    count = 1 << int(np.ceil(np.log2(_POINTS_PER_TOOTH * teeth)))
    window = tooth_window(2 * np.pi * np.arange(count) / count, teeth=teeth)
    rise = 1 + fault.depth_mm * fault.amplitude_per_mm * window
    lag = np.exp(-1j * fault.depth_mm * fault.phase_rad_per_mm * np.outer(harmonics, window))
    shares = np.fft.fftshift(np.fft.fft(rise * lag - 1, axis=1), axes=1) / count
    return np.arange(-count // 2, count // 2), shares


def _folded(multiples: NDArray[np.int_], lines: ComplexArray) -> ComplexArray:
    """Add lines at whole multiples of a base, negative ones conjugated, to coefficients from 1 upwards."""
    present = lines != 0
    at, values = multiples[present], lines[present]
    coefficients = np.zeros(int(np.max(np.abs(at), initial=1)) + 1, dtype=np.complex128)
    np.add.at(coefficients, np.abs(at), np.where(at < 0, values.conj(), values))
    return coefficients[1:]


def impact_train(
    scene: Scene, number: int, *, offset: float, span_rev: tuple[float, float], draws: Draws
) -> ImpactTrain:
    """Return the impacts of fault `number` (from 0) between two revolutions of the reference shaft."""
    fault = scene.faults[number]
    if isinstance(fault, ToothCrack):
        return _crack_train(scene, fault, offset=offset, span_rev=span_rev)
    return _bearing_train(scene, fault, span_rev=span_rev, rng=draws("impacts", str(number)))


def _crack_train(scene: Scene, fault: ToothCrack, *, offset: float, span_rev: tuple[float, float]) -> ImpactTrain:
    tooth = scene.exact_orders("tooth")[fault.component]
    first, last = (float(tooth) * rev + offset for rev in span_rev)
    turns = np.arange(np.ceil(first), np.floor(last) + 1)
    return ImpactTrain(
        component=fault.component,
        kind="tooth",
        source=mesh_of(fault),
        revolutions=(turns - offset) / float(tooth),
        amplitudes=np.full(turns.size, fault.depth_mm * fault.impact_per_mm),
        order=tooth,
        offset=offset,
    )


def _bearing_train(
    scene: Scene, fault: BearingFault, *, span_rev: tuple[float, float], rng: np.random.Generator
) -> ImpactTrain:
    rates = scene.bearing(fault.component)
    order = float(scene.orders[fault.component, fault.kind])
    struck = impact_revolutions(order=order, fault=fault, span_rev=span_rev, rng=rng)
    zone = load_zone_order(fault.kind, rates)
    return ImpactTrain(
        component=fault.component,
        kind=fault.kind,
        source=fault.component,
        revolutions=struck,
        amplitudes=fault.size_mm * fault.impact_per_mm * impact_weights(struck, order=zone, fault=fault, rng=rng),
    )


def mesh_of(fault: ToothCrack) -> str:
    """Return the mesh of a component such as ``stage 1/pinion``."""
    return fault.component.rpartition("/")[0]

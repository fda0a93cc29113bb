"""Lines that gears in motion are expected to have at a speed and a load: harmonic balance with varying stiffness.

The exciting force of a mesh without vibration, ``p_static = F (1 - k_mean / k) - k_mean e``
(`data_synth.fidelity.linear_response`), has constant Fourier coefficients at exact orders: those of each part of the
transmission error e, which has the period of one gear, and of k, per N of the static force F. With vibration it is

    p_i = p_static_i + (1 - k_mean_i / k_i) (p_i + k_mean_i sum_j G_ij p_j)

G_ij the deflection of mesh i per N of p in mesh j at mean stiffness; that of a mesh itself is -1 / k_mean at rest. The
lines of a family are the multiples of one order, in all meshes: those of the varying stiffness at such multiples, a
damaged tooth's among them, couple them. At some speeds the equations of all lines are solved together by GMRES (Saad
and Schultz 1986); the product with the varying stiffness is one of waveforms in angle. Between these speeds forces are
interpolated.

Left out are lines at sums of the orders of different shafts, what they make of others, loss of contact, and transients:
a small part of the signal, which a projection finds.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.system import Mesh
from data_synth.fidelity.linear_response import MIN_STIFFNESS, response_of, spectral_lines
from data_synth.gears.transmission_error import SumOfErrors, TransmissionError
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.vibration.gear_lines import ExpectedLines
from data_synth.vibration.run import Motion, contacts_in
from data_synth.vibration.torques import static_tooth_forces

Singles: TypeAlias = NDArray[np.complex64]

_POINTS = 32  # to a period of the highest line, which is then right to 1 % for a stiffness that jumps
_FEWEST = 512  # points to a mesh cycle
_RESPONSES = 1 << 14  # frequencies from zero to half the rate, between which a response is linear
_APART_HZ = 20.0
"""Frequencies of the fastest mesh between which forces are linear: of its tenth harmonic a hundred Hz, the width of the
modes that varying stiffness changes, those of the teeth."""
_SLOWEST = 0.01  # of the top speed: below, lines are at frequencies where the stiffness acts statically
_BEYOND = 2.0  # times the highest line: lines beyond it act on others, those of stiffness that jumps as 1 over theirs
_RESIDUAL = 1e-4  # of the equations, over the force without vibration
_ITERATIONS, _EVERY = 40, 4  # at most, and from one look at the residual to the next


@dataclass(frozen=True, kw_only=True)
class _Excitation:
    """Lines of the exciting force of a mesh without vibration.

    Attributes
    ----------
    order : Fraction
        Of the mesh.
    cycles : int
        Period of its stiffness.
    mean : float
        Of ``1 - k_mean / k``.
    varying : (k,) complex array
        Lines of that, which are those of the force per N of static force.
    errors_n : mapping of cycles to (k,) complex array
        Lines of ``-k_mean e`` by the period of the parts of e.
    """

    order: Fraction
    cycles: int
    mean: float
    varying: ComplexArray
    errors_n: dict[int, ComplexArray]

    @classmethod
    def of(cls, mesh: Mesh, order: Fraction, *, top: float) -> "_Excitation":
        """Return the lines of a mesh up to an order."""
        mean, error, cycles = mesh.stiffness.mean, mesh.error, int(mesh.stiffness.period)
        parts: list[tuple[TransmissionError, float]] = [] if error is None else [(error, 0.0)]
        if isinstance(error, SumOfErrors):
            parts = [*zip(error.parts, error.by_cycles or (0.0,) * len(error.parts), strict=True)]

        def lines_of(values: Callable[[Array], Array], period: int) -> tuple[float, ComplexArray]:
            lines = max(1, math.floor(top / float(order) * period))
            points = max(_FEWEST * period, 1 << (_POINTS * lines - 1).bit_length())
            found = values((np.arange(points) + 0.5) * period / points)
            return float(np.mean(found)), spectral_lines(found, lines)

        def summed(period: int) -> Callable[[Array], Array]:
            some = [(part, by) for part, by in parts if int(part.period) == period]
            return lambda phases: sum((part(phases + by) for part, by in some), np.zeros(phases.size))

        constant, varying = lines_of(
            lambda phases: 1 - mean / np.maximum(mesh.stiffness(phases), MIN_STIFFNESS * mean), cycles
        )
        periods = dict.fromkeys(int(part.period) for part, _ in parts)
        errors_n = {period: -mean * lines_of(summed(period), period)[1] for period in periods}
        return cls(order=order, cycles=cycles, mean=constant, varying=varying, errors_n=errors_n)

    def waveform(self, base: Fraction, points: int) -> Array:
        """Return ``1 - k_mean / k`` (points,) in a period of an order, of its lines at multiples of that."""
        step = self.order / self.cycles / base
        lines, every = self.varying[step.denominator - 1 :: step.denominator], step.numerator
        lines = lines[: (points - 1) // 2 // every]
        spectrum = np.zeros(points // 2 + 1, dtype=np.complex64)
        spectrum[0] = points * self.mean
        spectrum[every : every * lines.size + 1 : every] = points / 2 * lines
        return np.asarray(np.fft.irfft(spectrum, points), dtype=np.float32)


def expected_lines(motion: Motion) -> tuple[ExpectedLines, ...]:
    """Return the expected lines of gears in motion, a family for each order whose multiples they are.

    None of planets, whose routes to a sensor vary with the carrier's angle, nor of a reference that turns backwards.

    Parameters
    ----------
    motion : Motion
        Teeth that change in time are taken as they are at first.
    """
    system, stage = motion.system, motion.stage
    speed_hz, rate_hz = stage.speed_hz, stage.scene.rate_hz
    if motion.sensor_forces.rotate or np.min(speed_hz) < 0 or not speed_hz.any():
        return ()
    response, orders = response_of(motion), stage.scene.exact_orders("gear_mesh")
    of_mesh = {number: order for name, order in orders.items() for number in contacts_in(system, name)}
    top = _BEYOND * rate_hz / 2 / float(np.max(speed_hz))
    excitations = [_Excitation.of(mesh, of_mesh[number], top=top) for number, mesh in enumerate(system.meshes)]
    frequency_hz = np.linspace(0.0, _BEYOND * rate_hz / 2, _RESPONSES)
    meshes = range(len(excitations))
    transfer = np.stack([response.channels(number, frequency_hz) for number in meshes])
    deflections = response.deflections_by(frequency_hz)
    gains = np.eye(len(meshes))[:, :, None] + response.means[:, None, None] * deflections
    static_n = static_tooth_forces(stage, system, motion.drive_load)
    inputs_n = np.concatenate([np.ones((1, speed_hz.size)), static_n])
    lowest_hz, highest_hz = max(np.min(speed_hz), _SLOWEST * np.max(speed_hz)), float(np.max(speed_hz))
    found = []
    for base, every in _families(excitations, tuple(stage.scene.exact_orders("tooth").values()), top=top).items():
        inputs = np.flatnonzero(every.any(axis=(1, 2)))
        # errors of teeth, which do not jump, excite few lines above the highest
        lines = every.shape[2] if inputs[-1] else math.ceil(every.shape[2] / _BEYOND)
        static, forces = every[inputs, :, :lines], list[Singles]()
        fastest = float(max(order for order in of_mesh.values() if (order / base).denominator == 1))
        speeds_hz = np.linspace(lowest_hz, highest_hz, 1 + math.ceil(fastest * float(np.ptp(speed_hz)) / _APART_HZ))
        for speed in speeds_hz:
            start = 2 * forces[-1] - forces[-2] if len(forces) > 1 else forces[0] if forces else np.zeros_like(static)
            at = float(base) * speed / frequency_hz[1]
            forces.append(_balanced(static, start, gains, excitations, base, at=at))
        found.append(
            ExpectedLines(
                base_order=base,
                forces=np.stack(forces),
                speeds_hz=speeds_hz,
                inputs_n=inputs_n[inputs],
                speed_hz=speed_hz,
                frequency_hz=frequency_hz,
                transfer=transfer,
            )
        )
    return tuple(found)


def _families(excitations: list[_Excitation], teeth: tuple[Fraction, ...], *, top: float) -> dict[Fraction, Singles]:
    """Return p without vibration, (input, mesh, k), by the order of which its lines are multiples.

    The first input is in N, the others are per N of the static force of each mesh. Harmonics of a mesh are among the
    multiples of a damaged tooth's order, whose stiffness they vibrate on, or of the order that most meshes share.
    """
    added = list[tuple[Fraction, int, int, Fraction, ComplexArray]]()  # family, input, mesh, order of the first, lines
    damaged = set[Fraction]()
    for number, mesh in enumerate(excitations):
        for cycles, lines in mesh.errors_n.items():
            added.append((mesh.order / cycles, 0, number, mesh.order / cycles, lines))
        own = mesh.varying[mesh.cycles - 1 :: mesh.cycles]
        added.append((mesh.order, 1 + number, number, mesh.order, own))
        for order in dict.fromkeys(teeth):
            step = order / (mesh.order / mesh.cycles)
            if mesh.cycles > 1 and step.denominator == 1 and (mesh.order / order).denominator == 1:
                lines = mesh.varying[step.numerator - 1 :: step.numerator].copy()
                every = int(mesh.order / order)
                lines[every - 1 :: every] = 0
                added.append((order, 1 + number, number, order, lines))
                damaged.add(order)
    bases = list(dict.fromkeys(family for family, *_ in added))
    orders = [mesh.order for mesh in excitations]

    def coupled(base: Fraction) -> tuple[bool, int, Fraction]:
        return base in damaged, sum((order / base).denominator == 1 for order in orders), -base

    of = {
        family: family
        if family not in orders
        else max((base for base in bases if (family / base).denominator == 1), key=coupled)
        for family in bases
    }
    found = {
        base: np.zeros((1 + len(orders), len(orders), math.floor(top / base)), dtype=np.complex64)
        for base in of.values()
    }
    for family, row, number, order, lines in added:
        base = of[family]
        every = int(order / base)
        some = found[base][row, number, every - 1 :: every]
        some += lines[: some.size]
    return {base: lines for base, lines in found.items() if lines.any()}


def _balanced(
    static: Singles,
    start: Singles,
    gains: ComplexArray,
    excitations: list[_Excitation],
    base: Fraction,
    *,
    at: float,
) -> Singles:
    """Return p with vibration, (input, mesh, k), from p without; `at` is the first line's place among the gains."""
    from scipy.fft import irfft, next_fast_len, rfft  # noqa: PLC0415

    inputs, meshes, lines = static.shape
    place = at * np.arange(1, lines + 1)
    number = np.minimum(place.astype(np.int64), gains.shape[2] - 2)
    share = np.minimum(place - number, 1.0)
    gain = ((1 - share) * gains[:, :, number] + share * gains[:, :, number + 1]).astype(np.complex64)
    points = next_fast_len(3 * lines + 1, real=True)  # no product of two lines aliases to a third
    varying = np.stack([each.waveform(base, points) for each in excitations])
    means = np.array([each.mean for each in excitations])
    # preconditioner: the response of each mesh to itself, at the mean of its 1 - k_mean / k
    inverse = (1 / (1 - means[:, None] * np.einsum("iik->ik", gain))).astype(np.complex64)

    def remainder(forces: Singles) -> Singles:
        spectrum = np.zeros((inputs, meshes, points // 2 + 1), dtype=np.complex64)
        for mesh in range(meshes):  # in place of einsum, whose loop over lines is three times as slow
            spectrum[..., 1 : lines + 1] += gain[:, mesh] * forces[:, None, mesh]
        return np.asarray(forces - rfft(irfft(spectrum, points) * varying)[..., 1 : lines + 1], dtype=np.complex64)

    left = static - remainder(start)
    bound = _RESIDUAL * np.linalg.norm(_rows(static), axis=1)
    solved = _gmres(lambda forces: remainder(inverse * forces), left, bound=bound)
    return np.asarray(start + inverse * solved, dtype=np.complex64)


def _rows(lines: Singles) -> NDArray[np.float32]:
    """Return lines (input, mesh, k) as real vectors (input, n)."""
    return np.asarray(np.ascontiguousarray(lines).reshape(lines.shape[0], -1).view(np.float32))


def _gmres(apply: Callable[[Singles], Singles], right: Singles, *, bound: Array) -> Singles:
    """Return x (input, mesh, k) of real-linear equations ``apply(x) = right``, residuals below bounds (input,)."""
    inputs, size = right.shape[0], np.linalg.norm(_rows(right), axis=1)
    if np.all(size <= bound):
        return np.zeros_like(right)
    tiny = np.finfo(np.float32).tiny
    basis = np.empty((_ITERATIONS + 1, *_rows(right).shape), dtype=np.float32)
    basis[0] = _rows(right) / np.maximum(size, tiny)[:, None]
    hessenberg, found = np.zeros((inputs, _ITERATIONS + 1, _ITERATIONS)), np.zeros((inputs, 1))
    for step in range(_ITERATIONS):
        new = _rows(apply(basis[step].view(np.complex64).reshape(right.shape)))
        for row in range(inputs):
            known = basis[: step + 1, row]
            shares = known @ new[row]
            new[row] -= shares @ known
            hessenberg[row, : step + 1, step] = shares
        norm = hessenberg[:, step + 1, step] = np.linalg.norm(new, axis=1)
        basis[step + 1] = new / np.maximum(norm, tiny)[:, None]
        if step % _EVERY == _EVERY - 1:
            square, first = hessenberg[:, : step + 2, : step + 1], np.zeros((inputs, step + 2, 1))
            first[:, 0, 0] = size
            solved = np.linalg.pinv(square) @ first
            found = solved[..., 0]
            if np.all(np.linalg.norm((first - square @ solved)[..., 0], axis=1) <= bound):
                break
    shares = found.astype(np.float32)
    total = np.stack([shares[row] @ basis[: shares.shape[1], row] for row in range(inputs)])
    return total.view(np.complex64).reshape(right.shape)

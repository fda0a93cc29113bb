"""Lines that gears in motion are expected to have at a speed and a load: harmonic balance with varying stiffness.

Teeth of stiffness k and transmission error e under the static force F bear k (delta - e). On a spring of the mean
stiffness, what that is more than the spring bears is an exciting force

    p_i = (k_i - k_mean_i) (delta_i - e_i) - k_mean_i e_i,   delta_i = delta_0i + sum_j G_ij p_j

G_ij the deflection of mesh i per N of p in mesh j at mean stiffness, and delta_0 such that the mean tooth force is F.
What drives it has constant Fourier coefficients at exact orders: those of each part of e, which has the period of one
gear, and of k, per N of F. The lines of a family are the multiples of one order, in all meshes: those of the varying
stiffness at such multiples, a damaged tooth's among them, couple them. At some speeds the equations of all lines are
solved together: a sweep in time through a period, mode by mode with p linear between instants, has all but a few per
cent of p, and again of what the equations of the lines then leave. The product with the varying stiffness is one of
waveforms in angle. Its factor delta is smooth where k jumps. Were the tooth force the factor, of ``1 - k_mean / k``,
both would jump, and lines of a product of jumps converge slowly (Li 1996, J. Opt. Soc. Am. A 13, 1870). Between speeds
p is interpolated.

Sound and damaged gears have the same families, speeds, points and bounds, so that the errors of both are alike and the
difference is the fault's, 60 dB below the record even. Left out are lines at sums of the order of a gear and that of a
mesh on other shafts, what they make of others, loss of contact, and transients.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, partial
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.system import Mesh
from data_synth.fidelity.linear_response import Response, response_of, spectral_lines
from data_synth.gears.transmission_error import SumOfErrors, TransmissionError
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.vibration.expected_response import ExpectedLines, lagrange
from data_synth.vibration.gear_lines import LOWER_SPEEDS
from data_synth.vibration.run import Motion, contacts_in
from data_synth.vibration.torques import static_tooth_forces

Singles: TypeAlias = NDArray[np.complex64]

_POINTS = 32  # to a period of the highest line, which is then right to 1 % for a stiffness that jumps
_FEWEST = 512  # points to a mesh cycle
_RESPONSES = 1 << 14  # frequencies from zero to that of the highest line, between which a response is linear
_APART, _ERROR = 0.7, 1e-2
"""How far apart are speeds between which p is interpolated, in least damping ratios, by one of which a line passes half
the width of a mode, where the integration may err by so much; by another error, with its fourth root, as cubics err."""
_FAR, _FINE_HZ = 0.08, 1.0
"""Of the speed, at most, so that all four speeds of a cubic have all lines in the band; and of the fastest mesh, what
speeds are farther apart than that share of them: harmonics of slow meshes that pass modes are high and weak."""
_LEAST_DAMPING = 1e-3  # less of it leaves so many speeds apart, and lines that no quasi-static response has
_STRIDE = 4  # a power of two
_SLOWEST = 0.01  # of the top speed: below, lines are at frequencies where the stiffness acts statically
_BEYOND, _ABOVE_MODES, _WIDER = 1.2, 2.0, 2**0.25
"""Times half the rate, and the highest mode where the integration may err by `_ERROR`, more with its sixth root: lines
beyond act on others. Up to 1.5 times a mode of gain 9 they err by 5 %, up to 2 times by 1.2 %, up to 3 times by 0.3 %.
And the steps in which a band is wider."""
_ALIKE = 1.5  # times slower than the highest speed, speeds have the same lines; slower ones have more
_INDEPENDENT = 1e-5  # of the largest of independent histories, below which one is left out
_COUPLED = 0.02  # of the RMS of the stiffness that varies most at the orders of a family: less couples nothing
_RESIDUAL = 2e-6  # of the equations, over the largest excitation: a fault may be 1e-3 of that
_MOST_SWEEPS = 16  # each leaves 2 to 15 per cent
_NO_USE = 0.7  # of what the sweep before left: the stiffness excites vibration that grows
_PART = 0.05  # of the force in a spring: less is not waited for, and modes with less deflect at once
_FAST = 2.5  # rad in a step of a sweep, where the highest line has 2.1: modes that turn faster deflect at once
_LONGEST_RUN_IN = 1 << 15  # steps before the period of a sweep, where modes are hardly damped


@dataclass(frozen=True, kw_only=True)
class _Excitation:
    """Lines of the exciting force of a mesh without vibration.

    Attributes
    ----------
    order : Fraction
        Of the mesh.
    cycles : int
        Period of its stiffness.
    varying : (k,) complex array
        Lines of ``k / k_mean - 1``.
    errors_n : mapping of cycles to (k,) complex array
        Lines of ``-k_mean e`` by the period of the parts of e.
    """

    order: Fraction
    cycles: int
    varying: ComplexArray
    errors_n: dict[int, ComplexArray]

    @classmethod
    def of(cls, mesh: Mesh, order: Fraction, *, top: float) -> "_Excitation":
        """Return the lines of a mesh up to an order."""
        mean, error, cycles = mesh.stiffness.mean, mesh.error, int(mesh.stiffness.period)
        parts: list[tuple[TransmissionError, float]] = [] if error is None else [(error, 0.0)]
        if isinstance(error, SumOfErrors):
            parts = [*zip(error.parts, error.by_cycles or (0.0,) * len(error.parts), strict=True)]

        def lines_of(values: Callable[[Array], Array], period: int) -> ComplexArray:
            lines = max(1, math.floor(top / float(order) * period))
            # to a mesh cycle as many for sound and for damaged gears, so that only damage makes them different
            points = period * max(_FEWEST, 1 << (_POINTS * math.ceil(top / float(order)) - 1).bit_length())
            return spectral_lines(values((np.arange(points) + 0.5) * period / points), lines)

        def summed(period: int) -> Callable[[Array], Array]:
            some = [(part, by) for part, by in parts if int(part.period) == period]
            return lambda phases: sum((part(phases + by) for part, by in some), np.zeros(phases.size))

        varying = lines_of(lambda phases: mesh.stiffness(phases) / mean, cycles)
        periods = dict.fromkeys(int(part.period) for part, _ in parts)
        errors_n = {period: -mean * lines_of(summed(period), period) for period in periods}
        return cls(order=order, cycles=cycles, varying=varying, errors_n=errors_n)

    def waveform(self, base: Fraction, points: int) -> Array:
        """Return ``k / k_mean - 1`` (points,) in a period of an order, of its lines at multiples of that."""
        step = self.order / self.cycles / base
        lines, every = self.varying[step.denominator - 1 :: step.denominator], step.numerator
        lines = lines[: (points - 1) // 2 // every]
        spectrum = np.zeros(points // 2 + 1, dtype=np.complex64)
        spectrum[every : every * lines.size + 1 : every] = points / 2 * lines
        return np.asarray(np.fft.irfft(spectrum, points), dtype=np.float32)


def expected_lines(motion: Motion) -> tuple[ExpectedLines, ...]:
    """Return the expected lines of gears in motion, a family for each order whose multiples they are.

    None of planets, whose routes to a sensor vary with the carrier's angle, nor of a reference that turns backwards.
    Where teeth change in time, p is linear between the instants at which they are known, as their stiffness is; of
    several meshes whose teeth change, each has those of its instant nearest to that of another.
    """
    speed_hz = motion.stage.speed_hz
    if motion.sensor_forces.rotate or np.min(speed_hz) < 0 or not speed_hz.any():
        return ()
    histories = [mesh.history.times_s for mesh in motion.system.meshes if mesh.history is not None]
    if not histories:
        return _of_teeth(motion, np.ones(speed_hz.size))
    times_s = np.unique(np.concatenate(histories))
    found = list[ExpectedLines]()
    for time_s, only in zip(times_s, np.eye(times_s.size), strict=True):
        shares = np.interp(motion.stage.instants_s, times_s, only)
        if shares.any():  # in a short record damage may be known at more instants than the truth
            meshes = tuple(_at(mesh, time_s) for mesh in motion.system.meshes)
            found += _of_teeth(replace(motion, system=replace(motion.system, meshes=meshes)), shares)
    return tuple(found)


def _at(mesh: Mesh, time_s: float) -> Mesh:
    """Return a mesh whose teeth remain what they are about an instant."""
    if mesh.history is None:
        return mesh
    number = round(float(mesh.history.position(np.array([time_s]))[0]))
    return replace(mesh, stiffness=mesh.history.stiffnesses[number], error=mesh.history.errors[number], history=None)


def _of_teeth(motion: Motion, shares: Array) -> tuple[ExpectedLines, ...]:
    """Return the expected lines of teeth that do not change, times their share (instant,) of what they are then.

    At such speeds as the teeth of other instants have, so that what lies between two of them errs alike.
    """
    system, stage = motion.system, motion.stage
    speed_hz, rate_hz = stage.speed_hz, stage.scene.rate_hz
    response, orders = response_of(motion), stage.scene.exact_orders("gear_mesh")
    of_mesh = {number: order for name, order in orders.items() for number in contacts_in(system, name)}
    lowest_hz, highest_hz = max(np.min(speed_hz), _SLOWEST * np.max(speed_hz)), float(np.max(speed_hz))
    finer = _ERROR / stage.scene.dynamics_or_default.error
    highest = _ABOVE_MODES * finer ** (1 / 6) * _Modes.of(response, np.arange(len(system.meshes))).highest_hz
    # in steps, so that sound and damaged gears, whose modes differ a little, have the same lines
    wider = math.ceil(math.log(max(highest / (_BEYOND * rate_hz / 2), 1.0), _WIDER))
    band_hz = _BEYOND * rate_hz / 2 * _WIDER**wider
    top = band_hz / max(lowest_hz, highest_hz / LOWER_SPEEDS)
    excitations = [_Excitation.of(mesh, of_mesh[number], top=top) for number, mesh in enumerate(system.meshes)]
    frequency_hz = np.linspace(0.0, band_hz * min(highest_hz / lowest_hz, _ALIKE), _RESPONSES)
    deflections, channels = response.between(frequency_hz)
    gains, transfer = response.means[:, None, None] * deflections, channels.astype(np.complex64)
    static_n = static_tooth_forces(stage, system, motion.drive_load)
    inputs_n = shares * np.concatenate([np.ones((1, shares.size)), static_n])
    rates = np.gradient(speed_hz, stage.instants_s)
    damping = max(float(np.min(-response.poles.real / np.abs(response.poles))), _LEAST_DAMPING)
    apart = _APART * damping / finer**0.25
    # one set of speeds for all families, as some are what others are without the damage
    slow_hz = _FINE_HZ / float(max(of_mesh.values())) / (_APART * damping)
    every_hz = _speeds(lowest_hz, highest_hz, apart=min(apart, _FAR), slow_hz=slow_hz)
    speeds_hz = _about(every_hz, speed_hz[shares > 0])
    families = _families(excitations, tuple(stage.scene.exact_orders("tooth").values()), top=top)
    driven = [_Driven.of(family, excitations, inputs_n) for family in families]
    # the same error in N for all: a family that is weak beside others need not be as exact by itself
    largest = max((float(np.max(np.linalg.norm(_rows(each.excitation), axis=1))) for each in driven), default=0.0)
    found = []
    for family, each in zip(families, driven, strict=True):
        solved = partial(
            _balanced,
            gains=gains[np.ix_(each.meshes, each.meshes)],
            varying_of=cache(partial(_Varying.of, [excitations[number] for number in each.meshes])),
            modes=_Modes.of(response, each.meshes),
            step_hz=float(frequency_hz[1]),
            bound=_RESIDUAL * largest,
        )
        slowest_hz = np.maximum(lowest_hz, np.minimum(speeds_hz, highest_hz / _ALIKE))
        sizes = np.floor(band_hz / slowest_hz / float(family.base)).astype(np.int64)
        forces = _over_speeds(partial(solved, base=family.base), each.excitation, speeds_hz, sizes)
        found.append(
            ExpectedLines(
                base_order=family.base,
                forces=family.sign * forces,
                speeds_hz=speeds_hz,
                slow_hz=slow_hz,
                inputs_n=each.histories,
                speed_hz=speed_hz,
                rates=rates,
                damping=damping,
                frequency_hz=frequency_hz,
                transfer=transfer[each.meshes],
            )
        )
    return tuple(found)


def _speeds(lowest_hz: float, highest_hz: float, *, apart: float, slow_hz: float) -> Array:
    """Return speeds that, with `slow_hz` added, rise by one factor, at most ``1 + apart``.

    Intervals are a multiple of `_STRIDE`, or few.
    """
    intervals = math.ceil(math.log((highest_hz + slow_hz) / (lowest_hz + slow_hz)) / math.log1p(apart) - 1e-9)
    if intervals < 1:
        return np.array([highest_hz])
    if intervals > _STRIDE:
        intervals = _STRIDE * math.ceil(intervals / _STRIDE)
    speeds_hz = np.geomspace(lowest_hz + slow_hz, highest_hz + slow_hz, intervals + 1) - slow_hz
    speeds_hz[[0, -1]] = lowest_hz, highest_hz
    return np.asarray(speeds_hz)


def _about(speeds_hz: Array, some_hz: Array) -> Array:
    """Return those of rising speeds by which cubics have some others, from one multiple of a stride to another."""
    first, last = (np.searchsorted(speeds_hz, each(some_hz)) for each in (np.min, np.max))
    begin, end = max(int(first) - 2, 0) // _STRIDE, -(-min(int(last) + 1, speeds_hz.size - 1) // _STRIDE)
    return speeds_hz[begin * _STRIDE : end * _STRIDE + 1]


def _over_speeds(
    solved: Callable[[Singles, Singles, float], Singles],
    excitation: Singles,
    speeds_hz: Array,
    sizes: NDArray[np.int_],
) -> Singles:
    """Return p at each speed, (node, input, mesh, k), zero beyond so many lines as that has.

    Speeds a stride apart are solved for one after the other, and those between from what lies beside them.
    """
    forces = np.zeros((speeds_hz.size, *excitation.shape), dtype=np.complex64)
    stride = _STRIDE if speeds_hz.size > _STRIDE + 1 else 1

    def at(number: int, nearby: Singles) -> Singles:
        some = slice(sizes[number])
        forces[number][..., some] = solved(excitation[..., some], nearby[..., some], float(speeds_hz[number]))
        return np.asarray(forces[number])

    nearby = np.zeros_like(excitation)
    for number in range(0, speeds_hz.size, stride):
        nearby = at(number, nearby)
    while stride > 1:
        known = forces[::stride]
        for number in range(stride // 2, speeds_hz.size, stride):
            weights = lagrange(np.array([number / stride]), known.shape[0])[:, 0]
            at(number, np.tensordot(weights.astype(np.float32), known, axes=1))
        stride //= 2
    return forces


def _independent(inputs_n: Array) -> tuple[Array, Array]:
    """Return independent histories (input, instant) of which all are sums, and their shares in each, (input, all).

    Forces of meshes rise and fall together where one torque drives them and little of it accelerates inertias.
    """
    sizes = np.max(np.abs(inputs_n), axis=1, keepdims=True)
    sizes[sizes == 0] = 1.0
    shares, weights, histories = np.linalg.svd(inputs_n / sizes, full_matrices=False)
    kept = weights > _INDEPENDENT * weights[0]
    largest = np.max(np.abs(histories[kept]), axis=1)
    return histories[kept] / largest[:, None], (sizes * shares[:, kept] * weights[kept] * largest).T


@dataclass(frozen=True, kw_only=True)
class _Family:
    """Lines at the multiples of an order, (input, mesh, k), that the stiffness couples.

    Of ``-k_mean e`` in N, the first input, and of ``k / k_mean - 1``, per N of the static force of each mesh.
    """

    base: Fraction
    lines: Singles
    sign: int = 1


def _families(excitations: list[_Excitation], teeth: tuple[Fraction, ...], *, top: float) -> list[_Family]:
    """Return the families of the excitation.

    Harmonics of a mesh are among the multiples of an order that it shares with the mesh on its shaft, which has the
    lines at sums of both; a damaged tooth beside that shaft has a family with the harmonics of its mesh, whose
    vibration its stiffness changes as well. What these are without the damage is subtracted.
    """
    orders = [mesh.order for mesh in excitations]
    shared = [
        _common(one, other)
        for one, other in combinations(dict.fromkeys(orders), 2)
        if any((one / order).denominator == (other / order).denominator == 1 for order in teeth)
    ]
    errors = [mesh.order / cycles for mesh in excitations for cycles in mesh.errors_n]
    damaged = [
        (number, order)
        for number, mesh in enumerate(excitations)
        for order in dict.fromkeys(teeth)
        if mesh.cycles > 1 and (order * mesh.cycles / mesh.order).denominator == (mesh.order / order).denominator == 1
    ]
    bases = dict.fromkeys([*shared, *errors, *(order for _, order in damaged), *orders])

    def home(order: Fraction) -> Fraction:
        """Return the base whose multiples the harmonics of a mesh are among."""
        within = [base for base in bases if (order / base).denominator == 1]
        return max(within, key=lambda base: (sum((each / base).denominator == 1 for each in orders), -base))

    found: dict[tuple[Fraction, int], Singles] = {}

    def add(base: Fraction, row: int, number: int, order: Fraction, lines: ComplexArray, sign: int = 1) -> None:
        shape = (1 + len(orders), len(orders), math.floor(top / base))
        every = int(order / base)
        some = found.setdefault((base, sign), np.zeros(shape, dtype=np.complex64))[row, number, every - 1 :: every]
        some += lines[: some.size]

    for number, mesh in enumerate(excitations):
        own = [(1 + number, mesh.varying[mesh.cycles - 1 :: mesh.cycles])]
        for cycles, lines in mesh.errors_n.items():
            if cycles == 1:
                own.append((0, lines))
            else:
                add(mesh.order / cycles, 0, number, mesh.order / cycles, lines)
        of_mesh = home(mesh.order)
        for row, lines in own:
            add(of_mesh, row, number, mesh.order, lines)
        for order in (order for of, order in damaged if of == number):
            step = int(order * mesh.cycles / mesh.order)
            lines, every = mesh.varying[step - 1 :: step].copy(), int(mesh.order / order)
            lines[every - 1 :: every] = 0
            add(order, 1 + number, number, order, lines)
            if of_mesh != order:
                for row, harmonics in own:
                    add(order, row, number, mesh.order, harmonics)
                    add(mesh.order, row, number, mesh.order, harmonics, -1)
    return [_Family(base=base, lines=lines, sign=sign) for (base, sign), lines in found.items() if lines.any()]


@dataclass(frozen=True, kw_only=True)
class _Varying:
    """``k / k_mean - 1`` in a period of an order, (mesh, n), and its lines (mesh, k), n / 2 times as large."""

    waves: NDArray[np.float32]
    lines: Singles

    @classmethod
    def of(cls, excitations: list[_Excitation], base: Fraction, lines: int) -> "_Varying":
        """Return it at so many points that no product of two of so many lines aliases to a third."""
        from scipy.fft import next_fast_len, rfft  # noqa: PLC0415

        points = next_fast_len(3 * lines + 1, real=True)
        waves = np.stack([each.waveform(base, points) for each in excitations]).astype(np.float32)
        return cls(waves=waves, lines=np.asarray(rfft(waves)[:, 1 : lines + 1], dtype=np.complex64))

    def of_meshes(self, meshes: NDArray[np.int_]) -> "_Varying":
        """Return that of some meshes."""
        return _Varying(waves=self.waves[meshes], lines=self.lines[meshes])

    def times(self, deflections: Singles) -> Singles:
        """Return the lines (input, mesh, k) of its product with deflections whose mean keeps that of tooth forces."""
        from scipy.fft import rfft  # noqa: PLC0415

        waves = self.waves_of(deflections)
        waves *= self.waves
        product = rfft(waves)
        found = product[..., 1 : self.lines.shape[1] + 1]
        found -= product[..., :1] / self.waves.shape[1] * self.lines
        return np.asarray(found, dtype=np.complex64)

    def waves_of(self, lines: Singles) -> NDArray[np.float32]:
        """Return lines (input, mesh, k) as waves (input, mesh, n)."""
        from scipy.fft import irfft  # noqa: PLC0415

        points = self.waves.shape[1]
        spectrum = np.zeros((*lines.shape[:-1], points // 2 + 1), dtype=np.complex64)
        spectrum[..., 1 : lines.shape[-1] + 1] = lines
        return np.asarray(irfft(spectrum, points, overwrite_x=True), dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class _Driven:
    """A family under the inputs of a scene.

    Attributes
    ----------
    meshes : (mesh,) int array
        Those that it excites or whose stiffness varies at its orders: others bear what springs of mean stiffness do.
    histories : (input, instant) array
        Independent ones, of which all inputs are sums.
    excitation : (input, mesh, k) array
        Its lines by them.
    """

    meshes: NDArray[np.int_]
    histories: Array
    excitation: Singles

    @classmethod
    def of(cls, family: _Family, excitations: list[_Excitation], inputs_n: Array) -> "_Driven":
        """Return a family under inputs (1 + mesh, instant): 1, and static forces."""
        varying = _Varying.of(excitations, family.base, family.lines.shape[-1])
        sizes = np.linalg.norm(varying.lines, axis=1)
        meshes = np.flatnonzero(family.lines.any(axis=(0, 2)) | (sizes > _COUPLED * np.max(sizes)))
        inputs = np.flatnonzero(family.lines.any(axis=(1, 2)))
        lines, varying = family.lines[np.ix_(inputs, meshes)], varying.of_meshes(meshes)
        if not inputs[0]:  # -k e = -k_mean e - (k - k_mean) e
            lines[:1] += varying.times(lines[:1])
        histories, shares = _independent(inputs_n[inputs])
        excitation = np.tensordot(shares, lines, axes=1).astype(np.complex64)
        return cls(meshes=meshes, histories=histories, excitation=excitation)


def _common(one: Fraction, other: Fraction) -> Fraction:
    """Return the largest order of which both are multiples."""
    return Fraction(
        math.gcd(one.numerator * other.denominator, other.numerator * one.denominator),
        one.denominator * other.denominator,
    )


def _balanced(
    excitation: Singles,
    start: Singles,
    speed_hz: float,
    *,
    gains: ComplexArray,
    varying_of: Callable[[Fraction, int], _Varying],
    modes: "_Modes",
    base: Fraction,
    step_hz: float,
    bound: float,
) -> Singles:
    """Return p, (input, mesh, k).

    Parameters
    ----------
    excitation : (input, mesh, k) array
        p without the deflections that p makes.
    start : (input, mesh, k) array
        First guess.
    speed_hz : float
    gains : (mesh, mesh, f) array
        Deflection of a mesh per N of p in another, times k_mean.
    varying_of : callable
        From base and number of lines to the varying stiffness of the meshes.
    modes : _Modes
        The same response as a sum over modes.
    base : Fraction
    step_hz : float
        Between the responses.
    bound : float
        Of the residual of each input.
    """
    meshes, lines = excitation.shape[1:]
    place = float(base) * speed_hz / step_hz * np.arange(1, lines + 1)
    number = np.minimum(place.astype(np.int64), gains.shape[2] - 2)
    share = np.minimum(place - number, 1.0)
    gain = ((1 - share) * gains[:, :, number] + share * gains[:, :, number + 1]).astype(np.complex64)
    varying = varying_of(base, lines)

    def remainder(forces: Singles) -> Singles:
        total = gain[:, 0] * forces[:, None, 0]
        for mesh in range(1, meshes):  # in place of einsum, whose loop over lines is three times as slow
            total += gain[:, mesh] * forces[:, None, mesh]
        return np.asarray(forces - varying.times(total))

    found, left, known = start, np.full(excitation.shape[0], np.inf), excitation - remainder(start)
    with np.errstate(over="ignore", invalid="ignore"):  # where the stiffness excites vibration that grows
        for _ in range(_MOST_SWEEPS):
            size = np.linalg.norm(_rows(known), axis=1)
            if not np.any(size < _NO_USE * left):
                break
            found, left = start, size
            if np.all(left <= bound):
                break
            start = found + modes.swept(known, varying, 1 / (float(base) * speed_hz))
            known = excitation - remainder(start)
    return found


def _rows(lines: Singles) -> NDArray[np.float32]:
    """Return lines (input, mesh, k) as real vectors (input, n)."""
    return np.asarray(np.ascontiguousarray(lines).reshape(lines.shape[0], -1).view(np.float32))


@dataclass(frozen=True, kw_only=True)
class _Modes:
    """Deflections of meshes by p in them, times k_mean, as a sum over modes: the real part, of one of each pair.

    Attributes
    ----------
    poles : (mode,) complex array
        rad/s.
    deflections : (mesh, mode) complex array
    inputs : (mode, mesh) complex array
    """

    poles: ComplexArray
    deflections: ComplexArray
    inputs: ComplexArray

    @classmethod
    def of(cls, response: Response, meshes: NDArray[np.int_]) -> "_Modes":
        """Return those of a response."""
        kept = response.poles.imag >= 0
        counts = np.where(response.poles[kept].imag > 0, 2.0, 1.0)
        deflections = response.means[meshes, None] * response.deflections[np.ix_(meshes, kept)]
        return cls(
            poles=response.poles[kept], deflections=counts * deflections, inputs=response.inputs[np.ix_(kept, meshes)]
        )

    @property
    def largest(self) -> Array:
        """Largest force in a spring per N of p, (mode,)."""
        sizes = np.max(np.abs(self.deflections), axis=0) * np.max(np.abs(self.inputs), axis=1)
        with np.errstate(divide="ignore"):
            return np.asarray(sizes / (2 * np.abs(self.poles.real)))

    @property
    def highest_hz(self) -> float:
        """Frequency of the highest mode that the stiffness brings into play."""
        return float(np.max(np.abs(self.poles[self.largest > 1]), initial=0.0)) / (2 * np.pi)

    def swept(self, right: Singles, varying: _Varying, period_s: float) -> Singles:
        """Return about the p (input, mesh, k) of which ``p - varying delta`` is so much, delta their deflections."""
        from scipy.fft import rfft  # noqa: PLC0415

        from data_synth.fidelity._sweep_kernels import sweep  # noqa: PLC0415

        waves = varying.waves_of(right)
        step_s, poles = period_s / waves.shape[-1], self.poles
        with np.errstate(divide="ignore"):
            rings = np.log(self.largest / _PART)  # until little of a mode is left, in its time
        slow = (rings > 0) & (np.abs(poles) * step_s < _FAST)
        at_once = ((self.deflections[:, ~slow] / -poles[~slow]) @ self.inputs[~slow]).real
        poles, outputs, inputs = poles[slow], self.deflections[:, slow], self.inputs[slow]
        turns = np.exp(poles * step_s)
        after = (turns - 1 - poles * step_s) / (poles**2 * step_s)
        before = (turns - 1) / poles - after
        # a wave that is linear between instants is weaker by this factor, which each mode has at its own frequency
        inputs = inputs / np.sinc(poles.imag * step_s / (2 * np.pi))[:, None] ** 2
        with np.errstate(divide="ignore"):
            run_in = min(np.max(rings[slow] / -poles.real, initial=0.0) / step_s, _LONGEST_RUN_IN)
        found = np.empty_like(waves)
        sweep(
            waves,
            varying.waves,
            _parts(turns),
            _parts((inputs * (before + turns * after)[:, None]).T),
            _parts(outputs),
            np.ascontiguousarray(at_once + ((outputs * after) @ inputs).real),
            int(run_in),
            found,
        )
        return np.asarray(rfft(found)[..., 1 : right.shape[-1] + 1], dtype=np.complex64)


def _parts(values: ComplexArray) -> Array:
    """Return real and imaginary part, (..., 2, mode), of values (..., mode)."""
    return np.ascontiguousarray(np.stack([values.real, values.imag], axis=-2))

"""Lines that gears in motion are expected to have at a speed and a load: harmonic balance with varying stiffness.

Teeth of stiffness k and transmission error e under the static force F bear k (delta - e). On a spring of the mean
stiffness, what that is more than the spring bears is an exciting force

    p_i = (k_i - k_mean_i) (delta_i - e_i) - k_mean_i e_i,   delta_i = delta_0i + sum_j G_ij p_j

G_ij the deflection of mesh i per N of p in mesh j at mean stiffness, and delta_0 such that the mean tooth force is F.
What drives it has constant Fourier coefficients at exact orders: those of each part of e, which has the period of one
gear, and of k, per N of F. The lines of a family are the multiples of one order, in all meshes: those of the varying
stiffness at such multiples, a damaged tooth's among them, couple them. At some speeds the equations of all lines are
solved together (`data_synth.fidelity.harmonic_balance`). Between speeds p is interpolated.

Sound and damaged gears have the same families, speeds, points and bounds, so that the errors of both are alike and the
difference is the fault's, 60 dB below the record even. Where a family's teeth would pull, they part, under some loads
between which p is interpolated. Left out are lines at sums of the orders of two families, as of a damaged tooth and
another gear or of meshes on different shafts, what parts in the sum of families alone, and transients.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from data_synth.dynamics.system import Mesh
from data_synth.fidelity.excitation import Excitation, Family, families_of
from data_synth.fidelity.harmonic_balance import Balance, Modes, Singles, Varying, real_rows
from data_synth.fidelity.linear_response import Response, response_of
from data_synth.operation.shaft_angle import Array
from data_synth.vibration.expected_response import ExpectedLines, Hearing, lagrange
from data_synth.vibration.gear_lines import LOWER_SPEEDS
from data_synth.vibration.line_candidates import turn_orders
from data_synth.vibration.run import Motion, contacts_in
from data_synth.vibration.sidebands import sidebands_of

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
_ONE_LOAD, _NO_LOAD, _LOADS = 0.01, 1e-6, 5
"""Of the largest static force, by which others are the same, and which is none; and how many there are else."""
_RESIDUAL = 2e-6  # of the equations, over the largest excitation: a fault may be 1e-3 of that


def expected_lines(motion: Motion) -> tuple[ExpectedLines, ...]:
    """Return the expected lines of gears in motion, a family for each order whose multiples they are.

    Of planets, whose routes to a sensor vary with the carrier's angle, one as well for each multiple of its order
    beside those, and for what static forces make at such multiples. None of a reference that turns backwards.
    Where teeth change in time, p is linear between the instants at which they are known, as their stiffness is; of
    several meshes whose teeth change, each has those of its instant nearest to that of another.
    """
    speed_hz = motion.stage.speed_hz
    if np.min(speed_hz) < 0 or not speed_hz.any():
        return ()
    histories = [mesh.history.times_s for mesh in motion.system.meshes if mesh.history is not None]
    found = list(_of_static_forces(motion))
    if not histories:
        return (*found, *_of_teeth(motion, np.ones(speed_hz.size)))
    times_s = np.unique(np.concatenate(histories))
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
    highest = _ABOVE_MODES * finer ** (1 / 6) * _modes(response, np.arange(len(system.meshes))).highest_hz
    # in steps, so that sound and damaged gears, whose modes differ a little, have the same lines
    wider = math.ceil(math.log(max(highest / (_BEYOND * rate_hz / 2), 1.0), _WIDER))
    band_hz = _BEYOND * rate_hz / 2 * _WIDER**wider
    top = band_hz / max(lowest_hz, highest_hz / LOWER_SPEEDS)
    excitations = [Excitation.of(mesh, of_mesh[number], top=top) for number, mesh in enumerate(system.meshes)]
    frequency_hz = np.linspace(0.0, band_hz * min(highest_hz / lowest_hz, _ALIKE), _RESPONSES)
    deflections, readings = response.between(frequency_hz)
    gains = response.means[:, None, None] * deflections
    inputs_n = shares * np.concatenate([np.ones((1, shares.size)), motion.static_n])
    rates = np.gradient(speed_hz, stage.instants_s)
    damping = max(float(np.min(-response.poles.real / np.abs(response.poles))), _LEAST_DAMPING)
    apart = _APART * damping / finer**0.25
    # one set of speeds for all families, as some are what others are without the damage
    slow_hz = _FINE_HZ / float(max(of_mesh.values())) / (_APART * damping)
    every_hz = _speeds(lowest_hz, highest_hz, apart=min(apart, _FAR), slow_hz=slow_hz)
    speeds_hz = _about(every_hz, speed_hz[shares > 0])
    families = families_of(excitations, tuple(turn_orders(stage.scene).values()), top=top)
    driven = [_Driven.of(family, excitations, inputs_n) for family in families]
    # the same error in N for all: a family that is weak beside others need not be as exact by itself
    largest = max((float(np.max(np.linalg.norm(real_rows(each.excitation), axis=1))) for each in driven), default=0.0)
    heard, found = _hearings(motion, frequency_hz, readings.astype(np.complex64)), list[ExpectedLines]()
    heard_of = cache(lambda *meshes: [one.of_meshes(np.array(meshes)) for one in heard])
    at_speeds = partial(
        ExpectedLines, speeds_hz=speeds_hz, slow_hz=slow_hz, speed_hz=speed_hz, rates=rates, damping=damping
    )
    may_part = np.array([mesh.backlash_m > 0 for mesh in system.meshes])
    loads = _Loads.of(motion.static_n)
    for family, each in zip(families, driven, strict=True):
        varying_of = cache(partial(Varying.of, [excitations[number] for number in each.meshes], family.base))
        balance_at = partial(
            Balance.at,
            base=family.base,
            gains=gains[np.ix_(each.meshes, each.meshes)],
            modes=_modes(response, each.meshes),
            step_hz=float(frequency_hz[1]),
            bound=_RESIDUAL * largest,
        )
        slowest_hz = np.maximum(lowest_hz, np.minimum(speeds_hz, highest_hz / _ALIKE))
        sizes = np.minimum(np.floor(band_hz / slowest_hz / float(family.base)).astype(int), each.excitation.shape[-1])
        balances = [
            partial(balance_at, speed, varying=varying_of(size))
            for speed, size in zip(speeds_hz.tolist(), sizes.tolist(), strict=True)
        ]
        parting = _Parting.of(loads.static_n if loads and may_part[each.meshes].any() else None, each, may_part)
        forces, histories = _over_speeds(balances, each.excitation, then=parting.at), each.histories
        if loads is not None and parting.found:
            forces, histories = parting.forces(forces), shares * loads.weights
        found += [
            at_speeds(base_order=family.base, forces=family.sign * forces, inputs_n=histories, heard=one)
            for one in heard_of(*each.meshes.tolist())
        ]
    return tuple(found)


@dataclass(frozen=True, kw_only=True)
class _Loads:
    """Loads between which what parting teeth do is interpolated, since it is not proportional to any.

    Attributes
    ----------
    static_n : (load, mesh) array
    weights : (load, instant) array
        Of which the static forces at the instants are the sums: linear between two loads.
    """

    static_n: Array
    weights: Array

    @classmethod
    def of(cls, static_n: Array) -> "_Loads | None":
        """Return some of the static forces (mesh, instant); None where they do not rise and fall together."""
        most = float(np.max(np.abs(static_n), initial=0.0))
        course = static_n[np.argmax(np.ptp(static_n, axis=1))]
        if np.ptp(course) <= _ONE_LOAD * most:
            return cls(static_n=np.mean(static_n, axis=1)[None], weights=np.ones((1, static_n.shape[1])))
        places = np.linspace(np.min(course), np.max(course), _LOADS)
        weights = np.stack([np.interp(course, places, only) for only in np.eye(_LOADS)])
        known = np.linalg.lstsq(weights.T, static_n.T, rcond=None)[0]
        if np.max(np.abs(weights.T @ known - static_n.T)) > _ONE_LOAD * most:
            return None
        return cls(static_n=np.where(np.abs(known) > _NO_LOAD * most, known, 0.0), weights=weights)


@dataclass(frozen=True, kw_only=True)
class _Parting:
    """A family's p under some loads, of teeth that part where they would pull.

    Attributes
    ----------
    static_n : (load, mesh) array
        Of the family's meshes; no load where teeth are not to part.
    shares : (load, input) array
        Of the family's inputs under each load.
    excitation : (load, mesh, k) array
    may_part : (mesh,) bool array
    enough : int
        Loads after which, where teeth part under none of them, they part under no other.
    found : mapping of (node, load) to (mesh, k) array
        Where teeth part.
    """

    static_n: Array
    shares: Array
    excitation: Singles
    may_part: NDArray[np.bool_]
    enough: int
    found: dict[tuple[int, int], Singles] = field(default_factory=dict)

    @classmethod
    def of(cls, static_n: Array | None, driven: "_Driven", may_part: NDArray[np.bool_]) -> "_Parting":
        """Return that of a family, with nothing found yet; under no load where static forces are None."""
        known_n = np.zeros((0, may_part.size)) if static_n is None else static_n
        shares = driven.shares_of(np.concatenate([np.ones((known_n.shape[0], 1)), known_n], axis=1))
        enough = loads = known_n.shape[0]
        if np.all(np.abs(np.sum(np.sign(known_n), axis=0)) == loads):
            alike = shares.shape[1] == 1 and loads and np.ptp(known_n / known_n[0] * shares[0] / shares) < _ONE_LOAD
            enough = 1 if alike else 2
        return cls(
            static_n=known_n[:, driven.meshes],
            enough=enough,
            shares=shares,
            excitation=np.tensordot(shares, driven.excitation, axes=1).astype(np.complex64),
            may_part=may_part[driven.meshes],
        )

    def at(self, node: int, balance: Balance, forces: Singles) -> None:
        """Look whether p (input, mesh, k) of a node parts teeth: under the largest load, the least, and those between.

        Under those between it does not where it does not under both, nor under others where all is proportional.
        """
        loads, lines, parts = self.static_n.shape[0], forces.shape[-1], False
        for number, load in enumerate(dict.fromkeys([loads - 1, *range(loads - 1)]) if loads else ()):
            if number >= self.enough and not parts:
                break
            now = balance.parted(
                self.excitation[load, :, :lines],
                sum(np.float32(share) * each for share, each in zip(self.shares[load], forces, strict=True)),
                self.static_n[load],
                may_part=self.may_part & (self.static_n[load] != 0),
            )
            if now is not None:
                self.found[node, load], parts = now, True

    def forces(self, forces: Singles) -> Singles:
        """Return p under each load, (node, load, mesh, k), from that of teeth that pull."""
        every = np.einsum("nimk,li->nlmk", forces, self.shares.astype(np.float32), optimize=True).astype(np.complex64)
        for (node, load), found in self.found.items():
            every[node, load, :, : found.shape[-1]] = found
        return np.asarray(every)


def _modes(response: Response, meshes: NDArray[np.int_]) -> Modes:
    """Return the deflections of some meshes by p in them."""
    kept = response.poles.imag >= 0
    counts = np.where(response.poles[kept].imag > 0, 2.0, 1.0)
    deflections = response.means[meshes, None] * response.deflections[np.ix_(meshes, kept)]
    return Modes(
        poles=response.poles[kept], deflections=counts * deflections, inputs=response.inputs[np.ix_(kept, meshes)]
    )


def _hearings(motion: Motion, frequency_hz: Array, readings: Singles) -> tuple[Hearing, ...]:
    """Return what the channels have of exciting forces, of which are readings (mesh, reading, f), at each shift."""
    routes, channels = _routes(motion, frequency_hz)
    return tuple(
        Hearing(
            shift=band.shift,
            frequency_hz=frequency_hz,
            readings=readings,
            gains=band.gains,
            channels=channels,
            routes=routes,
        )
        for band in sidebands_of(motion.sensor_forces, readings=readings.shape[1])
    )


def _routes(motion: Motion, frequency_hz: Array) -> tuple[Singles, NDArray[np.int_]]:
    """Return the complex amplitude in the channel of each route per N, (route, f), and its channel."""
    routes = motion.sensor_forces.routes
    responses = np.stack([route.response_in(motion.stage.scene)(frequency_hz) for route in routes])
    return responses.astype(np.complex64), np.array([route.number for route in routes])


def _of_static_forces(motion: Motion) -> Iterator[ExpectedLines]:
    """Yield the lines at multiples of a carrier's order that static forces make, which turn with it."""
    if not motion.sensor_forces.rotate:
        return
    stage, static_n = motion.stage, motion.every_static_reading
    for band in sidebands_of(motion.sensor_forces, readings=static_n.shape[0]):
        in_routes = 2 * (band.static_gains @ static_n + band.static_n)  # with those at the opposite order
        if band.shift <= 0 or not in_routes.any():
            continue
        frequency_hz = np.linspace(0.0, float(band.shift) * np.max(stage.speed_hz), _RESPONSES)
        routes, channels = _routes(motion, frequency_hz)
        unit = np.eye(channels.size, dtype=np.complex64)
        yield ExpectedLines(
            base_order=band.shift,
            forces=np.concatenate([unit, 1j * unit])[None, :, :, None],
            speeds_hz=np.array([np.max(stage.speed_hz)]),
            slow_hz=0.0,
            inputs_n=np.concatenate([in_routes.real, in_routes.imag]),
            speed_hz=stage.speed_hz,
            rates=np.zeros(stage.speed_hz.size),
            damping=1.0,
            heard=Hearing(
                shift=Fraction(0),
                frequency_hz=frequency_hz,
                readings=np.broadcast_to(unit[:, :, None], (*unit.shape, frequency_hz.size)),
                gains=unit,
                channels=channels,
                routes=routes,
            ),
        )


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
    balances: Sequence[Callable[[], Balance]],
    excitation: Singles,
    *,
    then: Callable[[int, Balance, Singles], None],
) -> Singles:
    """Return p at each speed, (node, input, mesh, k), zero beyond so many lines as that has, and do more with each.

    Speeds a stride apart are solved for one after the other, and those between from what lies beside them.
    """
    nodes = len(balances)
    forces = np.zeros((nodes, *excitation.shape), dtype=np.complex64)
    stride = _STRIDE if nodes > _STRIDE + 1 else 1

    def at(number: int, nearby: Singles) -> Singles:
        balance = balances[number]()
        some = slice(balance.gain.shape[-1])
        forces[number][..., some] = balance.solved(excitation[..., some], nearby[..., some])
        then(number, balance, forces[number][..., some])
        return np.asarray(forces[number])

    nearby = np.zeros_like(excitation)
    for number in range(0, nodes, stride):
        nearby = at(number, nearby)
    while stride > 1:
        known = forces[::stride]
        for number in range(stride // 2, nodes, stride):
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
    inputs : (some,) int array
        Those of 1 and the static forces that drive it.
    shares : (input, some) array
        Of these in each history.
    """

    meshes: NDArray[np.int_]
    histories: Array
    excitation: Singles
    inputs: NDArray[np.int_]
    shares: Array

    def shares_of(self, inputs_n: Array) -> Array:
        """Return the shares (load, input) of histories in 1 and static forces, (load, 1 + mesh)."""
        return np.asarray(np.linalg.lstsq(self.shares.T, inputs_n[:, self.inputs].T, rcond=None)[0].T)

    @classmethod
    def of(cls, family: Family, excitations: list[Excitation], inputs_n: Array) -> "_Driven":
        """Return a family under inputs (1 + mesh, instant): 1, and static forces."""
        varying = Varying.of(excitations, family.base, family.lines.shape[-1])
        sizes = np.linalg.norm(varying.lines, axis=1)
        meshes = np.flatnonzero(family.lines.any(axis=(0, 2)) | (sizes > _COUPLED * np.max(sizes)))
        inputs = np.flatnonzero(family.lines.any(axis=(1, 2)))
        lines, varying = family.lines[np.ix_(inputs, meshes)], varying.of_meshes(meshes)
        if not inputs[0]:  # -k e = -k_mean e - (k - k_mean) e
            lines[:1] += varying.times(lines[:1])
        histories, shares = _independent(inputs_n[inputs])
        excitation = np.tensordot(shares, lines, axes=1).astype(np.complex64)
        return cls(meshes=meshes, histories=histories, excitation=excitation, inputs=inputs, shares=shares)

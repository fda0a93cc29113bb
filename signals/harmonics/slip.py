"""A line whose order slips: amplitude, phase and the slip itself, each with its uncertainty.

The rollers of a bearing slide, so its lines stand a per cent or so off their nominal order and wander there. A
tracker at the nominal order must then be so wide that it lets the noise in. Here the deviation is part of
the state. With the slip s, relative to the order,

    y[n] = sum_k Re{ A_k exp(j k order (phase[n] + s (phase[n] - phase_c))) } + v[n],     var v = R,

within a block of samples whose middle is c; from one middle to the next

    s -> s' = s + e,     A_k -> exp(j k order (s + s') / 2 (step of the phase)) A_k + w.

Each quadrature of A is the random walk of `model`, so that `bandwidth` means what it means there: on a line
whose slip is known this is the plain smoother with one pole. The slip is a random walk over shaft angle. Its
strength is the standard deviation of its change in one revolution; over m revolutions it is sqrt(m) times that.

The filter is the extended Kalman filter (Jazwinski 1970, ch. 8): it linearises at its own prediction. The
smoother minimises the exact sum of squares, samples over R, changes over their variances, by Gauss-Newton
steps. Each is a Kalman filter and a Rauch-Tung-Striebel sweep on the model linearised at the trajectory so far
(Bell 1994 [1]_), halved until the sum falls (Sarkka and Svensson 2020 [2]_). The uncertainty is that of the
linearised model at the minimum, and holds while the phase is known to a fraction of a turn.

Both need a start near the truth. The record is cut into segments over which amplitude and slip can be taken for
constant; the power of each at a grid of slips, over that of noise beside the band, is exponentially distributed
where there is no line. The path through these cells that has most power, less what its changes cost, is found by
dynamic programming (Viterbi). Over all paths, Markov's inequality for exp(theta score) with the best theta bounds
the probability that noise alone has a path as good. It is the looser the livelier the slip may be.

A gap over which the phase cannot be carried (a walk of the slip would turn the line by more than a radian) cuts the
line: how often it turned there is unknown, and the phase after it must not say what the slip was within.

References
----------
.. [1] B. M. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optim. 4(3), 1994.
.. [2] S. Sarkka, L. Svensson, "Levenberg-Marquardt and line-search extended Kalman smoothers", ICASSP 2020.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil, log, pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from signals._checks import choice, positive, real_vector, whole
from signals._compile import compiled
from signals.harmonics.bandwidth import process_variance
from signals.harmonics.inputs import CheckedBandwidth, check_bandwidth
from signals.harmonics.model import PRIOR_STD, BandwidthUnits, Estimator

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Whole = NDArray[np.int64]
Status = Literal["converged", "not converged", "single pass", "no line"]

MOST_HARMONICS = 16
# Of 1 / bandwidth, and of the stretch over which the walk of the slip turns the line by a radian: in shorter blocks
# what is held constant differs from the continuous walks by a few 1e-4 of the uncertainty.
_BLOCK = 1 / 200
_SLIP_BLOCK = 1 / 50
# A change this small, in standard deviations, is no change.
_SETTLED = 1e-7
# Where rounding keeps the objective from falling any further the step is far below this, in the same unit.
_FLAT = 1e-3
_HALVINGS = 30
# Noise alone passes for a line at most this often.
_FALSE_ALARM = 0.01
_CELLS_PER_WIDTH = 2  # of slips searched, for each width (1 / segment) of a line
_NOISE_CELLS = np.arange(3, 19)  # widths beyond the searched band, on either side, at which the noise is measured
_FEWEST_NOISE_CELLS = 16
_TURN_OF_BLOCK = 1 / 32  # of a turn, at the edge of what is looked at
_TILTS = np.linspace(0.05, 0.95, 19)  # theta of the bound


@dataclass(frozen=True, kw_only=True, eq=False)
class SlippingTrack:
    """A slipping order: its harmonics' amplitudes, its slip, and how sure they are.

    Harmonic k is `Re{ Z exp(j k (order phase + slip_phase)) }`. Its amplitude `abs(Z)` and its phase have
    standard deviations of their own, since uncertainty of the slip goes into the phase alone.

    Attributes
    ----------
    complex_amplitude : (harmonic, output) array, Z relative to the slipped phase.
    std : (harmonic, output) array, `sqrt(E|Zhat - Z|^2 / 2)` where the slipped phase is taken as given.
    amplitude_std : (harmonic, output) array, of `abs(Z)`.
    phase_std_rad : (harmonic, output) array, of the harmonic's whole phase; beyond about 1 the phase is unknown.
    slip : (output,) array, relative deviation: the line is at `order (1 + slip)`.
    slip_std : (output,) array; without a line at least that of an even spread over +- largest_slip.
    slip_phase_rad : (output,) array, the fundamental's turn beyond `order phase`, zero at the first output.
    sample_index : (output,) array, the sample each output belongs to: the middle of its block.
    order : nominal order of the fundamental.
    largest_slip : as given.
    slip_change_per_rev : as given.
    bandwidth : full -3 dB width of the steady-state smoother of the amplitude, the mean where it varies.
    bandwidth_units : "hz" or "orders".
    estimator : "smoother" (all samples) or "filter" (this block and those before it).
    noise_variance : R, as given or as measured beside the line.
    innovation_mean_square : mean of the squared innovations over their variances: near 1 when R, bandwidth and
        slip_change_per_rev suit the record.
    false_alarm_probability : bound on the probability that white Gaussian noise of variance R has a path of slips
        with as much power; it does not know whether the line is the one looked for or a neighbour.
    status : "converged"; "not converged": the last step still mattered, read the numbers with care; "single
        pass": the filter does not iterate; "no line": the false alarm probability is above 0.01, and
        amplitude and slip are those of the loudest noise.
    iterations : Gauss-Newton steps taken.
    objective : (step,) array, half the sum of squares at the start and after every step; it never rises.
    """

    complex_amplitude: Complexes = field(metadata={"dims": ("harmonic", "output"), "units": "signal"})
    std: Floats = field(metadata={"dims": ("harmonic", "output"), "units": "signal"})
    amplitude_std: Floats = field(metadata={"dims": ("harmonic", "output"), "units": "signal"})
    phase_std_rad: Floats = field(metadata={"dims": ("harmonic", "output"), "units": "rad"})
    slip: Floats = field(metadata={"dims": ("output",), "units": "1"})
    slip_std: Floats = field(metadata={"dims": ("output",), "units": "1"})
    slip_phase_rad: Floats = field(metadata={"dims": ("output",), "units": "rad"})
    sample_index: Whole = field(metadata={"dims": ("output",), "units": "1"})
    order: float
    largest_slip: float
    slip_change_per_rev: float
    bandwidth: float
    bandwidth_units: BandwidthUnits
    estimator: Estimator
    noise_variance: float
    innovation_mean_square: float
    false_alarm_probability: float
    status: Status
    iterations: int
    objective: Floats = field(metadata={"dims": ("step",), "units": "1"})

    @property
    def converged(self) -> bool:
        """Whether there is a line and the smoother settled on it."""
        return self.status == "converged"


def track_slipping_order(
    x: ArrayLike,
    *,
    phase_rad: ArrayLike,
    order: float,
    largest_slip: float,
    slip_change_per_rev: float,
    bandwidth_hz: ArrayLike | None = None,
    bandwidth_orders: ArrayLike | None = None,
    rate_hz: float | None = None,
    samples_per_rev: float | None = None,
    harmonics: int = 1,
    estimator: Estimator = "smoother",
    output_every: int | None = None,
    noise_variance: float | None = None,
    most_iterations: int = 100,
) -> SlippingTrack:
    """Follow a line that wanders about its nominal order, and say how far it has slipped.

    Other lines are noise to this estimator: take the mean and whatever is strong and near out of `x` first.

    Parameters
    ----------
    x : (sample,) array, the record in any unit; NaN marks a missing sample.
    phase_rad : (sample,) array, shaft angle in rad.
    order : nominal order of the line, cycles per revolution.
    largest_slip : the line is looked for at `order (1 +- largest_slip)`; 0.02 suits most rolling bearings.
        Also the standard deviation of the first slip about zero; nothing else binds the slip later on.
    slip_change_per_rev : standard deviation of the change of the slip in one revolution; 0.001 lets a line
        at 1 % drift away by another per cent in a hundred revolutions.
    bandwidth_hz : full -3 dB width of the smoother of the amplitude in Hz, one number, or a (1, sample) array
        where it varies; with `rate_hz`.
    bandwidth_orders : the same in cycles per revolution; with `samples_per_rev` or `rate_hz`.
    rate_hz : samples per second.
    samples_per_rev : samples per revolution, for a record sampled in angle.
    harmonics : lines at 1 to this many times the order, which share one slip and one noise variance.
    estimator : "smoother" uses all samples for each output; "filter" this block and those before it, save for
        its first slip, which is where the search found the line in the first stretch of the record. It corrects
        the phase along the tangent, which leaves its amplitudes too large by half of `amplitude_std` or so.
    output_every : samples in a block, which gives one output. Default a 200th of 1 / bandwidth, or less where
        the slip's walk needs it.
    noise_variance : variance R of white noise as dense as that about the line; measured beside it unless given.
    most_iterations : Gauss-Newton steps before the smoother gives up.

    Returns
    -------
    SlippingTrack

    Raises
    ------
    ValueError
        An input makes no sense; the sentence says which and what to do.
    FloatingPointError
        The covariance lost its digits.
    """
    record = _record(x)
    phase = real_vector(phase_rad, name="phase_rad")
    choice(estimator, name="estimator", choices=("smoother", "filter"))
    line = _Line(
        order=positive(order, name="order"),
        harmonics=whole(harmonics, name="harmonics", least=1, most=MOST_HARMONICS),
        largest_slip=positive(largest_slip, name="largest_slip"),
        slip_change=positive(slip_change_per_rev, name="slip_change_per_rev"),
    )
    line.check(record, phase)
    bandwidth = check_bandwidth(
        bandwidth_hz=bandwidth_hz,
        bandwidth_orders=bandwidth_orders,
        rate_hz=rate_hz,
        samples_per_rev=samples_per_rev,
        shaft=np.zeros(1, dtype=np.int64),
        phases=(phase,),
    )
    width = bandwidth.cycles[0]
    given = None if noise_variance is None else positive(noise_variance, name="noise_variance")
    every = None if output_every is None else whole(output_every, name="output_every", least=1)
    limit = whole(most_iterations, name="most_iterations", least=1)
    ridge = _search(record, phase, line, memory=1 / float(width.mean()), noise_variance=given)
    chain = _chain(record, phase, line, width=width, noise_variance=ridge.noise_variance, block=every)
    status: Status = "single pass"
    if estimator == "filter":
        path, objective = _extended_filter(chain, ridge), np.empty(0)
    else:
        ends = [_iterate(chain, start, limit=limit) for start in _starts(chain, ridge)]
        path, status, objective = min(ends, key=lambda end: end[2][-1])
    return _result(
        chain,
        path,
        line=line,
        ridge=ridge,
        bandwidth=bandwidth,
        estimator=estimator,
        status="no line" if ridge.false_alarm_probability > _FALSE_ALARM else status,
        objective=objective,
    )


def _record(x: ArrayLike) -> Floats:
    record = real_vector(x, name="x", minimum=4, finite=False)
    infinite = np.flatnonzero(np.isinf(record))
    if infinite.size:
        raise ValueError(
            f"x[{infinite[0]}]={record[infinite[0]]} (and {infinite.size - 1} more) is infinite; "
            "samples must be finite, or NaN where missing: mark bad samples as NaN."
        )
    if np.isnan(record).all():
        raise ValueError(f"x has {record.size} samples, all of them missing (NaN); observed ones are needed.")
    return record


@dataclass(frozen=True, kw_only=True)
class _Line:
    """What is looked for.

    Attributes
    ----------
    order : cycles per revolution.
    harmonics : how many.
    largest_slip : relative.
    slip_change : standard deviation of the slip's change in a revolution.
    """

    order: float
    harmonics: int
    largest_slip: float
    slip_change: float

    @property
    def top(self) -> float:
        """Order of the highest harmonic."""
        return self.order * self.harmonics

    @property
    def steady_rev(self) -> float:
        """Revolutions over which the walk of the slip turns the highest harmonic by a radian."""
        # A walk of variance v a revolution turns by an angle of variance (2 pi order)^2 v m^3 / 3 in m of them.
        return float((np.sqrt(3) / (2 * pi * self.top * self.slip_change)) ** (2 / 3))

    def check(self, x: Floats, phase: Floats) -> None:
        if phase.size != x.size:
            raise ValueError(f"phase_rad has {phase.size} values for {x.size} samples of x; give one angle per sample.")
        if self.largest_slip >= 1:
            raise ValueError(
                f"largest_slip={self.largest_slip:g} is relative to the order and must be below 1; 2 % is 0.02."
            )
        if phase[-1] == phase[0]:
            raise ValueError("phase_rad ends where it began: the shaft has not turned, and no order can be told.")
        step = np.diff(phase)
        np.abs(step, out=step)
        at = int(step.argmax())
        fastest = self.top * (1 + self.largest_slip) * step[at]
        if fastest > pi:
            raise ValueError(
                f"order {self.top:g} with a slip of {self.largest_slip:g} turns by {fastest:.4g} rad between samples "
                f"{at} and {at + 1}; more than pi is above half of the rate: take fewer harmonics, raise the rate, or "
                "mend the phase there."
            )


# --- the start: a path of slips through the powers of segments ------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ridge:
    """The path of slips with most power.

    Attributes
    ----------
    angle_rad : (segment,) array, shaft angle at the middle of each segment.
    slip : (segment,) array.
    slip_width : the slip that turns the line once more in a segment.
    noise_variance : R.
    false_alarm_probability : bound on that of noise alone having such a path.
    """

    angle_rad: Floats
    slip: Floats
    slip_width: float
    noise_variance: float
    false_alarm_probability: float


@compiled
def _demodulate(x: Floats, phase: Floats, order: float, edges: Whole, sums: Complexes, counts: Floats) -> None:
    """Sum `x exp(-j k order phase)` over the observed samples between the edges: sums (harmonic, block)."""
    for block in range(edges.size - 1):
        for n in range(edges[block], edges[block + 1]):
            if not np.isnan(x[n]):
                turn = complex(np.cos(order * phase[n]), -np.sin(order * phase[n]))
                power = turn
                counts[block] += 1.0
                for k in range(len(sums)):
                    sums[k, block] += x[n] * power
                    power *= turn


def _search(x: Floats, phase: Floats, line: _Line, *, memory: float, noise_variance: float | None) -> _Ridge:
    """Look for the line where its amplitude keeps for `memory` samples."""
    per_rev = x.size * 2 * pi / abs(float(phase[-1] - phase[0]))
    length = min(memory, line.steady_rev * per_rev, float(x.size))
    reach = line.top * line.largest_slip + (_NOISE_CELLS[-1] + 1) * per_rev / length  # orders either side
    block = max(1, int(_TURN_OF_BLOCK * per_rev / reach))
    edges = np.append(np.arange(0, x.size - block // 2, block), x.size)
    sums = np.zeros((line.harmonics, edges.size - 1), dtype=np.complex128)
    counts = np.zeros(edges.size - 1)
    _demodulate(x, phase, line.order, edges, sums, counts)
    angle = phase[(edges[:-1] + edges[1:]) // 2]
    segments = max(1, round(x.size / length))
    cuts = np.linspace(0, edges.size - 1, segments + 1).round().astype(np.int64)
    parts = [slice(a, b) for a, b in pairwise(cuts) if b > a]
    span = abs(float(phase[-1] - phase[0])) / len(parts)  # rad
    noise = noise_variance or _noise_beside(sums, counts, angle, parts, line=line, width=2 * pi / span)
    slip_width = 2 * pi / (span * line.top)
    half = max(1, ceil(_CELLS_PER_WIDTH * line.largest_slip / slip_width))
    grid = np.linspace(-line.largest_slip, line.largest_slip, 2 * half + 1)
    power = np.array([_power(sums, counts, angle, part, line.order * grid) for part in parts]) / noise
    middle = np.array([angle[part].mean() for part in parts])
    change = line.slip_change**2 * np.abs(np.diff(middle)) / (2 * pi) + (grid[1] - grid[0]) ** 2 / 12
    path, score = _best_path(power, grid, change)
    observed = sum(bool(counts[part].any()) for part in parts)
    return _Ridge(
        angle_rad=middle,
        slip=_summits(power, grid, path),
        slip_width=slip_width,
        noise_variance=noise,
        false_alarm_probability=_chance(score, grid, change, degrees=observed * line.harmonics),
    )


def _power(sums: Complexes, counts: Floats, angle: Floats, part: slice, deviations: Floats) -> Floats:
    """Sum over the harmonics of a segment's power at each deviation of the order; white noise has R each."""
    total = np.zeros(deviations.size)
    lead = angle[part] - angle[part].mean()
    for k, harmonic in enumerate(sums, start=1):
        turned = np.exp(-1j * k * np.outer(deviations, lead)) @ harmonic[part]
        total += np.abs(turned) ** 2
    return np.asarray(total / max(1.0, counts[part].sum()))


def _noise_beside(
    sums: Complexes, counts: Floats, angle: Floats, parts: list[slice], *, line: _Line, width: float
) -> float:
    """Variance of white noise as dense as that on either side of the searched bands."""
    cells = []
    for k, harmonic in enumerate(sums, start=1):
        far = k * line.order * line.largest_slip + width * _NOISE_CELLS
        beside = np.concatenate([-far[far < k * line.order], far])
        for part in parts:
            lead = angle[part] - angle[part].mean()
            # Hann's window keeps the line itself out of cells three widths away.
            window = 0.5 + 0.5 * np.cos(lead * (2 * pi / max(np.ptp(lead), 1e-300)))
            seen = np.sum(window**2 * counts[part])
            if counts[part].sum() > counts[part].size / 2 and seen > 0:
                turned = np.exp(-1j * np.outer(beside, lead)) @ (window * harmonic[part])
                cells.append(np.abs(turned) ** 2 / seen)
    values = np.concatenate(cells) if cells else np.empty(0)
    noise = float(np.median(values)) / log(2) if values.size >= _FEWEST_NOISE_CELLS else 0.0
    if noise <= 0:
        raise ValueError(
            f"x shows no noise beside order {line.order:g} ({values.size} cells were looked at), and without it "
            "nothing can be weighed: pass noise_variance."
        )
    return noise


def _best_path(power: Floats, grid: Floats, change: Floats) -> tuple[Whole, float]:
    """Find the path with most power, less half its squared changes over their variances; and its score."""
    score = power[0]
    came_from = np.empty((len(power), grid.size), dtype=np.int64)
    apart = (grid[:, None] - grid) ** 2 / 2
    for segment, variance in enumerate(change, start=1):
        options = score - apart / variance
        came_from[segment] = options.argmax(axis=1)
        score = options.max(axis=1) + power[segment]
    path = np.empty(len(power), dtype=np.int64)
    path[-1] = score.argmax()
    for segment in range(len(power) - 1, 0, -1):
        path[segment - 1] = came_from[segment, path[segment]]
    return path, float(score.max())


def _summits(power: Floats, grid: Floats, path: Whole) -> Floats:
    """Slips of a path, each moved to the summit of the parabola through its cell and the two beside it."""
    at = np.clip(path, 1, grid.size - 2)
    left, middle, right = (power[np.arange(path.size), at + side] for side in (-1, 0, 1))
    bend = left - 2 * middle + right
    summit = (at == path) & (bend < 0) & (middle >= left) & (middle >= right)
    shift = np.where(summit, 0.5 * (left - right) / np.where(summit, bend, 1.0), 0.0)
    return np.asarray(grid[path] + shift * (grid[1] - grid[0]))


def _chance(score: float, grid: Floats, change: Floats, *, degrees: int) -> float:
    """Bound the probability that a path through cells of noise reaches this score."""
    apart = (grid[:, None] - grid) ** 2 / 2
    best = 0.0
    for tilt in _TILTS:
        paths, bound = np.ones(grid.size), -tilt * score - degrees * np.log1p(-tilt)
        for variance in change:
            paths = np.exp(-tilt * apart / variance) @ paths
            bound += log(paths.max())
            paths /= paths.max()
        best = min(best, bound + log(paths.sum()))
    return float(np.exp(best))


# --- the model in blocks, and the two sweeps ------------------------------------------------------------------
# A state is the real parts of A over the harmonics, their imaginary parts, and the slip.


@compiled
def _condense(
    x: Floats,
    phase: Floats,
    order: float,
    scale: float,
    first: int,
    last: int,
    centre: int,
    state: Floats,
    row: Floats,
    information: Floats,
    score: Floats,
) -> float:
    """Linearise a block at `state`: fill row^T row and row^T residual, summed; return the residuals' squares."""
    harmonics = state.size // 2
    information[:] = 0.0
    score[:] = 0.0
    squares = 0.0
    for n in range(first, last):
        if np.isnan(x[n]):
            continue
        lead = order * (phase[n] - phase[centre])
        angle = order * phase[n] + state[-1] * lead
        cosine, sine = np.cos(angle), np.sin(angle)
        c, s = 1.0, 0.0
        residual = scale * x[n]
        row[-1] = 0.0
        for k in range(harmonics):
            c, s = c * cosine - s * sine, s * cosine + c * sine
            real, imaginary = state[k], state[harmonics + k]
            row[k] = c
            row[harmonics + k] = -s
            residual -= real * c - imaginary * s
            row[-1] -= (k + 1) * lead * (real * s + imaginary * c)
        squares += residual * residual
        for a in range(row.size):
            score[a] += row[a] * residual
            for b in range(a + 1):
                information[a, b] += row[a] * row[b]
    for a in range(row.size):
        for b in range(a):
            information[b, a] = information[a, b]
    return squares


@compiled
def _condense_all(
    x: Floats,
    phase: Floats,
    order: float,
    scale: float,
    edges: Whole,
    centres: Whole,
    states: Floats,
    informations: Floats,
    scores: Floats,
) -> float:
    """Linearise every block at its state; return the sum of squared residuals of the record."""
    row = np.empty(states.shape[1])
    squares = 0.0
    for m in range(centres.size):
        squares += _condense(
            x, phase, order, scale, edges[m], edges[m + 1], centres[m], states[m], row, informations[m], scores[m]
        )
    return squares


@compiled
def _update(row: Floats, datum: float, at: Floats, mean: Floats, covariance: Floats, gain: Floats) -> float:
    """Take in `datum = row (state - at)` with unit noise; return the squared innovation over its variance."""
    innovation, variance = datum, 1.0
    for a in range(mean.size):
        gain[a] = 0.0
        for b in range(mean.size):
            gain[a] += covariance[a, b] * row[b]
    for a in range(mean.size):
        innovation -= row[a] * (mean[a] - at[a])
        variance += row[a] * gain[a]
    for a in range(mean.size):
        mean[a] += gain[a] * (innovation / variance)
        for b in range(mean.size):
            covariance[a, b] -= gain[a] * gain[b] / variance
    return innovation * innovation / variance


@compiled
def _take(
    information: Floats, score: Floats, at: Floats, mean: Floats, covariance: Floats, row: Floats, gain: Floats
) -> tuple[float, int]:
    """Take a block in, as one scalar measurement of unit noise for each pivot of its information.

    Returns the sum of the squared innovations over their variances, and how many there were.
    """
    total, count = 0.0, 0
    full = np.diag(information).copy()
    for i in range(mean.size):
        # A direction that the block cannot see leaves only rounding on its pivot.
        if not information[i, i] > 1e-12 * full[i]:
            continue
        root = np.sqrt(information[i, i])
        datum = score[i] / root
        row[:i] = 0.0
        row[i:] = information[i:, i] / root
        for a in range(i, mean.size):
            score[a] -= row[a] * datum
            for b in range(i, mean.size):
                information[a, b] -= row[a] * row[b]
        total += _update(row, datum, at, mean, covariance, gain)
        count += 1
    return total, count


@compiled
def _turn(at: Floats, ahead: float, turn: float, mean: Floats, F: Floats) -> None:
    """Fill F, the transition linearised where the state is `at` and the next slip `ahead`; move the mean by it."""
    harmonics = mean.size // 2
    middle = 0.5 * (at[-1] + ahead)
    off = mean[-1] - middle
    F[:] = 0.0
    F[-1, -1] = 1.0
    for k in range(harmonics):
        rate = (k + 1) * turn
        c, s = np.cos(rate * middle), np.sin(rate * middle)
        F[k, k] = F[harmonics + k, harmonics + k] = c
        F[k, harmonics + k] = -s
        F[harmonics + k, k] = s
        F[k, -1] = -rate * (s * at[k] + c * at[harmonics + k])
        F[harmonics + k, -1] = rate * (c * at[k] - s * at[harmonics + k])
        real, imaginary = mean[k], mean[harmonics + k]
        mean[k] = c * real - s * imaginary + F[k, -1] * off
        mean[harmonics + k] = s * real + c * imaginary + F[harmonics + k, -1] * off


@compiled
def _move(F: Floats, walk: float, slip_walk: float, covariance: Floats, moved: Floats) -> None:
    """Turn P into `F P F^T + Q`; leave F P in `moved`."""
    size = len(F)
    for a in range(size):
        for b in range(size):
            moved[a, b] = 0.0
            for i in range(size):
                moved[a, b] += F[a, i] * covariance[i, b]
    for a in range(size):
        for b in range(a + 1):
            # The change of the slip turns the line by half of what the slip before it does.
            covariance[a, b] = slip_walk * F[a, -1] * F[b, -1]
            covariance[a, b] *= (0.5 if a < size - 1 else 1.0) * (0.5 if b < size - 1 else 1.0)
            covariance[a, b] += walk if a == b and a < size - 1 else 0.0
            for i in range(size):
                covariance[a, b] += moved[a, i] * F[b, i]
            covariance[b, a] = covariance[a, b]


@compiled
def _forward(
    x: Floats,
    phase: Floats,
    order: float,
    scale: float,
    edges: Whole,
    centres: Whole,
    turns: Floats,
    walks: Floats,
    slip_walks: Floats,
    follow: bool,
    states: Floats,
    informations: Floats,
    scores: Floats,
    means: Floats,
    covariances: Floats,
) -> tuple[float, int]:
    """Filter all blocks: linearised at `states`, or (`follow`) at each prediction, which is then put there.

    Parameters
    ----------
    x, phase, order, scale : the record (times scale), the shaft's angle in rad, the order.
    edges : (block + 1,) array, first samples of the blocks and one past the last.
    centres : (block,) array, their middle samples.
    turns : (block - 1,) array, order times the step of the phase from middle to middle.
    walks, slip_walks : (block - 1,) arrays, variances of the changes of a quadrature and of the slip.
    follow : whether to linearise, and condense, at the prediction: the extended Kalman filter.
    states : (block, state) array; in `follow`, the filtered states on return.
    informations, scores : (block, state, state) and (block, state) arrays; used up.
    means, covariances : (block, state) and (block, state, state) arrays: the first of each holds what is known
        before any sample on entry; filled with what the filter knows.

    Returns
    -------
    Sum of squared innovations over their variances, and their number.
    """
    size = means.shape[1]
    mean, covariance = means[0].copy(), covariances[0].copy()
    row, gain = np.empty(size), np.empty(size)
    F, moved = np.empty((size, size)), np.empty((size, size))
    total, count = 0.0, 0
    for m in range(centres.size):
        if follow:
            states[m] = mean
            _condense(x, phase, order, scale, edges[m], edges[m + 1], centres[m], mean, row, informations[m], scores[m])
        added, more = _take(informations[m], scores[m], states[m], mean, covariance, row, gain)
        total += added
        count += more
        means[m] = mean
        covariances[m] = covariance
        if follow:
            states[m] = mean
        if m + 1 < centres.size:
            ahead = states[m, -1] if follow else states[m + 1, -1]
            _turn(states[m], ahead, turns[m], mean, F)
            _move(F, walks[m], slip_walks[m], covariance, moved)
    return total, count


@compiled
def _gain(moved: Floats, factor: Floats, G: Floats) -> None:
    """Fill G with `(F P)^T S^-1`, S = factor factor^T, row by row: forth and back through the triangle."""
    size = len(G)
    for row in range(size):
        for a in range(size):
            value = moved[a, row]
            for b in range(a):
                value -= factor[a, b] * G[row, b]
            G[row, a] = value / factor[a, a]
        for a in range(size - 1, -1, -1):
            value = G[row, a]
            for b in range(a + 1, size):
                value -= factor[b, a] * G[row, b]
            G[row, a] = value / factor[a, a]


@compiled
def _backward(
    turns: Floats, walks: Floats, slip_walks: Floats, follow: bool, states: Floats, means: Floats, covariances: Floats
) -> None:
    """Turn what the filter knows into what all blocks say (Rauch, Tung, Striebel); arguments as in `_forward`."""
    size = means.shape[1]
    F, moved, factor = np.empty((size, size)), np.empty((size, size)), np.empty((size, size))
    G, spread = np.empty((size, size)), np.empty((size, size))
    for m in range(len(means) - 2, -1, -1):
        mean = means[m].copy()
        covariance = covariances[m].copy()
        ahead = states[m, -1] if follow else states[m + 1, -1]
        _turn(states[m], ahead, turns[m], mean, F)
        _move(F, walks[m], slip_walks[m], covariance, moved)
        factor[:] = np.linalg.cholesky(covariance)
        _gain(moved, factor, G)
        for a in range(size):
            for b in range(size):
                means[m, a] += G[a, b] * (means[m + 1, b] - mean[b])
                spread[a, b] = 0.0
                for i in range(size):
                    spread[a, b] += G[a, i] * (covariances[m + 1, i, b] - covariance[i, b])
        for a in range(size):
            for b in range(a + 1):
                for i in range(size):
                    covariances[m, a, b] += spread[a, i] * G[b, i]
                covariances[m, b, a] = covariances[m, a, b]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Path:
    """States of all blocks, what the filter or smoother makes of them, and the fit of its innovations."""

    means: Floats
    covariances: Floats
    innovation_mean_square: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Chain:
    """The record in blocks, in units of the noise; attributes as in `_forward`.

    Attributes
    ----------
    prior_mean : (state,) array, before the first sample.
    prior_std : (state,) array.
    """

    x: Floats
    phase: Floats
    order: float
    scale: float
    edges: Whole
    centres: Whole
    turns: Floats
    walks: Floats
    slip_walks: Floats
    prior_mean: Floats
    prior_std: Floats

    @property
    def size(self) -> int:
        """Numbers in a state."""
        return self.prior_mean.size

    def condense(self, states: Floats) -> tuple[float, Floats, Floats]:
        """Objective at these states, and the information and score of every block."""
        informations = np.empty((len(states), self.size, self.size))
        scores = np.empty_like(states)
        squares = _condense_all(
            self.x, self.phase, self.order, self.scale, self.edges, self.centres, states, informations, scores
        )
        return 0.5 * (squares + self._changes(states)), informations, scores

    def _changes(self, states: Floats) -> float:
        """Squared changes over their variances, the first state's from its prior included."""
        harmonics = self.size // 2
        amplitude = states[:, :harmonics] + 1j * states[:, harmonics:-1]
        number = np.arange(1, harmonics + 1)
        slip = states[:, -1]
        moved = np.exp(1j * np.outer(0.5 * (slip[1:] + slip[:-1]) * self.turns, number)) * amplitude[:-1]
        start = (states[0] - self.prior_mean) / self.prior_std
        return float(
            start @ start
            + np.sum(np.abs(amplitude[1:] - moved) ** 2 / self.walks[:, None])
            + np.sum(np.diff(slip) ** 2 / self.slip_walks)
        )

    def run(
        self,
        states: Floats,
        *,
        condensed: tuple[Floats, Floats] | None = None,
        prior: tuple[Floats, Floats] | None = None,
        smooth: bool = True,
    ) -> _Path:
        """Filter, and smooth, linearised at the states; without condensed blocks, at each prediction."""
        follow = condensed is None
        mean, std = prior or (self.prior_mean, self.prior_std)
        informations, scores = condensed or (np.empty((len(states), self.size, self.size)), np.empty_like(states))
        means, covariances = np.empty_like(states), np.empty((len(states), self.size, self.size))
        means[0], covariances[0] = mean, np.diag(std**2)
        total, count = _forward(
            self.x,
            self.phase,
            self.order,
            self.scale,
            self.edges,
            self.centres,
            self.turns,
            self.walks,
            self.slip_walks,
            follow,
            states,
            informations,
            scores,
            means,
            covariances,
        )
        if smooth:
            try:
                _backward(self.turns, self.walks, self.slip_walks, follow, states, means, covariances)
            except np.linalg.LinAlgError as error:
                raise self._lost() from error
        if not np.all(np.diagonal(covariances, axis1=1, axis2=2) > 0):
            raise self._lost()
        return _Path(means=means, covariances=covariances, innovation_mean_square=total / max(count, 1))

    def _lost(self) -> FloatingPointError:
        return FloatingPointError(
            f"the covariance of {len(self.centres)} blocks is not positive definite in double precision; take a "
            "larger slip_change_per_rev, a wider bandwidth or longer blocks (output_every)."
        )


def _chain(x: Floats, phase: Floats, line: _Line, *, width: Floats, noise_variance: float, block: int | None) -> _Chain:
    """Cut the record into blocks; `width` is the bandwidth in cycles a sample, one number or one a sample."""
    per_rev = x.size * 2 * pi / abs(float(phase[-1] - phase[0]))
    if block is None:
        block = max(1, int(min(_BLOCK / float(width.max()), _SLIP_BLOCK * line.steady_rev * per_rev)))
        block -= (block + 1) % 2 if block > 1 else 0  # an odd number of samples has a middle one
    edges = np.append(np.arange(0, max(1, x.size - block // 2), block), x.size)
    centres = (edges[:-1] + edges[1:] - 1) // 2
    steps = np.diff(phase[centres])
    walk = process_variance(orders=[line.order], bandwidth=width, rate=1.0, poles=1, noise_variance=1.0)
    walks = np.diff(np.cumsum(walk)[centres]) if walk.size > 1 else walk[0] * np.diff(centres)
    # Where the bandwidth is nothing, or the shaft rests, the variance is; but it has to be divided by.
    walks = np.maximum(walks, 1e-12 * walk.max())
    walks[_breaks(x, phase, edges, line)] = PRIOR_STD**2
    prior_std = np.full(2 * line.harmonics + 1, PRIOR_STD)
    prior_std[-1] = line.largest_slip
    return _Chain(
        x=x,
        phase=phase,
        order=line.order,
        scale=float(1 / np.sqrt(noise_variance)),
        edges=edges,
        centres=centres,
        turns=line.order * steps,
        walks=walks,
        slip_walks=line.slip_change**2 * np.maximum(np.abs(steps) / (2 * pi), 1e-9),
        prior_mean=np.zeros(prior_std.size),
        prior_std=prior_std,
    )


def _breaks(x: Floats, phase: Floats, edges: Whole, line: _Line) -> Whole:
    """Transitions amid gaps so long that the phase cannot be carried across.

    How many turns the line made there is unknown, so its phase afterwards must not pin down its slip within.
    """
    observed = np.add.reduceat(~np.isnan(x), edges[:-1]) > 0
    seen = np.flatnonzero(observed)
    gaps = np.diff(seen)
    before, after = seen[:-1][gaps > 1], seen[1:][gaps > 1]
    turned = np.abs(phase[edges[after]] - phase[edges[before + 1] - 1]) / (2 * pi)
    long = turned > line.steady_rev
    return np.asarray((before[long] + after[long]) // 2, dtype=np.int64)


# --- from the start to the result -----------------------------------------------------------------------------


def _extended_filter(chain: _Chain, ridge: _Ridge, *, smooth: bool = False) -> _Path:
    mean, std = chain.prior_mean.copy(), chain.prior_std.copy()
    mean[-1] = ridge.slip[0]
    std[-1] = min(std[-1], ridge.slip_width / 2)
    return chain.run(np.empty((chain.centres.size, chain.size)), prior=(mean, std), smooth=smooth)


def _starts(chain: _Chain, ridge: _Ridge) -> list[Floats]:
    """Trajectories to start from: the amplitudes that go best with the ridge's slips; the filter's, smoothed."""
    states = np.zeros((chain.centres.size, chain.size))
    forwards = np.sign(chain.phase[-1] - chain.phase[0])
    states[:, -1] = np.interp(forwards * chain.phase[chain.centres], forwards * ridge.angle_rad, ridge.slip)
    _, informations, scores = chain.condense(states)
    given = chain.run(states, condensed=(informations, scores)).means
    # At zero amplitude nothing depends on the slip, which the sweep therefore returned to its prior.
    given[:, -1] = states[:, -1]
    return [given, _extended_filter(chain, ridge, smooth=True).means]


def _iterate(chain: _Chain, states: Floats, *, limit: int) -> tuple[_Path, Status, Floats]:
    """Gauss-Newton steps from a start, each halved until the objective falls."""
    cost, *condensed = chain.condense(states)
    costs = [cost]
    for _ in range(limit):
        path = chain.run(states, condensed=(condensed[0].copy(), condensed[1].copy()))
        step = path.means - states
        size = float(np.max(np.abs(step) / np.sqrt(np.diagonal(path.covariances, axis1=1, axis2=2))))
        if size < _SETTLED:
            return path, "converged", np.array(costs)
        for halving in range(_HALVINGS):
            trial = states + step / 2**halving
            cost, *fresh = chain.condense(trial)
            if cost < costs[-1]:
                break
        else:
            return path, "converged" if size < _FLAT else "not converged", np.array(costs)
        states, condensed = trial, fresh
        costs.append(cost)
    path = chain.run(states, condensed=(condensed[0], condensed[1]))
    return path, "not converged", np.array(costs)


def _result(
    chain: _Chain,
    path: _Path,
    *,
    line: _Line,
    ridge: _Ridge,
    bandwidth: CheckedBandwidth,
    estimator: Estimator,
    status: Status,
    objective: Floats,
) -> SlippingTrack:
    harmonics = line.harmonics
    real, imaginary = path.means[:, :harmonics].T, path.means[:, harmonics:-1].T
    k = np.arange(harmonics)
    var_real = path.covariances[:, k, k].T
    var_imaginary = path.covariances[:, harmonics + k, harmonics + k].T
    both = path.covariances[:, k, harmonics + k].T
    size = np.hypot(real, imaginary)
    c, s = real / size, imaginary / size
    along = c * c * var_real + 2 * c * s * both + s * s * var_imaginary
    across = s * s * var_real - 2 * c * s * both + c * c * var_imaginary
    slip = path.means[:, -1].copy()
    slip_phase = np.concatenate([[0.0], np.cumsum(0.5 * (slip[:-1] + slip[1:]) * chain.turns)])
    slip_std = np.sqrt(path.covariances[:, -1, -1])
    if status == "no line":
        slip_std = np.maximum(slip_std, line.largest_slip / np.sqrt(3))
    unit = 1 / chain.scale
    return SlippingTrack(
        complex_amplitude=np.asarray(unit * (real + 1j * imaginary) * np.exp(-1j * np.outer(k + 1, slip_phase))),
        std=unit * np.sqrt((var_real + var_imaginary) / 2),
        amplitude_std=unit * np.sqrt(along),
        phase_std_rad=np.sqrt(across) / size,
        slip=slip,
        slip_std=slip_std,
        slip_phase_rad=slip_phase,
        sample_index=chain.centres,
        order=line.order,
        largest_slip=line.largest_slip,
        slip_change_per_rev=line.slip_change,
        bandwidth=float(bandwidth.given[0]),
        bandwidth_units=bandwidth.units,
        estimator=estimator,
        noise_variance=ridge.noise_variance,
        innovation_mean_square=path.innovation_mean_square,
        false_alarm_probability=ridge.false_alarm_probability,
        status=status,
        iterations=max(0, objective.size - 1),
        objective=objective,
    )

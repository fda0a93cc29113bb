"""Track an order that slips: amplitude, phase and slip, each with its standard deviation.

The rollers of a bearing slide, so its orders differ from their nominal values by a per cent or so, and vary. A
tracker at the nominal order needs a bandwidth so wide that it passes much noise; here the slip s, relative to the
order, is part of the state. Within a block of samples whose middle is c, and from one middle to the next,

    y[n] = b + sum_k Re{ A_k exp(j k order (phase[n] + s (phase[n] - phase_c))) } + v[n],     var v = R,
    s -> s' = s + e,     A_k -> exp(j k order (s + s') / 2 (step of the phase)) A_k + w.

Each quadrature of A is the random walk of `model`, and so is the mean b: with a known slip this is the plain smoother
with one pole and the same `bandwidth`. The slip is a random walk over shaft angle.

The filter is the extended Kalman filter (Jazwinski 1970, ch. 8). It starts from the first slip of the path of slips
with most power, see `slip_detection`. The smoother minimises the exact sum of squares, samples over R, changes over
their variances, by Gauss-Newton steps: each is a Kalman filter and a Rauch-Tung-Striebel smoother of the model
linearised at the trajectory so far (Bell 1994 [1]_), halved until the sum falls (Sarkka and Svensson 2020 [2]_). Of the
minima found from that path and from the filter, which follows faster slips, it returns the lower one.
Both run on the chain of `signals.harmonics.node_chain`: relative to the phase of the line that slips along the
trajectory, all but the effect of the slip is a random walk. The uncertainty is that of the linearised model at the
minimum, and holds while the phase is known to a fraction of a turn.

The amplitude is independent on both sides of a gap in which the random walk of the slip would turn the line by more
than a radian: the number of turns there is unknown, and the phase after it must not determine the slip within.

References
----------
.. [1] B. M. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optim. 4(3), 1994.
.. [2] S. Sarkka, L. Svensson, "Levenberg-Marquardt and line-search extended Kalman smoothers", ICASSP 2020.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, get_args

import numpy as np

from signals._validation import checked, choice, positive, whole
from signals.harmonics._arguments import SMALLEST, check_below_half_rate, check_channel, check_model
from signals.harmonics.state_space import Estimator
from signals.slipping_order.block_chain import Status, along, chain_of, extended_filter, smooth
from signals.slipping_order.slip_detection import SlipRecord, search

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from signals.harmonics.state_space import Complexes, Floats, Indices

MOST_HARMONICS = 16
# Largest false-alarm probability of a detected line.
_FALSE_ALARM = 0.01
# Probability of changes of a slip at which it is called faster than declared.
_TOO_FAST = 1e-3
# Standard deviation of an unknown phase, uniform over a turn.
_UNKNOWN_PHASE = np.pi / np.sqrt(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class SlippingTrack:
    """Complex amplitudes of a slipping order's harmonics and its slip, with their standard deviations.

    The waveform of harmonic k is `Re{ Z exp(j k (order phase + slip_phase)) }`. Amplitude `abs(Z)` and phase have
    separate standard deviations, since an uncertain slip makes the phase uncertain and not the amplitude.

    Attributes
    ----------
    complex_amplitude : (harmonic, output) array
        Z relative to the slipped phase.
    std : (harmonic, output) array
        `sqrt(E|Zhat - Z|^2 / 2)` given the slipped phase.
    amplitude_std : (harmonic, output) array
        Standard deviation of `abs(Z)`; equal to `std` where Z is 0 and its phase undefined; without a detected line,
        at least `abs(Z)`, since the path with most noise was chosen.
    phase_std_rad : (harmonic, output) array
        Standard deviation in rad of the total phase of the harmonic; above about 1 the phase is unknown. At most
        pi / sqrt(3), that of a uniform phase, which is given where Z is 0 or no line is detected.
    slip : (output,) array
        Relative deviation: the line is at `order (1 + slip)`.
    slip_std : (output,) array
        Standard deviation of the slip; without a detected line, at least that of a uniform slip in +- largest_slip.
    slip_phase_rad : (output,) array
        Phase of the fundamental less `order phase`, in rad, zero at the first output.
    sample_index : (output,) array
        Sample number of each output: the middle of its block.
    noise_variance
        R, as given or as estimated on both sides of the line.
    false_alarm_probability
        Bound on the probability that white Gaussian noise has a path of slips with as much power over R; a neighbouring
        line is no false alarm in this sense.
    status
        "converged"; "slip at its bound": converged, but the slip exceeds largest_slip, the limit of the search, by more
        than its std: increase largest_slip; "slip faster than declared": the slip changes by more than it would in one
        of 1000 records with this slip_change_per_rev, so slip_std is too small: increase slip_change_per_rev; "not
        converged": the last step was not yet negligible; "single pass": the filter does not iterate; "no line": the
        false-alarm probability is above 0.01, and the estimates are those of noise.
    objective : (step,) array
        Half the sum of squares at the start and after every Gauss-Newton step; it never rises. In the end it is near
        half the number of samples if R, bandwidth and slip_change_per_rev suit the record.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.harmonics import track_slipping_order
    >>> angle = np.arange(5000) / 5
    >>> setting = dict(order=0.9, largest_slip=0.02, slip_change_per_rev=1e-3, bandwidth_orders=0.1, samples_per_rev=31)
    >>> print(track_slipping_order(np.random.default_rng(1).standard_normal(5000), phase_rad=angle, **setting).status)
    no line
    """

    complex_amplitude: Complexes = field(metadata={"dims": ("harmonic", "output"), "units": "signal"})
    std: Floats = field(metadata={"dims": ("harmonic", "output"), "units": "signal"})
    amplitude_std: Floats = field(metadata={"dims": ("harmonic", "output"), "units": "signal"})
    phase_std_rad: Floats = field(metadata={"dims": ("harmonic", "output"), "units": "rad"})
    slip: Floats = field(metadata={"dims": ("output",), "units": "1"})
    slip_std: Floats = field(metadata={"dims": ("output",), "units": "1"})
    slip_phase_rad: Floats = field(metadata={"dims": ("output",), "units": "rad"})
    sample_index: Indices = field(metadata={"dims": ("output",), "units": "1"})
    noise_variance: float
    false_alarm_probability: float
    status: Status
    objective: Floats = field(metadata={"dims": ("step",), "units": "1"})

    @property
    def converged(self) -> bool:
        """Whether a line is detected, with a slip within largest_slip, and the smoother's iteration has converged."""
        return self.status == "converged"


@checked
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
    """Estimate the complex amplitudes and the slip of an order that varies about its nominal value.

    The mean of the record is tracked as an order of its own. Other orders are noise to this estimator: subtract strong
    ones near the line from `x` first.

    Parameters
    ----------
    x : (sample,) array
        The record in any unit; NaN marks a missing sample.
    phase_rad : (sample,) array
        Shaft angle in rad.
    order
        Nominal order of the line in cycles per revolution.
    largest_slip
        Half-width of the search, `order (1 +- largest_slip)`; 0.02 suits most rolling bearings. Also the prior standard
        deviation of the first slip about zero; later slips are not bounded.
    slip_change_per_rev
        Standard deviation of the change of the slip in one revolution, sqrt(m) times that in m revolutions; with 0.001,
        a slip of 1 % may change by another per cent in a hundred revolutions.
    bandwidth_hz, bandwidth_orders, rate_hz, samples_per_rev
        Full -3 dB width of the smoother of the amplitude, one number, or a (1, sample) array where it varies, with the
        units and rates of `track_orders`.
    harmonics
        Number of harmonics, from the fundamental on, which share one slip and one noise variance.
    estimator
        "smoother" uses all samples for each output; "filter" uses the blocks up to it, except for the first slip, which
        is found by the search in the first segment. The filter corrects the phase along the tangent, so its amplitudes
        are too large by about half of `amplitude_std`.
    output_every
        Samples from one output to the next. Default: the longest block in which amplitude and slip can be held
        constant, a 200th of 1 / bandwidth or less. Fewer outputs do not change these blocks.
    noise_variance
        Variance R of white noise with the density found around the line; estimated on both sides of it by default,
        which requires about a hundred samples.
    most_iterations
        Largest number of Gauss-Newton steps.

    Returns
    -------
    SlippingTrack

    Raises
    ------
    ValueError
        An argument is out of range or contradicts another; the message names it and the remedy.
    FloatingPointError
        A covariance is no longer positive definite in double precision.

    Examples
    --------
    A line 1 % above its nominal order 3.6:

    >>> import numpy as np
    >>> from signals.harmonics import track_slipping_order
    >>> phase_rad = 2 * np.pi * 25 * np.arange(5000) / 5000
    >>> x = 2 * np.cos(3.6 * 1.01 * phase_rad) + 0.1 * np.random.default_rng(1).standard_normal(5000)
    >>> setting = dict(order=3.6, largest_slip=0.02, slip_change_per_rev=1e-3, bandwidth_orders=0.1, rate_hz=5000)
    >>> track = track_slipping_order(x, phase_rad=phase_rad, **setting)
    >>> print(track.slip.mean().round(3), np.abs(track.complex_amplitude).mean().round(1))
    0.01 2.0
    """
    from scipy.special import chdtrc  # noqa: PLC0415 - slow to import

    choice(estimator, name="estimator", choices=get_args(Estimator))
    limit = whole(most_iterations, name="most_iterations", least=1)
    every = None if output_every is None else whole(output_every, name="output_every", least=1)
    number = np.arange(1, whole(harmonics, name="harmonics", least=1, most=MOST_HARMONICS) + 1)
    for name, value in (("largest_slip", largest_slip), ("slip_change_per_rev", slip_change_per_rev)):
        if not positive(value, name=name) < 1:
            raise ValueError(f"{name}={value:g} is relative to the order and must be below 1; 2 % is 0.02.")
    samples = check_channel(x, smallest=SMALLEST)
    model, *_, given = check_model(
        orders=(positive(order, name="order") * number).tolist(), phase_rad=phase_rad, samples=samples.size, poles=1,
        noise_variance=noise_variance, initial_std=None, bandwidth_hz=bandwidth_hz, bandwidth_orders=bandwidth_orders,
        rate_hz=rate_hz, samples_per_rev=samples_per_rev,
    )  # fmt: skip
    record = SlipRecord(x=samples, model=model, largest_slip=largest_slip, slip_change=slip_change_per_rev, every=every)
    top, turned = model.orders[-1], record.turning[-1]
    if top * turned < 2 * np.pi:
        raise ValueError(
            f"phase_rad turns by {turned:g} rad in all, order {top:g} by {top * turned / (2 * np.pi):g} turns: "
            "the shaft has turned too little to tell a slip; take a longer record, or give the angle in rad."
        )
    check_below_half_rate(f"order {top:g} with a slip of {largest_slip:g}", top * (1 + largest_slip), model.phases[0])

    ridge, slip_width, noise, chance = search(record, noise_variance=given)
    chain, (_, centres, outputs) = chain_of(record, noise_variance=noise), record.blocks
    status: Status = "single pass"
    objective = np.empty(0)
    try:
        path = extended_filter(chain, slip=ridge[0], slip_std=min(largest_slip, slip_width / 2))
        if estimator == "smoother":
            ends = [smooth(chain, start, limit=limit) for start in (path, along(chain, ridge))]
            path, status, objective = min(ends, key=lambda end: end[2][-1])
    except np.linalg.LinAlgError as error:
        raise FloatingPointError(
            f"the covariance of {centres.size} blocks is not positive definite in double precision, with x of up to "
            f"{np.nanmax(np.abs(chain.x)):.2g} times the noise; take a larger slip_change_per_rev, a wider bandwidth "
            "or, where that is more than the record is good for, a larger noise_variance."
        ) from error

    states, covariances, slip_phase = path.states[outputs], path.gains[outputs], path.slip_phase[outputs]
    amplitude, std, amplitude_std, phase_std = _polar(states, covariances)
    start = np.exp(1j * slip_phase[0] * number[:, None])
    slip, slip_std = states[:, -1], np.sqrt(covariances[:, -1, -1])
    if status == "converged" and np.any(np.abs(slip) - slip_std >= largest_slip):
        status = "slip at its bound"
    # Changes of the estimate have at most the variance of those of the slip itself.
    turning = record.turning[centres]
    at = np.searchsorted(turning, np.arange(0, turning[-1], 2 * np.pi * record.steady_rev))
    changes = np.diff(path.states[at, -1]) ** 2 / np.diff(np.append(0.0, np.cumsum(chain.process[:, -1]))[at])
    if estimator == "smoother" and chdtrc(max(changes.size, 1), changes.sum()) < _TOO_FAST:
        status = "slip faster than declared"
    if chance > _FALSE_ALARM:
        status = "no line"
        slip_std = np.maximum(slip_std, largest_slip / np.sqrt(3))
        amplitude_std = np.maximum(amplitude_std, np.abs(amplitude))  # of the path with most noise
        phase_std[:] = _UNKNOWN_PHASE
    unit = np.sqrt(noise)
    return SlippingTrack(
        complex_amplitude=unit * amplitude * start, std=unit * std, amplitude_std=unit * amplitude_std,
        phase_std_rad=phase_std, slip=slip, slip_std=slip_std, slip_phase_rad=slip_phase - slip_phase[0],
        sample_index=centres[outputs], noise_variance=noise,
        status=status, objective=objective,
        false_alarm_probability=chance,
    )  # fmt: skip


def _polar(states: Floats, covariances: Floats) -> tuple[Complexes, Floats, Floats, Floats]:
    """Return amplitudes, `std` of their parts, std of their absolute values, and std of their phases in rad."""
    harmonics = states.shape[1] // 2 - 1
    k = np.arange(harmonics)
    amplitude = (states[:, :harmonics] + 1j * states[:, harmonics:-2]).T
    real, imaginary = covariances[:, k, k].T, covariances[:, harmonics + k, harmonics + k].T
    variance, size = (real + imaginary) / 2, np.abs(amplitude)
    # The covariance of the parts along and across the amplitude, which are independent of direction where it is zero.
    direction = np.divide(amplitude, size, out=np.zeros_like(amplitude), where=size > 0)
    excess = (((real - imaginary) / 2 + 1j * covariances[:, k, harmonics + k].T) * direction.conj() ** 2).real
    # A difference of parts can be as small as their rounding, but not smaller.
    along, across = (
        np.sqrt(np.maximum(part, np.finfo(np.float64).eps * variance))
        for part in (variance + excess, variance - excess)
    )
    phase_std = np.full_like(size, _UNKNOWN_PHASE)
    np.divide(across, size, out=phase_std, where=across < _UNKNOWN_PHASE * size)
    return amplitude, np.sqrt(variance), along, phase_std

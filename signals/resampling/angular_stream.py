"""Angular resampling of a record that arrives in blocks, in constant memory.

The record is processed in chunks counted from its first sample, so that the block sizes do not change the result.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from signals._validation import Array, Missing, choice, number, positive, samples, whole
from signals.resampling._engine import FEWEST, METHODS, Flags, Method, Warp
from signals.resampling.resampling import (
    AngularSignal,
    angle_map,
    forwards,
    passband_orders,
    unsettled,
    whole_revolutions,
)
from signals.shaft.phase import refuse_rest

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from signals.shaft.phase import ShaftPhase


class AngularStream:
    """Angular resampler of a record that arrives in blocks, with the result of `angular_resample` of the whole.

    Parameters
    ----------
    rate_hz, phase, samples_per_rev, start_s, method, missing
        As in `angular_resample`. The phase must be known in advance, for the whole record.

    Raises
    ------
    ValueError
        A phase without a whole revolution after `start_s`, with a standstill, or that reverses.

    Examples
    --------
    Resample a record of two seconds at 10 revolutions per second in blocks of 300 samples:

    >>> import numpy as np
    >>> from signals import AngularStream, constant_speed
    >>> phase = constant_speed(10.0, start_s=0.0, stop_s=2.0)
    >>> stream = AngularStream(rate_hz=1000, phase=phase, samples_per_rev=64)
    >>> parts = [stream.push(block) for block in np.split(np.ones(2100), 7)] + [stream.finish()]
    >>> sum(part.revolutions for part in parts)
    20
    """

    def __init__(
        self,
        *,
        rate_hz: float,
        phase: ShaftPhase,
        samples_per_rev: int,
        start_s: float = 0.0,
        method: Method = "sinc",
        missing: Missing = "refuse",
    ) -> None:
        choice(method, name="method", choices=METHODS)
        self._rate = positive(rate_hz, name="rate_hz")
        self._per_rev = whole(samples_per_rev, name="samples_per_rev", least=2)
        self._start_s, self._missing, self._least = number(start_s, name="start_s"), missing, FEWEST[method]
        phase = forwards(phase)
        refuse_rest(phase.times_s, phase.revolutions, start_s=start_s, stop_s=phase.stop_s, rate_hz=self._rate)
        self._first, count = whole_revolutions(phase, start_s=start_s, stop_s=phase.stop_s)
        grid = angle_map(
            phase,
            rate_hz=self._rate,
            start_s=start_s,
            samples_per_rev=self._per_rev,
            first=self._first,
            revolutions=count,
        )
        self._phase = phase
        self._passband = passband_orders(grid, self._per_rev)
        self._warp = Warp(grid, method=method)
        self._finished = False
        self._seen = 0  # samples
        self._values, self._beyond = np.empty(0), np.empty(0, dtype=bool)  # of the revolution that is not complete
        self._released = 0  # number of values returned so far

    def push(self, x: ArrayLike) -> AngularSignal:
        """Process the next block, (n,) of any length; return the whole revolutions it completes, if any.

        Raises
        ------
        ValueError
            Values that are not finite, with their index in the record; a stream that is already finished.
        """
        self._refuse_finished()
        block = samples(
            x,
            missing=self._missing,
            rate_hz=self._rate,
            start_s=self._start_s,
            first=self._warp.samples_seen,
        )
        self._seen += block.size
        return self._whole_revolutions(*self._warp.push(block[None]))

    def finish(self) -> AngularSignal:
        """End the record; return its remaining whole revolutions, if any.

        Raises
        ------
        ValueError
            Fewer samples than the method needs; a stream that is already finished.
        """
        self._refuse_finished()
        if self._warp.samples_seen < self._least:
            raise ValueError(
                f"the stream was finished after {self._warp.samples_seen} samples; at least {self._least} are needed: "
                "push more before finish()."
            )
        self._finished = True
        return self._whole_revolutions(*self._warp.finish())

    def _refuse_finished(self) -> None:
        if self._finished:
            raise ValueError("the stream is finished; make another AngularStream for the next record.")

    def _covered(self) -> int:
        """Return the number of values in whole revolutions between the first and the latest sample."""
        stop_s = self._start_s + (self._seen - 1) / self._rate
        try:
            return whole_revolutions(self._phase, start_s=self._start_s, stop_s=stop_s)[1] * self._per_rev
        except ValueError:  # not one yet
            return 0

    def _whole_revolutions(self, values: Array, beyond: Flags) -> AngularSignal:
        """Return the whole revolutions completed by these values, (1, n), and keep the remainder."""
        values, beyond = np.concatenate([self._values, values[0]]), np.concatenate([self._beyond, beyond])
        size = min(values.size // self._per_rev * self._per_rev, self._covered() - self._released)
        self._values, self._beyond = values[size:].copy(), beyond[size:].copy()
        start = self._first + self._released // self._per_rev
        self._released += size
        return AngularSignal(
            values=values[:size],
            samples_per_rev=self._per_rev,
            start_rev=start,
            passband_orders=self._passband,
            unsettled=unsettled(beyond[:size]),
        )

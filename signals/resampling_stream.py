"""Angular resampling of a record that comes in blocks, in memory that does not grow with it.

The record is worked on in chunks counted from its first sample, so how it is split into blocks changes nothing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from signals._checks import Array, choice, positive, whole
from signals._gaps import Missing, samples
from signals._turning import refuse_rest
from signals._warp import FEWEST, METHODS, Flags, Method, Warp
from signals.resampling import (
    AngularSignal,
    angle_map,
    forwards,
    passband_orders,
    unsettled,
    whole_revolutions,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import ArrayLike

    from signals.phase import ShaftPhase


class AngularStream:
    """`angular_resample` of a record that is pushed block by block.

    Parameters
    ----------
    rate_hz, phase, samples_per_rev, start_s, method, missing
        As in `angular_resample`. The phase is known beforehand, for the whole record.

    Examples
    --------
    Average a long record over its revolutions:

    >>> stream = AngularStream(rate_hz=51_200, phase=phase, samples_per_rev=256)    # doctest: +SKIP
    >>> for block in blocks:                                                        # doctest: +SKIP
    ...     turns = stream.push(block)
    ...     total += turns.values.reshape(-1, 256).sum(axis=0)
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
        self._start_s, self._missing, self._least = start_s, missing, FEWEST[method]
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
        self._passband = passband_orders(grid, self._per_rev)
        self._warp = Warp(grid, method=method)
        self._finished = False
        self._values, self._beyond = np.empty(0), np.empty(0, dtype=bool)  # of the revolution that is not complete
        self._given = 0

    def push(self, x: ArrayLike) -> AngularSignal:
        """Take the next block, (n,) of any length; return the whole revolutions it completes, perhaps none.

        Raises
        ------
        ValueError
            Values that are not finite, with their place in the record; a stream that was finished.
        """
        self._refuse_finished()
        block = samples(
            x,
            missing=self._missing,
            rate_hz=self._rate,
            start_s=self._start_s,
            first=self._warp.samples_seen,
        )
        return self._whole(*self._warp.push(block))

    def finish(self) -> AngularSignal:
        """Return the whole revolutions that are left at the end of the record, perhaps none.

        Raises
        ------
        ValueError
            Fewer samples than the method needs; a stream that was finished.
        """
        self._refuse_finished()
        if self._warp.samples_seen < self._least:
            raise ValueError(
                f"the stream was finished after {self._warp.samples_seen} samples; at least {self._least} are needed."
            )
        self._finished = True
        return self._whole(*self._warp.finish())

    def _refuse_finished(self) -> None:
        if self._finished:
            raise ValueError("the stream was finished; make another for the next record.")

    def _whole(self, values: Array, beyond: Flags) -> AngularSignal:
        values, beyond = np.concatenate([self._values, values]), np.concatenate([self._beyond, beyond])
        size = values.size // self._per_rev * self._per_rev
        self._values, self._beyond = values[size:].copy(), beyond[size:].copy()
        start = self._first + self._given // self._per_rev
        self._given += size
        return AngularSignal(
            values=values[:size],
            samples_per_rev=self._per_rev,
            start_rev=start,
            passband_orders=self._passband,
            unsettled=unsettled(beyond[:size]),
        )


def angular_blocks(
    blocks: Iterable[ArrayLike],
    *,
    rate_hz: float,
    phase: ShaftPhase,
    samples_per_rev: int,
    start_s: float = 0.0,
    method: Method = "sinc",
    missing: Missing = "refuse",
    block_size: int | None = None,
) -> Iterator[AngularSignal]:
    """Resample a record that comes in blocks; yield it in blocks of whole revolutions, or of `block_size` values.

    Parameters
    ----------
    blocks : iterable of (n,) arrays, of any lengths
    rate_hz, phase, samples_per_rev, start_s, method, missing
        As in `angular_resample`.
    block_size : int, optional
        How many values each block is to have, the last perhaps fewer; its ``start_rev`` then falls between
        revolutions. Default: as many whole revolutions as are complete. Together both are the same values.
    """
    stream = AngularStream(
        rate_hz=rate_hz,
        phase=phase,
        samples_per_rev=samples_per_rev,
        start_s=start_s,
        method=method,
        missing=missing,
    )
    signals = _finished(stream, blocks)
    if block_size is None:
        yield from signals
    else:
        yield from _regrouped(signals, whole(block_size, name="block_size", least=1))


def _finished(stream: AngularStream, blocks: Iterable[ArrayLike]) -> Iterator[AngularSignal]:
    for block in blocks:
        signal = stream.push(block)
        if signal.values.size:
            yield signal
    signal = stream.finish()
    if signal.values.size:
        yield signal


def _regrouped(signals: Iterable[AngularSignal], size: int) -> Iterator[AngularSignal]:
    values, beyond = np.empty(0), np.empty(0, dtype=bool)
    like: AngularSignal | None = None
    for signal in signals:
        if like is None:
            like = replace(signal, values=values)
        flags = np.zeros(signal.values.size, dtype=bool)
        flags[: signal.unsettled[0]] = flags[flags.size - signal.unsettled[1] :] = True
        values, beyond = np.concatenate([values, signal.values]), np.concatenate([beyond, flags])
        while values.size >= size:
            like = _block(like, values[:size], beyond[:size])
            yield like
            values, beyond = values[size:], beyond[size:]
    if like is not None and values.size:
        yield _block(like, values, beyond)


def _block(before: AngularSignal, values: Array, beyond: Flags) -> AngularSignal:
    """Return the values that follow another block."""
    start = before.start_rev + before.values.size / before.samples_per_rev
    return replace(before, values=values, start_rev=start, unsettled=unsettled(beyond))

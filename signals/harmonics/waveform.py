"""Waveforms of tracked orders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from signals._validation import checked, whole
from signals.harmonics import _block_kernels
from signals.harmonics._arguments import check_orders
from signals.harmonics.block_grid import pieces_between

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from signals.harmonics.state_space import Floats
    from signals.harmonics.tracking_results import OrderTracks


@checked
def order_waveform(
    tracks: OrderTracks, *, phase_rad: ArrayLike | Mapping[str, ArrayLike], places: Sequence[int] | None = None
) -> Floats:
    """Return the waveform `sum_k Re{ Z_k exp(j order_k phase) }` of some of the tracked orders.

    Parameters
    ----------
    tracks
        Result of `track_orders`; amplitudes between its outputs are interpolated, cubic, or linear for one pole.
    phase_rad
        Shaft angle in rad, as it was given there.
    places
        Indices into `tracks.orders`; all orders by default.

    Returns
    -------
    (sample,) array, or (channel, sample) for tracks of several channels, in the unit of the record.

    Raises
    ------
    ValueError
        An index or a phase does not belong to these tracks.

    Examples
    --------
    >>> import numpy as np
    >>> from signals.harmonics import order_waveform, track_orders
    >>> phase_rad = 2 * np.pi * 25 * np.arange(5000) / 5000
    >>> x = 1 + 2 * np.cos(3 * phase_rad)  # a mean of 1 and a tone at order 3
    >>> tracks = track_orders(x, phase_rad=phase_rad, orders=[0, 3], bandwidth_hz=2, rate_hz=5000)
    >>> wave = order_waveform(tracks, phase_rad=phase_rad, places=[1])
    >>> print(round(np.std(wave), 3), (x - wave)[[0, 2500]].round(3))  # sqrt(2), and the mean
    1.414 [1. 1.]
    """
    if tracks.first_output > 0 or tracks.sample_index.size == 0:
        raise ValueError(
            f"tracks have {tracks.sample_index.size} outputs from sample {tracks.first_output} on: a later block of "
            "a stream. Waveforms are made from tracks that begin with the record; take those of track_orders."
        )
    named = range(tracks.orders.size) if places is None else places
    chosen = np.array([whole(place, name="places", least=0) for place in named], dtype=np.int64)
    if chosen.max(initial=0) >= tracks.orders.size:
        raise ValueError(
            f"places={chosen.tolist()} must lie between 0 and {tracks.orders.size - 1}; they count the tracked orders."
        )
    own = list(zip(tracks.shafts, tracks.orders.tolist(), strict=True)) if tracks.shafts else tracks.orders
    orders, _, shaft, phases = check_orders(own, phase_rad, samples=tracks.samples)
    amplitude = tracks.complex_amplitude
    amplitude = (amplitude if amplitude.ndim == 3 else amplitude[None])[:, chosen]  # noqa: PLR2004
    waves = np.zeros((len(amplitude), tracks.samples))
    if chosen.size:
        if amplitude.shape[-1] == 1:
            amplitude = np.repeat(amplitude, 2, axis=-1)
        pieces = pieces_between(amplitude, cubic=tracks.poles > 1)
        for pieces_of_channel, wave in zip(pieces, waves, strict=True):
            _block_kernels.remodulate(
                pieces_of_channel, tracks.output_every, np.stack(phases), orders[chosen], shaft[chosen], 0,
                np.empty((2, _block_kernels.PIECE)), wave,
            )  # fmt: skip
    return waves if tracks.complex_amplitude.ndim == 3 else waves[0]  # noqa: PLR2004

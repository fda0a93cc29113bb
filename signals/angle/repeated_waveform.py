"""Whether the waveform at one tooth of a gear repeats from turn to turn, for records of two or three turns.

Energies of so few turns repeat by chance: rotations of two turns of a hundred teeth against one another bring two
impacts together in one of a hundred cases. A damaged tooth repeats its waveform as well, to a cycle of the highest
order, and a turn holds thousands of such places. The signal about the tooth is correlated with the whole turns, turned
against one another by any angle (a permutation test over rotations, exact where turns are exchangeable under rotation;
cross-correlation is the matched filter of one turn for the other: Turin 1960, IRE Trans. Inf. Theory 6, 311-329).
Impacts at random do not repeat as precisely, nor do those of a shaft or race whose turns do not fit in the gear's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from signals._validation import positive

if TYPE_CHECKING:
    from fractions import Fraction

    from numpy.typing import NDArray

    from signals.resampling.resampling import AngularSignal

_REACH = 2  # samples by which a repetition may be off: a cycle of the highest order, to which shafts' angles are known


def repeated_waveform(
    signal: AngularSignal,
    *,
    order: Fraction | float,
    teeth: float,
    position_rev: float,
    keep: NDArray[np.bool_] | None = None,
) -> float:
    """Return the probability that turns rotated at random repeat the waveform at one tooth as well.

    Parameters
    ----------
    signal : AngularSignal
        Residual over the angle of the reference, its bands of equal power (`whitened_residual`).
    order : Fraction or float
        Turns of the gear per revolution of the reference.
    teeth : float
        Teeth that pass in a turn.
    position_rev : float
        Place of the tooth, in turns from the reference's angle zero.
    keep : (k,) bool array, optional
        Parts of the record to use, equally long; default all.

    Returns
    -------
    float
        At least one over the number of places in a turn that can be told apart.

    Raises
    ------
    ValueError
        Fewer whole turns than two.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import AngularSignal
    >>> from signals.angle.repeated_waveform import repeated_waveform
    >>> rng = np.random.default_rng(0)
    >>> x = rng.normal(size=2 * 8192)
    >>> at_tooth = 8 * rng.normal(size=50)
    >>> x[3000:3050] += at_tooth
    >>> x[8192 + 3000 : 8192 + 3050] += at_tooth
    >>> signal = AngularSignal(values=x, samples_per_rev=8192, start_rev=0.0, passband_orders=4000.0)
    >>> repeated_waveform(signal, order=1, teeth=80, position_rev=3025 / 8192) < 0.001
    True
    """
    rate, pitch = positive(order, name="order"), positive(teeth, name="teeth")
    begin, per_turn = rate * signal.start_rev, signal.samples_per_rev / rate
    first = math.ceil(begin - 1e-9)
    turns = math.floor(begin + signal.values.size / per_turn + 1e-9) - first
    if turns < 2:  # noqa: PLR2004
        raise ValueError(f"{max(turns, 0)} turns cannot repeat; record two or more.")
    start = max(0, round((first - begin) * per_turn))
    values = signal.values[start : start + round(turns * per_turn)]
    if keep is not None:
        values = values * keep[(start + np.arange(values.size)) * keep.size // signal.values.size]
    place = np.arange(values.size) / per_turn
    # a tooth on either side of the place: its own contact, and the ringing after it
    at_tooth = np.abs((place - position_rev + 0.5) % 1.0 - 0.5) < 1 / pitch
    spectra = np.conj(fft.rfft(values * at_tooth)) * fft.rfft(values)
    correlation = fft.irfft(spectra, values.size)  # of whole turns, circular: each rotation has as many samples
    step = 2 * _REACH + 1
    either = int(per_turn / 2) // step  # rotations by up to half a turn, either way, that count as different
    lags = round(per_turn) + np.arange(-_REACH - either * step, _REACH + either * step + 1)
    highest = correlation[lags % values.size].reshape(-1, step).max(axis=1)
    # the rotation by whole turns is one of all
    return float(np.count_nonzero(highest >= highest[either]) / highest.size)

"""Values of a record that are not finite: refused with their index, or replaced by NaN."""

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from signals._checks import Samples, choice, real_samples

Missing = Literal["refuse", "mark"]


def samples(
    x: ArrayLike, *, missing: Missing, minimum: int = 0, rate_hz: float = 1.0, start_s: float = 0.0, first: int = 0
) -> Samples:
    """Return a block of a record from index `first` on; raise at values that are not finite, or make them NaN."""
    choice(missing, name="missing", choices=get_args(Missing))
    vector = real_samples(x, name="the signal", minimum=minimum, finite=False)
    bad = np.flatnonzero(~np.isfinite(vector))
    if bad.size and missing == "refuse":
        index = first + int(bad[0])
        raise ValueError(
            f"the signal has {bad.size} values that are not finite, the first at index {index} "
            f"({start_s + index / rate_hz:.6g} s); repair or leave out that part of the record, or say "
            'missing="mark" to have NaN where the filter reaches them.'
        )
    if bad.size:
        vector = vector.copy()
        vector[bad] = np.nan
    return vector

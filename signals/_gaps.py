"""Values of a record that are not finite: refused with their place, or marked."""

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from signals._checks import Samples, choice, real_samples

Missing = Literal["refuse", "mark"]


def samples(
    x: ArrayLike, *, missing: Missing, minimum: int = 0, rate_hz: float = 1.0, start_s: float = 0.0, first: int = 0
) -> Samples:
    """Return a block of a record, from sample `first` on; or say where it is not finite."""
    choice(missing, name="missing", choices=get_args(Missing))
    vector = real_samples(x, name="the signal", minimum=minimum, finite=False)
    bad = np.flatnonzero(~np.isfinite(vector))
    if bad.size and missing == "refuse":
        place = first + int(bad[0])
        raise ValueError(
            f"the signal has {bad.size} values that are not finite, the first at index {place} "
            f"({start_s + place / rate_hz:.6g} s); repair or leave out that part of the record, or say "
            'missing="mark" to have NaN where the filter reaches them.'
        )
    if bad.size:
        vector = vector.copy()
        vector[bad] = np.nan
    return vector

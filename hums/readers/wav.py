"""WAV files: rate in the header, no units."""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hums.records.record import RecordError

__all__ = ["read"]


def read(path: Path) -> tuple[int, dict[str, NDArray[np.generic]]]:
    """Return the rate in Hz and the channels, (n,) each, as "channel 1", "channel 2", ...

    Integers become float64 with full scale at 1; floats are not changed.
    """
    from scipy.io import wavfile  # noqa: PLC0415

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks without sound
            warnings.filterwarnings("error", "Reached EOF prematurely", wavfile.WavFileWarning)
            rate_hz, samples = wavfile.read(path)
    except Exception as error:  # a parser may fail in any way on damaged bytes
        raise RecordError(f"{path} is no whole WAV file ({error}). Copy it again from where it came.") from error
    columns = _full_scale(np.atleast_2d(samples.T))
    return int(rate_hz), {f"channel {number}": column for number, column in enumerate(columns, start=1)}


def _full_scale(samples: NDArray[np.generic]) -> NDArray[np.generic]:
    """Scale integers to +-1. Bytes are unsigned about 128; scipy returns 24 bits in the upper bits of 32."""
    kind, bits = samples.dtype.kind, 8 * samples.dtype.itemsize
    if kind not in "iu":
        return samples
    middle = 2 ** (bits - 1) if kind == "u" else 0
    return np.divide(samples.astype(np.float64) - middle, 2.0 ** (bits - 1))

"""WAV files, which state a rate but no units."""

import struct
import warnings
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hums.readers.columns import Field, ForeignFile, Stated
from hums.readers.description import ImportDescription


def read(path: Path, _: ImportDescription) -> ForeignFile:
    """Return the channels, (n,) each, as "channel 1", "channel 2", ..., and the rate of the file.

    Integers become float64 with full scale at 1; floats are unchanged. If the recorder was stopped before it wrote the
    sizes into the header, which are then 0 or 0xFFFFFFFF, the samples reach the end of the file, and a note says so.
    """
    from scipy.io import wavfile  # noqa: PLC0415

    source = _with_sizes(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks without sound
        warnings.filterwarnings("error", "Reached EOF prematurely", wavfile.WavFileWarning)
        rate_hz, samples = wavfile.read(source)
    columns = _full_scale(np.atleast_2d(samples.T))
    fields: dict[str, Field] = {f"channel {number}": column for number, column in enumerate(columns, start=1)}
    notes = () if source is path else ("is read to the end of the file, since its header states no length",)
    return ForeignFile(path=path, fields=fields, stated={"": Stated(rate_hz=float(rate_hz), notes=notes)})


def _with_sizes(path: Path) -> Path | BytesIO:
    """Return a WAV file, or a copy in memory with the sizes in its header that its recorder did not write."""
    with path.open("rb") as stream:
        head = stream.read(65536)  # includes the first samples
    layout = head.find(b"fmt ", 12)
    place = head.find(b"data", layout + 24) + 8
    is_open = head[place - 4 : place] in {bytes(4), b"\xff" * 4}
    if not head.startswith(b"RIFF") or min(layout, place - 8) < 0 or not is_open:
        return path
    whole = bytearray(path.read_bytes())
    frame = max(1, int.from_bytes(whole[layout + 20 : layout + 22], "little"))
    count = (len(whole) - place) // frame * frame
    follows = whole[place : place + 4].isalnum() and int.from_bytes(whole[place + 4 : place + 8], "little") + place + 8
    if not count or (head[place - 4] == 0 and 0 < follows <= len(whole)):  # a chunk follows: there are no samples
        return path
    whole[4:8], whole[place - 4 : place] = struct.pack("<I", place + count - 8), struct.pack("<I", count)
    return BytesIO(whole[: place + count])


def _full_scale(samples: NDArray[np.generic]) -> NDArray[np.generic]:
    """Scale integers to +-1; bytes are unsigned about 128, and scipy returns 24 bits in the upper bits of 32."""
    kind, bits = samples.dtype.kind, 8 * samples.dtype.itemsize
    if kind not in "iu":
        return samples
    middle = 2 ** (bits - 1) if kind == "u" else 0
    return np.divide(samples.astype(np.float64) - middle, 2.0 ** (bits - 1))

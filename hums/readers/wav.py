"""WAV files: rate in the header, no units."""

import struct
import warnings
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from hums.readers.columns import Field, ForeignFile, Stated
from hums.readers.description import ImportDescription

__all__ = ["read"]


def read(path: Path, _: ImportDescription) -> ForeignFile:
    """Return the channels, (n,) each, as "channel 1", "channel 2", ..., and the rate of the file.

    Integers become float64 with full scale at 1; floats are not changed. Where a recorder was stopped before it wrote
    the sizes into the header, which are 0 or 0xFFFFFFFF then, the samples reach to the end of the file, and a note says
    so.
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
    """Return a WAV file, in memory with the sizes in its header written where its recorder left them open."""
    end = path.stat().st_size
    with path.open("rb") as stream:
        if stream.read(4) != b"RIFF":
            return path
        place, frame = 12, 1
        while place + 8 <= end:
            stream.seek(place)
            kind, size = struct.unpack("<4sI", stream.read(8))
            if kind == b"fmt ":
                frame = max(1, struct.unpack("<12xH", stream.read(14))[0])
            if kind == b"data":
                break
            place += 8 + size + size % 2
        else:
            return path
        count = (end - place - 8) // frame * frame
        if size not in {0, 0xFFFFFFFF} or not count or (size == 0 and _is_chunk(stream, end)):
            return path
        stream.seek(0)
        whole = bytearray(stream.read(place + 8 + count))
    whole[4:8], whole[place + 4 : place + 8] = struct.pack("<I", len(whole) - 8), struct.pack("<I", count)
    return BytesIO(whole)


def _is_chunk(stream: BinaryIO, end: int) -> bool:
    """Return whether a chunk follows, which ends within the file: the one before it is empty indeed."""
    head = stream.read(8)
    return len(head) == 8 and head[:4].isalnum() and stream.tell() + struct.unpack("<I", head[4:])[0] <= end  # noqa: PLR2004


def _full_scale(samples: NDArray[np.generic]) -> NDArray[np.generic]:
    """Scale integers to +-1. Bytes are unsigned about 128; scipy returns 24 bits in the upper bits of 32."""
    kind, bits = samples.dtype.kind, 8 * samples.dtype.itemsize
    if kind not in "iu":
        return samples
    middle = 2 ** (bits - 1) if kind == "u" else 0
    return np.divide(samples.astype(np.float64) - middle, 2.0 ** (bits - 1))

"""NumPy files: an array, or several by name; a table is columns by number."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hums.records.record import RecordError

__all__ = ["read"]

_TABLE = 2  # dimensions


def read(path: Path) -> dict[str, NDArray[np.generic] | str]:
    """Return the arrays of a .npz by name, or the columns of the array of a .npy as "column 1", "column 2", ...

    Objects are not unpickled: unpickling runs code that the file states.
    """
    try:
        found = np.load(path, allow_pickle=False)
        arrays = {"": found} if isinstance(found, np.ndarray) else {str(name): found[name] for name in found.files}
    except Exception as error:  # a parser may fail in any way on damaged bytes
        raise RecordError(
            f"{path} is no NumPy file of numbers, or damaged ({error}). Write it again with numpy.save."
        ) from error
    fields: dict[str, NDArray[np.generic] | str] = {}
    for name, array in arrays.items():
        if not name and array.ndim == _TABLE:
            fields |= {f"column {number}": column for number, column in enumerate(array.T, start=1)}
        else:
            plain = array.dtype.kind in "iuf" and array.size
            fields[name or "column 1"] = array if plain else "empty" if not array.size else f"of type {array.dtype}"
    return fields

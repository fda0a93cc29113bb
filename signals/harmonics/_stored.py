"""Numbers and arrays of an object under plain names, and back again."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Shape = tuple[int | None, ...]


def stored(prefix: str, holder: object, names: Sequence[str]) -> dict[str, Any]:
    """Return copies of some attributes under `prefix_name`."""
    return {f"{prefix}_{name}": np.copy(getattr(holder, name)) for name in names}


def restored(
    prefix: str,
    like: object,
    names: Sequence[str],
    state: Mapping[str, Any],
    *,
    free: Mapping[str, Shape] | None = None,
) -> dict[str, Any]:
    """Return what `stored` left in a state, each of the kind and shape that `like` has it.

    Parameters
    ----------
    prefix, names : as for `stored`.
    like : an object with these attributes.
    state : a mapping with what was stored.
    free : shapes of those whose lengths may differ, None where they may.
    """
    found = {}
    for name in names:
        example = np.asarray(getattr(like, name))
        value = array(state, f"{prefix}_{name}", (free or {}).get(name, example.shape)).astype(example.dtype)
        found[name] = value if value.ndim else value.item()
    return found


def array(state: Mapping[str, Any], key: str, shape: Shape) -> Any:  # noqa: ANN401
    """Return a copy of a stored array of numbers, or refuse one of another shape; None stands for any length."""
    if key not in state:
        raise ValueError(
            f"state lacks {key!r}: pass what OrderTracker.state() returned, or what numpy.load made of it."
        )
    value = np.array(state[key])
    fits = value.ndim == len(shape) and all(n in (None, m) for m, n in zip(value.shape, shape, strict=True))
    if not fits or value.dtype.kind not in "biuf":
        needed = str(tuple("any" if n is None else n for n in shape)).replace("'", "")
        raise ValueError(
            f"state[{key!r}] has shape {value.shape} and type {value.dtype}; needed numbers of shape {needed}: "
            "pass what OrderTracker.state() returned, unchanged."
        )
    return value

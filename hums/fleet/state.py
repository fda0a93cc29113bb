"""State of a monitored machine as JSON, read bit for bit as written."""

import gzip
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hums.fleet import monitor, series
from hums.fleet.monitor import MachineState
from hums.fleet.monitor_settings import MonitorError
from hums.records.outputs import atomic_write
from signals.monitoring import health

SCHEMA = "hums-watch/13"
_KINDS: Mapping[str, Any] = {
    name: kind for part in (health, monitor, series) for name, kind in vars(part).items() if is_dataclass(kind)
}
_SEQUENCES: Mapping[str, Any] = {"list": list, "tuple": tuple, "Keys": series.shared, "Series": series.Series._make}


def write_state(state: MachineState, path: Path) -> None:
    """Write a state to a file atomically."""
    text = json.dumps({"schema": SCHEMA, "state": _encoded(state)})
    with atomic_write(path) as part:
        part.write_bytes(gzip.compress(text.encode(), compresslevel=6, mtime=0))


def read_state(path: Path) -> MachineState:
    """Return the state in a file of `write_state`.

    Raises
    ------
    MonitorError
        If the file is not a state.
    """
    try:
        table = json.loads(gzip.decompress(path.read_bytes()))
        schema = table["schema"]
        state = _decoded(table["state"]) if schema == SCHEMA else None
    except Exception as error:  # noqa: BLE001 - of damaged bytes: a broken archive, lists in the place of numbers
        raise MonitorError(f"{path}: not a state of hums.watch ({error}); name the file that it wrote.") from None
    if schema != SCHEMA:
        raise MonitorError(f"{path} holds {schema!r}, but this version reads {SCHEMA!r}; start again.")
    if not isinstance(state, MachineState):
        raise MonitorError(f"{path}: not a state of hums.watch; name the file that it wrote.")
    return state


def _encoded(thing: Any) -> Any:  # noqa: ANN401
    """Return the JSON form of a value, with all significant digits of floats."""
    if is_dataclass(thing):
        return [type(thing).__name__, {one.name: _encoded(getattr(thing, one.name)) for one in fields(thing)}]
    if isinstance(thing, np.ndarray):
        return ["array", str(thing.dtype), list(thing.shape), thing.ravel().tolist()]
    if isinstance(thing, np.generic):
        return _encoded(np.asarray(thing))
    if isinstance(thing, Mapping):
        return ["dict", [[_encoded(key), _encoded(value)] for key, value in thing.items()]]
    if isinstance(thing, list | tuple):
        return [type(thing).__name__, [_encoded(one) for one in thing]]
    return thing


def _decoded(thing: Any) -> Any:  # noqa: ANN401
    if not isinstance(thing, list):
        return thing
    kind, *rest = thing
    if kind == "array":
        dtype, shape, values = rest
        return np.array([math.nan if x is None else x for x in values], dtype=dtype).reshape(shape)
    if kind == "dict":
        return {_decoded(key): _decoded(value) for key, value in rest[0]}
    if kind in _SEQUENCES:
        return _SEQUENCES[kind](tuple(_decoded(one) for one in rest[0]))
    return _KINDS[kind](**{name: _decoded(value) for name, value in rest[0].items()})

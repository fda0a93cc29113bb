"""Monitoring in an acquisition loop: condition and alarms of a machine after each new record.

The state of the machine is kept as JSON, read bit for bit as written.
"""

import gzip
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hums.analysis.result import Analysis
from hums.fleet import monitor, series
from hums.fleet.maintenance import Work
from hums.fleet.monitor import Judgement, MachineState, update
from hums.fleet.monitor_settings import MonitorError, MonitorSettings
from hums.fleet.observation import observation
from hums.fleet.result_files import results
from hums.jobs import locked
from hums.records.outputs import atomic_write
from signals._validation import checked
from signals.monitoring import health

SCHEMA = "hums-watch/13"
_KINDS: Mapping[str, Any] = {
    name: kind for part in (health, monitor, series) for name, kind in vars(part).items() if is_dataclass(kind)
}
_SEQUENCES: Mapping[str, Any] = {"list": list, "tuple": tuple, "Keys": series.shared, "Series": series.Series._make}


@checked
def watch(
    analysis: Analysis,
    state: str | Path,
    *,
    settings: MonitorSettings | None = None,
    work: Sequence[Work] = (),
) -> Judgement:
    """Compare a new record of a machine with its baseline, and keep the state of the machine in a file.

    The first records form the baseline, which is then frozen. The state has a constant size and is restored bit for
    bit, so that an interrupted loop resumes with identical results. Processes that share a state take turns. A record
    that was given before, or is older than the latest one, is not judged and changes nothing.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze`; the records of one machine come in chronological order.
    state : str or Path
        File of the machine's state, created if missing.
    settings : MonitorSettings, optional
        Settings for a new state; an existing one keeps its own.
    work : sequence of Work, optional
        Maintenance, from `read_maintenance`.

    Returns
    -------
    Judgement
        Whether the record was judged or why not, the condition index of each component (0 normal, 1 alarm), and the
        alarms raised by it, rows of ``alarms.csv``.

    Raises
    ------
    MonitorError
        If the file is not a state, or that of another machine.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> import hums
    >>> rng, gearbox = np.random.default_rng(0), hums.load_gearbox("two-stage")
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> with TemporaryDirectory() as folder:
    ...     for _ in range(3):
    ...         record = hums.make_record({"housing": rng.normal(size=8000)}, rate_hz=4000, units="g", angle=angle)
    ...         analysis = hums.analyze(record, gearbox)
    ...         found = hums.watch(analysis, f"{folder}/mill.state", settings=hums.MonitorSettings(baseline_records=2))
    ...         print(found.judged, found.why, len(found.alarms))
    False learning 0
    False learning 0
    True  0
    """
    row = results(analysis)
    facts = {name: str(analysis.attrs.get(name, "")) for name in ("record", "machine", "recorded_at")}
    path = Path(state)
    with locked(path.resolve().parent, wait=True):  # from the state that is read to the one that is written
        if path.exists():
            kept = read_state(path)
        else:
            kept = MachineState(machine=facts["machine"], settings=settings or MonitorSettings())
        if facts["machine"] != kept.machine:
            whose = f"of machine {facts['machine']!r} and the state of {kept.machine!r}"
            raise MonitorError(f"the record is {whose}; keep a state for each.")
        found = update(kept, observation(facts | row), work=work)
        write_state(kept, path)
    return found


# ---- the state -----------------------------------------------------------------------------------------------------


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

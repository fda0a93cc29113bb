"""Monitoring in an acquisition loop: condition and alarms of a machine after each new record.

The state of the machine is kept as JSON, read bit for bit as written.
"""

import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hums.analysis.result import Analysis
from hums.fleet import monitor, series
from hums.fleet.maintenance import Work
from hums.fleet.monitor import Judgement, MachineState, update
from hums.fleet.monitor_settings import MonitorSettings
from hums.fleet.observation import FleetError, observation
from hums.fleet.result_files import results
from hums.jobs import locked
from hums.records.outputs import atomic_write
from signals._validation import checked
from signals.monitoring import health

SCHEMA = "hums-watch/15"
_KINDS: Mapping[str, Any] = {
    name: kind for part in (health, monitor, series) for name, kind in vars(part).items() if is_dataclass(kind)
}
_KIND, _KEYS = "__kind__", ("keys", "series")  # of a dataclass or an array; fields that hold names of series


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
    FleetError
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
            raise FleetError(f"the record is {whose}; keep a state for each.")
        found = update(kept, observation(facts | row), work=work)
        write_state(kept, path)
    return found


# ---- the state -----------------------------------------------------------------------------------------------------


def write_state(state: MachineState, path: Path) -> None:
    """Write a state to a file atomically."""
    text = json.dumps({"schema": SCHEMA, "state": state}, default=_plain)
    with atomic_write(path) as part:
        part.write_bytes(gzip.compress(text.encode(), compresslevel=6, mtime=0))


def read_state(path: Path) -> MachineState:
    """Return the state in a file of `write_state`.

    Raises
    ------
    FleetError
        If the file is not a state.
    """
    try:
        table = json.loads(gzip.decompress(path.read_bytes()), object_hook=_restored)
        schema, state = table["schema"], table["state"]
    except Exception as error:  # noqa: BLE001 - of damaged bytes: a broken archive, lists in the place of numbers
        raise FleetError(f"{path}: not a state of hums.watch ({error}); name the file that it wrote.") from None
    if schema != SCHEMA:
        raise FleetError(f"{path} holds {schema!r}, but this version reads {SCHEMA!r}; start again.")
    if not isinstance(state, MachineState):
        raise FleetError(f"{path}: not a state of hums.watch; name the file that it wrote.")
    return state


def _plain(thing: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return a dataclass or an array as a JSON object, with all significant digits of floats."""
    if is_dataclass(thing):
        return {_KIND: type(thing).__name__} | {one.name: getattr(thing, one.name) for one in fields(thing)}
    return {_KIND: "array", "values": thing.ravel().tolist(), "dtype": str(thing.dtype), "shape": thing.shape}


def _restored(table: dict[str, Any]) -> Any:  # noqa: ANN401
    """Return the dataclass or the array of a JSON object of `_plain`, and any other object as it is."""
    kind = table.pop(_KIND, "")
    if kind == "array":
        return np.array(table["values"], dtype=table["dtype"]).reshape(table["shape"])
    for name in (one for one in _KEYS if isinstance(table.get(one), list)):
        table[name] = series.shared(tuple(map(series.Series._make, table[name])))
    return _KINDS[kind](**table) if kind else table

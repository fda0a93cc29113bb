"""Monitoring in an acquisition loop: condition and alarms of a machine after each new record."""

from collections.abc import Sequence
from pathlib import Path

from hums.analysis.result import Analysis
from hums.fleet.maintenance import Work
from hums.fleet.monitor import Judgement, MachineState, update
from hums.fleet.monitor_settings import MonitorError, MonitorSettings
from hums.fleet.observation import observation
from hums.fleet.results import results
from hums.fleet.state import read_state, write_state
from hums.jobs import locked
from signals._validation import checked


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

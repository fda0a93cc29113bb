"""Measured machines: bearings run to failure (PRONOSTIA), and a wind turbine's gearbox with four records."""

import math
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from fleet_analyses import Array

from hums import AnalysisSettings, analyze, load_gearbox
from hums.fleet.monitor import MachineState, update
from hums.fleet.observation import MonitorSettings, Observation
from hums.fleet.result_files import StoredRecord, results
from hums.fleet.series import Numbers, Series, shared
from hums.fleet.watched_machines import MachineHistory
from hums.readers import convert

ROOT = Path(__file__).resolve().parents[1]
BANDS_HZ = ((20, 500), (500, 2_000), (2_000, 5_000), (5_000, 12_800))
RATE_HZ = 25_600.0
DAY = datetime(2020, 1, 1, tzinfo=UTC)  # of the first snapshot; one every 10 s


def snapshot(accelerations: Array) -> Numbers:
    """Return logarithms of plain indicators of a snapshot (2, samples) in g."""
    found = {}
    for channel, raw in zip(("horizontal", "vertical"), accelerations, strict=True):
        x = raw - raw.mean()
        rms, lines = x.std(), np.fft.rfft(x)
        hz = np.fft.rfftfreq(x.size, 1 / RATE_HZ)
        numbers = {
            ("rms", "g"): rms,
            ("peak", "g"): np.abs(x).max(),
            ("kurtosis", "1"): np.mean(x**4) / rms**4,
            ("crest_factor", "1"): np.abs(x).max() / rms,
        }
        for low, high in BANDS_HZ:
            inside = (hz >= low) & (hz < high)
            analytic = np.zeros(x.size, dtype=complex)
            analytic[: hz.size] = np.where(inside, 2 * lines, 0)
            envelope = np.abs(np.fft.ifft(analytic))
            numbers[f"rms {low} to {high} Hz", "g"] = np.sqrt(np.mean(envelope**2) / 2)
            numbers[f"envelope variation {low} to {high} Hz", "1"] = envelope.std() / envelope.mean()
        for (name, unit), value in numbers.items():
            key = Series(channel=channel, component="record", kind="channel", indicator=name, unit=unit)
            found[key] = float(np.log(value))
    return Numbers(keys=shared(tuple(found)), values=np.array(list(found.values())))


def run_to_failure(path: Path) -> tuple[int, float, str, bool]:
    """Return snapshots, share of life at the first alarm of a component, its indicators, and whether it stands."""
    with np.load(path) as kept:
        runs = kept["milli_g"] / 1000.0
        times = [(DAY + timedelta(seconds=10.0 * float(number))).isoformat() for number in kept["snapshot"]]
    settings = MonitorSettings(baseline_records=max(10, len(runs) // 10))
    state, first, what = MachineState(machine=path.stem, settings=settings), math.inf, ""
    for number, accelerations in enumerate(runs):
        seen = Observation(
            machine=path.stem, record=str(number), recorded_at=times[number], values=snapshot(accelerations)
        )
        for alarm in update(state, seen).alarms:
            if not alarm["component"].startswith("sensor") and not what:
                first, what = number / len(runs), alarm["indicator"]
    return len(runs), first, what, any(alarm["state"] == "raised" for alarm in state.standing.values())


def turbine(folder: Path) -> Iterator[tuple[str, float, str, str, str]]:
    """Yield time, condition index, change and alarm of the worst component, if any of those with an alarm."""
    gearbox = load_gearbox(ROOT / "tests" / "data" / "wind-turbine.toml")
    state = MachineState(machine="turbine", settings=MonitorSettings(baseline_records=2))
    history = MachineHistory(state=state)
    for path in sorted(folder.glob("*.mat")):
        when = datetime.strptime(path.stem, "data-%Y%m%dT%H%M%SZ").replace(tzinfo=UTC).isoformat()
        record = convert(
            path,
            channels=["vibration"],
            rate_hz=97_656,
            units="g",
            tach_times="tach",
            pulses_per_rev=2,
            shaft="high speed shaft",
        )
        analysis = analyze(record, gearbox, settings=AnalysisSettings(most_tracks=0))
        row = results(analysis) | {"record": path.stem, "machine": "turbine", "recorded_at": when}
        history.follow([StoredRecord(**row)], ())
        found = history.last
        if found is not None:
            standing = {name: one for name, one in state.standing.items() if one["state"] == "raised"}
            worst = max(standing or found.index, key=lambda name: found.index[name])
            words = "".join(f"{one['severity']}: {one['indicator']}" for name, one in standing.items() if name == worst)
            yield when, found.index[worst], f"{found.drivers[worst][-1]:.3g} times normal", worst, words

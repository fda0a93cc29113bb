"""Cost of a fleet: tables and page, records long and short, files converted, and the page in the browser."""

import json
import os
import shutil
import sys
import tempfile
import time
from datetime import UTC, datetime, timedelta
from itertools import chain
from pathlib import Path

import numpy as np

from hums import AnalysisSettings, NominalSpeed, analyze, load_gearbox, make_record, save_record
from hums.conversion import convert_files, find_sources
from hums.fleet.fleet_analysis import analyze_fleet
from hums.fleet.fleet_page import write_page
from hums.fleet.observation import MonitorSettings
from hums.fleet.result_files import packed_row, read_results, read_row, results
from hums.fleet.table import write_tables
from hums.fleet.watched_machines import watch_machines, write_alarms, write_baselines, write_components
from hums.jobs import Processes

FIRST = datetime(2020, 1, 1, tzinfo=UTC)
FIVE_YEARS = 1_826


def cost_rows(analyses: Path, *, records: int, machines: int = 20) -> list[tuple[str, str, str]]:
    """Return what was measured, the result, and what is asked."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        spent = table_seconds(analyses, Path(folder), machines=machines, records=500)
        rows.append((f"tables, alarms and page of {500 * machines:,} rows, CPU on one core", f"{spent:.1f} s", "20 s"))
    with tempfile.TemporaryDirectory() as folder:
        spent = table_seconds(analyses, Path(folder), machines=machines, records=FIVE_YEARS)
        rows.append((f"as above, {FIVE_YEARS * machines:,} rows, five years of daily records", f"{spent:.1f} s", ""))
        for what, seconds in zip(("newly started browser", "running browser"), opened(Path(folder)), strict=False):
            rows.append((f"their page opened and drawn in Chromium, {what}", f"{seconds:.2f} s", "3 s"))
    short = record_seconds(seconds=0.1, rate_hz=25_600)
    rows.append(("a record of 0.1 s at 25.6 kHz, CPU", f"{1e3 * short:.0f} ms", "20 ms"))
    rows.append(("a record of 1 s at 50 kHz, CPU", f"{1e3 * record_seconds(seconds=1, rate_hz=50_000):.0f} ms", ""))
    what = f"{records:,} records of 1 s at 50 kHz, two processes, from files to page, elapsed time"
    rows.append((what, f"{run_seconds(records):.0f} s", f"{0.15 * records:.0f} s"))
    what = "`hums convert --files` of a CSV file of 2,560 samples, CPU"
    rows.append((what, f"{1e3 * convert_seconds():.1f} ms", "10 ms"))
    return rows


def table_seconds(analyses: Path, room: Path, *, machines: int, records: int) -> float:
    """Return the CPU seconds for all tables, alarms and the page of machines with daily records."""
    names = json.loads((analyses / "fleet/records.json").read_text()).values()
    rows = [read_row(analyses / "fleet/records" / name) for name in names]
    rng, paths = np.random.default_rng(14), []
    for machine in range(machines):
        for day, chosen in enumerate(rng.integers(len(rows), size=records)):
            named = {"record": f"{machine}/{day}.h5", "machine": f"mill {machine}"}
            paths.append(room / f"{machine} {day}.json.gz")
            named |= {"recorded_at": (FIRST + timedelta(days=day)).isoformat()}
            paths[-1].write_bytes(packed_row(rows[chosen] | named))  # unsynced, as nothing is lost with them
    start = time.process_time()
    seen = read_results(paths)
    histories = watch_machines(seen, settings=MonitorSettings())
    write_alarms(histories, room / "alarms.csv")
    write_components(histories, room / "components.csv")
    write_baselines(histories, room / "baselines.json")
    health = {one["seen"].record: one for history in histories for one in history.records}
    write_tables(seen, room, health=health, limits=dict(chain(*(one.severe_scores.items() for one in histories))))
    write_page(histories, room / "fleet.html", gearbox="two-stage")
    return time.process_time() - start


def opened(folder: Path) -> list[float]:
    """Return the seconds until ``fleet.html`` is drawn in headless Chromium, twice; none without the browser."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        return []
    sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
    from browser import drawn_s, show, start_browser  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as profile:
        driver, found = start_browser(profile), []
        for _ in range(2):
            show(driver, folder / "fleet.html")
            found.append(drawn_s(driver))
        driver.quit()
    return found


def record_seconds(*, seconds: float, rate_hz: float, count: int = 20) -> float:
    """Return the CPU seconds for the analysis of a record of noise by a fleet, the mean after one to warm up."""
    rng, gearbox = np.random.default_rng(15), load_gearbox("two-stage")
    record = make_record(
        {"sensor": rng.normal(size=int(seconds * rate_hz))},
        rate_hz=rate_hz,
        units="g",
        angle=NominalSpeed(rpm=1200, shaft="input"),
    )
    start, settings = 0.0, AnalysisSettings(most_tracks=0, pictures=False)
    for number in range(count + 1):
        if number == 1:
            start = time.process_time()
        results(analyze(record, gearbox, settings=settings))
    return (time.process_time() - start) / count


def run_seconds(records: int) -> float:
    """Return the seconds that pass for the whole run over records of 1 s at 50 kHz of ten machines."""
    rng = np.random.default_rng(18)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "records"
        made.mkdir()
        for number in range(records):
            record = make_record(
                {"sensor": rng.normal(size=50_000)},
                rate_hz=50_000,
                units="g",
                angle=NominalSpeed(rpm=1200, shaft="input"),
                machine=f"mill {number % 10}",
                recorded_at=FIRST + timedelta(days=number // 10),
            )
            save_record(record, made / f"{number}.h5")
        start = time.perf_counter()
        analyze_fleet([made], "two-stage", Path(folder) / "fleet", workers=Processes(count=2))
        return time.perf_counter() - start


def convert_seconds(files: int = 200) -> float:
    """Return the CPU seconds of a small CSV file that becomes a record, the reader's process included."""
    rng = np.random.default_rng(19)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(files):
            np.savetxt(f"{folder}/acc_{number}.csv", rng.normal(size=2_560), fmt="%.5f", header="vib", comments="")
        sources = find_sources([f"{folder}/acc_*.csv"])
        spent = []
        for count in (1, files):  # the first takes the start of the reader's process
            start = _used()
            declared = {"channels": ["vib"], "units": "g", "rate_hz": 25_600, "no_tachometer": True}
            convert_files(sources[:count], f"{folder}/out {count}", form="files", **declared)
            spent.append(_used() - start)
    return (spent[1] - spent[0]) / (files - 1)


def _used() -> float:
    """Return the CPU seconds of this process and of those it started that have ended."""
    times = time.process_time(), *os.times()[2:4]
    return float(sum(times))

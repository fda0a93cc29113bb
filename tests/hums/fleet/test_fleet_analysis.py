import contextlib
import csv
import itertools
import json
import math
import os
import shutil
import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import clusters
import h5py
import numpy as np
import pytest
import xarray as xr
from fleets import LINES, kept, observed

import hums
from data_synth import make_dataset
from data_synth.plan import parse_plan
from hums.analysis.result import findings_table, indicator_table, line_table
from hums.cli import main
from hums.fleet import fleet_analysis
from hums.fleet.fleet_analysis import analyze_fleet
from hums.fleet.observation import FleetError
from hums.fleet.series import Numbers, shared
from hums.fleet.table import NO_TRENDS, write_tables
from hums.jobs import Processes, Serial
from hums.records.store import save_record

RATE_HZ, SPEED_HZ, SECONDS = 4000, 20.0, 2.0
FIRST = datetime(2026, 3, 1, tzinfo=UTC)


def record(amplitude, *, day=0.0, machine="mill", noise=0.01, seed=0):
    """A record whose mesh line, order 23, has the amplitude; whole revolutions, so its RMS is exact."""
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    values = amplitude * np.cos(2 * np.pi * 23 * SPEED_HZ * time)
    values += noise * np.random.default_rng(seed).standard_normal(time.size)
    return hums.make_record(
        {"a": values},
        rate_hz=RATE_HZ,
        units="g",
        angle=hums.PulseTimes(times_s=np.arange(0, SECONDS, 1 / SPEED_HZ), shaft="input", pulses_per_rev=1),
        machine=machine,
        recorded_at=FIRST + timedelta(days=day),
    )


SETTINGS = hums.AnalysisSettings(most_tracks=0, envelope_band_hz=None, pictures=False)


def run(sources, folder, **more):
    return analyze_fleet(sources, "two-stage", folder, **({"settings": SETTINGS} | more))


def rows(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def tables(folder):
    return {name: (folder / name).read_bytes() for name in ("fleet.h5", "fleet.csv", "trends.csv")}


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    folder = tmp_path_factory.mktemp("records")
    for day in range(6):
        save_record(record(1 + day / 10, day=day, noise=0.0 if day == 0 else 0.01, seed=day), folder / f"{day}.h5")
    return folder


@pytest.fixture(scope="module")
def done(records, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fleet")
    run([records], folder)
    return folder


class TestTable:
    def test_each_row_is_the_analysis_of_its_record(self, records, done):
        with xr.open_dataset(done / "fleet.h5", engine="h5netcdf") as opened:
            table = opened.load()
        assert list(table.record.values) == [str(records / f"{day}.h5") for day in range(6)]
        for number in (0, 4):
            with hums.open_record(records / f"{number}.h5") as one:
                analysis = hums.analyze(one, hums.load_gearbox("two-stage"), settings=SETTINGS)
            row = table.isel(record=number)
            self.check_lines(row, line_table(analysis, "order_spectrum"))
            self.check_indicators(row, indicator_table(analysis))
            verdicts = {
                (component, kind): ("none", "indicated", "diagnosed")[verdict]
                for component, kind, verdict in zip(
                    table.condition_component.values, table.condition_kind.values, row.verdict.values, strict=True
                )
            }
            found = findings_table(analysis)
            assert {key for key, verdict in verdicts.items() if verdict != "none"} == set(
                zip(found["component"], found["kind"], strict=True)
            )
            assert row.speed_hz.item() == pytest.approx(SPEED_HZ, rel=1e-9)  # exact pulses

    @staticmethod
    def check_lines(row, expected):
        keys = ("component", "kind", "harmonic", "sideband")
        found = {
            key: (amplitude, snr, bool(claimed), order)
            for *key_parts, amplitude, snr, claimed, order in zip(
                *(row[f"line_{key}"].values for key in keys),
                *(row[name].values for name in ("amplitude", "snr", "claimed", "order")),
                strict=True,
            )
            if (key := tuple(key_parts)) and np.isfinite(amplitude)
        }
        assert len(found) == len(expected)
        for line in expected.itertuples():
            amplitude, snr, claimed, order = found[tuple(getattr(line, key) for key in keys)]
            assert (amplitude, snr) == pytest.approx((line.amplitude, line.snr), rel=1e-6)  # kept as float32
            assert (claimed, order) == (line.claimed, line.order)

    @staticmethod
    def check_indicators(row, expected):
        keys = ("component", "kind", "indicator")
        columns = zip(*(row[f"indicator_{key}"].values for key in keys), row["value"].values, strict=True)
        found = {tuple(key): value for *key, value in columns if np.isfinite(value)}
        known = expected[np.isfinite(expected["value"])]
        assert len(found) == len(known) > 5
        for indicator in known.itertuples():
            key = tuple(getattr(indicator, name) for name in keys)
            assert found[key] == pytest.approx(indicator.value, rel=1e-6)

    def test_csv_holds_the_same(self, done):
        with xr.open_dataset(done / "fleet.h5", engine="h5netcdf") as opened:
            table = opened.load()
        lines = rows(done / "fleet.csv")
        assert [line["record"] for line in lines] == list(table.record.values)
        mesh = (table.line_component == "stage 1") & (table.line_kind == "gear_mesh") & (table.line_harmonic == 1)
        expected = table.amplitude.values[:, np.flatnonzero(mesh)[0]]
        title = "a: order_spectrum: stage 1 gear_mesh harmonic 1 [g]"
        assert [float(line[title]) for line in lines] == pytest.approx(expected, rel=1e-6)
        assert expected == pytest.approx(1 + np.arange(6) / 10, rel=0.01)  # noise of 0.01 rms, a window's ripple
        assert all("kinds of damage could not be judged (" in line["parts_not_judged"] for line in lines)

    def test_a_dataset_is_many_records_and_made_again_is_analysed_again(self, tmp_path):
        plan = 'scene = "demo"\nrecords = 2\nseed = {}\nchange = {{ duration_s = 0.5, fault = [] }}'
        make_dataset(parse_plan(plan.format(1)), tmp_path / "made")
        result = run([tmp_path / "made"], tmp_path / "out")
        assert (result.records, result.failed) == (2, 0)
        made = rows(tmp_path / "out" / "fleet.csv")
        assert [line["record"] for line in made] == [f"{tmp_path / 'made'}/{number}" for number in (0, 1)]
        assert [line["class"] for line in made] == hums.open_dataset(tmp_path / "made")["class"].to_numpy().tolist()
        speeds = [hums.dataset_record(tmp_path / "made", number)["truth_speed"].mean().item() for number in (0, 1)]
        assert [float(line["speed_hz"]) for line in made] == pytest.approx(speeds, rel=0.01)
        shutil.rmtree(tmp_path / "made")
        make_dataset(parse_plan(plan.format(2)), tmp_path / "made")
        assert run([tmp_path / "made"], tmp_path / "out").analysed == 2
        assert rows(tmp_path / "out" / "fleet.csv") != made

    @pytest.mark.filterwarnings("ignore:.*was changed after it was written")
    def test_a_record_that_fails_is_a_row_with_its_sentence(self, records, tmp_path):
        names = ["broken", "dated", "dead", os.fsdecode(b"named \xff")]  # the last is no UTF-8
        broken, dated, dead, named = (tmp_path / f"{name}.h5" for name in names)
        broken.write_text("nothing of the kind")
        save_record(record(1.0).drop_vars("a").assign(a=record(0.0, noise=0.0)["a"]), dead)
        shutil.copy(records / "1.h5", dated)
        with h5py.File(dated, "a") as file:
            file.attrs["recorded_at"] = "yesterday"
        with contextlib.suppress(OSError):  # a file system that takes no such name
            named.write_text("nothing of the kind")
        sources = [path for path in (broken, records / "0.h5", dated, dead, named) if path.exists()]
        result = run(sources, tmp_path / "o")
        assert (result.records, result.failed) == (len(sources), len(sources) - 1)
        errors = {line["record"]: line["error"] for line in rows(tmp_path / "o" / "fleet.csv")}
        assert "broken.h5 is not an HDF5 file" in errors[str(broken)]
        assert errors.pop(str(records / "0.h5")) == ""
        assert "recorded_at='yesterday'" in errors[str(dated)]
        assert "same value 0 throughout" in errors[str(dead)]
        assert result.errors == errors
        assert not named.exists() or str(tmp_path / "named \\xff.h5") in errors

    def test_even_a_mistake_of_ours_ends_no_run(self, records, tmp_path, monkeypatch):
        def analyze(*_, **__):
            raise IndexError("out of bounds")

        monkeypatch.setattr(fleet_analysis, "analyze", analyze)
        assert run([records / "0.h5"], tmp_path).failed == 1
        assert rows(tmp_path / "fleet.csv")[0]["error"] == "IndexError: out of bounds"


def test_what_was_measured_is_a_condition_as_speed_is(tmp_path):
    for day in range(2):
        measured = {"torque": hums.Measured(values=100.0 + day, units="N m")}
        one = record(1.0, day=day, seed=day)
        angle = hums.NominalSpeed(rpm=60 * SPEED_HZ, shaft="input")
        facts = {"machine": "mill", "recorded_at": one.recorded_at, "measured": measured}
        one = hums.make_record({"a": one["a"].values}, rate_hz=RATE_HZ, units="g", angle=angle, **facts)
        save_record(one, tmp_path / f"{day}.h5")
    run([tmp_path], tmp_path / "out", monitoring=hums.MonitorSettings(baseline_records=2))
    ((baseline,),) = json.loads((tmp_path / "out" / "baselines.json").read_text()).values()
    assert baseline["covariates"] == ["speed_hz", "torque"]


class TestGoingOn:
    def test_a_record_that_kills_its_process_is_a_row(self, records, done, tmp_path, monkeypatch):
        folder = shutil.copytree(done, tmp_path / "fleet")
        (folder / "records" / fleet_analysis._result_name(fleet_analysis._of_file(records / "2.h5"))).unlink()
        monkeypatch.setattr(fleet_analysis, "_analyse_to_file", clusters.die_at_record)
        result = run([records], folder, workers=Processes(count=1))
        assert (result.records, result.failed, result.analysed) == (6, 1, 1)
        assert "2.h5: the process that analysed it died twice" in result.errors[str(records / "2.h5")]
        failed = [row["record"] for row in rows(folder / "fleet.csv") if row["error"]]
        assert failed == [str(records / "2.h5")]
        monkeypatch.undo()  # what killed it may be over
        result = run([records], folder)
        assert (result.failed, result.analysed, result.kept) == (0, 1, 5)
        assert tables(folder) == tables(done)

    def test_stopped_and_run_again_the_tables_are_the_same(self, records, done, tmp_path, monkeypatch):
        analyze, calls = fleet_analysis.analyze, itertools.count()

        def stopping(*args, **kwargs):
            if next(calls) == 3:
                raise KeyboardInterrupt
            return analyze(*args, **kwargs)

        monkeypatch.setattr(fleet_analysis, "analyze", stopping)
        with pytest.raises(KeyboardInterrupt):
            run([records], tmp_path)
        result = run([records], tmp_path)
        assert (result.analysed, result.kept) == (3, 3)
        assert tables(tmp_path) == tables(done)

    def test_any_order_of_the_files_gives_the_same_tables(self, records, done, tmp_path):
        shutil.copytree(done, tmp_path / "fleet")
        names = sorted(records.glob("*.h5"), reverse=True)
        assert run([*names[2:], *names[:2]], tmp_path / "fleet").kept == 6
        assert tables(tmp_path / "fleet") == tables(done)

    def test_new_and_changed_records_alone_are_analysed_and_take_their_place(self, tmp_path):
        (tmp_path / "records").mkdir()
        monitoring = hums.MonitorSettings(baseline_records=2)
        for day in range(2):
            save_record(record(1.0, day=day), tmp_path / "records" / f"{day}.h5")
        run([tmp_path / "records"], tmp_path / "out", monitoring=monitoring)
        for day in (1, 2):
            save_record(record(1.0 + day, day=day), tmp_path / "records" / f"{day}.h5")
        new = [tmp_path / "records" / f"{day}.h5" for day in (1, 2)]
        result = run(new, tmp_path / "out", append=True, monitoring=monitoring)
        assert (result.records, result.analysed, result.kept) == (3, 2, 1)
        rms = [float(line["a: record channel rms [g]"]) for line in rows(tmp_path / "out" / "fleet.csv")]
        assert rms == pytest.approx(np.array([1, 2, 3]) / math.sqrt(2), rel=1e-3)  # noise of 0.01 adds 1e-4 of it
        run([tmp_path / "records"], tmp_path / "anew", monitoring=monitoring)
        for name in ("fleet.csv", "components.csv", "alarms.csv", "trends.csv"):
            assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "anew" / name).read_bytes()

    def test_a_run_that_begins_while_another_writes_its_tables_is_refused(self, records, tmp_path, monkeypatch):
        def meanwhile(*_, **__):
            run([records / "1.h5"], tmp_path, append=True)

        monkeypatch.setattr(fleet_analysis, "write_page", meanwhile)
        with pytest.raises(hums.JobError, match="another run is using"):
            run([records / "0.h5"], tmp_path)

    def test_another_gearbox_or_other_settings_are_refused(self, records, done):
        with pytest.raises(
            FleetError, match=r"analysed with another settings; mixing is refused\. Name another folder"
        ):
            run([records], done, settings=hums.AnalysisSettings(most_tracks=1))
        with pytest.raises(FleetError, match="another gearbox"):
            analyze_fleet([records], "wijianto-pair", done, settings=SETTINGS)

    def test_no_records(self, tmp_path):
        (tmp_path / "empty").mkdir()
        with pytest.raises(FleetError, match=r"holds no record, no file that ends in \.h5"):
            run([tmp_path / "empty"], tmp_path / "out")
        with pytest.raises(FleetError, match="no records were named"):
            run([], tmp_path / "out")

    def test_a_path_that_is_not_there_is_refused_before_anything_is_made(self, records, tmp_path):
        with pytest.raises(FleetError, match=r"nothere: there is no such file or folder; check the path"):
            run([records / "0.h5", tmp_path / "nothere"], tmp_path / "out")
        assert not (tmp_path / "out").exists()


def trends(amplitudes, folder, *, days=None):
    """Why there are no trends, and the trends: of machines whose records have these amplitudes, a record a day."""
    stored = []
    for machine, of_machine in amplitudes.items():
        for day, amplitude in enumerate(of_machine):
            one = observed(days[day] if days else day, record=f"{machine} {day}")
            lines = Numbers(keys=shared(LINES[:1]), values=np.array([[amplitude, 2, 1]], dtype=np.float32))
            stored.append(replace(kept(one), machine=machine, lines=lines, orders=np.array([23.0])))
    return write_tables(stored, folder), rows(folder / "trends.csv")


class TestWhyThereAreNoTrends:
    def test_none_is_missing_where_there_are_some(self, records, done):
        assert run([records], done).no_trends == ""
        assert rows(done / "trends.csv")

    def test_too_few_of_a_machine(self, tmp_path):
        why, found = trends({"fan": (1.0, 1.2, 1.4), "mill": (1.1, 1.3, 1.5)}, tmp_path)
        assert why.startswith("no trends: a machine needs 5 records with different times (recorded_at; ")
        assert {row["trend"] for row in found} == {"too few to test"}
        change = {row["machine"]: float(row["change"]) for row in found}
        assert change == pytest.approx({"fan": 1.4 / 1.0, "mill": 1.5 / 1.1}, rel=1e-5)  # six digits are written

    def test_no_dates_or_all_at_one_time(self, tmp_path):
        stored = [replace(kept(observed(day)), recorded_at="") for day in range(6)]
        for why in (write_tables(stored, tmp_path), trends({"mill": range(1, 6)}, tmp_path, days=[0] * 5)[0]):
            assert why == NO_TRENDS
            assert (tmp_path / "trends.csv").read_text().startswith("machine,regime,series,units,records,median,")


def test_the_command_says_why_and_fails_where_all_fail(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("hums.jobs.Processes", lambda **_: Serial())  # a process costs seconds and adds nothing here
    save_record(record(1.0), tmp_path / "good.h5")
    for number in range(6):
        (tmp_path / f"{number}.h5").write_text("nothing of the kind")
    broken = [str(tmp_path / f"{number}.h5") for number in range(6)]

    def command(*sources):
        words = [*sources, "--gearbox", "two-stage", "-o", str(tmp_path / "out"), "--no-envelope", "--workers", "1"]
        monkeypatch.setattr(sys, "argv", ["hums", "fleet", *words])
        return main(), *capsys.readouterr()

    code, out, err = command(*broken)
    assert code == 1
    assert err.endswith("hums: 6 of 6 failed; reasons: column error of fleet.csv.\n")
    assert f"failed {broken[0]}: {broken[0]} is not an HDF5 file" in out
    assert out.count("failed ") == 5  # the first
    assert len(rows(tmp_path / "out" / "fleet.csv")) == 6
    code, out, _ = command(str(tmp_path / "good.h5"), broken[0])
    assert (code, out.splitlines()[-1]) == (3, "1 of 2 failed; reasons: column error of fleet.csv")
    assert "2 records: 1 analysed now, 1 before, 1 failed" in out
    assert NO_TRENDS in out


def test_the_command_keeps_what_a_script_analysed(records, done, tmp_path, monkeypatch, capsys):
    folder = shutil.copytree(done, tmp_path / "fleet")
    words = ["fleet", str(records), "--gearbox", "two-stage", "-o", str(folder), "--no-envelope", "--workers", "1"]
    monkeypatch.setattr(sys, "argv", ["hums", *words])
    assert main() == 0
    assert "6 records: 0 analysed now, 6 before, 0 failed" in capsys.readouterr().out
    assert tables(folder) == tables(done)


class TestTrends:
    def test_of_a_level_that_rises(self, done):
        found = {row["series"]: row for row in rows(done / "trends.csv")}
        rms = found["a: record channel rms"]
        assert float(rms["slope_per_day"]) == pytest.approx(0.1 / math.sqrt(2), rel=1e-3)  # noise of 0.01 rms in it
        assert float(rms["slope_low"]) < 0.1 / math.sqrt(2) < float(rms["slope_high"])
        assert float(rms["p_value"]) < 1e-4
        assert rms["records"] == "6"
        assert rms["machine"] == "mill"

    def test_machines_have_their_own_and_noise_has_none(self, tmp_path):
        noise = 1 + 0.01 * np.random.default_rng(0).standard_normal((20, 7))
        new = {f"new {number}": amplitudes for number, amplitudes in enumerate(noise)}
        found = {row["machine"]: row["trend"] for row in trends({"worn": 1 + np.arange(7) / 20, **new}, tmp_path)[1]}
        assert found.pop("worn") == "rising"
        assert sum(trend != "none" for trend in found.values()) <= 1  # of 20, each judged alone at one in a hundred

    def test_of_a_regime_are_its_own(self, tmp_path):
        # two regimes, of which that with the higher level comes ever more often
        stored = []
        for day in range(60):
            cruise = 37 * day % 60 < day
            one = replace(observed(day), regime="cruise" if cruise else "hover")
            stored.append(kept(one, growth=(10.0 if cruise else 1.0) * (1 + 0.01 * np.sin(37 * day))))
        write_tables(stored, tmp_path)
        found = [row for row in rows(tmp_path / "trends.csv") if row["series"].startswith("a: order_spectrum")]
        assert {row["regime"] for row in found} == {"cruise", "hover"}
        assert {row["trend"] for row in found} == {"none"}

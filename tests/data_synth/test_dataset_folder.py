import hashlib
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import partial_files
import pytest
import xarray as xr

import hums
from data_synth import PlanError, SceneError, load_plan, make_dataset, simulate
from data_synth.card import data_card
from data_synth.dataset_folder import dataset_cost
from data_synth.plan import parse_plan
from hums.jobs import Tally
from hums.records.fields import RecordError
from hums.records.store import open_record, save_record

SMALL = """
records = 7
seed = 3
records_per_shard = 3
detectability_s = 0.3
[scene]
gearbox = "two-stage"
rate_hz = 5000
duration_s = 0.5
fidelity = "kinematic"
speed = { link = "input", rpm = 600 }
tachometer = { link = "input", pulses_per_rev = 1 }
resonance = { frequency_hz = 1500, damping_ratio = 0.05 }
sensor = [
    { name = "a", on = "input bearing", units = "g", direction = [0, 0, 1] },
    { name = "b", on = "output", units = "g" },
]
[change]
speed = { rpm = { uniform = [500, 1500] } }
[[class]]
name = "healthy"
[[class]]
name = "crack"
[[class.change.fault]]
kind = "tooth_crack"
component = "stage 1/pinion"
depth_mm = { uniform = [1, 3] }
"""


@pytest.fixture(scope="module")
def plan():
    return parse_plan(SMALL)


@pytest.fixture(scope="module")
def folder(plan, tmp_path_factory):
    folder = tmp_path_factory.mktemp("dataset") / "small"
    assert make_dataset(plan, folder) == Tally(done=3, kept=0)
    return folder


@pytest.fixture(scope="module")
def single(plan, folder):
    """Every record, read one by one."""
    return [hums.dataset_record(folder, number) for number in range(plan.records)]


@pytest.fixture
def copy(folder, tmp_path):
    return Path(shutil.copytree(folder, tmp_path / "copy"))


def contents(folder):
    """Every file of a folder, hidden ones too, byte for byte."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


class TestRecords:
    def test_a_record_is_what_its_scene_and_seed_simulate(self, tmp_path):
        plan = parse_plan(f'dtype = "float64"\n{SMALL}')
        make_dataset(plan, tmp_path / "exact")
        for number in (1, 6):
            save_record(simulate(plan.scene(number), seed=plan.seed_of(number)), tmp_path / "record.h5")
            with open_record(tmp_path / "record.h5") as expected:
                xr.testing.assert_identical(hums.dataset_record(tmp_path / "exact", number), expected)

    def test_float32_rounds_samples_and_amplitudes_and_nothing_else(self, plan, single):
        expected, record = simulate(plan.scene(1), seed=plan.seed_of(1)), single[1]
        assert np.array_equal(record["a"], expected["a"].astype(np.float32))
        assert np.array_equal(record["tachometer"], expected["tachometer"])
        assert np.array_equal(record["truth_amplitude"], expected["truth_amplitude"].astype(np.complex64))
        assert np.array_equal(record["truth_order"], expected["truth_order"])
        assert record.attrs["truth_scene"] == plan.scene(1).to_toml()

    def test_records_count_from_zero(self, folder):
        for number in (-1, 7):
            with pytest.raises(RecordError, match=rf"no record {number}; its 7 records are numbered 0 to 6"):
                hums.dataset_record(folder, number)


class TestParquet:
    def test_a_row_is_a_record(self, folder, tmp_path):
        pd = pytest.importorskip("pandas")
        make_dataset(parse_plan(f"parquet = true\n{SMALL}"), tmp_path / "small")
        table, opened = pd.read_parquet(tmp_path / "small" / "records.parquet"), hums.open_dataset(folder)
        assert len(table) == 7
        for name in ("class", "class_number", "split", "component", "speed.rpm", "detectability_db"):
            assert np.array_equal(table[name], opened[name], equal_nan=table[name].dtype.kind == "f")
        for name in ("a", "b"):
            assert np.array_equal(np.stack(table[name]), opened[name])
        pulses = opened["tachometer"].values
        assert [len(row) for row in table["tachometer"]] == np.sum(~np.isnan(pulses), axis=1).tolist()
        assert "records.parquet" in (tmp_path / "small" / "checksums.sha256").read_text(encoding="utf-8")


class TestOpened:
    def test_labels_are_coordinates(self, plan, folder):
        opened = hums.open_dataset(folder)
        for number in range(plan.records):
            labels = plan.labels(number)
            own = {"class", "class_number", "component", "split", "seed"}
            assert own | {"speed.rpm", "fault.1.depth_mm"} == labels.keys()
            for name, value in labels.items():
                assert np.array_equal(opened.coords[name][number].item(), value, equal_nan=name == "fault.1.depth_mm")
            assert np.isnan(opened["detectability_db"][number].item()) == (labels["class"] == "healthy")

    def test_a_crack_is_as_detectable_as_its_whole_record_says(self, plan, folder):
        # of 0.3 s of a stationary record, scaled to 0.5 s: within what its five or so impacts of a fixed crack differ
        whole = simulate(plan.scene(1), seed=plan.seed_of(1), detectability=True)["truth_fault_detectability_db"]
        assert hums.open_dataset(folder)["detectability_db"][1].item() == pytest.approx(whole.values[0, 0], abs=1)

    def test_channels_are_those_of_the_records(self, folder, single):
        opened = hums.open_dataset(folder)
        assert opened["a"].dims == ("record", "time")
        assert opened["a"].attrs["units"] == "g"
        assert opened.time.values == pytest.approx(np.arange(2500) / 5000)
        for number, record in enumerate(single):
            for name in ("a", "b"):
                assert np.array_equal(opened[name][number], record[name])

        opened = opened["tachometer"]  # ends in NaN where a record has fewer pulses
        rows = [record["tachometer"].values for record in single]
        assert opened.sizes["pulse_tachometer"] == max(map(len, rows)) > min(map(len, rows))
        for whole, row in zip(opened.values, rows, strict=True):
            assert np.array_equal(whole[: row.size], row)
            assert np.isnan(whole[row.size :]).all()

    @pytest.mark.parametrize(
        "key",
        [
            (3,),
            (-1,),
            (slice(None),),
            (slice(1, 7, 2), slice(100, 50, -3)),
            (slice(None, None, -1), 17),
            ([6, 0, 0, 3], [5, 2, 2400]),
            ([], slice(3)),
            (2, slice(0, 0)),
            (np.arange(7) % 2 == 0, -1),
        ],
    )
    def test_picked_like_an_array(self, folder, key):
        opened = hums.open_dataset(folder)["a"]
        picks = dict(zip(opened.dims, key, strict=False))
        expected = xr.DataArray(opened.values, dims=opened.dims).isel(picks)
        assert np.array_equal(opened.isel(picks).values, expected.values)

    def test_only_files_that_are_needed_are_read(self, copy):
        opened = hums.open_dataset(copy)
        before = opened["a"][4].values
        for shard in ("000000.h5", "000002.h5"):
            (copy / "shards" / shard).unlink()
        assert np.array_equal(opened["a"][4].values, before)
        with pytest.raises(RecordError, match=r"000002\.h5: there is no such file"):
            opened["a"][6].values  # noqa: B018

    def test_survives_pickling(self, folder):
        opened = hums.open_dataset(folder)
        xr.testing.assert_identical(pickle.loads(pickle.dumps(opened)).load(), opened.load())  # noqa: S301

    def test_a_damaged_file_is_named(self, copy):
        path = copy / "shards" / "000001.h5"
        with h5py.File(path) as file:
            where = file["a"].id.get_chunk_info(1).byte_offset
        with path.open("r+b") as stream:
            stream.seek(where + 20)
            stream.write(b"\xff\xff\xff")
        opened = hums.open_dataset(copy)
        assert np.isfinite(opened["a"][3]).all()
        with pytest.raises(
            RecordError, match=r'000001\.h5: "a" of record 4 cannot be read .*run the same hums dataset'
        ):
            opened["a"][4].values  # noqa: B018
        with pytest.raises(RecordError, match=r"000001\.h5: record 4 cannot be read"):
            hums.dataset_record(copy, 4)

    def test_folders_that_hold_none(self, copy, tmp_path):
        with pytest.raises(RecordError, match=r"no such folder; name an output folder"):
            hums.open_dataset(tmp_path / "nowhere")
        with pytest.raises(RecordError, match=r"no complete dataset, as it has no index\.h5; make one"):
            hums.open_dataset(tmp_path)
        (copy / "index.h5").unlink()
        with pytest.raises(RecordError, match="complete it by the same hums dataset again"):
            hums.open_dataset(copy)


class TestGoingOn:
    def test_only_missing_files_are_made(self, plan, folder, copy):
        assert make_dataset(plan, copy) == Tally(done=0, kept=3)
        (copy / "shards" / "000001.h5").unlink()
        partial_files.of_a_dead_writer(copy)
        assert make_dataset(plan, copy) == Tally(done=1, kept=2)
        assert contents(copy) == contents(folder)

    @pytest.mark.slow
    @pytest.mark.skipif(os.name != "posix", reason="kill -9")
    def test_killed_at_any_instant_the_result_is_the_same(self, tmp_path):
        """Two workers make the first files, and what is missing is made here."""
        text = SMALL.replace("rate_hz = 5000", "rate_hz = 20000").replace(
            "records_per_shard = 3", "records_per_shard = 1"
        )
        (tmp_path / "plan.toml").write_text(text)
        words = [sys.executable, "-m", "hums", "dataset", "plan.toml", "-o", "killed", "--workers", "2"]
        killed = tmp_path / "killed"
        run = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        give_up = time.monotonic() + 300  # on a busy machine
        while not list(killed.glob("shards/*.h5")) and run.poll() is None:
            assert time.monotonic() < give_up
            time.sleep(0.002)
        time.sleep(np.random.default_rng(0).uniform(0, 0.05))
        run.send_signal(signal.SIGKILL)
        run.wait()
        assert 0 < len(list(killed.glob("shards/*.h5"))) < 7  # in the middle
        make_dataset(parse_plan(text), killed)
        make_dataset(parse_plan(text), tmp_path / "whole")
        assert contents(killed) == contents(tmp_path / "whole")


class TestFolder:
    def test_the_card_has_every_label_class_and_machine(self, plan, folder):
        card = (folder / "data-card.md").read_text(encoding="utf-8")
        rows = {line.split(" | ")[0].removeprefix("| ").strip("`"): line for line in card.splitlines()}
        assert {*plan.labels(0), "detectability_db", *plan.classes} <= rows.keys()
        assert "| tooth_crack | depth from the flank at the root |" in rows["crack"]
        assert "500 to 1.5e+03" not in rows["speed.rpm"]  # what was drawn
        assert "## Machines" not in card
        shipped = load_plan("benchmark-1").changed(records=20)
        benchmark = data_card(shipped)
        assert all(f"| {machine.name} | {machine.split} |" in benchmark for machine in shipped.machines)
        assert max(len(line) for line in benchmark.splitlines() if not line.startswith("|")) <= 120

    def test_it_says_what_its_files_add_up_to(self, folder):
        rows = [line.split("  ") for line in (folder / "checksums.sha256").read_text(encoding="utf-8").splitlines()]
        files = sorted(path for path in folder.rglob("[!.]*") if path.is_file() and path.name != "checksums.sha256")
        assert [name for _, name in rows] == [path.relative_to(folder).as_posix() for path in files]
        assert [hashlib.sha256(path.read_bytes()).hexdigest() for path in files] == [own for own, _ in rows]

    def test_its_cost_is_known_before(self, plan, monkeypatch):
        monkeypatch.setattr(
            "data_synth.dataset_folder.explain", lambda _: SimpleNamespace(seconds=2.0, truth_bytes=1000)
        )
        cost = dataset_cost(plan)
        assert cost.truth_bytes == 7 * 500  # single precision
        assert cost.size_bytes == 7 * 2 * 2500 * 4
        # of a crack, a short healthy record as well
        assert cost.seconds == pytest.approx(2.0 * (4 + 2 * 3))


class TestRefusals:
    def test_a_folder_of_another_plan(self, copy):
        other = parse_plan(SMALL.replace("seed = 3", "seed = 4"))
        with pytest.raises(PlanError, match=r'started with another plan .*: there "seed = 3", here "seed = 4"\. Name'):
            make_dataset(other, copy)

    def test_a_folder_of_another_version(self, plan, copy):
        mark = copy / "plan.toml"
        mark.write_text(re.sub("hums-toolkit .*;", "hums-toolkit 0.0.1;", mark.read_text()))
        with pytest.raises(PlanError, match=r'or another version .*: there "# made by hums-toolkit 0\.0\.1'):
            make_dataset(plan, copy)

    def test_a_folder_of_other_files(self, plan, tmp_path):
        (tmp_path / "thesis.tex").touch()
        with pytest.raises(PlanError, match="holds files that do not belong to a dataset"):
            make_dataset(plan, tmp_path)
        with pytest.raises(RecordError, match=r"thesis\.tex is a file; name a folder"):
            make_dataset(plan, tmp_path / "thesis.tex")

    def test_a_disk_that_is_too_small(self, tmp_path, monkeypatch):
        plan = parse_plan(SMALL)  # 7 records of 2 channels, 2500 samples, 4 bytes: 140 000, and their truth
        need = 140_000 + dataset_cost(plan).truth_bytes
        monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=need - 1))
        with pytest.raises(PlanError, match=r"7 records of 0\.02 MB and [0-9.]+ MB of truth need .* GB are free at"):
            make_dataset(plan, tmp_path / "full")
        monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=need))
        make_dataset(plan, tmp_path / "full")
        # the estimate was enough: it counts lines before they are compressed
        files = sum(path.stat().st_size for path in (tmp_path / "full" / "shards").iterdir())
        layout = 7 * 100_000  # bytes of names, attributes and indices
        assert files < need + layout

    def test_a_record_that_cannot_be_simulated_is_named(self, tmp_path):
        plan = parse_plan(SMALL.replace("[500, 1500]", "[500, 5000]"))
        with pytest.raises(SceneError, match=r'record \d, class "\w+": rate_hz = 5000 is not above'):
            make_dataset(plan, tmp_path / "fast")

    def test_a_label_called_like_a_channel(self, tmp_path):
        plan = parse_plan(SMALL.replace("[500, 1500]", '[500, 1500], label = "b"'))
        with pytest.raises(ValueError, match='the label "b" has the name of a channel; choose another label'):
            make_dataset(plan, tmp_path / "named")

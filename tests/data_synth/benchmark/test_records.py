"""Splits, order and scenes of a benchmark, and a dataset of a few short records."""

import hashlib
import json
import re
import shutil
import tomllib
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import hums
from data_synth import PlanError, explain, load_plan, make_dataset, simulate
from data_synth.benchmark.conditions import FAULTS
from data_synth.benchmark.records import CLASSES, FURTHER, NAME, SPLITS, VERSION, BenchmarkRecords, gearboxes, paths
from data_synth.dataset import dataset_cost
from data_synth.plan import parse_plan
from data_synth.scene.faults import DIMENSIONS
from hums.jobs import Tally

PLAN = load_plan("benchmark-1")


@cache
def every_label():
    return [PLAN.labels(number) for number in range(PLAN.records)]


def to_six_digits(value):
    """Floats as text of six digits, as libraries of mathematics agree on."""
    if isinstance(value, dict):
        return {key: to_six_digits(each) for key, each in value.items()}
    if isinstance(value, list):
        return [to_six_digits(each) for each in value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class TestOrder:
    def test_it_is_what_was_asked_for(self):
        assert (PLAN.records, PLAN.duration_s, len(CLASSES)) == (1000, 10, 11)
        assert len(gearboxes()) >= 12
        assert len(SPLITS["test"].gearboxes) == 4

    def test_splits_share_no_gearbox_and_no_path(self):
        for pool, names in (("gearboxes", gearboxes()), ("paths", paths())):
            every = [name for split in SPLITS.values() for name in getattr(split, pool)]
            assert sorted(every) == sorted(names)
            assert len(set(every)) == len(every)
        for labels in every_label():
            assert labels["gearbox"] in SPLITS[labels["split"]].gearboxes
            assert labels["path"] in SPLITS[labels["split"]].paths

    def test_every_split_has_its_part_of_every_class(self):
        counts = Counter((labels["split"], labels["class"]) for labels in every_label())
        for name, split in SPLITS.items():
            for class_name, of_25 in (("healthy", 3), ("crack", 2), ("cage", 1)):
                assert counts[name, class_name] == 1000 * split.share / 20 * of_25 / 25

    def test_every_gearbox_is_healthy_and_has_every_fault(self):
        seen = {(labels["gearbox"], labels["class"]) for labels in every_label()}
        assert len(seen) == 16 * (len(CLASSES) + len(FURTHER))

    def test_the_order_is_shuffled(self):
        numbers = [CLASSES.index(labels["class"]) for labels in every_label() if labels["class"] in CLASSES]
        # of independent draws: 3 / sqrt(920)
        assert abs(np.corrcoef(numbers[1:], numbers[:-1])[0, 1]) < 0.1

    def test_a_record_does_not_depend_on_how_many_there_are(self):
        few = replace(PLAN, records=20)
        # as text, since NaN is not equal to itself
        assert str([few.labels(number) for number in range(20)]) == str(every_label()[:20])
        with pytest.raises(ValueError, match=r"no record 20; the 20 of this plan count from 0"):
            few.labels(20)

    def test_seeds_change_records_and_not_gearboxes(self):
        other = replace(PLAN, seed=2)
        assert [other.labels(n)["class"] for n in range(50)] != [labels["class"] for labels in every_label()[:50]]
        names = {labels["gearbox"]: labels["stages"] for labels in every_label()}
        assert all(names[other.labels(n)["gearbox"]] == other.labels(n)["stages"] for n in range(50))

    def test_severities_are_spread_and_columns_are_alike(self):
        severities = [x["severity"] for x in every_label() if x["class"] not in ("healthy", "missing tooth")]
        assert np.histogram(severities, bins=4, range=(0, 1))[0].min() > 0.2 * len(severities)
        assert len({tuple(labels) for labels in every_label()}) == 1

    def test_speed_and_load_vary_in_every_way(self):
        for kind in ("speed_kind", "torque_kind"):
            shares = Counter(labels[kind] for labels in every_label())
            # four ways of a quarter each: 250 of 1,000, +- 14
            assert len(shares) == 4
            assert min(shares.values()) > 200
        spread = [labels["load_share"] for labels in every_label()]
        assert (min(spread) < 0.2) & (max(spread) > 0.95)

    @pytest.mark.parametrize("name", [*CLASSES, *FURTHER])
    def test_the_scene_of_a_class_is_in_motion_and_has_the_size_of_its_label(self, name):
        number = next(n for n, labels in enumerate(every_label()) if labels["class"] == name)
        scene = PLAN.scene(number)
        assert (scene.rate_hz, scene.duration_s, scene.fidelity) == (25600, 10, "lateral")
        assert scene.imperfections.gears is not None
        sizes_mm = [] if name == "healthy" else [every_label()[number]["size_mm"]]
        assert [fault.initial_mm for fault in scene.faults] == sizes_mm

    def test_a_missing_tooth_is_gone_to_its_root(self):
        for labels in every_label():
            if labels["class"] == "missing tooth":
                stage = gearboxes()[labels["gearbox"]].stage_of(labels["component"])
                assert labels["size_mm"] == 2.25 * stage.module_mm  # addendum and dedendum of ISO 53
                assert labels["severity"] == 1.0  # gross by nature, as the card says

    def test_numbers_of_numpy_name_records_too(self):
        assert str(PLAN.labels(np.int64(3))) == str(PLAN.labels(3))

    def test_what_belongs_to_a_gearbox_is_in_all_its_records(self):
        numbers = [n for n, labels in enumerate(every_label()) if labels["gearbox"] == "g01"][:5]
        tables = [PLAN.scene(number).imperfections for number in numbers]
        assert len({(each.gears, each.imbalance, each.bearings, each.neighbour.speed_hz) for each in tables}) == 1
        assert len({each.knocks for each in tables}) == 5
        assert len({PLAN.machine_seed_of(number) for number in numbers}) == 1

    def test_a_version_keeps_its_records(self):
        # what changes this digest is another VERSION: all labels, and the scenes of a record of each class
        numbers = [next(n for n, labels in enumerate(every_label()) if labels["class"] == name) for name in CLASSES]
        scenes = [tomllib.loads(PLAN.scene(number).to_toml()) for number in numbers]
        digest = hashlib.sha256(json.dumps(to_six_digits([every_label(), scenes])).encode()).hexdigest()
        assert (VERSION, digest[:16]) == ("2.8", "c0c9089154fd2894")


class TestPlan:
    def test_the_text_is_a_plan_that_says_the_same(self):
        assert parse_plan(PLAN.text) == PLAN

    def test_another_version_is_refused(self):
        this = f'plan: version = "9" of benchmark-1, but this program makes {re.escape(VERSION)}'
        with pytest.raises(PlanError, match=this):
            parse_plan(PLAN.text.replace(f'"{VERSION}"', '"9"'))


@pytest.fixture(scope="module")
def small():
    # crack, inner race and healthy, all of g09, whose teeth meet again soonest: errors of its teeth are soon tabulated
    return BenchmarkRecords(records=3, seed=82457, duration_s=0.2)


@pytest.fixture(scope="module")
def folder(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("benchmark") / "small"
    assert make_dataset(small, folder) == Tally(done=3, kept=0)
    return folder


class TestDataset:
    def test_labels_are_columns(self, small, folder):
        opened = hums.open_dataset(folder)
        assert opened["input vertical"].shape == (3, 5120)
        for number in range(3):
            labels = small.labels(number)
            for name, value in labels.items():
                assert opened[name][number].item() == pytest.approx(value, nan_ok=True)
            healthy = labels["class"] == "healthy"
            assert np.isnan(opened["detectability_db"][number].item()) == healthy

    def test_a_record_has_its_scene_and_its_fault_alone(self, small, folder):
        for number in range(3):
            record = hums.dataset_record(folder, number)
            assert record.attrs["truth_scene"] == small.scene(number).to_toml()
            assert record["truth_fault_kind"].size == (small.labels(number)["class"] != "healthy")

    def test_a_missing_file_is_made_again_to_the_byte(self, small, folder, tmp_path):
        copy = tmp_path / "copy"
        shutil.copytree(folder, copy)
        before = (copy / "shards" / "000002.h5").read_bytes()
        (copy / "shards" / "000002.h5").unlink()
        (copy / "index.h5").unlink()
        assert make_dataset(small, copy) == Tally(done=1, kept=2)
        assert (copy / "shards" / "000002.h5").read_bytes() == before
        assert (copy / "index.h5").read_bytes() == (folder / "index.h5").read_bytes()

    def test_the_card_has_every_class_split_and_gearbox(self, folder):
        card = (folder / "data-card.md").read_text(encoding="utf-8")
        for name in (*CLASSES, *FURTHER, *SPLITS, *gearboxes()):
            assert f"| {name} |" in card
        rows = {line.split(" | ")[0].removeprefix("| "): line for line in card.splitlines()}
        assert all(DIMENSIONS[family.kind] in rows[name] for name, family in FAULTS.items())
        assert max(len(line) for line in card.splitlines() if not line.startswith("|")) <= 120

    def test_the_card_has_the_score_of_the_page(self, folder):
        page = (Path(__file__).parents[3] / "docs/benchmarks/dataset.md").read_text(encoding="utf-8")
        page = " ".join(page.split())
        (score,) = re.findall(r"Balanced accuracy ([\d.]+) on test", page)
        assert f"{NAME} {VERSION}, seed 1" in page
        assert f"accuracy of {score} on the test" in (folder / "data-card.md").read_text(encoding="utf-8")

    def test_a_folder_says_what_its_files_add_up_to(self, folder):
        rows = [line.split("  ") for line in (folder / "checksums.sha256").read_text(encoding="utf-8").splitlines()]
        files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "checksums.sha256")
        assert [name for _, name in rows] == [path.relative_to(folder).as_posix() for path in files]
        assert [hashlib.sha256(path.read_bytes()).hexdigest() for path in files] == [own for own, _ in rows]

    def test_its_cost_is_known_before(self, small, monkeypatch):
        assert explain(small.scene(2)).seconds > 0
        # where there is a fault, a short record is made as well, for its detectability
        monkeypatch.setattr("data_synth.dataset.explain", lambda _: SimpleNamespace(seconds=2.0, truth_bytes=1000))
        cost = dataset_cost(small)
        assert cost.truth_bytes == 3 * 500  # single precision
        assert cost.size_bytes == 3 * 5120 * 4
        assert cost.seconds == pytest.approx(2.0 * (2 + 2 + 1))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CLASSES, *FURTHER])
def test_every_class_can_be_simulated(name):
    number = next(n for n, labels in enumerate(every_label()) if (labels["class"], labels["gearbox"]) == (name, "g09"))
    plan = replace(PLAN, duration_s=0.1)
    faulty, healthy = (
        simulate(plan.scene(number, healthy=healthy), seed=1)["input vertical"].values for healthy in (False, True)
    )
    assert np.all(np.isfinite(faulty))
    assert np.array_equal(faulty, healthy) == (name == "healthy")

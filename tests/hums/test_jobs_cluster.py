"""On a Dask cluster jobs, datasets and fleets leave what they leave in one process."""

import sys
from concurrent.futures import CancelledError
from importlib.util import find_spec

import clusters
import pytest

import hums
from data_synth import make_dataset
from data_synth.plan import parse_plan
from hums import jobs
from hums.cli import main
from hums.fleet.fleet_analysis import analyze_fleet
from hums.jobs import Cluster, Job, JobError, Tally, run_jobs

# Found and not imported, which takes each worker of pytest a second.
without = pytest.mark.skipif(find_spec("distributed") is None, reason="dask[distributed] is not installed")
pytestmark = [pytest.mark.slow, without]

JOBS = [Job(name=f"{item}.txt", item=item) for item in range(6)]
PLAN = """
records = 3
seed = 3
records_per_shard = 1
[scene]
gearbox = "two-stage"
rate_hz = 5000
duration_s = 0.5
fidelity = "kinematic"
speed = { link = "input", rpm = 600 }
tachometer = { link = "input", pulses_per_rev = 1 }
sensor = [{ name = "a", on = "input bearing", units = "g" }]
[[class]]
name = "healthy"
[[class]]
name = "noisy"
change = { noise = { rms = 1.0 } }
"""


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs, "_TIMEOUT_S", clusters.START_S)
        with clusters.dask_cluster(tmp_path_factory.mktemp("cluster"), nanny=True) as address:
            yield Cluster(address=address)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The dataset that one process makes."""
    folder = tmp_path_factory.mktemp("alone") / "made"
    make_dataset(parse_plan(PLAN), folder)
    return folder


def contents(folder):
    """Every file of a folder, byte for byte."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_jobs_leave_the_same_files(tmp_path, cluster):
    assert run_jobs(clusters.write_item, JOBS, folder=tmp_path, workers=cluster) == Tally(done=6, kept=0)
    assert contents(tmp_path) == {f"{item}.txt": f"item {item}".encode() for item in range(6)}


def test_a_job_that_kills_its_worker_is_found_and_the_rest_is_done(tmp_path, cluster):
    killed = []
    found = {"folder": tmp_path, "workers": cluster, "when_killed": lambda item, _: killed.append(item)}
    run_jobs(clusters.die_at_three, JOBS, **found)
    assert killed == [3]
    assert contents(tmp_path) == {f"{item}.txt": f"item {item}".encode() for item in range(6) if item != 3}


def test_a_cluster_without_the_package_is_named(tmp_path, cluster, monkeypatch):
    (tmp_path / "only_here.py").write_text("def write(item, path):\n    path.write_text(str(item))\n")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "out").mkdir()
    from only_here import write  # noqa: PLC0415 - exists from now on

    with pytest.raises(JobError, match=r"cannot load the jobs \(.*only_here.*Install"):
        run_jobs(write, JOBS, folder=tmp_path / "out", workers=cluster)


def test_the_command_dataset_leaves_the_same_bytes(tmp_path, alone, cluster, monkeypatch, capsys):
    (tmp_path / "plan.toml").write_text(PLAN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["hums", "dataset", "plan.toml", "-o", "out", "--scheduler", cluster.address])
    assert main() == 0
    assert "out: 3 records\nclasses: healthy, noisy\n" in capsys.readouterr().out
    assert contents(tmp_path / "out") == contents(alone)


def test_a_fleet_has_the_same_tables(tmp_path, alone, cluster):
    settings = hums.AnalysisSettings(most_tracks=0, envelope_band_hz=None, pictures=False)
    for folder, more in (("alone", {}), ("cluster", {"workers": cluster})):
        result = analyze_fleet([alone], "two-stage", tmp_path / folder, settings=settings, **more)
        assert (result.records, result.failed) == (3, 0)
    for name in ("fleet.h5", "fleet.csv", "trends.csv"):
        assert (tmp_path / "cluster" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()


def test_a_scheduler_lost_on_the_way_is_a_sentence(cluster):
    # Dask cancels the jobs of a scheduler that does not come back
    with pytest.raises(JobError, match="was lost"), jobs._cluster(cluster.address):
        raise CancelledError

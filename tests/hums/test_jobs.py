import os
import signal
import subprocess
import sys
import time
from multiprocessing import get_context
from pathlib import Path

import clusters
import partial_files
import pytest

from hums import jobs
from hums.jobs import Cluster, Job, JobError, Processes, Serial, Tally, cpu_limit, run_jobs

JOBS = [Job(name=f"{item}.txt", item=item) for item in range(6)]
posix = pytest.mark.skipif(os.name != "posix", reason="signals and locks of POSIX")


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir()}


WRITTEN = {f"{item}.txt": f"item {item}" for item in range(6)}


class TestWorkers:
    @pytest.mark.parametrize("workers", [Serial(), Processes(count=2)])
    def test_all_make_the_same_files(self, tmp_path, workers):
        assert run_jobs(clusters.write_item, JOBS, folder=tmp_path, workers=workers) == Tally(done=6, kept=0)
        assert contents(tmp_path) == WRITTEN

    def test_processes_have_one_thread_and_ours_keeps_its_own(self, tmp_path, monkeypatch):
        monkeypatch.setenv("OMP_NUM_THREADS", "7")
        monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
        run_jobs(clusters.write_threads, JOBS[:1], folder=tmp_path, workers=Processes(count=1))
        assert contents(tmp_path) == {"0.txt": "1"}
        assert os.environ["OMP_NUM_THREADS"] == "7"
        assert "MKL_NUM_THREADS" not in os.environ


class TestGoingOn:
    def test_what_is_there_is_not_made_again(self, tmp_path):
        (tmp_path / "2.txt").write_text("made before")
        assert run_jobs(clusters.write_item, JOBS, folder=tmp_path, workers=Serial()) == Tally(done=5, kept=1)
        assert contents(tmp_path) == WRITTEN | {"2.txt": "made before"}

    @pytest.mark.parametrize("workers", [Serial(), Processes(count=2)])
    def test_what_was_made_before_an_error_stays(self, tmp_path, workers):
        with pytest.raises(ValueError, match="three is too many"):
            run_jobs(clusters.fail_at_three, JOBS, folder=tmp_path, workers=workers)
        made = contents(tmp_path)
        assert made.items() <= WRITTEN.items()
        assert {"0.txt", "1.txt"} <= made.keys()
        run_jobs(clusters.write_item, JOBS, folder=tmp_path, workers=Serial())
        assert contents(tmp_path) == WRITTEN

    def test_half_written_files_of_a_killed_run_are_removed(self, tmp_path):
        part = partial_files.of_a_dead_writer(tmp_path)
        run_jobs(clusters.write_item, JOBS, folder=tmp_path, workers=Serial())
        assert not part.exists()
        assert contents(tmp_path) == WRITTEN

    @posix
    def test_killed_outright_it_leaves_no_worker(self, tmp_path):
        (tmp_path / "out").mkdir()
        code = (
            "import clusters; from pathlib import Path; from hums.jobs import *\n"
            "if __name__ == '__main__':\n"
            "    jobs = [Job(name=f'{i}', item=i) for i in range(4)]\n"
            "    run_jobs(clusters.note_and_sleep, jobs, folder=Path('out'), workers=Processes(count=2))\n"
        )
        (tmp_path / "script.py").write_text(code)
        environment = os.environ | {"PYTHONPATH": f"{clusters.ROOT}{os.pathsep}{clusters.ROOT / 'tests'}"}
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        run = subprocess.Popen([sys.executable, "script.py"], cwd=tmp_path, env=environment, **quiet)
        self.until(lambda: len(list(tmp_path.glob("worker *"))) == 2)
        pids = [int(path.name.split()[1]) for path in tmp_path.glob("worker *")]
        run.send_signal(signal.SIGKILL)
        run.wait()
        self.until(lambda: not any(self.runs(pid) for pid in pids))

    @staticmethod
    def until(condition):
        give_up = time.monotonic() + 300  # on a busy machine
        while not condition():
            assert time.monotonic() < give_up
            time.sleep(0.02)

    @staticmethod
    def runs(pid):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
        status = Path(f"/proc/{pid}/stat")  # a dead child that nobody has waited for still has a number
        return not status.exists() or status.read_text().rsplit(")", 1)[1].split()[0] != "Z"


class TestQueue:
    def test_the_bar_counts_what_is_in_the_jobs(self, tmp_path, capsys):
        sized = [Job(name=str(item), item=item, size=10) for item in range(3)]
        (tmp_path / "0").write_text("made before")
        run_jobs(clusters.write_item, sized, folder=tmp_path, workers=Serial(), title="records")
        out, err = capsys.readouterr()
        assert out == ""
        assert "records" in err
        assert "30/30" in err


class TestKillers:
    @pytest.mark.parametrize("count", [1, 2])
    def test_a_job_that_kills_its_process_is_found_and_the_rest_is_done(self, tmp_path, count):
        # it takes those down that run beside it and wait for its process; they are done again
        killed = []
        tally = run_jobs(
            clusters.die_at_three, JOBS, folder=tmp_path, workers=Processes(count=count),
            when_killed=lambda item, path: killed.append((item, path.name)),
        )  # fmt: skip
        assert killed == [(3, "3.txt")]
        assert contents(tmp_path) == {name: text for name, text in WRITTEN.items() if name != "3.txt"}
        assert tally == Tally(done=6, kept=0)

    def test_a_process_killed_from_outside_costs_nothing(self, tmp_path):
        (tmp_path / "out").mkdir()
        run_jobs(clusters.die_once, JOBS, folder=tmp_path / "out", workers=Processes(count=2))
        assert contents(tmp_path / "out") == WRITTEN

    def test_processes_that_do_not_start_blame_no_job(self, tmp_path, monkeypatch):
        monkeypatch.setattr(jobs, "_prepare_worker", clusters.die_at_start)
        with pytest.raises(JobError, match="die as soon as they start"):
            run_jobs(
                clusters.write_item, JOBS, folder=tmp_path, workers=Processes(count=1), when_killed=lambda *_: None
            )
        assert not contents(tmp_path)


class TestRefusals:
    @posix
    def test_a_second_run_in_one_folder(self, tmp_path):
        with jobs.locked(tmp_path), pytest.raises(JobError, match=r"another run is using .*; wait until"):
            run_jobs(clusters.write_item, JOBS, folder=tmp_path, workers=Serial())
        run_jobs(clusters.write_item, JOBS, folder=tmp_path, workers=Serial())  # it let go

    def test_a_worker_that_dies(self, tmp_path):
        with pytest.raises(JobError, match=r"a worker process died twice at 0\.txt.*run the same command again"):
            run_jobs(clusters.die, JOBS, folder=tmp_path, workers=Processes(count=1))

    def test_a_worker_with_another_disk(self, tmp_path):
        with pytest.raises(JobError, match=r"0\.txt, but it is not on this machine"):
            run_jobs(clusters.write_nothing, JOBS[:1], folder=tmp_path, workers=Processes(count=1))

    def test_no_processes(self):
        with pytest.raises(JobError, match=r"workers = 0: at least 1"):
            Processes(count=0)

    def test_no_scheduler(self, tmp_path, monkeypatch):
        pytest.importorskip("dask.distributed")
        monkeypatch.setattr(jobs, "_TIMEOUT_S", 0.5)
        with pytest.raises(JobError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9 .*dask scheduler"):
            run_jobs(clusters.write_item, JOBS, folder=tmp_path, workers=Cluster(address="tcp://127.0.0.1:9"))

    def test_no_dask(self, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "dask.distributed", None)
        with pytest.raises(JobError, match=r'pip install "hums-toolkit\[dask\]"'):
            run_jobs(clusters.write_item, JOBS, folder=tmp_path, workers=Cluster(address="tcp://127.0.0.1:9"))


def spin(seconds):
    with cpu_limit(seconds):
        while True:
            pass


@pytest.mark.skipif(sys.platform != "linux", reason="forks")
def test_a_worker_that_hangs_is_ended():
    process = get_context("fork").Process(target=spin, args=(0.01,))
    process.start()
    process.join(60)
    assert process.exitcode == -signal.SIGXCPU

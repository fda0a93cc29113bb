"""What users get, in one table: python benchmarks/scoreboard.py [--quick | --full] [--first N] [--tree PATH].

Prints a row for each outcome: what is measured, the figure now, that of commit a135c42, the limit, and whether it
holds; ends with status 1 where one does not, other than misses known with their figure. `--quick` takes three minutes
on two cores and judges no times, since it runs on every machine and beside other work; plain takes ten on an idle one,
`--full` hours.
`--first` advances the numbers of synthetic records, which are the seeds of all they hold. `--tree` measures another
working tree with the same records; the figures of a135c42 are made with

    git worktree add ../baseline a135c42
    python benchmarks/scoreboard.py --quick --tree ../baseline --save && \
    python benchmarks/scoreboard.py --tree ../baseline --save

Measured records are those of the folder in HUMS_REAL_DATA or `--data`; without one their rows are left out. `--page`
writes the table to docs/benchmarks/scoreboard.md.
"""

import argparse
import json
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )
    if "--tree" in sys.argv[:-1]:  # before anything of this tree is imported
        place = sys.argv.index("--tree")
        os.environ["PYTHONPATH"] = str(Path(sys.argv[place + 1]).resolve())
        words = [sys.executable, __file__, *sys.argv[1:place], *sys.argv[place + 2 :]]
        sys.exit(subprocess.run(words, check=False).returncode)  # noqa: S603

from board import costs, declarations, estimates, fleets, speeds, verdicts_of_records
from board.sections import Effort, Section, Task
from board.table import Figure, saved, table

COMMIT = "a135c42"
BASELINE = Path(__file__).parent / "results" / f"scoreboard_{COMMIT}.json"
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "scoreboard.md"
NOTE = """\
# Scoreboard

Made by `python benchmarks/scoreboard.py{flag} --first {first} --page`: what users get, one row per outcome, compared
with the figures of commit {commit}; `benchmarks/results/scoreboard_{commit}.json` holds these and the commands that
made them. Before a mechanism is added or removed, there must be a row that shows its effect.

`--quick` takes three minutes on two cores, does not judge times, and is part of `.ci/run`; without it, ten minutes;
`--full` takes hours. `--first N` advances the seeds of synthetic records, so that nothing is tuned to them. `--tree
PATH` measures another working tree on the same records: the figures of {commit} come from `git worktree add ../baseline
{commit}`, and `--tree ../baseline --save`.

**Limits.** Measured records never change: the figure on {commit} is the limit. The limit of a count of synthetic
records is what an unchanged tree meets with other records in all but one case in a hundred, by the binomial
distribution with the share found on {commit}. Averages may be worse by four standard errors of their difference, from
the scatter between records. Deterministic errors, and times in units of `numpy.fft.rfft` of the same record in the same
run, may be a multiple of {commit}, from 1.01 for errors of trackers to 2 for times. Two figures that were deliberately
traded for less code have limits of their own: the power that the ground truth does not cover, and the time of the
causal filter. Budgets of the code are in `tests/test_architecture.py`. Where verdicts on {commit} are poor, as with
wrong declarations, the limit only requires that they do not get worse.

The second simulator (`benchmarks/second_simulator.py`) shares no code with `data_synth`; its numbers below 200 were
inspected while verdicts were developed. In four of ten of its healthy machines, something knocks on a shaft, which one
record cannot distinguish from a chipped tooth: the verdict says so, and has a separate row.

"""
SECTIONS: tuple[Section, ...] = (
    *verdicts_of_records.SECTIONS,
    declarations.SECTION,
    *speeds.SECTIONS,
    fleets.SECTION,
    *estimates.SECTIONS,
    *costs.SECTIONS,
)


def _tried(task: Task) -> Any:  # noqa: ANN401
    """Return what a task finds, or the error that ended it: one broken measurement must not hide the others."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return task()
        except Exception as error:  # noqa: BLE001
            return RuntimeError(f"{type(error).__name__}: {error}")


def measured(sections: Sequence[Section], effort: Effort, *, jobs: int) -> Iterator[dict[str, Figure | str]]:
    """Yield the figures of each section, or for its rows the sentence that ended their measurement."""
    together = [section for section in sections if not section.alone]
    tasks = {section.name: list(section.tasks(effort)) for section in sections}
    with ProcessPoolExecutor(jobs) as pool:
        running = {section.name: [pool.submit(_tried, task) for task in tasks[section.name]] for section in together}
        for section in together:
            yield _figures(section, [each.result() for each in running[section.name]])
    for section in sections:
        if section.alone:
            yield _figures(section, [_tried(task) for task in tasks[section.name]])


def _figures(section: Section, results: list[Any]) -> dict[str, Figure | str]:
    """Return the figures of a section; all its rows say why where a task failed."""
    for result in results:
        if isinstance(result, RuntimeError):
            return dict.fromkeys((row.name for row in section.rows), f"failed: {str(result)[:120]}")
    print(f"{section.name}: {len(results)} tasks", file=sys.stderr, flush=True)  # noqa: T201
    return dict(section.figures(results)) if results else {}


def baseline(size: str) -> dict[str, Figure]:
    """Return the figures of the baseline at a size, and at those below it of rows that were not measured at it."""
    sizes = json.loads(BASELINE.read_text(encoding="utf-8"))["sizes"] if BASELINE.exists() else {}
    order = ("quick", "plain", "full")
    held = [sizes.get(name, {"figures": {}})["figures"] for name in order[: order.index(size) + 1]]
    return {name: Figure(**figure) for figures in held for name, figure in figures.items()}


def save(size: str, first: int, figures: dict[str, Figure | str]) -> None:
    """Save figures as those of the baseline at a size."""
    held = json.loads(BASELINE.read_text(encoding="utf-8")) if BASELINE.exists() else {"commit": COMMIT, "sizes": {}}
    flag = "" if size == "plain" else f" --{size}"
    command = f"python benchmarks/scoreboard.py{flag} --first {first} --tree ../baseline --save"
    held["sizes"].setdefault(size, {"figures": {}})
    held["sizes"][size] |= {"command": command, "first": first}
    held["sizes"][size]["figures"] |= saved(figures)
    BASELINE.parent.mkdir(exist_ok=True)
    BASELINE.write_text(json.dumps(held, indent=1) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None, sections: Sequence[Section] = SECTIONS) -> int:
    """Measure, print the table, and return 1 where a limit does not hold that is not known to be missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    sizes = parser.add_mutually_exclusive_group()
    sizes.add_argument("--quick", dest="size", action="store_const", const="quick", default="plain")
    sizes.add_argument("--full", dest="size", action="store_const", const="full")
    parser.add_argument("--first", type=int, default=0, help="number of the first synthetic record")
    parser.add_argument("--tree", type=Path, help="measure this working tree")
    parser.add_argument("--only", action="append", choices=[section.name for section in sections])
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side")
    parser.add_argument("--data", type=Path, default=os.environ.get("HUMS_REAL_DATA"), help="measured records")
    parser.add_argument("--save", action="store_true", help="save the figures as those of the baseline")
    parser.add_argument("--page", action="store_true", help="write the table to docs/benchmarks/scoreboard.md")
    given = parser.parse_args(arguments)
    begun = time.perf_counter()
    chosen = [section for section in sections if not given.only or section.name in given.only]
    data = None if given.data is None else Path(given.data)
    figures: dict[str, Figure | str] = {}
    for found in measured(chosen, Effort(size=given.size, first=given.first, data=data), jobs=given.jobs):
        figures |= found
        if given.save:
            save(given.size, given.first, found)
    rows = [row for section in sections for row in section.rows]
    lines, holds = table(rows, figures, baseline(given.size), baseline=COMMIT, times=given.size != "quick")
    if given.page:
        flag = "" if given.size == "plain" else f" --{given.size}"
        flag += "" if Path(__file__).resolve().parents[1] == estimates.TREE else " --tree ../baseline"
        note = NOTE.format(flag=flag, first=given.first, commit=COMMIT)
        PAGE.write_text(note + "\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))  # noqa: T201
    said = "all hold, or miss as known" if holds else "not all hold"
    print(f"\n{given.size}, {time.perf_counter() - begun:.0f} s: {said}")  # noqa: T201
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())

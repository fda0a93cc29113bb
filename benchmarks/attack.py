"""Odd calls of every exported function, damaged files and kills: python benchmarks/attack.py [FOLDER].

Writes attack.md into FOLDER (default docs/benchmarks).
"""

import faulthandler
import os
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

from attacks.call_cases import Case, all_cases
from attacks.damaged_files import COLUMNS, attack_files
from attacks.kills import kill_saves, kill_workers
from attacks.odd_calls import answers_that_differ, failure, odd_calls

KILL_S = 60
MOST_SHOWN = 40
NOTE = """\
Made by `python benchmarks/attack.py`. Each call has one odd argument: a wrong type, NaN, infinities, nothing, one
sample, a constant, a table, sizes of 1e-300 to 1e300. It may return, or raise a ValueError or TypeError in a sentence
of ours; a warning, another exception, 5 s of processor, or 1 GB beyond what is used, is wrong. `answers`: results
that differ where the same numbers come as float32, integers, big-endian, strided or read-only, or scaled by 1e6 and
1e-6."""
HEADER = "| package | functions | calls | wrong | answers that differ | s |\n|---|---|---|---|---|---|"


def package_of(case: Case) -> str:
    """Return the package and sub-package of a function."""
    return ".".join(case.function.__module__.split(".")[:2])


FILES_NOTE = """\
## Damaged files

A small valid file of each reader is cut off, or has bits flipped, bytes replaced, or sizes written over it (seed 20),
and is read by `ReaderProcess`. `crash contained` and `stopped`: the process ended, in a sentence that names the file;
`wrong`: another exception, a message without the name of the file, or, of a record, other values without a warning."""
FILES, SAVES, RUNS = 1000, 500, 10  # files of each reader, saves, runs of jobs


def damage(
    scratch: Path, *, files: int = FILES, saves_killed: int = SAVES, runs_killed: int = RUNS
) -> tuple[str, bool]:
    """Return the part of the page on damaged files and on kills, and whether anything was wrong."""
    rows, wrong = attack_files(scratch, count=files)
    saves = kill_saves(scratch, count=saves_killed)
    dead, runs = kill_workers(scratch / "runs", count=runs_killed)
    header = f"| reader | files | {' | '.join(COLUMNS)} | s |\n|{'---|' * (len(COLUMNS) + 3)}"
    kills_text = (
        f"{saves_killed} saves of a record over another were killed (-9): {len(saves)} times something was lost or "
        f"left behind. {dead} workers of {runs_killed} runs of jobs were killed: {len(runs)} runs were not whole."
    )
    every = [*wrong, *saves, *runs]
    shown = [f"- `{line[:200].replace('`', '')}`".replace("\n", " ") for line in every[:MOST_SHOWN]]
    page = "\n".join([FILES_NOTE, "", header, *rows, "", "## Kills", "", kills_text, "", *shown])
    return page.rstrip() + "\n", bool(every)


def main(folder: Path, *, cases: list[Case] | None = None) -> int:
    """Make every odd call and write the page; return 1 where a call came out wrong."""
    folder = folder.resolve()
    with tempfile.TemporaryDirectory() as scratch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        os.chdir(scratch)
        found = all_cases(Path(scratch)) if cases is None else cases
        counts, seconds, wrong = Counter[tuple[str, str]](), Counter[str](), []
        for case in found:
            package, begun = package_of(case), time.process_time()
            calls = odd_calls([case])
            for odd in calls:
                faulthandler.dump_traceback_later(KILL_S, exit=True)
                if outcome := failure(odd):
                    wrong.append(f"{odd}: {outcome}")
                    counts[package, "wrong"] += 1
            faulthandler.cancel_dump_traceback_later()
            counts[package, "functions"] += 1
            counts[package, "calls"] += len(calls)
            counts[package, "differ"] += len(list(answers_that_differ(case)))
            seconds[package] += time.process_time() - begun
        about_damage, damaged = damage(Path(scratch))
        os.chdir(folder)
    rows = [
        f"| {name} | " + " | ".join(str(counts[name, what]) for what in ("functions", "calls", "wrong", "differ"))
        + f" | {seconds[name]:.0f} |"
        for name in sorted(seconds)
    ]  # fmt: skip
    shown = [f"- `{line[:200].replace('`', '')}`".replace("\n", " ") for line in wrong[:MOST_SHOWN]]
    page = "\n".join(["# Odd calls", "", NOTE, "", HEADER, *rows, "", *shown, "", about_damage])
    (folder / "attack.md").write_text(page, encoding="utf-8")
    print(page)  # noqa: T201 - what the command is for
    return int(bool(wrong) or damaged)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/benchmarks")))

"""Odd calls, damaged files, kills, and tries of the commands: python benchmarks/attack.py [FOLDER].

Writes attack.md and tries.md into FOLDER (default docs/benchmarks), with --tries the latter alone. What each part finds
is kept in --kept, if named: a run that was stopped goes on there.
"""

import argparse
import faulthandler
import os
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

from attacks.call_cases import Case, all_cases
from attacks.damaged_files import COLUMNS, FOREIGN, KINDS, attack_kind, file_rows
from attacks.kills import WRITERS, kill_saves, kill_workers
from attacks.odd_calls import answers_that_differ, failure, odd_calls
from attacks.parts import kept_or_made
from attacks.tries import CLASSES, make_tries, try_rows

KILL_S = 60
MOST_SHOWN = 40
PER_PART = 500
FILES, OTHER_FILES = 8000, 5000  # of each kind that other programs write, and of each that we or users do
SAVES = {"record": 500, "analysis": 50, "state": 350}
RUNS, RUNS_PER_PART = 100, 10  # of jobs, a worker of each killed
CALLS_NOTE = """\
Made by `python benchmarks/attack.py`. Each call has one unusual argument: a wrong type, NaN, infinities, an empty
array, one sample, a constant, a table, sizes of 1e-300 to 1e300. It may return, or raise a ValueError or TypeError with
a message of ours; a warning, another exception, 5 s of CPU time or 1 GB of additional memory is wrong. `answers that
differ`: results that change if the same numbers are float32, integers, big-endian, strided or read-only, or scaled by
1e6 and 1e-6."""
CALLS_HEADER = "| package | functions | calls | wrong | answers that differ | s |\n|---|---|---|---|---|---|"
FILES_NOTE = """\
A small valid file of each kind is truncated, or has bits flipped, bytes replaced, or sizes overwritten; in text files,
values are also replaced by unusual ones, and lines omitted or duplicated (seed 20). Signals, records and analyses are
read by `ReaderProcess`, with at most 5 s of CPU time and 1 GB per file, the last four kinds in the calling process.
`sentence`: refused with a message; `crash contained` and `stopped`: the reader process ended, with a message that names
the file; `wrong`: another exception, a message without the name of the file, or, for a record, different values without
a warning. Times were measured under other load."""

TRIES_NOTE = """\
# Robustness of the commands

Made by `python benchmarks/attack.py --tries`. Each try runs a command in a separate folder (seed 20). Its exit status
must be one of those in `docs/reference.md`, with a message unless it is 0; input files, and files that hums did not
write, must not change, except outputs under `--force`; no temporary file may remain; no cell of a table may start a
formula, and no name may run a script or control the terminal. `output paths`: each file of each command as a text, a
folder, a pipe, a link, another name of an input; `names`: of components, channels, machines, files, options;
`contradicting metadata`: rates stated in a file that differ from declared ones; the trusted one must apply;
`interrupts`: SIGINT, SIGTERM or SIGKILL at a random instant; the command is then repeated, and must end with 0 and the
same tables; `races`: two commands at once, or inputs truncated or emptied during one, which is then repeated. Times
were measured under other load."""
TRIES_HEADER = (
    "| class | tries | 0 | 1 | 2 | 3 | 130 | killed | failed | s |\n|---|---|---|---|---|---|---|---|---|---|"
)


def calls_of(cases: list[Case]) -> dict[str, Any]:
    """Make every odd call; return counts and seconds by package, and what went wrong."""
    counts: dict[str, Counter[str]] = {}
    wrong = []
    for case in cases:
        count = counts.setdefault(".".join(case.function.__module__.split(".")[:2]), Counter())
        calls, begun = odd_calls([case]), time.process_time()
        for odd in calls:
            faulthandler.dump_traceback_later(KILL_S, exit=True)
            if outcome := failure(odd):
                wrong.append(f"{odd}: {outcome}")
                count["wrong"] += 1
        faulthandler.cancel_dump_traceback_later()
        differing = list(answers_that_differ(case))
        count.update(functions=1, calls=len(calls), differ=len(differing))
        count["ms"] += round(1000 * (time.process_time() - begun))
        wrong += differing
    return {"counts": counts, "wrong": wrong}


def call_rows(counts: dict[str, dict[str, int]]) -> list[str]:
    """Return a row of the table for each package."""
    return [
        f"| {name} | " + " | ".join(str(count.get(what, 0)) for what in ("functions", "calls", "wrong", "differ"))
        + f" | {count['ms'] / 1000:.0f} |"
        for name, count in sorted(counts.items())
    ]  # fmt: skip


def attack(kept: Path, scratch: Path, *, files: int) -> tuple[str, bool]:
    """Make every part that is not kept; return the page, and whether anything was wrong."""
    calls = kept_or_made(kept, "calls", lambda: calls_of(all_cases(scratch)))
    saves = {
        kind: kept_or_made(
            kept, f"saves {kind}", lambda kind=kind: kill_saves(scratch / "saves", count=SAVES[kind], kind=kind)
        )
        for kind in WRITERS
    }
    parts = [
        kept_or_made(
            kept, f"{kind} {part}",
            lambda kind=kind, number=number, part=part: attack_kind(
                kind, scratch, count=PER_PART, seed=(20, number, part)
            ),
        )
        for part in range(files // PER_PART)
        for number, kind in enumerate(KINDS)
        if kind in FOREIGN or part < OTHER_FILES // PER_PART
    ]  # fmt: skip
    runs = [
        kept_or_made(
            kept, f"workers {part}",
            lambda part=part: kill_workers(scratch / f"runs {part}", count=RUNS_PER_PART, seed=part),
        )
        for part in range(RUNS // RUNS_PER_PART)
    ]  # fmt: skip
    parts.sort(key=lambda part: KINDS.index(part["kind"]))
    workers = sum(killed for killed, _ in runs)
    lost = [line for found in saves.values() for line in found] + [line for _, found in runs for line in found]
    wrong = [*calls["wrong"], *(line for part in parts for line in part["wrong"]), *lost]
    files_header = f"| reader | files | {' | '.join(COLUMNS)} | s |\n|{'---|' * (len(COLUMNS) + 3)}"
    kills = (
        f"{sum(SAVES.values()) + workers} processes were killed (-9): {SAVES['record']} while saving a record over "
        f"another, {SAVES['analysis']} while saving an analysis, {SAVES['state']} the state of a watched machine, and "
        f"{workers} workers of {RUNS} runs of jobs. Files were lost, duplicated or left behind in {len(lost)} cases."
    )
    page = ["# Edge cases", "", CALLS_NOTE, "", CALLS_HEADER, *call_rows(calls["counts"]), "", "## Damaged files", "",
            f"{sum(part['count'] for part in parts):,} files. {FILES_NOTE}", "", files_header, *file_rows(parts), "",
            "## Killed processes", "", kills, "", *_shown(wrong)]  # fmt: skip
    return "\n".join(page).rstrip() + "\n", bool(wrong)


def _shown(wrong: list[str]) -> list[str]:
    return [f"- `{line[:200].replace('`', '')}`".replace("\n", " ") for line in wrong[:MOST_SHOWN]]


def attack_commands(kept: Path, scratch: Path) -> tuple[str, bool]:
    """Make every class of tries that is not kept; return the page, and whether anything was wrong."""
    parts = [kept_or_made(kept, f"tries {name}", lambda name=name: make_tries(name, scratch)) for name in CLASSES]
    wrong = [line for part in parts for line in part["wrong"]]
    count = f"{sum(part['count'] for part in parts):,} tries, {len(wrong)} failed."
    page = [TRIES_NOTE, "", count, "", TRIES_HEADER, *try_rows(parts), "", *_shown(wrong)]
    return "\n".join(page).rstrip() + "\n", bool(wrong)


def main(folder: Path, *, kept: Path | None = None, files: int = FILES, tries: bool = False) -> int:
    """Write the pages; return 1 where anything came out wrong."""
    folder, status = folder.resolve(), 0
    with tempfile.TemporaryDirectory() as scratch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        kept = (kept or Path(scratch, "kept")).resolve()
        kept.mkdir(parents=True, exist_ok=True)
        for name in ("tries",) if tries else ("tries", "attack"):
            os.chdir(scratch)  # some odd calls name files
            page, wrong = (
                attack_commands(kept, Path(scratch)) if name == "tries" else attack(kept, Path(scratch), files=files)
            )
            status |= wrong
            (folder / f"{name}.md").write_text(page, encoding="utf-8")
            print(page)  # noqa: T201 - what the command is for
        os.chdir(folder)
    return status


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", nargs="?", type=Path, default=Path("docs/benchmarks"))
    options.add_argument("--kept", type=Path)
    options.add_argument("--files", type=int, default=FILES, help=f"of a kind; at most {OTHER_FILES} of our own kinds")
    options.add_argument("--tries", action="store_true", help="of the commands alone")
    given = options.parse_args()
    sys.exit(main(given.folder, kept=given.kept, files=given.files, tries=given.tries))

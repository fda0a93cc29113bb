"""Tries of the commands: odd outputs, names, environments and metadata, interrupts, and two runs at once.

Each runs `hums` in a forked process and a folder of its own. Its exit status has to be one of the table in
docs/reference.md, with a sentence where it is not 0; what it did not write, and what it reads, has to stay as it was.
"""

from __future__ import annotations

import csv
import json
import os
import re
import resource
import shutil
import signal
import sys
import threading
import time
import traceback
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

import hums.jobs
from attacks.damaged_files import CHANNELS, SCENE, SUFFIXES, small_analysis, write_valid
from hums.cli import main

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

PATIENCE_S = 120
LEAST_WORDS = 4
CLOCKS = 0.01  # by which rates differ that clocks count
RATE_HZ = 1000.0  # which damaged_files.write_valid states, where a format has a place for it
INTERRUPTED, BROKE = 130, 70
COLOURS = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")  # which FORCE_COLOR asks for
BOX = """\
frame = "housing"
reference = "input"
axes = { input = ["housing", "input"], output = ["housing", "output"] }
mesh = [{ name = NAME, teeth = { input = 23, output = 67 } }]
bearing = [{ names = [NAME], inner_ring = "input", outer_ring = "housing", bearing = "SKF 6203-2RS JEM" }]
"""
PLAN = "records = 2\nseed = 1\nclass = [{ name = NAME }]\n[scene]\n" + SCENE.replace(
    "duration_s = 1.5", "duration_s = 1"
)
DECLARED = "--channel vib --units g --no-tachometer"
COMMANDS = {  # and the files that each writes
    f"convert raw.csv out.h5 --rate-hz 1000 {DECLARED}": ["out.h5"],
    f"convert raw out --files --rate-hz 1000 {DECLARED}":
        ["out", "out/a.h5", "out/refused.csv", "out/conversion-files.json"],
    f"convert raw out --rate-hz 1000 {DECLARED}": ["out", "out/index.h5", "out/labels.csv", "out/shards"],
    "info raw.csv --draft out.toml": ["out.toml"],
    "synth scene.toml -o out.h5": ["out.h5"],
    "dataset plan.toml -o out": ["out", "out/labels.csv", "out/data-card.md", "out/plan.toml"],
    "drawing box.toml -o out.html": ["out.html"],
    "drawing box.toml -o out.svg": ["out.svg"],
    "drawing box.toml -o out": ["out", "out/orders.svg"],
    "analyze record.h5 --gearbox box.toml -o out --no-envelope":
        ["out", "out/analysis.h5", "out/report.html", "out/orders.csv", "out/summary.json"],
    "report analysis.h5 -o out": ["out", "out/analysis.h5", "out/report.html", "out/indicators.csv"],
    "fleet record.h5 --gearbox box.toml -o out --no-envelope":
        ["out", "out/fleet.csv", "out/fleet.html", "out/fleet.h5", "out/alarms.csv", "out/task.json"],
}  # fmt: skip
LIGHT = [words for words in COMMANDS if words.startswith(("convert", "info")) or words.endswith(".html")]
AGAIN = {words: (0, 1) if "--draft" in words else (0,) for words in COMMANDS}  # a draft is filled in by hand
PRINTING = (
    "orders box.toml", "orders box.toml --csv", "info record.h5", "info raw.csv", "bearings 6203", "schema plan",
    "synth scene.toml --explain", "--version", "--help", "analyze --help",
)  # fmt: skip
STATES: Mapping[str, Callable[[Path], object]] = {  # of a path that is to be written
    "text": lambda path: path.write_text("the user's own", encoding="utf-8"),
    "table": lambda path: path.write_text("time,vib\n0,1\n", encoding="utf-8"),
    "HDF5": lambda path: h5py.File(path, "w").close(),
    "directory": lambda path: (path.mkdir(), (path / "kept.txt").write_text("kept", encoding="utf-8")),
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/null"),
    "loop": lambda path: path.symlink_to(path),
    "dangling": lambda path: path.symlink_to("/proc/none/at all"),
    "link to an input": lambda path: path.symlink_to(Path("record.h5").resolve()),
    "link to a text": lambda path: path.symlink_to(Path("raw.csv").resolve()),
    "other name of an input": lambda path: os.link("record.h5", path),
    "other name of an analysis": lambda path: os.link("analysis.h5", path),
    "empty": Path.touch,
}
NAMES = (
    "=1+1", "-1", "@SUM(A1)", "<script>alert(1)</script>", "a\rb", "a\nb", "a\tb", "a\x1b[2Jb", "a\u202eb", "pr\udcfcf",
    "\ud800", "$x_1$", "%s%n", "{0}", "a,b", 'a"b', "a'b", "a;b", "a/b", "../a", "..", "CON", " a ", "", "a" * 250,
    "\u00fc\u4e2d\U0001f600", "e\u0301", "a\0b", "--help", "a\\b", "a\u2028b", "&amp;", "nan", "None", "\ufeffa",
)  # fmt: skip
ENVIRONMENTS: tuple[dict[str, str], ...] = (
    *({"PYTHONIOENCODING": coding} for coding in ("ascii", "latin-1", "cp1252", "utf-16", "ascii:surrogateescape")),
    *({"TZ": zone} for zone in ("", "Nowhere/Land", "UTC-99", "Europe/Berlin")),
    *({"LC_ALL": name, "LANG": name} for name in ("C", "de_DE.UTF-8", "none")),
    *({"COLUMNS": width, "LINES": width} for width in ("0", "1", "-5", "x", "100000")),
    *({name: "/proc/none"} for name in ("HOME", "XDG_CACHE_HOME", "TMPDIR", "MPLCONFIGDIR", "PATH")),
    *({name: "x"} for name in ("HOME", "SOURCE_DATE_EPOCH", "MPLBACKEND", "NO_COLOR", "FORCE_COLOR", "DISPLAY")),
    {"TERM": "dumb"}, {"TERM": ""}, *({"closed": number} for number in "012"),
    {"files": "40"}, {"size": "2000"}, {"gone": "1"}, {"full": "1"},
)  # fmt: skip
STATING = ("tdms", "uff", "lvm", "mf4", "wav", "csv with times", "csv with stamps")
FACTORS = (0.1, 0.5, 0.9, 0.98, 0.9999, 1.0, 1.0001, 1.02, 1.1, 2.0, 1000.0, 0.0, -1.0, float("nan"), float("inf"))


@dataclass(frozen=True, kw_only=True)
class Try:
    """Words of a command, what is done beforehand in its folder, what disturbs it, and what has to come of it."""

    words: str | tuple[str, ...]
    name: str = ""
    before: Callable[[], object] = lambda: None
    environment: Mapping[str, str] | None = None
    disturb: Callable[[int], object] | None = None  # of the process; the command is run once more thereafter
    runs: int = 1  # at once
    holds: Callable[[str], bool] = lambda _: True  # of what was said, where the status is 0
    statuses: tuple[int, ...] = (0, 1, 2, 3)
    again: tuple[int, ...] = (0,)


def material(folder: Path) -> None:
    """Write small inputs of every command into a folder."""
    (folder / "raw").mkdir(parents=True)
    noise = np.random.default_rng(20).normal(size=3000)
    for name in ("raw.csv", "raw/a.csv", "raw/b.csv"):
        np.savetxt(folder / name, noise, header="vib", comments="")
    angle = hums.NominalSpeed(rpm=1200, shaft="input")
    record = hums.make_record({"vib": noise}, rate_hz=2000, units="g", angle=angle)
    for name, text in (("box", BOX), ("plan", PLAN), ("scene", SCENE)):
        (folder / f"{name}.toml").write_text(text.replace("NAME", '"a"'), encoding="utf-8")
    hums.save_record(record, folder / "record.h5")
    hums.save_analysis(small_analysis(), folder / "analysis.h5")


def start(words: tuple[str, ...], environment: Mapping[str, str], said: Path) -> int:
    """Run a command in a forked process that writes what it says into a file; return its number."""
    if child := os.fork():
        return child
    status = BROKE
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.environ.update(environment)
        time.tzset()
        text = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for number in (1, 2):
            os.dup2(os.open("/dev/full", os.O_WRONLY) if number == 1 and "full" in environment else text, number)
        coding, _, errors = environment.get("PYTHONIOENCODING", "utf-8").partition(":")
        sys.stdout = os.fdopen(1, "w", encoding=coding, errors=errors or "strict", closefd=False)
        sys.stderr = os.fdopen(2, "w", encoding=coding, errors="backslashreplace", closefd=False)
        _limit(environment)
        hums.jobs.Processes = lambda **_: hums.Serial()  # kills.py has processes
        sys.argv = ["hums", *words]
        status = main()
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else BROKE
    except BaseException:  # noqa: BLE001 - whatever there is
        os.write(2, traceback.format_exc().encode(errors="replace"))
    finally:
        os._exit(status)


def _limit(environment: Mapping[str, str]) -> None:
    for name, limit in (("files", resource.RLIMIT_NOFILE), ("size", resource.RLIMIT_FSIZE)):
        if name in environment:
            resource.setrlimit(limit, (int(environment[name]), resource.getrlimit(limit)[1]))
    if "closed" in environment:
        os.close(number := int(environment["closed"]))
        setattr(sys, ("stdin", "stdout", "stderr")[number], None)  # as the interpreter has it
    if "gone" in environment:
        shutil.rmtree(Path.cwd())


def ended(child: int) -> int:
    """Return the exit status of a process, which is killed where it takes too long; less than 0 after a signal."""
    timer = threading.Timer(PATIENCE_S, os.kill, (child, signal.SIGABRT))
    timer.start()
    _, status = os.waitpid(child, 0)
    timer.cancel()
    return os.waitstatus_to_exitcode(status)


def contents(folder: Path) -> dict[str, bytes]:
    """Return every regular file of a folder."""
    found = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def outcome(attempt: Try, folder: Path) -> tuple[Counter[str], str]:
    """Return how often which exit status came of a try, and what was wrong with it, empty where nothing was."""
    os.chdir(folder)
    attempt.before()
    there, said = contents(folder), folder.with_suffix(".said")
    words = tuple(attempt.words.split()) if isinstance(attempt.words, str) else attempt.words
    environment = attempt.environment or {}
    coding = environment.get("PYTHONIOENCODING", "utf-8").partition(":")[0]
    statuses, wrong = Counter[str](), []
    for rerun in range(1 if attempt.disturb is None and attempt.runs == 1 else 2):
        runs = range(1 if rerun else attempt.runs)
        children = [start(words, environment, Path(f"{said}{number}")) for number in runs]
        if attempt.disturb is not None and not rerun:
            attempt.disturb(children[0])
        for number, status in enumerate(map(ended, children)):
            text = Path(f"{said}{number}").read_text(coding, "replace")
            statuses["killed" if status < 0 else str(status)] += 1
            wrong += _problems(attempt, status, text, allowed=attempt.again if rerun else attempt.statuses)
    os.chdir(folder.parent)
    if folder.exists():
        own = (there[name] for name in ("record.h5", "analysis.h5") if name not in words)
        wrong += _files(folder, there, {b"", *own}, force="--force" in words)
    return statuses, f"{' '.join(words)} [{attempt.name}]: {'; '.join(wrong)}" if wrong else ""


def _problems(attempt: Try, status: int, said: str, *, allowed: tuple[int, ...]) -> Iterator[str]:
    silent = {"closed", "full", "size"} & set(attempt.environment or {})
    said = COLOURS.sub("", said) if "FORCE_COLOR" in (attempt.environment or {}) else said
    if status not in allowed:
        yield f"exit status {status}: {said[-300:]}"
    elif "Traceback" in said:
        yield said[-300:]
    elif status > 0 and status != INTERRUPTED and not silent and len(said.split()) < LEAST_WORDS:
        yield f"exit status {status} without a sentence: {said}"
    elif status == 0 and not attempt.holds(said):
        yield f"an outcome that contradicts its file: {said[-300:]}"
    if any((ord(sign) < ord(" ") and sign not in "\n\t") or sign == "\x7f" for sign in said):
        yield f"a control character in {said!r:.200}"


def _files(folder: Path, there: Mapping[str, bytes], may_change: set[bytes], *, force: bool) -> Iterator[str]:
    """Yield what is wrong with the files of a folder after a run."""
    now = contents(folder)
    for name in there:
        if now.get(name) != there[name] not in may_change and not (force and name.startswith("out")):
            yield f"{name} was {'changed' if name in now else 'lost'}"
    for name in now.keys() - there.keys():
        if name.endswith(".part"):
            yield f"{name} was left behind"
        elif name.endswith(".html") and b"<script>alert(1)" in now[name]:
            yield f"{name} runs a script of a name"
        elif name.endswith(".csv"):
            rows = list(csv.reader(now[name].decode("utf-8", "replace").splitlines()))
            if len({len(row) for row in rows}) > 1:
                yield f"{name} has rows of several lengths"
            if cells := [cell for row in rows for cell in row if cell.startswith(("=", "@", "+S"))]:
                yield f"{name} has cells that a spreadsheet runs: {cells[0]!r}"


# ---- tables of tries -------------------------------------------------------------------------------------------------


def outputs(_: np.random.Generator) -> Iterator[Try]:
    """Yield each command with each of its files in each state, with --force where a try is light."""
    forced = {f"{words} --force": COMMANDS[words] for words in LIGHT}
    for (words, files), state in product((COMMANDS | forced).items(), STATES):
        for file in files:

            def before(path: Path = Path(file), state: str = state) -> None:
                path.parent.mkdir(exist_ok=True)
                STATES[state](path)

            yield Try(words=words, name=f"{file} is {state}", before=before)


def _declare(odd: str) -> None:
    """Give the odd name to parts, classes and columns of hand-written files, as TOML and CSV write it."""
    written = json.dumps(odd, ensure_ascii=False).replace("\x7f", "\\u007f")
    for file, text in (("box.toml", BOX), ("plan.toml", PLAN)):
        Path(file).write_bytes(text.replace("NAME", written).encode(errors="surrogatepass"))
    titled = Path("raw.csv").read_text(encoding="utf-8").replace("vib", odd)
    Path("raw.csv").write_bytes(titled.encode(errors="surrogatepass"))


def _record(odd: str) -> None:
    """Give the odd name to channel and machine of the record; to one of them, if that is refused."""
    for channel, machine in ((odd, odd), ("a", odd), (odd, "a")):
        with suppress(ValueError):
            noise, angle = np.random.default_rng(20).normal(size=3000), hums.NominalSpeed(rpm=1200, shaft="input")
            made = hums.make_record({channel: noise}, rate_hz=2000, units="g", angle=angle, machine=machine)
            hums.save_record(made, "record.h5")
            return


def names(_: np.random.Generator) -> Iterator[Try]:
    """Yield commands on files that have odd names in them, and with odd names as their arguments."""
    converted = ("convert", "raw.csv", "out.h5", "--rate-hz", "1000", "--units", "g", "--shaft-rpm", "600")
    inside = (
        *PRINTING[:4],
        "drawing box.toml -o out.html",
        "analyze record.h5 --gearbox box.toml -o out --no-envelope",
    )
    for odd, place in product(NAMES, (_declare, _record)):
        for words in inside:
            yield Try(words=words, name=f"{place.__name__} {odd!r:.40}", before=partial(place, odd))
    for odd, option in product((odd for odd in NAMES if "\0" not in odd), ("machine", "units", "shaft", "channel")):
        yield Try(words=(*converted, f"--{option}", odd), before=partial(_declare, odd))
    commands = ("orders", "synth -o out.h5", "info", "drawing box.toml -o", "report analysis.h5 -o", "bearings")
    for odd, words in product((odd for odd in NAMES if "\0" not in odd), commands):
        yield Try(words=(*words.split(), odd))


def environments(_: np.random.Generator) -> Iterator[Try]:
    """Yield commands in odd environments."""
    for environment, words in product(ENVIRONMENTS, (*PRINTING, *LIGHT)):
        yield Try(words=words, name=str(environment), environment=environment)


def metadata(_: np.random.Generator) -> Iterator[Try]:
    """Yield conversions of files whose rate contradicts what is declared: refused, or the rate that is trusted."""
    for kind, factor, trust in product(STATING, FACTORS, ("", "file", "declared")):
        file, given = f"stated{SUFFIXES.get(kind, '.csv')}", factor * RATE_HZ

        def holds(_: str, agreed: float = given if trust == "declared" else RATE_HZ) -> bool:
            with hums.open_record("out.h5") as record:
                return bool(abs(record.attrs["rate_hz"] / agreed - 1) < CLOCKS)

        declared = f"--rate-hz {given} --units g --no-tachometer {'--trust ' * bool(trust)}{trust}"
        words = ("convert", file, "out.h5", "--channel", CHANNELS.get(kind, "vib"), *declared.split())
        yield Try(words=words, name=kind, before=partial(write_valid, kind, Path(file)), holds=holds)


def interrupts(rng: np.random.Generator) -> Iterator[Try]:
    """Yield commands that a signal ends at a random instant, and that are run once more."""
    for words, number, _ in product(COMMANDS, (signal.SIGINT, signal.SIGTERM, signal.SIGKILL), range(2)):

        def disturb(child: int, wait_s: float = rng.uniform(0.02, 0.6), number: int = number) -> None:
            time.sleep(wait_s)
            os.kill(child, number)

        statuses = (0, 130 if number == signal.SIGINT else -number)
        yield Try(words=words, name=number.name, disturb=disturb, statuses=statuses, again=AGAIN[words])


def races(rng: np.random.Generator) -> Iterator[Try]:
    """Yield commands that run twice at once, or whose inputs are cut off or gone meanwhile."""
    for words in COMMANDS:
        yield Try(words=words, name="two at once", runs=2, again=AGAIN[words])
        for share in (0.0, 0.5):

            def disturb(_: int, wait_s: float = rng.uniform(0, 0.3), share: float = share) -> None:
                kept = {name: whole for name, whole in contents(Path()).items() if not name.startswith("out")}
                time.sleep(wait_s)
                for name, whole in kept.items():
                    Path(name).write_bytes(whole[: int(share * len(whole))])
                time.sleep(0.1)
                for name, whole in kept.items():
                    Path(name).write_bytes(whole)

            yield Try(words=words, name=f"inputs cut to {share:g}", disturb=disturb, again=(0, 1, 3))


CLASSES: Mapping[str, Callable[[np.random.Generator], Iterator[Try]]] = {
    "output paths": outputs, "names": names, "environment": environments, "contradicting metadata": metadata,
    "interrupts": interrupts, "races": races,
}  # fmt: skip
STATUSES = ("0", "1", "2", "3", "130", "killed")


def make_tries(name: str, scratch: Path, *, every: int = 1) -> dict[str, Any]:
    """Make the tries of a class, or each `every`-th; return their number, exit statuses, and what was wrong."""
    folder, begun = scratch / "tries" / name, time.perf_counter()
    material(folder / "whole")
    found, wrong, tables = Counter[str](), [], dict[Any, dict[str, bytes]]()
    attempts = list(CLASSES[name](np.random.default_rng(20)))[::every]
    for attempt in attempts:
        shutil.copytree(folder / "whole", folder / "run")
        statuses, problem = outcome(attempt, folder / "run")
        found += statuses
        wrong += [problem] if problem else []
        if name == "interrupts":  # whatever the instant, the tables in the end are the same
            made = {file: whole for file, whole in contents(folder / "run").items() if file.endswith(".csv")}
            if made != tables.setdefault(attempt.words, made):
                wrong.append(f"{attempt.words} [{attempt.name}]: another table")
        shutil.rmtree(folder / "run", ignore_errors=True)
    os.chdir(scratch)
    shutil.rmtree(folder)
    return {"class": name, "count": len(attempts), "found": found, "wrong": wrong, "s": time.perf_counter() - begun}


def try_rows(parts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the rows of a table, a class of tries each."""
    return [
        f"| {part['class']} | {part['count']} | {' | '.join(str(part['found'].get(status, 0)) for status in STATUSES)} "
        f"| {len(part['wrong'])} | {part['s']:.0f} |"
        for part in parts
    ]

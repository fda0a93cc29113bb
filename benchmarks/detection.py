"""What is found against what could be: python benchmarks/detection.py [FOLDER] [--cases N] [--first N] [--jobs N].

Writes detection.md into FOLDER (default docs/benchmarks): faults of the second simulator, each added at a level, by
kind. A logistic curve over the level says where half are named first; the distance from the bound is the gap.
"""

import argparse
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import second_simulator
import verdicts
from scipy.optimize import minimize

from hums import analyze
from hums.records.outputs import write_text

PLACES = 1e4  # at which a fault of a known waveform may begin: samples of a revolution
PAGE = """\
# Detection compared with a bound

Made by `python benchmarks/detection.py --first {first}`: {cases} machines of a simulator that shares no code with
`data_synth`, at a stated probability of {stated:g}. *Level*: the signal-to-noise ratio in dB after a matched filter
that knows the waveform of the fault and excludes the lines of the sound machine. At an unknown position among
{places:g}, such a filter detects a fault from {bound:.1f} dB. *Half named*: the level at which half are named first, by
a logistic curve. *Gap*: the difference between the two. *Sound*: those that read "nothing found".

| fault | machines | named first | half named, dB | gap, dB | sound |
|---|---|---|---|---|---|
{rows}

The filter knows the waveform, the path and the exact rate. The analysis searches 31 bands for any ringing, at rates
within slip, for every part of every bearing and gear, and names a part only if nothing else explains the line and few
healthy machines show evidence as strong. A tooth shares its rate with anything loose on its shaft: its verdict depends
on the angle of its impacts and on the mesh that it modulates.
"""


def judged(number: int) -> tuple[str, float, bool, bool]:
    """Return the kind and level of a fault, whether it is named first, and whether it reads "nothing found"."""
    case = second_simulator.case(number, faulty=True)
    kind = "tooth" if case.kind in second_simulator.TEETH else case.kind
    said = verdicts.said(analyze(case.record, case.gearbox, settings=verdicts.SETTINGS), kind, case.component)
    return case.kind, case.level_db, bool(said["first"]), bool(said["sound"])


def half_named(levels: Sequence[float], named: Sequence[bool]) -> float:
    """Return the level at which the likeliest logistic curve passes a half; NaN outside of the levels."""
    x, y = np.asarray(levels), np.asarray(named, dtype=float)

    def against(middle_and_width: np.ndarray) -> float:
        z = (x - middle_and_width[0]) / max(middle_and_width[1], 0.5)
        return float(np.sum(np.logaddexp(0, z) - y * z))

    middle = float(minimize(against, [40.0, 5.0], method="Nelder-Mead").x[0])
    return middle if x.min() < middle < x.max() else math.nan


def main() -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("docs/benchmarks"))
    for name, default in (("--cases", 480), ("--first", 30_000), ("--jobs", 2)):
        parser.add_argument(name, type=int, default=default)
    given = parser.parse_args()
    with ProcessPoolExecutor(given.jobs) as pool:
        found = list(pool.map(judged, range(given.first, given.first + given.cases)))
    bound, rows = 10 * math.log10(2 * math.log(PLACES / verdicts.STATED)), []
    for kind in second_simulator.KINDS:
        levels, first, sound = zip(*(one[1:] for one in found if one[0] == kind), strict=True)
        middle = half_named(levels, first)
        gap = (f"{middle:.1f}", f"{middle - bound:.1f}") if math.isfinite(middle) else ("-", "-")
        numbers = len(levels), sum(first), *gap, sum(sound)
        rows.append(f"| {' | '.join([kind.replace('_', ' '), *map(str, numbers)])} |")
    page = {"cases": given.cases, "first": given.first, "stated": verdicts.STATED, "places": PLACES, "bound": bound}
    write_text(given.folder / "detection.md", PAGE.format(rows="\n".join(rows), **page))


if __name__ == "__main__":
    main()

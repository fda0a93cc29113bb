"""Time against error of every way to integrate a gear pair: python benchmarks/integrators.py [FOLDER].

Writes integrators.md and integrators.svg into FOLDER (default docs/benchmarks). The pair is the one of the tests, with
four degrees of freedom, started from rest: 2 s, 2,652 mesh periods, q, x2' and w2 at 50 kHz.
"""

import os
import sys

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )
    sys.path.insert(0, str(__import__("pathlib").Path(__file__).resolve().parents[1] / "tests"))

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
from gear_pair import DIRECTION, DRAG, LINEAR_DRAG, MASSES, driven, output, pair, rectangle, ten_harmonics, worst
from numpy.typing import NDArray
from scipy.integrate import odeint

from data_synth.integrate import (
    Accuracy,
    DormandPrince8,
    GeneralisedAlpha,
    Problem,
    RungeKutta4,
    Splitting,
    Steps,
    Transition,
    integrate,
)
from hums.plots import save_figure

Array = NDArray[np.float64]

DURATION_S, RATE_HZ, MESH_RAD_S = 2.0, 50e3, 8334.0
REPEATS = 5
ONCE_S = 0.2

NOTE = """\
Made by `python benchmarks/integrators.py`, one thread. A gear pair with four degrees of freedom and no damper, from
rest under 75 Nm: 2 s, 2,652 mesh periods; q = r1 theta1 - r2 theta2, x2' and w2 at 50 kHz. Error: RMS over the record
over the RMS, the worst of the three, against the splitting with 32 steps to a sample (rectangular) and Dormand-Prince
8 with 2 (smooth). Time, medians of {repeats} (of what takes less than {once:g} s; the rest and the baseline run once),
as a ratio to `scipy.integrate.odeint` at rtol 1e-9, atol 1e-14 with a compiled right-hand side, in the same run: below
1 is faster. Preparing is included, compiling is not. odeint took {units} s."""

TARGETS = (("rectangular", 1e-10, 100), ("smooth", 1e-4, 150), ("smooth", 1e-6, 30))


def _series() -> tuple[Array, Array]:
    h = np.arange(1, 11)
    return h * MESH_RAD_S, 0.6e6 * (1 - np.exp(-0.8j * np.pi * h)) / (1j * np.pi * h)


LINES, _LINES_C = _series()
AMPLITUDES, ANGLES = np.abs(_LINES_C), np.angle(_LINES_C)
G0, G1, G2, G3 = (float(g) for g in DIRECTION)
M0, M1, M2, M3 = (float(m) for m in MASSES)


@numba.njit(fastmath=True)
def _motion(y: Array, stiffness: float, drag: float) -> Array:
    force = stiffness * (G0 * y[0] + G1 * y[1] + G2 * y[2] + G3 * y[3])
    out = np.empty(8)
    out[:4] = y[4:]
    out[4] = (-1e8 * y[0] - G0 * force) / M0
    out[5] = (75.0 - G1 * force) / M1
    out[6] = (-1e8 * y[2] - G2 * force) / M2
    out[7] = (-G3 * force - drag) / M3
    return out


@numba.njit(fastmath=True)
def smooth_rates(y: Array, t: float) -> Array:
    """Right-hand side with ten harmonics and a quadratic load."""
    stiffness = 1e6
    for i in range(10):
        stiffness += AMPLITUDES[i] * np.cos(LINES[i] * t + ANGLES[i])
    return _motion(y, stiffness, DRAG * y[7] * abs(y[7]))


@numba.njit(fastmath=True)
def rectangular_rates(y: Array, t: float) -> Array:
    """Right-hand side with a rectangle and a linear load."""
    phase = t * (MESH_RAD_S / (2 * np.pi))
    return _motion(y, 1.36e6 if phase - np.floor(phase) < 0.4 else 0.76e6, LINEAR_DRAG * y[7])  # noqa: PLR2004


@dataclass(frozen=True, kw_only=True)
class Case:
    """A problem and how the baseline solves it."""

    name: str
    problem: Problem
    rates: Callable[[Array, float], Array]

    def baseline(self) -> Array:
        """Solve it by LSODA from sample to sample."""
        times_s = np.arange(round(DURATION_S * RATE_HZ) + 1) / RATE_HZ
        y = odeint(self.rates, np.zeros(8), times_s, rtol=1e-9, atol=1e-14, mxstep=100_000)
        maps = output(RATE_HZ)
        return np.asarray(y[:, :4] @ maps.displacement.T + y[:, 4:] @ maps.velocity.T)


CASES = (
    Case(
        name="rectangular",
        problem=driven(pair(rectangle(), damping=np.diag([0, 0, 0, LINEAR_DRAG])), duration_s=DURATION_S),
        rates=rectangular_rates,
    ),
    Case(
        name="smooth",
        problem=driven(pair(ten_harmonics()), duration_s=DURATION_S, drag=DRAG),
        rates=smooth_rates,
    ),
)

FIXED: dict[str, tuple[Any, tuple[int, ...]]] = {
    "splitting": (Splitting(), (1, 2, 4)),
    "RK4": (RungeKutta4(), (1, 4)),
    "Dormand-Prince 8": (DormandPrince8(), (1,)),
    "Newmark 1/4": (GeneralisedAlpha(), (1, 4)),
    "generalised alpha 0.8": (GeneralisedAlpha(spectral_radius=0.8), (2,)),
}
CHOSEN = (1e-4, 1e-6)


def runs(case: Case) -> dict[tuple[str, str], Callable[[], Array]]:
    """Return every way through a case, by method and setting."""

    def way(method: Any, tolerance: Steps | Accuracy) -> Callable[[], Array]:  # noqa: ANN401
        read = output(RATE_HZ)
        return lambda: integrate(case.problem, method=method, output=read, tolerance=tolerance).checked().values

    found = {}
    if case.name == "rectangular":
        found["exact transitions", "exact"] = way(Transition(), Steps(per_sample=1))
    for name, (method, steps) in FIXED.items():
        for count in steps:
            found[name, f"{count} a sample"] = way(method, Steps(per_sample=count))
    for relative in CHOSEN:
        found["splitting, chosen", f"{relative:g} asked for"] = way(Splitting(), Accuracy(relative=relative))
    return found


def reference_of(case: Case) -> Array:
    """Return the record to measure against, by other means than what it is quoted for."""
    method, steps = (Splitting(), 32) if case.name == "rectangular" else (DormandPrince8(), 2)
    found = integrate(case.problem, method=method, output=output(RATE_HZ), tolerance=Steps(per_sample=steps))
    return found.checked().values


def timed(call: Callable[[], Array], repeats: int) -> tuple[float, Array]:
    """Return the median time in s, and what comes of it."""
    seconds: list[float] = []
    while True:
        start = time.perf_counter()
        values = call()
        seconds.append(time.perf_counter() - start)
        if len(seconds) == repeats or seconds[0] > ONCE_S:
            return statistics.median(seconds), values


def measure(case: Case, *, repeats: int = REPEATS) -> tuple[float, list[tuple[str, str, float, float]]]:
    """Return the baseline's time in s, and (method, setting, time as a ratio to it, error)."""
    reference = reference_of(case)
    for call in runs(replace(case, problem=replace(case.problem, duration_s=1e-3))).values():
        call()  # compiled before it is timed
    case.rates(np.zeros(8), 0.0)
    start = time.perf_counter()
    values = case.baseline()
    unit = time.perf_counter() - start
    rows = [("scipy odeint", "rtol 1e-9", 1.0, worst(values, reference))]
    for (method, setting), call in runs(case).items():
        seconds, values = timed(call, repeats)
        rows.append((method, setting, seconds / unit, worst(values, reference)))
    return unit, rows


def verdict(rows: list[tuple[str, str, float, float]], error: float, times: float) -> str:
    """Say which way reaches an error soonest, and whether soon enough."""
    good = [row for row in rows[1:] if row[3] <= error]
    if not good:
        return f"error {error:g}: not reached."
    method, setting, ratio, found = min(good, key=lambda row: row[2])
    word = "met" if ratio <= 1 / times else "missed"
    asked = f"error {error:g} in 1/{times:g} of odeint's time"
    return f"{asked}: {word}, {method} ({setting}), {found:.1e} in 1/{1 / ratio:.0f}."


def main(folder: Path) -> int:
    """Measure, and write the table and the picture."""
    outcomes = {case.name: measure(case) for case in CASES}
    measured = {name: rows for name, (_, rows) in outcomes.items()}
    units = " and ".join(f"{unit:.2g}" for unit, _ in outcomes.values())
    lines = ["# Integrators: time against error", ""]
    lines += [NOTE.format(repeats=REPEATS, once=ONCE_S, units=units)]
    for case in CASES:
        lines += [
            "",
            f"## {case.name.capitalize()} stiffness",
            "",
            "| method | setting | time | error |",
            "|---|---|---|---|",
        ]
        lines += [f"| {m} | {s} | {t:.4f} (1/{1 / t:.0f}) | {e:.1e} |" for m, s, t, e in measured[case.name]]
    lines += ["", "## Targets", ""]
    lines += [f"- {name}: {verdict(measured[name], error, times)}" for name, error, times in TARGETS]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "integrators.md").write_text("\n".join(lines) + "\n", encoding="utf-8")

    def draw(ax: Any) -> None:  # noqa: ANN401
        for case, mark in zip(CASES, ("s--", "o-"), strict=True):
            rows = measured[case.name]
            for number, method in enumerate(dict.fromkeys(row[0] for row in rows)):
                mine = [(row[3], row[2]) for row in rows if row[0] == method]
                label = f"{method}, {case.name}"
                ax.loglog(*zip(*mine, strict=True), mark, color=f"C{number}", ms=4, lw=1, label=label)
        ax.set(xlabel="error", ylabel="time, multiples of odeint")
        ax.legend(frameon=False, fontsize=6, ncols=2)

    save_figure(draw, folder / "integrators.svg", width=7, height=4.6)
    print("\n".join(lines))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/benchmarks")))

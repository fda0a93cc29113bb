"""Time against error of every way to integrate a gear pair: python benchmarks/integrators.py [FOLDER].

Writes integrators.md and integrators.svg into FOLDER (default docs/benchmarks). The pair is the one of the tests, with
four degrees of freedom, started from rest: 2 s, 2,652 mesh periods, q, x2' and w2 at 50 kHz. Then the energy of a mass
between two walls, over ten thousand oscillations.
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
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from gear_pair import (
    DRAG,
    LINEAR_DRAG,
    MESH_RAD_S,
    PERIOD_S,
    by_exponentials,
    by_scipy,
    constant,
    driven,
    output,
    pair,
    rectangle,
    ten_harmonics,
    turning,
    worst,
)
from integrator_peers import DORMAND_PRINCE_8, RK4, Explicit, Pair, explicit, generalised_alpha
from numpy.typing import NDArray
from page_files import folder_given, table, write_page
from scipy.integrate import odeint

from data_synth.dynamics.system import Mesh, System
from data_synth.integrators.driver import integrate, steps_for_error
from data_synth.integrators.problem import Load, Output, Problem, State
from hums.plots import save_figure

Array = NDArray[np.float64]

DURATION_S, RATE_HZ = 2.0, 50e3
PERIODS = 2652
SLOW_S = 0.05  # what scipy's solvers are given, which call a function of Python at every stage
HALF_GAP_M, BEARING_DAMPING = 2e-5, 50.0
REPEATS = 9
ONCE_S = 0.2

NOTE = """\
Made by `python benchmarks/integrators.py`, one thread. A gear pair with four degrees of freedom, from rest under 75 N
m: 2 s, 2,652 mesh periods; q = r1 theta1 - r2 theta2, x2' and w2 at 50 kHz, in the second table once per mesh period.
Only the load damps; for loss of contact, 40 um of backlash with the rectangular stiffness, bearings with 50 N s/m, 0.2
s. Error: RMS error over the RMS of the record, the worst of the three, relative to matrix exponentials between jumps
(rectangular), Dormand-Prince 8 with steps of 10 us (smooth) and the splitting with steps of 0.16 us (loss of contact).
`simulate` uses the splitting; the others are plain compiled loops over full matrices (the two implicit ones over the
diagonals of this pair). Aligned methods end a step at each jump of the stiffness. `solve_ivp` runs over the first
{slow:g} s, as does odeint for its ratio. CPU time, medians of {repeats} (if less than {once:g} s; otherwise one run,
with the baseline before, between and after), as a ratio to `scipy.integrate.odeint` at rtol 1e-9, atol 1e-14 with a
compiled right-hand side, in the same run: below 1 is faster. Set-up is included, compilation is not. odeint took
{units} s."""

ENERGY_NOTE = """\
A mass between two walls, without dissipation: 10,000 oscillations of amplitude 3, half the gap 1, from four initial
states of equal energy. Largest relative deviation of the energy, over the first thousand oscillations and over all;
slope: the mean of four over its standard error, below about 3 if the energy has no trend. The number of steps per
oscillation is not an integer, since steps would then synchronise with the contacts, and halving them would gain only a
factor of two. From 100 to 200 steps, the error of the splitting falls with the power {power:.1f} of the step."""
OSCILLATIONS, AMPLITUDE = 10_000, 3.0
PERIOD = 2 * np.pi + 4 / (AMPLITUDE - 1)


def _series() -> tuple[Array, Array]:
    h = np.arange(1, 11)
    return h * MESH_RAD_S, 0.6e6 * (1 - np.exp(-0.8j * np.pi * h)) / (1j * np.pi * h)


LINES, _LINES_C = _series()
AMPLITUDES, ANGLES = np.abs(_LINES_C), np.angle(_LINES_C)


@numba.njit(fastmath=True)
def smooth(t: float) -> float:
    """Stiffness with ten harmonics."""
    stiffness = 1e6
    for i in range(10):
        stiffness += AMPLITUDES[i] * np.cos(LINES[i] * t + ANGLES[i])
    return stiffness


@numba.njit(fastmath=True)
def rectangular(t: float) -> float:
    """Stiffness that is high for 0.4 of each mesh period."""
    phase = t / PERIOD_S
    return 1.36e6 if phase - np.floor(phase) < 0.4 else 0.76e6  # noqa: PLR2004


@dataclass(frozen=True, kw_only=True)
class Case:
    """A problem, the same written for peers, how often it is read, and with how many steps to per sample."""

    name: str
    title: str
    problem: Problem
    peer: Pair
    rate_hz: float = RATE_HZ
    steps: dict[str, tuple[int, ...]]
    reference: int = 0  # steps to per sample; 0: by matrix exponentials

    @property
    def times_s(self) -> Array:
        """When it is read."""
        return np.arange(round(self.problem.duration_s * self.rate_hz) + 1) / self.rate_hz

    @property
    def jumps_s(self) -> Array:
        """When the rectangle jumps."""
        periods = np.arange(np.ceil(self.problem.duration_s / PERIOD_S) + 1)
        return np.sort(np.concatenate([periods, periods + 0.4])) * PERIOD_S

    def read(self, states: Array) -> Array:
        """Return the channels of states (times, 8)."""
        maps = output(self.rate_hz)
        return np.asarray(states[:, :4] @ maps.displacement.T + states[:, 4:] @ maps.velocity.T)

    def read_by(self, name: str, steps: int) -> Array:
        """Solve it by a peer, `steps` steps to per sample."""
        method, _, aligned = name.partition(", ")
        if method in EXPLICIT:
            jumps_s = self.jumps_s if aligned else None
            return self.read(explicit(self.peer, EXPLICIT[method], times_s=self.times_s, steps=steps, jumps_s=jumps_s))
        radius = SPECTRAL_RADII[method]
        return self.read(generalised_alpha(self.peer, times_s=self.times_s, steps=steps, spectral_radius=radius))

    def baseline(self) -> Array:
        """Solve it by LSODA from sample to sample."""
        return self.read(
            odeint(self.peer.odeint_rates, np.zeros(8), self.times_s, rtol=1e-9, atol=1e-14, mxstep=100_000)
        )


STEPS = {
    "splitting": (1, 2, 4),
    "RK4": (1, 4),
    "RK4, aligned": (1, 4),
    "Dormand-Prince 8": (1,),
    "Dormand-Prince 8, aligned": (1,),
    "Newmark 1/4": (1, 4),
    "generalised alpha 0.8": (2,),
}
LOADED = Pair(rectangular, np.array([0.0, 0, 0, LINEAR_DRAG]))
RECTANGLE = driven(pair(rectangle(), damping=np.diag(LOADED.damping)), duration_s=DURATION_S)
RUBBER = np.array([BEARING_DAMPING, 0, BEARING_DAMPING, 0])
CASES = (
    Case(
        name="rectangular",
        title="Rectangular stiffness",
        problem=RECTANGLE,
        peer=LOADED,
        steps={**STEPS, "splitting": (1, 2, 4, 8, 16)},
    ),
    Case(
        name="rectangular, once a period",
        title="Rectangular stiffness, sampled once per mesh period",
        problem=replace(RECTANGLE, duration_s=PERIODS * PERIOD_S),
        peer=LOADED,
        rate_hz=1 / PERIOD_S,
        steps={
            "splitting": (20, 40, 80),
            "RK4, aligned": (8, 16, 32),
            "Dormand-Prince 8, aligned": (2, 4, 8),
        },
    ),
    Case(
        name="smooth",
        title="Smooth stiffness",
        problem=driven(pair(ten_harmonics()), duration_s=DURATION_S, drag=DRAG),
        peer=Pair(smooth, np.zeros(4), drag=DRAG),
        steps={name: steps for name, steps in STEPS.items() if "aligned" not in name},
        reference=2,
    ),
    Case(
        name="parting",
        title="Loss of contact",
        problem=driven(pair(rectangle(), damping=np.diag(RUBBER), backlash_m=HALF_GAP_M), duration_s=0.2),
        peer=Pair(rectangular, RUBBER, half_gap_m=HALF_GAP_M),
        steps=STEPS,
        reference=128,
    ),
)
CHOSEN = (1e-4, 1e-6)
EXPLICIT: dict[str, Explicit] = {"RK4": RK4, "Dormand-Prince 8": DORMAND_PRINCE_8}
SPECTRAL_RADII = {"Newmark 1/4": None, "generalised alpha 0.8": 0.8}


def runs(case: Case) -> dict[tuple[str, str], Callable[[], Array]]:
    """Return every way through a case, by method and setting."""
    read = output(case.rate_hz)

    def ours(steps: int) -> Array:
        return integrate(case.problem, output=read, steps=steps).values

    def chosen(relative: float) -> Array:
        return ours(steps_for_error(case.problem, output=read, relative=relative))

    found = {}
    for name, steps in case.steps.items():
        for count in steps:
            call = partial(case.read_by, name, count)
            found[name, f"{count} per sample"] = partial(ours, count) if name == "splitting" else call
    for relative in CHOSEN:
        found["splitting, chosen", f"{relative:g} requested"] = partial(chosen, relative)
    return found


def reference_of(case: Case) -> Array:
    """Return the record to measure against, by other means than what it is quoted for."""
    if case.name == "smooth":
        return case.read(explicit(case.peer, DORMAND_PRINCE_8, times_s=case.times_s, steps=case.reference))
    if not case.reference:
        return np.asarray(by_exponentials(case.problem, output(case.rate_hz)))
    return integrate(case.problem, output=output(case.rate_hz), steps=case.reference).values


def timed(call: Callable[[], Array], repeats: int) -> tuple[float, Array]:
    """Return the median processor time in s, and what comes of it."""
    seconds: list[float] = []
    while True:
        start = time.process_time()
        values = call()
        seconds.append(time.process_time() - start)
        if len(seconds) == repeats or seconds[0] > ONCE_S:
            return statistics.median(seconds), values


def measure(case: Case, *, repeats: int = REPEATS) -> tuple[float, list[tuple[str, str, float, float]]]:
    """Return the baseline's time in s, and (method, setting, time as a ratio to it, error)."""
    reference = reference_of(case)
    short = replace(case, problem=replace(case.problem, duration_s=4 * PERIOD_S))
    for call in runs(short).values():
        call()  # compiled before it is timed
    case.peer.odeint_rates(np.zeros(8), 0.0)
    ways, found, baselines = runs(case), {}, [timed(case.baseline, 1)]
    for number, (way, call) in enumerate(ways.items(), start=1):
        found[way] = timed(call, repeats)
        if number in {len(ways) // 2, len(ways)}:
            baselines.append(timed(case.baseline, 1))
    unit = statistics.median(seconds for seconds, _ in baselines)
    rows = [("scipy odeint", "rtol 1e-9", 1.0, worst(baselines[0][1], reference))]
    rows += [(*way, seconds / unit, worst(values, reference)) for way, (seconds, values) in found.items()]
    return unit, [*rows, scipys(case, reference)] if case.rate_hz == RATE_HZ else rows


def scipys(case: Case, reference: Array) -> tuple[str, str, float, float]:
    """Measure `solve_ivp` over a shorter segment."""
    short = replace(case, problem=replace(case.problem, duration_s=min(SLOW_S, case.problem.duration_s)))
    unit, _ = timed(short.baseline, 1)
    seconds, values = timed(lambda: np.asarray(by_scipy(short.problem, output(case.rate_hz), relative=1e-8)), 1)
    return "scipy solve_ivp, DOP853", "rtol 1e-8", seconds / unit, worst(values, reference[: values.shape[0]])


def energies(steps: float) -> tuple[float, float, float]:
    """Return largest departures of the energy over the first tenth and over all, and the slope over its error."""
    mesh = Mesh(name="walls", direction=np.ones(1), stiffness=constant(1.0), backlash_m=1.0)
    zero = np.zeros((1, 1))
    system = System(mass=np.eye(1), damping=zero, stiffness=zero, meshes=(mesh,), names=("x",))
    read = Output(
        rate_hz=1.037 * steps / PERIOD, displacement=np.array([[1.0], [0]]), velocity=np.array([[0.0], [1.0]])
    )
    early, late, slopes = [], [], []
    for x in (1.5, 2.0, 2.5, 3.0):
        start = State(displacement=np.full(1, x), velocity=np.full(1, np.sqrt((AMPLITUDE - 1) ** 2 - (x - 1) ** 2)))
        problem = Problem(
            system=system,
            reference=turning(1.0),
            load=Load(constant=np.zeros(1)),
            duration_s=OSCILLATIONS * PERIOD,
            start=start,
        )
        found = integrate(problem, output=read, steps=1)
        q, v = found.values.T
        departure = (v**2 + np.maximum(np.abs(q) - 1, 0) ** 2) / (AMPLITUDE - 1) ** 2 - 1
        early.append(np.max(np.abs(departure[: q.size // 10])))
        late.append(np.max(np.abs(departure)))
        slopes.append(np.polyfit(found.times_s / found.times_s[-1], departure, 1)[0])
    trend = float(np.mean(slopes) / (np.std(slopes, ddof=1) / 2))
    return float(np.max(early)), float(np.max(late)), trend


def energy_lines() -> list[str]:
    """Return the table of energies."""
    found = {f"splitting, {steps} per oscillation": energies(steps) for steps in (25, 50, 100, 200)}
    last, before = (found[f"splitting, {steps} per oscillation"][1] for steps in (200, 100))
    rows = [(name, f"{early:.1e}", f"{late:.1e}", f"{trend:.1f}") for name, (early, late, trend) in found.items()]
    head = ("method", "1,000 oscillations", "10,000", "slope")
    return ["## Energy", "", ENERGY_NOTE.format(power=np.log2(before / last)), "", *table(head, rows)]


def times(ratio: float) -> str:
    """Write a ratio, and what part of the baseline it is."""
    return f"{ratio:.4f} (1/{1 / ratio:.0f})" if ratio <= 1 else f"{ratio:.3g}"


def main(folder: Path) -> None:
    """Measure, and write the table and the picture."""
    outcomes = {case.name: measure(case) for case in CASES}
    measured = {name: rows for name, (_, rows) in outcomes.items()}
    units = ", ".join(f"{unit:.2g}" for unit, _ in outcomes.values())
    note = NOTE.format(repeats=REPEATS, once=ONCE_S, units=units, slow=SLOW_S)
    lines = ["# Integrators: time against error", "", note, ""]
    for case in CASES:
        rows = ((*way, times(ratio), f"{error:.1e}") for *way, ratio, error in measured[case.name])
        lines += [f"## {case.title}", "", *table(("method", "setting", "time", "error"), rows)]
    write_page(folder / "integrators.md", [*lines, *energy_lines()])
    methods = list(dict.fromkeys(row[0] for rows in measured.values() for row in rows))

    marks = dict(zip((case.name for case in CASES), ("s--", "D-.", "o-", "^:"), strict=True))
    colours = dict(zip(methods, (f"C{n}" for n in range(10)), strict=False)) | {"scipy solve_ivp, DOP853": "k"}

    def draw(ax: Any) -> None:  # noqa: ANN401
        for name, mark in marks.items():
            for method in dict.fromkeys(row[0] for row in measured[name]):
                mine = [(row[3], row[2]) for row in measured[name] if row[0] == method]
                ax.loglog(*zip(*mine, strict=True), mark, color=colours[method], ms=4, lw=1)
        for method, colour in colours.items():
            ax.plot([], [], "-", color=colour, lw=3, label=method)
        for name, mark in marks.items():
            ax.plot([], [], mark, color="0.4", ms=4, lw=1, label=name)
        ax.set(xlabel="error", ylabel="time, multiples of odeint")
        ax.legend(frameon=False, fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))

    save_figure(draw, folder / "integrators.svg", width=8, height=4.2)


if __name__ == "__main__":
    main(folder_given())

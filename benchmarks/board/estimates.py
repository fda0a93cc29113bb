"""Errors of estimates against what is known exactly: trackers, resampling, integration, and the truth of records."""

import inspect
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from jobs import Floats, JobName, standard_job
from tracking.coverage import KINDS, SLIPPING_KINDS, cells, slipping_cells

import hums
from board.sections import Effort, Section, Task
from board.table import Figure, Row, fixed, times
from data_synth import load_scene
from signals import track_orders

TREE = Path(hums.__file__).resolve().parents[1]  # the working tree that is measured

# ---- trackers --------------------------------------------------------------------------------------------------------

EVERY = 200
SMOOTHER_HZ: Mapping[JobName, float] = {"J1 run-up": 1.19, "J2 crossing": 1.02, "J3 angle": 0.0122}  # best, 2 poles
FILTER_HZ: Mapping[JobName, float] = {"J1 run-up": 4.01, "J2 crossing": 3.49, "J3 angle": 0.0406}  # best, 1 pole
CAUSAL_TIME = 45.0  # rffts: J1 by a textbook covariance filter takes 35, and a time in the run of others a quarter more


def _seconds(run: Callable[[], object]) -> float:
    start = time.process_time()
    run()
    return time.process_time() - start


def rfft_s(x: Floats) -> float:
    """Return the median processor time of five transforms of a record in s."""
    return median(_seconds(lambda: np.fft.rfft(x)) for _ in range(5))


def in_rffts(call: Callable[[], object], x: Floats, rounds: int = 3) -> float:
    """Return the processor time of a call that has run before as a multiple of an rfft, both measured in turn."""
    both = [(_seconds(call), rfft_s(x)) for _ in range(rounds)]
    return median(mine for mine, _ in both) / median(unit for _, unit in both)


def tracked(name: JobName, *, causal: bool) -> tuple[float, float]:
    """Return the error on a standard job, and the time in rffts: all outputs of the filter, of the smoother a few."""
    job = standard_job(name)
    settings: dict[str, Any] = {"estimator": "smoother", "poles": 2, "output_every": EVERY}
    width = SMOOTHER_HZ[name]
    if causal:
        settings, width = {"estimator": "filter", "poles": 1, "output_every": 1}, FILTER_HZ[name]

    def run() -> Any:  # noqa: ANN401
        return track_orders(**job.tracking(width), **settings)

    tracks = run()
    return job.error(tracks.complex_amplitude, tracks.sample_index), in_rffts(run, job.x)


def tracker_tasks(_: Effort) -> list[Task]:
    """Return a task for each job and estimator."""
    return [partial(tracked, name, causal=causal) for name in SMOOTHER_HZ for causal in (False, True)]


def tracker_figures(found: Sequence[tuple[float, float]]) -> dict[str, Figure]:
    """Return errors and times."""
    ways = [(name[:2], way) for name in SMOOTHER_HZ for way in ("smoother", "filter")]
    figures = {}
    for (job, way), (error, rffts) in zip(ways, found, strict=True):
        figures |= {f"{job} {way}: error": Figure(value=error), f"{job} {way}: time": Figure(value=rffts)}
    return figures


TRACKERS = Section(
    name="trackers",
    rows=tuple(
        Row(
            name=f"{job} {way}: {key}",
            what=f"{words}, {'relative error' if key == 'error' else 'rffts of the record'}",
            limit=times(1.01) if key == "error" else fixed(CAUSAL_TIME) if way == "filter" else times(2.0),
            timed=key == "time",
        )
        for job in ("J1", "J2", "J3")
        for way, words in (("smoother", "2 poles, every 200th output"), ("filter", "1 pole, all outputs"))
        for key in ("error", "time")
    ),
    tasks=tracker_tasks,
    figures=tracker_figures,
    alone=True,
)

# ---- coverage of `std` -----------------------------------------------------------------------------------------------

POLES = {"quick": (2,), "plain": (1, 2, 3, 4), "full": (1, 2, 3, 4)}
OUTSIDE = {"narrow": 4, "slipping order": 6}  # cells, known; one of another kind may be by chance


def coverage_tasks(effort: Effort) -> list[Task]:
    """Return a task for the cells of each kind and number of poles, and of the slipping order."""
    tracked = [partial(judged, kind, (number,), effort.first) for kind in KINDS for number in POLES[effort.size]]
    slipping = SLIPPING_KINDS[: effort.pick(1, None, None)]
    return tracked + [partial(judged, kind, (), effort.first) for kind in slipping]


def judged(kind: str, poles: tuple[int, ...], first: int) -> tuple[str, list[bool]]:
    """Return the row of some cells, and which are outside of their limits."""
    found = cells(kind, poles, first=first) if poles else slipping_cells(kind, first=first)
    return kind if poles else "slipping order", [not cell.holds for cell in found]


def coverage_figures(found: Sequence[tuple[str, list[bool]]]) -> dict[str, Figure]:
    """Return how many cells of each kind are outside."""
    kinds = dict.fromkeys(kind for kind, _ in found)
    return {f"std: {one}": Figure.share([bad for kind, some in found if kind == one for bad in some]) for one in kinds}


COVERAGE = Section(
    name="coverage",
    rows=tuple(
        Row(
            name=f"std: {kind}",
            what=f"coverage cells outside limits, {words}",
            limit=fixed(OUTSIDE.get(kind, 1)),
        )
        for kind, words in (KINDS | {"slipping order": "six kinds of record"}).items()
    ),
    tasks=coverage_tasks,
    figures=coverage_figures,
)

# ---- resampling ------------------------------------------------------------------------------------------------------


def resampled(samples: int) -> tuple[float, float, float]:
    """Return relative errors at orders 1 and 400, and what is left of a tone that would fold, relative."""
    import resampling  # noqa: PLC0415 - draws as well

    errors, left_db = resampling.errors_of(resampling.whole("sinc"), resampling.Record.made(samples))
    return errors[0], errors[-1], 10 ** (left_db[0] / 20)


RESAMPLING = Section(
    name="resampling",
    rows=tuple(
        Row(name=f"resampling: {name}", what=what, limit=times(1.5))
        for name, what in (
            ("order 1", "relative error of a tone, 1,024 samples per revolution"),
            ("order 400", "relative error of a tone, 1,024 samples per revolution"),
            ("folding", "residual of order 313, 512 samples per revolution"),
        )
    ),
    tasks=lambda effort: [partial(resampled, effort.pick(200_000, 1_000_000, 1_000_000))],
    figures=lambda found: {
        f"resampling: {name}": Figure(value=value)
        for name, value in zip(("order 1", "order 400", "folding"), found[0], strict=True)
    },
)

# ---- integration -----------------------------------------------------------------------------------------------------

# State of the gear pair [x1, x2, q, x2', w2] of fifty digits, after 2,652 mesh periods of constant and 100 of
# rectangular stiffness.
ORACLES = {
    "constant": (2652, 1.158291726597e-5, -1.244479508671e-5, 1.199957237219e-3, 1.505469885551e-4, 132.1547571565),
    "rectangular": (100, 1.235130893838e-5, -1.235230154837e-5, 1.311545438764e-3, -2.275943771227e-3, 53.56034784742),
}
STEPS = 20  # a mesh period


def integrated(name: str) -> float:
    """Return the largest relative error of the state of the gear pair, x2' relative to its largest value."""
    if str(TREE / "tests") not in sys.path:
        sys.path.insert(0, str(TREE / "tests"))
    import gear_pair  # noqa: PLC0415 - the tests' own, of the tree that is measured

    from data_synth.integrators import driver, problem  # noqa: PLC0415

    periods, *state = ORACLES[name]
    stiffness = gear_pair.constant() if name == "constant" else gear_pair.rectangle()
    damping = np.diag([0, 0, 0, gear_pair.LINEAR_DRAG])
    posed = gear_pair.driven(gear_pair.pair(stiffness, damping=damping), duration_s=periods * gear_pair.PERIOD_S)
    more: dict[str, Any] = {}
    if "method" in inspect.signature(driver.integrate).parameters:
        from data_synth.integrators.splitting import Splitting  # noqa: PLC0415

        more["method"] = Splitting()
    read = gear_pair.state_output(1 / gear_pair.PERIOD_S)
    more |= {"tolerance": problem.Steps(per_sample=STEPS)} if hasattr(problem, "Steps") else {"steps": STEPS}
    found = driver.integrate(posed, output=read, **more)
    scale = np.abs(state)
    scale[3] = np.max(np.abs(found.values[:, 3]))
    return float(np.max(np.abs(found.values[-1] - state) / scale))


INTEGRATION = Section(
    name="integration",
    rows=tuple(
        Row(
            name=f"integrator: {name}",
            what=f"gear pair of {name} stiffness, largest relative error",
            limit=times(2.0, least=1e-9),
        )
        for name in ORACLES
    ),
    tasks=lambda _: [partial(integrated, name) for name in ORACLES],
    figures=lambda found: {
        f"integrator: {name}": Figure(value=error) for name, error in zip(ORACLES, found, strict=True)
    },
)

# ---- truth -----------------------------------------------------------------------------------------------------------

RISE_RPM_S = {"steady": 0.0, "ramp": 30.0}
OF_TRUTH = {
    "record": "power that the ground truth does not cover, record, %",
    "fault": "power that the ground truth does not cover, fault, %",
    "size": "size of the ground truth over that of the samples",
}
LEFT = {"steady": (0.1, 1.0, 1.0), "ramp": (0.24, 1.0, 1.0)}


def left_by_truth(motion: str, seconds: float) -> tuple[float, float, float]:
    """Return the power that the lines of gears in motion leave of the record and of its fault, %, and their size."""
    import truth  # noqa: PLC0415 - imports more than other sections need

    rpm = [[0, 1200], [seconds, 1200 + RISE_RPM_S[motion] * seconds]]
    scene = load_scene("gears-in-motion").changed(speed={"link": "input", "rpm": rpm}, duration_s=seconds)
    _, found = truth.covered(truth.plain(scene))
    return 100 - found["record"], 100 - found["fault"], found["size"]


TRUTH = Section(
    name="truth",
    rows=tuple(
        Row(name=f"truth: {motion}, {of}", what=words, limit=fixed(most))
        for motion, limits in LEFT.items()
        for (of, words), most in zip(OF_TRUTH.items(), limits, strict=True)
    ),
    tasks=lambda effort: [partial(left_by_truth, motion, effort.pick(4.0, 10.0, 10.0)) for motion in RISE_RPM_S],
    figures=lambda found: {
        f"truth: {motion}, {of}": Figure(value=value)
        for motion, found_of in zip(RISE_RPM_S, found, strict=True)
        for of, value in zip(OF_TRUTH, found_of, strict=True)
    },
)
SECTIONS = (COVERAGE, RESAMPLING, INTEGRATION, TRUTH, TRACKERS)

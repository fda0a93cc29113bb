"""Time against error of every way to track orders: python benchmarks/trackers.py [FOLDER].

Writes trackers.md and trackers.svg into FOLDER (default docs/benchmarks). Every estimator runs on the standard jobs
(jobs.py) at the bandwidth that suits it best there, beside the usual ways on other packages (peers.py; statsmodels
comes with the extra `bench`).
"""

import contextlib
import ctypes
import dataclasses
import os
import sys

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import peers
from jobs import SAMPLES_PER_REV, Floats, Job, JobName, standard_job
from matplotlib.patheffects import withStroke
from matplotlib.ticker import NullLocator
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from hums.plots import save_figure
from hums.plots.labels import Board, points, settle
from hums.plots.style import FAINT, INK, LINE, MARK
from signals.harmonics import track_orders

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Run = Callable[[Job, float], tuple[NDArray[np.complex128], NDArray[Any]]]
Kind = Literal["smoother", "filter", "peer"]

# What an estimator may answer instead of numbers; the report says so and goes on.
REFUSED = (ValueError, ArithmeticError, np.linalg.LinAlgError, ImportError)
SLOW_S = 1.0
LONGEST_S = 30.0  # of one call in the tables of scaling; larger ones are not tried
BANDWIDTH_HZ = (0.4, 8.0)  # searched
DRAWN = (0.0115, 0.075)  # errors
DECIMATED = 200
FILTERPY_TARGET, STATSMODELS_TARGET = 300, 60
LINEAR, QUADRATIC = 1.1, 2.1  # exponents, a tenth of them left to the clock

NOTE = """\
Made by `python benchmarks/trackers.py`, one thread. Time as a multiple of `numpy.fft.rfft` of the same record, the two
timed in turn ({repeats} times, {slow} where a call takes more than a second) and their medians divided; compilation is
apart. Error: `sqrt(sum |Z' - Z|^2 / sum |Z|^2)` over all orders and the middle 90 % of the outputs. Bandwidth: the best
of a search on the job itself, one number for all orders, in Hz (J3: in orders). Memory: how far the process grew.
Records: J1 ten orders of a shaft that runs up from 10 to 40 Hz in 20 s; J2 orders 20 and 20.2 of it, crossed by a line
at 300 Hz; J3 the ten orders at 512 samples a turn; a million samples each, in noise of variance 1 (`jobs.py`)."""


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much to measure.

    Attributes
    ----------
    samples : of each job; None for all.
    excerpt : samples given to what is too slow for a whole job.
    repeats, slow_repeats : of a timing.
    search : evaluations in the search of a bandwidth.
    with_peers : whether other packages run too.
    lengths : numbers of samples, for the first table of scaling.
    separable, coupled : numbers of orders, for the other two.
    """

    samples: int | None = None
    excerpt: int = 20_000
    repeats: int = 15
    slow_repeats: int = 3
    search: int = 14
    with_peers: bool = True
    lengths: tuple[int, ...] = (125_000, 250_000, 500_000, 1_000_000)
    separable: tuple[int, ...] = (10, 20, 50, 100, 200)
    coupled: tuple[int, ...] = (2, 5, 10, 15, 20)


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One way to run one estimator.

    Attributes
    ----------
    kind : "smoother" and "filter" are ours.
    label : in the picture, equal for settings that share a line.
    estimator, method, poles, outputs : as the table says them.
    run : from a job and a bandwidth to the amplitudes and their samples.
    family : settings of one family have the same best bandwidth.
    search : what the search of the bandwidth runs: `run` or something quicker with the same errors.
    on : the jobs it runs on.
    excerpt_of : the estimator whose error it shares, if it runs on an excerpt and its time is scaled up.
    """

    kind: Kind
    label: str
    estimator: str
    method: str
    poles: int
    outputs: str
    run: Run
    family: str
    search: Run
    on: tuple[JobName, ...] = get_args(JobName)
    excerpt_of: str | None = None


@dataclass(frozen=True, kw_only=True)
class Row:
    """What one setting did on one job: time in multiples of an rfft, memory in MB (NaN where unknown)."""

    job: Job
    setting: Setting
    bandwidth: float
    time: float
    error: float
    memory: float

    def __str__(self) -> str:
        label = f"{self.job.name[:2]} {self.setting.label} ({self.setting.method})"
        return f"{label}: bandwidth {self.bandwidth:g}, time {self.time:.3g}, error {self.error:.4f}"


@dataclass(frozen=True, kw_only=True)
class Target:
    """What was to be reached, and what was."""

    what: str
    needed: str
    measured: str
    passed: bool


def _track(job: Job, bandwidth: float, **settings: Any) -> tuple[NDArray[np.complex128], NDArray[np.int64]]:  # noqa: ANN401
    tracks = track_orders(**job.tracking(bandwidth), **settings)
    return tracks.complex_amplitude, tracks.sample_index


def ours(
    estimator: Literal["smoother", "filter"],
    method: str,
    *,
    poles: int,
    every: int = 1,
    rtol: float | None = None,
    on: tuple[JobName, ...] = get_args(JobName),
) -> Setting:
    """Return a setting of `track_orders`; `rtol` None is its default."""
    tolerance: dict[str, Any] = {} if rtol is None else {"rtol": rtol}
    return Setting(
        kind=estimator,
        label=f"{estimator} {poles}" + (", exact" if method == "exact" else "") + (", all" if every == 1 else ""),
        estimator=estimator,
        method=method if rtol is None else f"{method}, rtol {rtol:g}",
        poles=poles,
        outputs="all" if every == 1 else f"every {every}",
        run=partial(_track, estimator=estimator, method=method, poles=poles, output_every=every, **tolerance),
        family=f"{estimator} {poles}",
        search=partial(_track, estimator=estimator, method="auto", poles=poles, output_every=DECIMATED),
        on=on,
    )


def our_settings() -> list[Setting]:
    """Return every estimator and method of `track_orders` at several poles, tolerances and outputs."""
    smoothers = [
        ours("smoother", "fast", poles=poles, every=DECIMATED, rtol=rtol)
        for poles in (1, 2, 3, 4)
        for rtol in (1e-2, None, 1e-4)
    ]
    smoothers += [ours("smoother", "fast", poles=poles) for poles in (1, 2)]
    smoothers += [ours("smoother", "exact", poles=poles, every=DECIMATED, on=("J3 angle",)) for poles in (1, 2)]
    return smoothers + [ours("filter", method, poles=poles) for method in ("exact", "fast") for poles in (1, 2)]


def _given(job: Job, bandwidth: float, *, kept: dict[tuple[str, int], Floats]) -> peers.Tracks:
    key = job.name, job.samples
    if key not in kept:
        for other in [other for other in kept if other[0] != job.name]:
            del kept[other]
        kept[key] = peers.regressors(job)
    return peers.compiled_filter_given(job, bandwidth, rows=kept[key])


def peer_settings() -> list[Setting]:
    """Return the other packages' ways; the first call of one makes what is not timed."""
    alone = partial(peers.vold_kalman_alone, poles=2, block=peers.BLOCK)
    coupled = partial(peers.vold_kalman_coupled, poles=2)
    blocks = f"every {peers.BLOCK}"
    causal = next(s for s in our_settings() if s.family == "filter 1")

    def peer(label: str, method: str, poles: int, run: Run, **settings: Any) -> Setting:  # noqa: ANN401
        usual: dict[str, Any] = {"outputs": "all", "family": label, "search": run}
        estimator = label.replace("VK", "Vold-Kalman")
        return Setting(
            kind="peer", label=label, estimator=estimator, method=method, poles=poles, run=run, **(usual | settings)
        )

    one: dict[str, Any] = {"family": causal.family, "search": causal.search}
    given = partial(_given, kept={})
    slow = one | {"excerpt_of": "numba"}
    return [
        peer("Butterworth", "demodulation, scipy sosfiltfilt", 2, peers.demodulated),
        peer("VK alone", "scipy solveh_banded", 1, partial(peers.vold_kalman_alone, poles=1)),
        peer("VK alone, sums", "scipy solveh_banded on means", 2, alone, outputs=blocks),
        peer(
            "VK alone, 2 poles",
            "scipy solveh_banded",
            2,
            partial(peers.vold_kalman_alone, poles=2),
            search=alone,
        ),
        peer("VK coupled, sums", "scipy solveh_banded on sums", 2, coupled, outputs=blocks),
        peer("numba", "covariance filter", 1, peers.compiled_filter, **one),
        peer("numba, given sines", "covariance filter", 1, given, **one),
        peer("filterpy", "covariance filter", 1, peers.filterpy_filter, **slow),
        peer("statsmodels", "covariance filter", 1, peers.statsmodels_filter, **slow),
    ]


def _seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def time_in_ffts(call: Callable[[], object], record: Floats, effort: Effort) -> float:
    """Time a call that has run before, in those of an rfft of the record, both in turn."""
    repeats = effort.repeats if _seconds(call) < SLOW_S else effort.slow_repeats
    both = [(_seconds(call), _seconds(lambda: np.fft.rfft(record))) for _ in range(repeats)]
    return statistics.median(mine for mine, _ in both) / statistics.median(fft for _, fft in both)


def _give_back() -> None:
    """Return freed memory to the system, where the C library can: what grows into it would not show."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def _resident_mb(which: Literal["VmRSS", "VmHWM"]) -> float:
    """Resident set of this process, now or at its peak; NaN where the system does not tell."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
        if which == "VmRSS":
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak starts anew
    except OSError:
        return float("nan")
    return next(float(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith(which))


def best_bandwidth(job: Job, run: Run, effort: Effort) -> float:
    """Search the bandwidth with the least error, to three digits."""
    unit = 0.01 if job.per_revolution else 1.0  # a hundred turns of J3 are as much as a second of J1
    failed: list[Exception] = []

    def log_error(log_bandwidth: float) -> float:
        try:
            return float(np.log(job.error(*run(job, unit * float(np.exp(log_bandwidth))))))
        except REFUSED as error:
            failed.append(error)
            return 10.0

    bounds = tuple(np.log(BANDWIDTH_HZ))
    found: Any = minimize_scalar(
        log_error, bounds=bounds, method="bounded", options={"xatol": 5e-3, "maxiter": effort.search}
    )
    if found.fun == 10.0:  # noqa: PLR2004  (nothing ran)
        raise failed[0]
    return float(f"{unit * np.exp(found.x):.3g}")


def measure(names: Iterable[JobName], settings: Sequence[Setting], effort: Effort) -> tuple[list[Row], list[str]]:
    """Run every setting on its jobs; return the rows and a sentence for each refusal."""
    rows: list[Row] = []
    refused: dict[str, list[str]] = {}
    for name in names:
        job = standard_job(name, samples=effort.samples)
        widths: dict[str, float] = {}
        for setting in (s for s in settings if name in s.on):
            try:
                if setting.family not in widths:
                    widths[setting.family] = best_bandwidth(job, setting.search, effort)
                rows.append(_measured(job, setting, widths[setting.family], effort, rows))
                print(rows[-1], file=sys.stderr)  # noqa: T201  (a quarter of an hour is long)
            except REFUSED as refusal:
                why = f"{setting.label} ({setting.method}): {type(refusal).__name__}: {refusal}"
                refused.setdefault(why, []).append(name[:2])
    return rows, [f"{', '.join(names)}: {why}" for why, names in refused.items()]


def _check_causal(job: Job, run: Run, bandwidth: float, effort: Effort) -> None:
    """Refuse a filter whose outputs change with later samples: it would beat all others for the wrong reason."""
    record = standard_job(job.name, samples=min(effort.excerpt, job.samples))
    half = record.samples // 2
    later = np.where(np.arange(record.samples) < half, record.x, 2 - 3 * record.x)
    (one, at), (other, _) = (run(dataclasses.replace(record, x=x), bandwidth) for x in (record.x, later))
    before = np.abs(one - other)[:, at < half]
    if not np.all(before <= 1e-9 * np.abs(one).max()):
        raise ArithmeticError(f"outputs change by up to {before.max():.2g} with samples that come after them")


def _measured(job: Job, setting: Setting, bandwidth: float, effort: Effort, rows: list[Row]) -> Row:
    short = setting.excerpt_of is not None
    record = standard_job(job.name, samples=min(effort.excerpt, job.samples)) if short else job
    setting.run(record, bandwidth)  # compiles
    if setting.family.startswith("filter"):
        _check_causal(job, setting.run, bandwidth, effort)
    _give_back()
    before = _resident_mb("VmRSS")
    error = record.error(*setting.run(record, bandwidth))
    memory = np.nan if short else _resident_mb("VmHWM") - before
    if short:
        alike = [row.error for row in rows if (row.job.name, row.setting.label) == (job.name, setting.excerpt_of)]
        error = alike[0] if alike else np.nan
    times = time_in_ffts(lambda: setting.run(record, bandwidth), job.x, effort) * job.samples / record.samples
    return Row(job=job, setting=setting, bandwidth=bandwidth, time=times, error=error, memory=memory)


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> list[str]:
    """Return a table in Markdown with an empty line after it."""
    rows = [head, ["---"] * len(head), *lines]
    return ["| " + " | ".join(row) + " |" for row in rows] + [""]


def job_table(rows: Sequence[Row]) -> list[str]:
    """Return the table of one job."""
    head = ("estimator", "method", "poles", "outputs", "bandwidth", "time", "error", "MB")
    lines = []
    for row in rows:
        s = row.setting
        scaled = " (scaled)" if s.excerpt_of else ""
        memory = f"{max(row.memory, 0):.0f}" if np.isfinite(row.memory) else "-"
        measured = f"{row.bandwidth:g}", f"{row.time:.3g}{scaled}", f"{row.error:.4f}", memory
        lines.append((s.estimator, s.method, str(s.poles), s.outputs, *measured))
    return _table(head, lines)


def _only(rows: Sequence[Row], job: str, **wanted: object) -> list[Row]:
    """Rows of a job (by the start of its name) whose settings have these values."""
    return [
        row
        for row in rows
        if row.job.name.startswith(job) and all(getattr(row.setting, name) == value for name, value in wanted.items())
    ]


def difference(job: Job, one: Run, other: Run, bandwidth: float) -> float:
    """Root of the mean square difference of two answers over that of the second, second half of the outputs."""
    (mine, at), (theirs, _) = one(job, bandwidth), other(job, bandwidth)
    late = slice(at.size // 2, None)
    return float(np.linalg.norm(mine[:, late] - theirs[:, late]) / np.linalg.norm(theirs[:, late]))


def _within(value: float, bound: float, digits: int = 3) -> bool:
    """Whether a value is at most the bound as printed with so many digits."""
    return float(f"{value:.{digits}g}") <= bound


def targets(rows: Sequence[Row]) -> list[Target]:
    """Compare the rows with what is asked of the trackers."""
    found = []
    for job, error, most in (("J1", 0.0155, 4), ("J2", 0.0150, 4), ("J3", 0.0176, 3)):
        mine = _only(rows, job, kind="smoother", outputs=f"every {DECIMATED}")
        good = [row for row in mine if _within(row.error, error)] or mine
        if good:
            best = min(good, key=lambda row: row.time)
            passed = _within(best.error, error) and _within(best.time, most)
            needed = f"error {error:g}, time {most}"
            found.append(_target(f"{job} smoother, outputs every {DECIMATED}", needed, best, passed=passed))
    found += _dense_smoother_targets(rows) + _causal_targets(rows)
    return found


def _target(what: str, needed: str, row: Row, *, passed: bool, more: str = "") -> Target:
    measured = f"error {row.error:.4f}, time {row.time:.3g} ({row.setting.method}, poles {row.setting.poles}){more}"
    return Target(what=what, needed=needed, measured=measured, passed=passed)


def _dense_smoother_targets(rows: Sequence[Row]) -> list[Target]:
    found = []
    for dense in _only(rows, "J1", kind="smoother", outputs="all"):
        same = {"kind": "smoother", "outputs": f"every {DECIMATED}", "poles": dense.setting.poles, "method": "fast"}
        for sparse in _only(rows, "J1", **same):
            apart = abs(dense.error / sparse.error - 1)
            passed = apart <= 1e-3 and _within(dense.time, 8)  # noqa: PLR2004
            needed = f"error within 0.001 of that with outputs every {DECIMATED}, time 8"
            found.append(_target("J1 smoother, all outputs", needed, dense, passed=passed, more=f", {apart:.1e} apart"))
    return found


def _causal_targets(rows: Sequence[Row]) -> list[Target]:
    found = []
    for name, most in (("J1", 12), ("J3", 3)):
        exact = _only(rows, name, kind="filter", method="exact", poles=1)
        both = [*exact, *_only(rows, name, kind="filter", method="fast", poles=1)]
        if not exact:
            continue
        best, reference = min(both, key=lambda row: row.time), exact[0]
        what = f"{name} causal, 1 pole, all outputs"
        if name == "J1":
            apart = difference(best.job, best.setting.run, reference.setting.run, best.bandwidth)
            passed = apart <= 1e-6 and _within(best.error, 0.0486) and _within(best.time, most)  # noqa: PLR2004
            needed = f"within 1e-6 of exact, error 0.0486, time {most}"
            found.append(_target(what, needed, best, passed=passed, more=f", {apart:.1e} from exact"))
        else:
            apart = abs(best.error / reference.error - 1)
            passed = apart <= 0.01 and _within(best.time, most)  # noqa: PLR2004
            needed = f"error within 1 % of that of exact, time {most}"
            found.append(_target(what, needed, best, passed=passed, more=f", {apart:.1e} apart"))
    single, double = (_only(rows, "J1", kind="filter", poles=poles) for poles in (1, 2))
    if single and double:
        best, bound = min(double, key=lambda row: row.error), min(row.error for row in single)
        needed = f"error below that with 1 pole, {bound:.4f}"
        found.append(_target("J1 causal, 2 poles, all outputs", needed, best, passed=best.error < bound))
    return found


def speedups(rows: Sequence[Row], effort: Effort) -> tuple[list[str], list[Target]]:
    """Compare the causal one-pole filters on the same excerpt, sample by sample."""
    found, lines = [], []
    head = ("job", "peer", "our method", "times as fast", "difference")
    bounds = {"filterpy": FILTERPY_TARGET, "statsmodels": STATSMODELS_TARGET}
    for name in ("J1 run-up", "J3 angle"):
        job = standard_job(name, samples=effort.excerpt)
        mine = _only(rows, name, kind="filter", poles=1, outputs="all")
        for theirs in (row for row in rows if row.job.name == name and row.setting.label in bounds):
            ratios = []
            for row in mine:
                seconds = [_per_call(partial(s.run, job, row.bandwidth), effort) for s in (theirs.setting, row.setting)]
                apart = difference(job, row.setting.run, theirs.setting.run, row.bandwidth)
                ratios.append(seconds[0] / seconds[1])
                lines.append((name, theirs.setting.label, row.setting.method, f"{ratios[-1]:.3g}", f"{apart:.1e}"))
            if ratios:
                bound = bounds[theirs.setting.label]
                what = f"{name[:2]} causal, 1 pole, {effort.excerpt:,} samples against {theirs.setting.label}"
                measured = f"{max(ratios):.3g} times as fast"
                target = Target(
                    what=what, needed=f"{bound} times as fast", measured=measured, passed=max(ratios) >= bound
                )
                found.append(target)
    return _table(head, lines), found


def _per_call(call: Callable[[], object], effort: Effort) -> float:
    """Median seconds of a call, after one that warms up."""
    repeats = effort.repeats if _seconds(call) < SLOW_S else effort.slow_repeats
    return statistics.median(_seconds(call) for _ in range(repeats))


def scaling(bandwidths: tuple[float, float], effort: Effort) -> tuple[list[str], list[Target]]:
    """Time against samples (J1), separable orders and coupled ones; `bandwidths` of smoother and filter in Hz."""
    smooth = ours("smoother", "fast", poles=2, every=DECIMATED).run
    causal = ours("filter", "auto", poles=1).run
    tables: list[tuple[str, float, Sequence[int], Callable[[int], Callable[[], object]]]] = [
        (
            f"J1 smoother, 2 poles, every {DECIMATED}: samples",
            LINEAR,
            effort.lengths,
            lambda n: partial(smooth, standard_job("J1 run-up", samples=n), bandwidths[0]),
        ),
        (
            "J1 filter, 1 pole, all outputs: samples",
            LINEAR,
            effort.lengths,
            lambda n: partial(causal, standard_job("J1 run-up", samples=n), bandwidths[1]),
        ),
        (
            "smoother, 2 poles: whole orders 1, 2, 3, ...",
            LINEAR,
            effort.separable,
            lambda n: partial(_noise_tracked, np.arange(1.0, n + 1), effort),
        ),
        (
            "smoother, 2 poles: orders 20, 20.01, 20.02, ...",
            QUADRATIC,
            effort.coupled,
            lambda n: partial(_noise_tracked, 20 + 0.01 * np.arange(n), effort),
        ),
    ]
    unit = _per_call(lambda: np.fft.rfft(np.ones(max(effort.lengths))), effort)
    lines, found = [], []
    for what, bound, sizes, make in tables:
        times = _growing(sizes, make, effort)
        lines += [(what, f"{size:,}", f"{seconds / unit:.3g}") for size, seconds in times.items()]
        late = np.log(list(times.items())[-3:])
        power = float(np.polyfit(late[:, 0], late[:, 1], 1)[0]) if len(late) > 1 else np.nan
        measured = f"exponent {power:.2f} up to {max(times, default=0):,}"
        passed = power <= bound and len(times) == len(sizes)
        found.append(
            Target(what=what, needed=f"exponent {bound:g}, to {sizes[-1]:,}", measured=measured, passed=passed)
        )
    return _table(("what grows", "how many", "time"), lines), found


def _growing(sizes: Sequence[int], make: Callable[[int], Callable[[], object]], effort: Effort) -> dict[int, float]:
    """Seconds a call at each size, as far as one call may last."""
    times: dict[int, float] = {}
    for size in sizes:
        if times and times[max(times)] * (size / max(times)) ** 3 > LONGEST_S:
            break
        try:
            times[size] = _per_call(make(size), effort)
        except REFUSED:
            break
    return times


def _noise_tracked(orders: NDArray[Any], effort: Effort) -> object:
    """Smooth plain noise sampled in angle; what it holds does not change how long it takes."""
    samples = max(effort.lengths) // 4
    return track_orders(
        np.random.default_rng(0).standard_normal(samples),
        phase_rad=2 * np.pi / SAMPLES_PER_REV * np.arange(samples),
        orders=orders,
        bandwidth_orders=0.05,
        samples_per_rev=SAMPLES_PER_REV,
        poles=2,
        method="fast",
        output_every=DECIMATED,
    )


COLOURS: dict[Kind, str] = {"smoother": LINE, "filter": MARK, "peer": FAINT}


def draw(rows: Sequence[Row], ax: "Axes") -> None:
    """Draw one panel a job in place of the Axes."""
    figure = ax.figure
    ax.remove()
    names = list(dict.fromkeys(row.job.name for row in rows))
    shown = [[row for row in rows if row.job.name == name and row.error <= DRAWN[1]] for name in names]
    panels = np.atleast_1d(figure.subplots(1, len(names), sharey=True))
    for panel, name, mine in zip(panels, names, shown, strict=True):
        _panel(mine, panel)
        panel.set_title(name, loc="left", color=INK)
        panel.set_xlabel("time, multiples of an rfft")
    panels[0].set_ylabel("error")
    legend = f"filled: every {DECIMATED} samples; open: all\ndotted: best of all, and of the causal"
    panels[-1].text(1, 1, legend, fontsize=6, color=INK, va="top", ha="right", transform=panels[-1].transAxes)
    settle(panels[0])
    for panel, mine in zip(panels, shown, strict=True):
        _label(mine, panel)


def _panel(rows: Sequence[Row], panel: "Axes") -> None:
    panel.set(xscale="log", yscale="log")
    ticks = (0.015, 0.02, 0.03, 0.05, 0.07)
    panel.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.yaxis.set_minor_locator(NullLocator())
    panel.set_ylim(*DRAWN)
    panel.margins(x=0.22)
    for mine in _lines(rows):
        colour = COLOURS[mine[0].setting.kind]
        face = "white" if mine[0].setting.outputs == "all" else colour
        at = [row.time for row in mine], [row.error for row in mine]
        panel.plot(*at, "o-", color=colour, markerfacecolor=face, markersize=4, linewidth=1, zorder=3)
    for among in (rows, [row for row in rows if row.setting.family.startswith("filter")]):
        front: list[Row] = []
        for row in sorted(among, key=lambda row: (row.time, row.error)):
            if not front or row.error < front[-1].error:
                front.append(row)
        corners = [row.time for row in front], [row.error for row in front]
        panel.plot(*corners, drawstyle="steps-post", color=INK, linewidth=0.6, linestyle=":", zorder=1)
    panel.set_xlim(panel.get_xlim())  # as the points have it, whatever is drawn to name them


def _lines(rows: Sequence[Row]) -> list[list[Row]]:
    """Rows that differ in their tolerance only, quickest first, for each label."""
    labels = dict.fromkeys(row.setting.label for row in rows)
    return [sorted((row for row in rows if row.setting.label == name), key=lambda row: row.time) for name in labels]


def _label(rows: Sequence[Row], panel: "Axes") -> None:
    """Name every line at a place that is still free, with a thread to it where that is not beside a point."""
    pixel = points(panel)
    where = {id(row): panel.transData.transform((row.time, row.error)) for row in rows}
    board = Board(inside=panel.get_window_extent())
    for x, y in where.values():
        board.take(Bbox.from_extents(x - 2.5 * pixel, y - 2.5 * pixel, x + 2.5 * pixel, y + 2.5 * pixel))
    back = panel.transData.inverted()
    for mine in _lines(rows):
        colour = INK if mine[0].setting.kind == "peer" else COLOURS[mine[0].setting.kind]
        text = panel.text(1, 1, mine[0].setting.label, fontsize=6, color=colour, va="center", ha="center", zorder=4)
        text.set_path_effects([withStroke(linewidth=2, foreground="white")])
        text.set_in_layout(False)
        half = np.array([text.get_window_extent().width, text.get_window_extent().height]) / 2
        places = []
        for away in (4, 8, 13, 19, 26, 34):
            for x, y in (where[id(mine[0])], where[id(mine[-1])]):
                right, up = half + away * pixel
                slants = [(side, level) for level in (up, -up) for side in (0, right / 2, -right / 2, right, -right)]
                places += [(x + dx, y + dy) for dx, dy in [(right, 0), (-right, 0), *slants]]
        board.put(text, [tuple(back.transform(place)) for place in places])
        box = text.get_window_extent()
        threads = [(start, np.clip(start, box.min, box.max)) for start in (where[id(mine[0])], where[id(mine[-1])])]
        start, end = min(threads, key=lambda thread: float(np.linalg.norm(thread[1] - thread[0])))
        if np.linalg.norm(end - start) > 6 * pixel:
            panel.plot(*back.transform([start, end]).T, color=colour, linewidth=0.4, zorder=2)


def main(folder: Path, *, effort: Effort | None = None) -> int:
    """Measure, and write the tables and the picture."""
    effort = effort or Effort()
    settings = our_settings() + (peer_settings() if effort.with_peers else [])
    names: tuple[JobName, ...] = get_args(JobName)
    rows, refusals = measure(names, settings, effort)
    note = NOTE.format(repeats=effort.repeats, slow=effort.slow_repeats)
    lines = ["# Trackers: time against error", "", note, "", "![Time against error](trackers.svg)", ""]
    reached = targets(rows)
    faster, fast_enough = speedups(rows, effort)
    widths = {row.setting.family: row.bandwidth for row in _only(rows, "J1")}
    grown, straight = scaling((widths.get("smoother 2", 1.0), widths.get("filter 1", 1.0)), effort)
    verdicts = [
        (t.what, t.needed, t.measured, "yes" if t.passed else "**no**") for t in reached + fast_enough + straight
    ]
    lines += ["## Targets", "", *_table(("what", "needed", "measured", "reached"), verdicts)]
    for name in names:
        lines += [f"## {name}", "", *job_table(_only(rows, name))]
    lines += ["## Against other packages, sample by sample", "", *faster] if effort.with_peers else []
    lines += ["## Scaling", "", *grown]
    lines += ["## Left out", "", *(f"- {refusal}" for refusal in refusals), ""] if refusals else []
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trackers.md").write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")
    save_figure(partial(draw, rows), folder / "trackers.svg", width=11, height=4.6)
    print("\n".join(lines))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/benchmarks")))

"""Every way to track orders that the report compares: ours, and those of other packages."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, Literal, get_args

import numpy as np
import peers
from jobs import Job, JobName
from numpy.typing import NDArray

from signals.harmonics import OrderTracker, likely_bandwidth, track_orders
from signals.harmonics.state_space import Method

Tracks = tuple[NDArray[np.complex128], NDArray[Any]]
Run = Callable[[Job, float], Tracks]
Kind = Literal["smoother", "filter", "peer"]

OWN_BANDWIDTHS = "own bandwidths"  # family of what finds them by itself
DECIMATED = 200  # samples from one output to the next, where not all are wanted
FED = 4096  # samples of a block that a stream is fed with
EVERYWHERE: tuple[JobName, ...] = get_args(JobName)


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
    prepare : makes for a job what is not timed.
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
    on: tuple[JobName, ...] = EVERYWHERE
    excerpt_of: str | None = None
    prepare: Callable[[Job], object] | None = None


def _track(job: Job, bandwidth: float, **settings: Any) -> Tracks:  # noqa: ANN401
    tracks = track_orders(**job.tracking(bandwidth), **settings)
    return tracks.complex_amplitude, tracks.sample_index


def _likeliest(job: Job, _: float) -> Tracks:
    searched = job.tracking(2.0)
    searched["largest_bandwidth_hz"] = searched.pop("bandwidth_hz")
    tracks = track_orders(**job.tracking(likely_bandwidth(**searched, poles=2)), poles=2)
    return tracks.complex_amplitude, tracks.sample_index


def ours(
    estimator: Literal["smoother", "filter"],
    method: str,
    *,
    poles: int,
    every: int = 1,
    rtol: float | None = None,
    on: tuple[JobName, ...] = EVERYWHERE,
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


def stream(job: Job, bandwidth: float, *, poles: int, method: Method) -> Tracks:
    """Feed a job to an `OrderTracker`, block by block."""
    names = ("bandwidth_orders", "samples_per_rev") if job.per_revolution else ("bandwidth_hz", "rate_hz")
    rates: dict[str, Any] = dict(zip(names, (bandwidth, job.rate), strict=True))
    tracker = OrderTracker(orders=job.orders, noise_variance=1.0, poles=poles, method=method, **rates)
    parts = []
    for start in range(0, job.samples, FED):
        block = slice(start, start + FED)
        if isinstance(job.phase_rad, Mapping):
            parts.append(tracker.update(job.x[block], phase_rad={s: p[block] for s, p in job.phase_rad.items()}))
        else:
            parts.append(tracker.update(job.x[block], phase_rad=job.phase_rad[block]))
    amplitude = np.concatenate([part.complex_amplitude for part in parts], axis=-1)
    return amplitude, np.concatenate([part.sample_index for part in parts])


def streams() -> list[Setting]:
    """Return the causal filter in blocks."""
    causal, methods = ours("filter", "exact", poles=1), get_args(Method)
    return [
        Setting(
            kind="filter",
            label=f"filter 1, {method}, in blocks, all",
            estimator="filter in blocks",
            method=f"{method}, {FED:,} samples at a time",
            poles=1,
            outputs="all",
            run=partial(stream, poles=1, method=method),
            family=causal.family,
            search=causal.search,
        )
        for method in methods
    ]


def our_settings() -> list[Setting]:
    """Return every estimator and method of ours at several poles, tolerances and outputs."""
    smoothers = [
        ours("smoother", "fast", poles=poles, every=DECIMATED, rtol=rtol)
        for poles in (1, 2, 3, 4)
        for rtol in (1e-2, None, 1e-4)
    ]
    smoothers += [ours("smoother", "fast", poles=poles) for poles in (1, 2)]
    smoothers += [ours("smoother", "exact", poles=poles, every=DECIMATED) for poles in (1, 2)]
    own: dict[str, Any] = {"method": "maximum-likelihood bandwidths", "run": _likeliest, "search": _likeliest}
    own["label"] = "smoother 2, likeliest bandwidths, all"
    smoothers.append(replace(ours("smoother", "auto", poles=2, on=("J4 close",)), family=OWN_BANDWIDTHS, **own))
    filters = [ours("filter", method, poles=poles) for method in ("exact", "fast") for poles in (1, 2, 3, 4)]
    return [*smoothers, *filters, *streams()]


_regressors = lru_cache(maxsize=1)(peers.regressors)  # of one job at a time


def _given(job: Job, bandwidth: float) -> Tracks:
    """Run the filter on regressors made beforehand."""
    return peers.compiled_filter_given(job, bandwidth, rows=_regressors(job))


def peer_settings() -> list[Setting]:
    """Return the other packages' ways."""
    alone = partial(peers.vold_kalman_alone, poles=2, block=peers.BLOCK)
    coupled = partial(peers.vold_kalman_coupled, poles=2)
    blocks = f"every {peers.BLOCK}"
    causal = ours("filter", "exact", poles=1)

    def peer(label: str, method: str, poles: int, run: Run, **settings: Any) -> Setting:  # noqa: ANN401
        usual: dict[str, Any] = {"outputs": "all", "family": label, "search": run}
        estimator = label.replace("VK", "Vold-Kalman")
        return Setting(
            kind="peer", label=label, estimator=estimator, method=method, poles=poles, run=run, **(usual | settings)
        )

    one: dict[str, Any] = {"family": causal.family, "search": causal.search}
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
        peer("numba, given sines", "covariance filter", 1, _given, **one, prepare=_regressors),
        peer("filterpy", "covariance filter", 1, peers.filterpy_filter, **slow),
        peer("statsmodels", "covariance filter", 1, peers.statsmodels_filter, **slow),
    ]

"""Every way to track orders that the report compares: ours, and those of other packages."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, get_args

import numpy as np
import peers
from jobs import Floats, Job, JobName
from numpy.typing import NDArray

from signals.harmonics import track_orders

Run = Callable[[Job, float], tuple[NDArray[np.complex128], NDArray[Any]]]
Kind = Literal["smoother", "filter", "peer"]

DECIMATED = 200  # samples from one output to the next, where not all are wanted


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

"""How time grows with samples and with orders."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from jobs import SAMPLES_PER_REV, standard_job
from numpy.typing import NDArray

from signals.harmonics import track_orders
from tracking.clock import Effort, seconds, time_in_ffts
from tracking.measuring import REFUSED
from tracking.settings import DECIMATED, ours
from tracking.tables import table
from tracking.targets import Target

LONGEST_S = 30.0  # of one call; larger sizes are not tried
LINEAR, QUADRATIC = 1.1, 2.1  # exponents, a tenth of them left to the clock


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
    lines, found = [], []
    for what, bound, sizes, make in tables:
        times = _growing(sizes, make, effort)
        lines += [(what, f"{size:,}", f"{time:.3g}") for size, time in times.items()]
        late = np.log(list(times.items())[-3:])
        power = float(np.polyfit(late[:, 0], late[:, 1], 1)[0]) if len(late) > 1 else np.nan
        measured = f"exponent {power:.2f} up to {max(times, default=0):,}"
        passed = power <= bound and len(times) == len(sizes)
        found.append(
            Target(what=what, needed=f"exponent {bound:g}, to {sizes[-1]:,}", measured=measured, passed=passed)
        )
    return table(("what grows", "how many", "time"), lines), found


def _growing(sizes: Sequence[int], make: Callable[[int], Callable[[], object]], effort: Effort) -> dict[int, float]:
    """Time a call at each size, in rffts of the longest record, as far as one call may last."""
    times: dict[int, float] = {}
    took, record = 0.0, np.ones(max(effort.lengths))
    for size in sizes:
        if times and took * (size / max(times)) ** 3 > LONGEST_S:
            break
        call = make(size)
        try:
            call()
        except REFUSED:
            break
        took = seconds(call)
        times[size] = time_in_ffts(call, record, effort)
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

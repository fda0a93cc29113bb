"""The condition indicators of a gear, each from what it was defined on: average, residual, difference, mesh band."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hums.baseline import Baseline
from hums.layout import IndicatorValue
from signals.averaging import SynchronousAverage
from signals.indicators import INDICATORS
from signals.residues import difference_signal, mesh_band, regular_signal, residual_signal

_SHAFT_ORDERS = (1, 2)  # of the shaft itself, taken out beside the mesh
GAUSSIAN_KURTOSIS = 3.0
_OVER_NOISE = 4.0  # standard deviations of a kurtosis, below which noise may make it


@dataclass(frozen=True, kw_only=True)
class Part:
    """What indicators speak of, in one channel."""

    channel: str
    units: str
    component: str
    kind: str

    def row(
        self,
        name: str,
        takes: str,
        compute: Callable[[], Any],
        *,
        unit: str = "",
        source: str = "",
        noise_limit: float = math.nan,
    ) -> IndicatorValue:
        """Return an indicator's value, or the sentence of the error that keeps it from one."""
        known = INDICATORS.get(name)
        unit = unit or (known.unit if known else "1")
        value, withheld = math.nan, ""
        try:
            value = float(compute())
        except ValueError as error:
            withheld = str(error)
        if not withheld and not math.isfinite(value):
            value, withheld = math.nan, "it is not finite: what it is divided by is nothing."
        return IndicatorValue(
            channel=self.channel,
            component=self.component,
            kind=self.kind,
            indicator=name,
            value=value,
            unit=self.units if unit == "signal" else unit,
            noise_limit=math.nan if withheld else noise_limit,
            takes=takes,
            source=source or (known.source if known else ""),
            withheld=withheld,
        )


def smooth_kurtosis(harmonics: int) -> float:
    """Return the kurtosis of a mesh of `harmonics` equal ones in phase that swings like a sine over the turn.

    Run-out and misalignment leave such a difference signal: nothing in it is local, but harmonics in phase peak once a
    tooth. The fourth moment of ``sum_k cos(k x)`` is a mean over so many points that it is exact; the swing,
    independent of it, contributes the 3/2 of a sine.
    """
    angle = 2 * np.pi * np.arange(4 * harmonics + 1) / (4 * harmonics + 1)
    waves = np.cos(np.multiply.outer(np.arange(1, harmonics + 1), angle)).sum(axis=0)
    return float(1.5 * np.mean(waves**4) / np.mean(waves**2) ** 2)


def refusing(reason: str) -> Callable[[], float]:
    """Return a computation that raises a sentence known already."""

    def refuse() -> float:
        raise ValueError(reason)

    return refuse


@dataclass(frozen=True, kw_only=True)
class Gear:
    """A gear on an averaged shaft: its teeth, those of every gear on that shaft, and how many mesh harmonics count."""

    component: str
    teeth: int
    on_shaft: tuple[int, ...]
    harmonics: int

    @property
    def sidebands(self) -> int:
        """How many sidebands of the first mesh harmonic are its own: half-way to any other mesh on the shaft."""
        others = {harmonic * teeth for teeth in self.on_shaft for harmonic in range(1, 2 * self.teeth // teeth + 1)}
        nearest = min(abs(other - self.teeth) for other in others | {2 * self.teeth} if other != self.teeth)
        return max(1, (nearest - 1) // 2)

    def last_order(self, average: SynchronousAverage) -> int:
        """Highest order kept: half a mesh beyond its last harmonic, or what the average passes."""
        passed = min(average.passband_orders, (average.samples_per_rev - 1) // 2)
        return int(min((self.harmonics + 0.5) * self.teeth, passed))


def gear_indicators(part: Part, average: SynchronousAverage, gear: Gear, baseline: Baseline) -> list[IndicatorValue]:
    """Compute every indicator of a gear from the average of its shaft, or of itself."""
    of = f"of {average.revolutions} revolution{'s' if average.revolutions > 1 else ''}"
    return [
        *_of_average(part, average, gear, f"average {of}"),
        *_of_rest(part, average, gear, of, baseline),
        *_of_mesh(part, average, gear, of, baseline),
    ]


def _of_average(part: Part, average: SynchronousAverage, gear: Gear, takes: str) -> Iterator[IndicatorValue]:
    passed = max(1, min(gear.harmonics, int(average.passband_orders // gear.teeth)))
    yield part.row("fm0", takes, partial(INDICATORS["fm0"], average, teeth=gear.teeth, harmonics=passed))
    for name in ("sideband_index", "sideband_level_factor"):
        yield part.row(name, takes, partial(INDICATORS[name], average, teeth=gear.teeth))


def _of_rest(
    part: Part, average: SynchronousAverage, gear: Gear, of: str, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Compute what rests on the average without the meshes of all gears on the shaft.

    Kept up to order n it has 2 n independent values a turn; the kurtosis of that many Gaussian ones is 3 with a
    standard deviation of sqrt(24 / 2n), and four of those are allowed to noise.
    """
    last = gear.last_order(average)
    cut: dict[str, Any] = {"teeth": gear.on_shaft, "harmonics": gear.harmonics, "shaft_orders": _SHAFT_ORDERS}
    limit = GAUSSIAN_KURTOSIS + _OVER_NOISE * math.sqrt(24 / (2 * last)) if last else math.nan
    for name in ("fm4", "m6a", "m8a"):
        yield part.row(
            name,
            f"difference signal {of}, up to order {last}",
            lambda indicator=INDICATORS[name]: indicator(difference_signal(average, max_order=last, **cut)),  # type: ignore[misc]
            noise_limit=limit if name == "fm4" else math.nan,
        )
    residual = partial(residual_signal, average, max_order=last, **cut)
    takes = f"residual signal {of}, up to order {last}"
    yield part.row("energy_operator", takes, lambda: INDICATORS["energy_operator"](residual()))
    yield _against_history(part, "na4", takes, residual, baseline)

    def energy_ratio() -> Any:  # noqa: ANN401
        difference = difference_signal(average, **cut)
        return INDICATORS["energy_ratio"](difference, regular_signal(average, left=difference))

    yield part.row("energy_ratio", f"difference and regular signal {of}", energy_ratio)


def _of_mesh(
    part: Part, average: SynchronousAverage, gear: Gear, of: str, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Compute how the first mesh harmonic is modulated; always the first, so that records can be compared."""
    beside = gear.sidebands
    takes = f"mesh order {gear.teeth} with {beside} sidebands {of}"
    band = partial(mesh_band, average, mesh_order=gear.teeth, sidebands=beside)
    for name, indicator in INDICATORS.items():
        if indicator.takes == INDICATORS["nb4"].takes and not indicator.needs:
            yield part.row(name, takes, lambda indicator=indicator: indicator(band()))  # type: ignore[misc]
    yield _against_history(part, "nb4", takes, band, baseline)


def _against_history(part: Part, name: str, takes: str, make: Callable[[], Any], baseline: Baseline) -> IndicatorValue:
    """Compute NA4 or NB4 with this record in its history, and say how many records that holds."""
    try:
        signal = make()
        history = baseline.updated((part.channel, part.component, name), signal)
    except ValueError as error:
        return part.row(name, takes, refusing(str(error)))
    held = "frozen history" if history.frozen else "history"
    count = f"{history.records} record{'s' if history.records > 1 else ''}"
    return part.row(name, f"{takes}; {held} of {count}", partial(INDICATORS[name], signal, history=history))

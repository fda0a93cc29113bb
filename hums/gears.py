"""Condition indicators of a gear, from its synchronous average, residual and difference signal, and mesh band."""

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

_SHAFT_ORDERS = (1, 2)  # removed from the residual signal together with the mesh
GAUSSIAN_KURTOSIS = 3.0
_OVER_NOISE = 4.0  # standard deviations of the kurtosis of noise, up to which it is not significant


@dataclass(frozen=True, kw_only=True)
class MonitoredComponent:
    """A component in one channel, for which indicators are computed."""

    channel: str
    units: str
    component: str
    kind: str

    def evaluate(
        self,
        name: str,
        takes: str,
        compute: Callable[[], Any],
        *,
        unit: str = "",
        source: str = "",
        noise_limit: float = math.nan,
    ) -> IndicatorValue:
        """Return the value of an indicator, or the message of the ValueError that withholds it."""
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


def modulated_mesh_kurtosis(harmonics: int) -> float:
    """Return the kurtosis of a mesh signal of equal harmonics in phase with sinusoidal amplitude over the revolution.

    Run-out and misalignment leave such a difference signal, in which nothing is local, although harmonics in phase
    peak once per tooth. The moments of ``sum_k cos(k x)`` are exact as means over 4 `harmonics` + 1 points; the
    independent sinusoidal amplitude contributes its kurtosis of 3/2.
    """
    angle = 2 * np.pi * np.arange(4 * harmonics + 1) / (4 * harmonics + 1)
    waves = np.cos(np.multiply.outer(np.arange(1, harmonics + 1), angle)).sum(axis=0)
    return float(1.5 * np.mean(waves**4) / np.mean(waves**2) ** 2)


def unavailable(reason: str) -> Callable[[], float]:
    """Return a function that raises ValueError with the given reason."""

    def refuse() -> float:
        raise ValueError(reason)

    return refuse


@dataclass(frozen=True, kw_only=True)
class Gear:
    """A gear on an averaged shaft: its teeth, those of all gears on the shaft, and the mesh harmonics used."""

    component: str
    teeth: int
    on_shaft: tuple[int, ...]
    harmonics: int

    @property
    def sidebands(self) -> int:
        """Number of sidebands of the first mesh harmonic, up to half-way to the nearest other mesh harmonic."""
        others = {harmonic * teeth for teeth in self.on_shaft for harmonic in range(1, 2 * self.teeth // teeth + 1)}
        nearest = min(abs(other - self.teeth) for other in others | {2 * self.teeth} if other != self.teeth)
        return max(1, (nearest - 1) // 2)

    def last_order(self, average: SynchronousAverage) -> int:
        """Return the highest order used: half a mesh order above the last harmonic, within the average's passband."""
        passed = min(average.passband_orders, (average.samples_per_rev - 1) // 2)
        return int(min((self.harmonics + 0.5) * self.teeth, passed))


def gear_indicators(
    monitored: MonitoredComponent, average: SynchronousAverage, gear: Gear, baseline: Baseline
) -> list[IndicatorValue]:
    """Return all indicators of a gear, computed from the synchronous average of its shaft or of the gear itself."""
    of = f"of {average.revolutions} revolution{'s' if average.revolutions > 1 else ''}"
    return [
        *_average_indicators(monitored, average, gear, f"average {of}"),
        *_residual_indicators(monitored, average, gear, of, baseline),
        *_mesh_band_indicators(monitored, average, gear, of, baseline),
    ]


def _average_indicators(
    monitored: MonitoredComponent, average: SynchronousAverage, gear: Gear, takes: str
) -> Iterator[IndicatorValue]:
    passed = max(1, min(gear.harmonics, int(average.passband_orders // gear.teeth)))
    yield monitored.evaluate("fm0", takes, partial(INDICATORS["fm0"], average, teeth=gear.teeth, harmonics=passed))
    for name in ("sideband_index", "sideband_level_factor"):
        yield monitored.evaluate(name, takes, partial(INDICATORS[name], average, teeth=gear.teeth))


def _residual_indicators(
    monitored: MonitoredComponent, average: SynchronousAverage, gear: Gear, of: str, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Yield the indicators of the residual and difference signals, without the meshes of all gears on the shaft.

    Up to order n these have 2 n independent values per revolution; the kurtosis of that many Gaussian values is 3 with
    a standard deviation of sqrt(24 / 2n). The noise limit is four of these above 3.
    """
    last = gear.last_order(average)
    cut: dict[str, Any] = {"teeth": gear.on_shaft, "harmonics": gear.harmonics, "shaft_orders": _SHAFT_ORDERS}
    limit = GAUSSIAN_KURTOSIS + _OVER_NOISE * math.sqrt(24 / (2 * last)) if last else math.nan
    for name in ("fm4", "m6a", "m8a"):
        yield monitored.evaluate(
            name,
            f"difference signal {of}, up to order {last}",
            lambda indicator=INDICATORS[name]: indicator(difference_signal(average, max_order=last, **cut)),  # type: ignore[misc]
            noise_limit=limit if name == "fm4" else math.nan,
        )
    residual = partial(residual_signal, average, max_order=last, **cut)
    takes = f"residual signal {of}, up to order {last}"
    yield monitored.evaluate("energy_operator", takes, lambda: INDICATORS["energy_operator"](residual()))
    yield _history_indicator(monitored, "na4", takes, residual, baseline)

    def energy_ratio() -> Any:  # noqa: ANN401
        difference = difference_signal(average, **cut)
        return INDICATORS["energy_ratio"](difference, regular_signal(average, left=difference))

    yield monitored.evaluate("energy_ratio", f"difference and regular signal {of}", energy_ratio)


def _mesh_band_indicators(
    monitored: MonitoredComponent, average: SynchronousAverage, gear: Gear, of: str, baseline: Baseline
) -> Iterator[IndicatorValue]:
    """Yield the indicators of the modulation of the first mesh harmonic, the same one in every record."""
    beside = gear.sidebands
    takes = f"mesh order {gear.teeth} with {beside} sidebands {of}"
    band = partial(mesh_band, average, mesh_order=gear.teeth, sidebands=beside)
    for name, indicator in INDICATORS.items():
        if indicator.takes == INDICATORS["nb4"].takes and not indicator.needs:
            yield monitored.evaluate(name, takes, lambda indicator=indicator: indicator(band()))  # type: ignore[misc]
    yield _history_indicator(monitored, "nb4", takes, band, baseline)


def _history_indicator(
    monitored: MonitoredComponent, name: str, takes: str, make: Callable[[], Any], baseline: Baseline
) -> IndicatorValue:
    """Return NA4 or NB4 with this record in its history of variances."""
    try:
        signal = make()
        history = baseline.update((monitored.channel, monitored.component, name), signal)
    except ValueError as error:
        return monitored.evaluate(name, takes, unavailable(str(error)))
    held = "frozen history" if history.frozen else "history"
    count = f"{history.records} record{'s' if history.records > 1 else ''}"
    return monitored.evaluate(name, f"{takes}; {held} of {count}", partial(INDICATORS[name], signal, history=history))

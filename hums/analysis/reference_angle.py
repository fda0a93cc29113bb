"""Kinematics of the gearbox and angle of its reference shaft in a record."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import combinations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.analysis.thresholds import STEADY_SPEED
from hums.gearbox.bearing_catalogue import BearingOrders
from hums.gearbox.components import closest
from hums.gearbox.defect_orders import DefectOrder, bearing_orders, defects
from hums.gearbox.kinematics import Kinematics, solve_kinematics
from hums.gearbox.model import Gearbox
from hums.records.channels import Sampling, channel_values, nominal_speed, sampling, tachometers, vibration_channels
from signals.resampling.resampling import whole_revolutions
from signals.shaft.phase import ShaftPhase, constant_speed
from signals.shaft.phase_demodulation import refine_phase
from signals.shaft.tacholess import DeclaredSpeed, SpeedEstimate, estimate_speed, refine_declared_speed
from signals.shaft.tachometer import shaft_phase

_JITTER_LIMIT_RAD = 0.3  # phase error that takes 4 % off a line
_FEWEST_SAMPLES = 64  # to look for lines in
# of shafts, whose combs show a speed: loose, misaligned or rubbing ones have some ten, and the tenth shows it ten times
# as exactly as the first; of the orders that do not show none costs more than the chance that one does
_SHAFT_HARMONICS = 10
_FASTEST_HZ = 750.0  # 45,000 rpm, our choice: faster input shafts are of small turbines alone, and declare a range
_INSTANTS = 400  # pulses at which the angles of two tachometers are compared
_FEWEST_PULSES = 5  # two more than ratio, delay and offset take
_LEAST_RATIO = 1e-3  # by which speeds have to differ from the drawing's ratio: both have the clock of the record
_LEAST_PULSES = 0.5  # of the finer tachometer by which angles have to differ, or of the coarser by which they scatter
_LEAST_TURNS = 0.01  # of the reference that a delay shifts its angle over a change of speed: half a cycle of order 50
_CERTAIN = 5.0  # standard deviations of a delay
_CHANGE = 0.02  # of the speed, below which no delay shows
_FOLLOWED = 4.0  # times the change of a steady speed, for the error of the speed over one revolution
_FAULTY_PULSES = 0.05  # share of repaired pulses from which a tachometer is faulty


@dataclass(frozen=True, kw_only=True)
class SpeedFromVibration:
    """Speed estimated from the vibration of one channel."""

    channel: str
    speed: SpeedEstimate

    @property
    def confidence(self) -> float:
        """Mean confidence over the frames with an estimate."""
        shown = np.isfinite(self.speed.speed_hz)
        return float(self.speed.confidence[shown].mean())


@dataclass(frozen=True, kw_only=True)
class AngleSource:
    """Shaft whose angle is known, and its source: a tachometer, a declared speed, or the vibration.

    `declared` is the declared speed as refined by the lines of the first channel; `followed`: its changes are refined
    too. `contradiction` states how other tachometers contradict this one, `unusable` why some are not used.
    """

    shaft: str
    phase: ShaftPhase
    tachometer: str = ""
    pulses_per_rev: int = 0
    estimated: SpeedFromVibration | None = None
    declared: DeclaredSpeed | None = None
    followed: bool = False
    contradiction: str = ""
    unusable: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Kinematics and defect orders of a gearbox, with the angle `phase` of its reference.

    `ratio` is the number of revolutions of the reference per revolution of the shaft in `source`. For a record in
    parts, with unrelated angles, `phase` is that of the fastest part, and `parts` has the machine of each.
    """

    kinematics: Kinematics
    reference: str
    defect_orders: tuple[DefectOrder, ...]
    bearings: tuple[BearingOrders, ...]
    phase: ShaftPhase
    source: AngleSource
    ratio: float
    parts: tuple["Machine", ...] = ()

    def phase_in_parts(self, parts_per_turn: int) -> ShaftPhase:
        """Return the angle of the reference in equal parts of a turn."""
        return self.phase if parts_per_turn == 1 else self.phase.scaled(parts_per_turn)

    def whole_turns(self, when: Sampling, *, parts_per_turn: int, early_s: float = 0.0) -> float:
        """Return the turns in whole parts of a turn, up to `early_s` before the last sample; ValueError for none."""
        phase, stop_s = self.phase_in_parts(parts_per_turn), when.start_s + (when.count - 1) / when.rate_hz - early_s
        return whole_revolutions(phase, start_s=when.start_s, stop_s=stop_s)[1] / parts_per_turn

    @cached_property
    def speeds_hz(self) -> NDArray[np.float64]:
        """Mean speed of the reference over each revolution, in rev/s."""
        if self.parts:
            return np.concatenate([part.speeds_hz for part in self.parts])
        return self.phase.mean_speed_per_revolution_hz()

    @cached_property
    def top_speed_hz(self) -> float:
        """Highest mean speed of the reference over a revolution, in rev/s."""
        return float(self.speeds_hz.max())

    @property
    def mean_speed_hz(self) -> float:
        """Mean speed of the reference, in rev/s."""
        phases = [part.phase for part in self.parts or (self,)]
        turns = sum(float(phase.revolutions[-1] - phase.revolutions[0]) for phase in phases)
        return turns / sum(phase.stop_s - phase.start_s for phase in phases)

    @property
    def separates_time_from_angle(self) -> bool:
        """Whether lines of constant frequency widen in angle: not at a steady speed that is declared or estimated.

        The error of such an angle widens the lines of the shaft itself.
        """
        steady = float(np.ptp(self.speeds_hz)) <= _FOLLOWED * STEADY_SPEED * self.mean_speed_hz
        return not self.phase.nominal and not (steady and self.source.estimated is not None)

    @property
    def jitter_s(self) -> float:
        """Standard deviation of a pulse time in s, 0 where unknown."""
        return 0.0 if math.isnan(self.source.phase.jitter_s) else self.source.phase.jitter_s

    @property
    def jitter_limit_order(self) -> float:
        """Order above which jitter attenuates a line by 4 % or more."""
        turn = 2 * math.pi * self.jitter_s * self.mean_speed_hz
        return _JITTER_LIMIT_RAD / turn if turn else math.inf

    def order_of(self, link: str) -> Fraction:
        """Return the exact shaft order of a link on a fixed axis: its speed over that of the reference, unsigned."""
        return abs(self.kinematics.relative_speed(link, seen_from=self.kinematics.gearbox.frame))

    def phase_std_rad(self, times_s: NDArray[np.float64], *, bandwidth_orders: float) -> NDArray[np.float64]:
        """Return the standard deviation of the reference's angle in rad, within the bandwidth of a tracker.

        Errors of single pulses are independent: of white errors at p pulses per revolution, the first-order smoother of
        full -3 dB width B passes the share ``1.22 B / p`` of the variance (its equivalent noise bandwidth is 1.22 B).
        Errors of an estimated angle are slow and pass unattenuated.
        """
        if self.source.estimated is not None:
            return np.full(times_s.size, 2 * math.pi * self.source.estimated.speed.phase_std_rev)
        if self.phase.nominal or not math.isfinite(self.phase.jitter_s):
            return np.zeros(times_s.size)
        std = self.phase.std_rad(np.clip(times_s, self.phase.start_s, self.phase.stop_s))
        pulses = self.source.pulses_per_rev / self.ratio
        return np.asarray(std * math.sqrt(min(1.0, _NOISE_BANDWIDTH * bandwidth_orders / pulses)))

    @property
    def tachometer_condition(self) -> tuple[str, tuple[str, ...]]:
        """Status of the tachometer, "ok", "suspect" or "faulty", and a sentence for each reason."""
        phase, reasons = self.source.phase, list(self.source.unusable)
        repairs = phase.repairs
        if repairs.total:
            reasons.append(
                f"The tachometer's pulses were repaired: {repairs.missing} were missing and counted, {repairs.double} "
                f"double and {repairs.spurious} spurious ones left out, of {phase.times_s.size} that remain."
            )
        if phase.direction_unknown:
            begin, end = phase.stops_s[0]
            reasons.append(
                f"The shaft may have stopped ({len(phase.stops_s)} times, first from {begin:.4g} to {end:.4g} s), and "
                "the pulses do not show its direction afterwards: it is taken to have continued in the same direction."
            )
        if self.jitter_limit_order < 1:
            reasons.append(
                f"The tachometer's pulses jitter by {self.jitter_s * 1e6:.3g} us, so much that even the first order of "
                f"{self.reference} is blurred. Check the sensor and its threshold."
            )
        faulty = repairs.total > _FAULTY_PULSES * phase.times_s.size or self.jitter_limit_order < 1
        return ("faulty" if faulty else "suspect" if reasons else "ok"), tuple(reasons)


_NOISE_BANDWIDTH = math.pi / 4 / math.sqrt(math.sqrt(2) - 1)  # of 1 / (1 + (f/f0)^2) over its full -3 dB width


def prepare_machine(record: xr.Dataset, gearbox: Gearbox, settings: AnalysisSettings) -> Machine:
    """Return the kinematics of the gearbox and the angle of its reference in the record.

    Raises
    ------
    AnalysisError
        If the gearbox has several degrees of freedom or no reference, a shaft does not exist, the tachometer pulses
        cannot be repaired, the speed cannot be estimated, or the record holds less than one revolution.
    """
    mechanism = solved(gearbox)
    kinematics, reference = mechanism.kinematics, mechanism.reference
    source = _angle_source(record, kinematics, mechanism.defect_orders, reference, settings)
    ratio = _ratio(kinematics, source.shaft, reference)
    phase = source.phase if abs(ratio) == 1 else source.phase.scaled(abs(ratio))
    turned = float(phase.revolutions[-1] - phase.revolutions[0])
    if turned < 1:
        raise AnalysisError(
            f'the record holds no whole revolution of the reference "{reference}" ({turned:.3g} of one in '
            f"{phase.stop_s - phase.start_s:.3g} s); record longer, or choose a faster reference."
        )
    if source.tachometer:
        _refuse_implausible(phase, source.tachometer, reference, settings)
    return Machine(
        kinematics=kinematics,
        reference=reference,
        defect_orders=mechanism.defect_orders,
        bearings=mechanism.bearings,
        phase=phase,
        source=source,
        ratio=abs(ratio),
    )


def together(machines: Sequence[Machine]) -> Machine:
    """Return the machine over all parts of a record: the angle of the fastest, and the speeds of all."""
    if len(machines) == 1:
        return machines[0]
    return replace(max(machines, key=lambda one: one.top_speed_hz), parts=tuple(machines))


@dataclass(frozen=True, kw_only=True)
class SolvedGearbox:
    """Part of a `Machine` that depends on the gearbox alone."""

    kinematics: Kinematics
    reference: str
    defect_orders: tuple[DefectOrder, ...]
    bearings: tuple[BearingOrders, ...]


def solved(gearbox: Gearbox) -> SolvedGearbox:
    """Return a gearbox with one degree of freedom solved for its orders; raise AnalysisError for any other."""
    if not isinstance(gearbox, Gearbox):
        raise AnalysisError(f"gearbox is a {type(gearbox).__name__}; load it first, as hums.load_gearbox(...) does.")
    return _solved(gearbox)


@lru_cache(maxsize=8)  # a fleet has thousands of records of a few gearboxes
def _solved(gearbox: Gearbox) -> SolvedGearbox:
    kinematics = solve_kinematics(gearbox)
    if kinematics.dof != 1:
        raise AnalysisError(
            f'gearbox "{gearbox.name}" has {kinematics.dof} degrees of freedom; an analysis needs one, so that one '
            "tachometer determines every speed. Fix the other inputs, for example by making them rigid with the frame."
        )
    if gearbox.reference is None:
        raise AnalysisError(f'gearbox "{gearbox.name}" declares no reference shaft; add reference = "LINK".')
    return SolvedGearbox(
        kinematics=kinematics,
        reference=gearbox.reference,
        defect_orders=defects(kinematics),
        bearings=bearing_orders(kinematics),
    )


def _refuse_implausible(phase: ShaftPhase, tachometer: str, reference: str, settings: AnalysisSettings) -> None:
    """Raise if the speed by the tachometer is mostly outside the declared range, or implausibly high."""
    speed = float(np.median(np.abs(phase.mean_speed_per_revolution_hz())))
    low, high = settings.speed_range_hz or (0.0, _FASTEST_HZ)
    if low <= speed <= high:
        return
    said = "the declared range" if settings.speed_range_hz else "the plausible range"
    raise AnalysisError(
        f'tachometer "{tachometer}" gives {speed:.4g} rev/s ({60 * speed:,.0f} rpm) of the reference "{reference}", '
        f"outside {said}, {low:g} to {high:g} rev/s. Check the tachometer, its pulses_per_rev and whether the shaft "
        "turned, or declare the range: speed_range_hz=(low, high) with max_acceleration_hz_s=..., on the command line "
        "--speed-range LOW HIGH --max-acceleration HZ_PER_S."
    )


def _ratio(kinematics: Kinematics, shaft: str, reference: str) -> float:
    """Return the turns of the reference per turn of the shaft whose angle is known."""
    if shaft not in kinematics.links:
        raise AnalysisError(
            f'the record\'s angle is of shaft "{shaft}", which gearbox "{kinematics.gearbox.name}" does not have'
            f"{closest(shaft, list(kinematics.links))}"
        )
    turns = kinematics.rates({shaft: 1})
    ratio = sum(float(factor * turns[body]) for body, factor in kinematics.spin(reference).items())
    if ratio == 0:
        raise AnalysisError(f'the shaft "{shaft}" turns, but the reference "{reference}" does not; name another.')
    return ratio


def _angle_source(
    record: xr.Dataset,
    kinematics: Kinematics,
    defect_orders: Sequence[DefectOrder],
    reference: str,
    settings: AnalysisSettings,
) -> AngleSource:
    """Return the shaft angle from a tachometer, else a declared speed, else the vibration."""
    names = tachometers(record)
    if settings.tachometer is not None and settings.tachometer not in names:
        there = closest(settings.tachometer, names) if names else "; it has none"
        raise AnalysisError(f'the record has no tachometer "{settings.tachometer}"{there}')
    if names:
        return _best_tachometer(record, names, kinematics, reference, settings)
    declared = nominal_speed(record)
    if declared is not None:
        shaft = declared.attrs["shaft"]
        ratio = abs(_ratio(kinematics, shaft, reference))
        return _declared_angle(record, float(declared), shaft, ratio, defect_orders, settings)
    if settings.speed_range_hz is None or settings.max_acceleration_hz_s is None:
        raise AnalysisError(
            "the record has neither a tachometer nor a declared speed. To have the speed of the reference "
            f'"{reference}" estimated, give its range and rate of change, speed_range_hz=(low, high) and '
            "max_acceleration_hz_s=..., on the command line --speed-range LOW HIGH --max-acceleration HZ_PER_S."
        )
    return _vibration_angle(
        record, defect_orders, reference, settings, settings.speed_range_hz, settings.max_acceleration_hz_s
    )


def _declared_angle(
    record: xr.Dataset,
    speed_hz: float,
    shaft: str,
    ratio: float,
    defect_orders: Sequence[DefectOrder],
    settings: AnalysisSettings,
) -> AngleSource:
    """Return the angle of a shaft at its declared speed, refined by the lines of the first channel within tolerance.

    `ratio` is the number of turns of the reference, to which the orders refer, per turn of the shaft.
    """
    name = (settings.channels or vibration_channels(record))[0]
    when = sampling(record, name)
    found = DeclaredSpeed(declared_hz=speed_hz, speed_hz=speed_hz)
    values = np.asarray(channel_values(record, name), dtype=np.float64)
    top = when.rate_hz / 2 / (speed_hz * ratio)
    shafts = {row.order for row in defect_orders if row.kind == "shaft"}
    combs = {harmonic * order for order in shafts for harmonic in range(1, _SHAFT_HARMONICS + 1)}
    orders = sorted(combs.union(_speed_estimation_orders(defect_orders, settings.harmonics, below=top)))
    if settings.nominal_speed_tolerance > 0 and values.size >= _FEWEST_SAMPLES and np.isfinite(values).all():
        found = refine_declared_speed(
            values,
            rate_hz=when.rate_hz,
            speed_hz=speed_hz,
            orders=[order * ratio for order in orders if order <= top],
            tolerance=settings.nominal_speed_tolerance,
        )
    stop = when.start_s + (when.count - 1) / when.rate_hz
    phase = constant_speed(found.speed_hz, start_s=when.start_s, stop_s=stop)
    followed = None
    if found.orders.size and any(row.kind == "gear_mesh" for row in defect_orders):
        turning = [order * ratio for order in _speed_estimation_orders(defect_orders, settings.harmonics, below=top)]
        followed = _followed(values, when, phase, turning)
    return AngleSource(shaft=shaft, phase=followed or phase, declared=found, followed=followed is not None)


def _followed(
    values: NDArray[np.float64], when: Sampling, phase: ShaftPhase, orders: Sequence[float]
) -> ShaftPhase | None:
    """Return a declared angle with the speed changes shown by its orders, None if they show none.

    The speed of a motor varies by a few thousandths within a record, which is a tooth in a few hundred revolutions.
    """
    try:
        found = refine_phase(
            values, rate_hz=when.rate_hz, phase=phase, orders=orders, tolerance=STEADY_SPEED, start_s=when.start_s
        )
    except ValueError:  # too short, or no order low enough
        return None
    if found.phase is None:
        return None
    turning = found.phase.mean_speed_per_revolution_hz() / phase.speed_hz(np.array([phase.start_s]))
    # one that turns much further has followed something else
    return replace(found.phase, nominal=True) if np.abs(turning - 1).max() <= _FOLLOWED * STEADY_SPEED else None


def _best_tachometer(
    record: xr.Dataset, names: Sequence[str], kinematics: Kinematics, reference: str, settings: AnalysisSettings
) -> AngleSource:
    """Return the angle by the requested or the best tachometer, with contradictions by the others."""
    sources, unusable = {}, []
    for name in names:
        try:
            sources[name] = _tachometer_angle(record, name)
        except AnalysisError as error:
            if len(names) == 1 or name == settings.tachometer:
                raise
            unusable.append(f"Not used: {error}")
    if not sources:
        raise AnalysisError(" ".join(unusable))
    ratios = {name: abs(_ratio(kinematics, source.shaft, reference)) for name, source in sources.items()}
    compared = [
        _Tachometer(
            name=name,
            shaft=source.shaft,
            phase=source.phase.scaled(ratios[name]),
            pulses_per_turn=source.pulses_per_rev / ratios[name],
        )
        for name, source in sources.items()
    ]
    used = sources[settings.tachometer or min(compared, key=lambda one: one.std_rev).name]
    return replace(used, contradiction=_contradictions(compared, reference), unusable=tuple(unusable))


@dataclass(frozen=True, kw_only=True)
class _Tachometer:
    """Angle of the reference by one tachometer, and its pulses per revolution of the reference."""

    name: str
    shaft: str
    phase: ShaftPhase
    pulses_per_turn: float

    @property
    def std_rev(self) -> float:
        """Standard deviation of the angle of the reference, averaged over a revolution."""
        speed = abs(self.phase.revolutions[-1] - self.phase.revolutions[0]) / (self.phase.stop_s - self.phase.start_s)
        jitter = self.phase.jitter_s
        wrong = (1 + self.phase.repairs.total) / self.phase.times_s.size
        return float((jitter * speed if math.isfinite(jitter) else 1.0) + wrong / self.pulses_per_turn) / math.sqrt(
            self.pulses_per_turn
        )


def _contradictions(found: Sequence[_Tachometer], reference: str) -> str:
    """Return the joined sentences on pairs of tachometers that contradict each other by the gearbox ratio.

    With A and B the angles of the reference by both and v its speed, ``A - B = c + r B + d v`` is solved by least
    squares: r is the error of their ratio, d the delay of B after A, which is observable if the speed varies.
    """
    said = (_contradiction(one, other, reference) for one, other in combinations(found, 2))
    return "; ".join(filter(None, said))


def _contradiction(one: _Tachometer, other: _Tachometer, reference: str) -> str:
    begin, end = max(one.phase.start_s, other.phase.start_s), min(one.phase.stop_s, other.phase.stop_s)
    if not end > begin:
        return ""
    coarse, fine = sorted((one, other), key=lambda tach: tach.pulses_per_turn)
    pulses = coarse.phase.times_s  # at which its angle is known best
    at = pulses[(pulses >= begin) & (pulses <= end)]
    if at.size < _FEWEST_PULSES:
        return ""
    at = at[:: math.ceil(at.size / _INSTANTS)]
    first, second = (np.abs(tach.phase.revolutions_at(at) - tach.phase.revolutions[0]) for tach in (one, other))
    speed = np.abs(other.phase.speed_hz(at))
    turns = float(second[-1] - second[0])
    names = f'the tachometers "{one.name}" ({one.shaft}) and "{other.name}" ({other.shaft})'
    changes = float(np.ptp(speed)) > _CHANGE * float(speed.mean())
    ratio, delay, std, left = _fitted(first - second, second, speed if changes else None)
    apart, scattered = (max(_LEAST_PULSES / tach.pulses_per_turn, _LEAST_RATIO * turns) for tach in (fine, coarse))
    if abs(ratio) * turns > apart or left > scattered:
        speeds = [float(np.abs(tach[-1] - tach[0])) / (end - begin) for tach in (first, second)]
        return (
            f"{names} contradict each other: by the drawing they give {speeds[0]:.5g} and {speeds[1]:.5g} Hz as the "
            f'speed of "{reference}", a ratio of {speeds[0] / speeds[1]:.4g} instead of 1. Correct pulses_per_rev, '
            "the shaft or the drawing, or leave the wrong one out of the record"
        )
    if abs(delay) * float(np.ptp(speed)) > _LEAST_TURNS and abs(delay) > _CERTAIN * std:
        late, early = (other, one) if delay > 0 else (one, other)
        return (
            f'{names} contradict each other: "{late.name}" is {1e3 * abs(delay):.3g} ms later than "{early.name}" '
            f"(standard deviation {1e3 * std:.2g} ms), and at most one of them has the time of the channels. Correct "
            "the pulse times of the other, or leave it out of the record"
        )
    return ""


def _fitted(
    difference: NDArray[np.float64], angle: NDArray[np.float64], speed: NDArray[np.float64] | None
) -> tuple[float, float, float, float]:
    """Return ratio less one, delay and its standard deviation in s, and the largest residual in turns."""
    columns = [np.ones(angle.size), angle, *([] if speed is None else [speed])]
    matrix = np.stack(columns, axis=1)
    solution = np.linalg.lstsq(matrix, difference, rcond=None)[0]
    left = difference - matrix @ solution
    if speed is None:
        return float(solution[1]), 0.0, math.inf, float(np.abs(left).max())
    variance = float(left @ left) / (angle.size - matrix.shape[1])
    std = math.sqrt(variance * float(np.linalg.inv(matrix.T @ matrix)[2, 2]))
    return float(solution[1]), float(solution[2]), std, float(np.abs(left).max())


def _tachometer_angle(record: xr.Dataset, name: str) -> AngleSource:
    pulses, per_rev = record[name], int(record[name].attrs["pulses_per_rev"])
    try:
        phase = shaft_phase(channel_values(record, name), pulses_per_rev=per_rev)
    except ValueError as error:
        raise AnalysisError(f'tachometer "{name}": {error}') from None
    return AngleSource(shaft=pulses.attrs["shaft"], phase=phase, tachometer=name, pulses_per_rev=per_rev)


def _vibration_angle(
    record: xr.Dataset,
    defect_orders: Sequence[DefectOrder],
    reference: str,
    settings: AnalysisSettings,
    speed_range_hz: tuple[float, float],
    max_acceleration_hz_s: float,
) -> AngleSource:
    """Return the angle of the reference, estimated from the first channel that allows it."""
    tried = []
    for name in settings.channels or vibration_channels(record):
        when = sampling(record, name)
        try:
            found = estimate_speed(
                np.asarray(channel_values(record, name), dtype=np.float64),
                rate_hz=when.rate_hz,
                orders=_speed_estimation_orders(
                    defect_orders, settings.harmonics, below=when.rate_hz / 2 / speed_range_hz[0]
                ),
                speed_range_hz=speed_range_hz,
                max_acceleration_hz_s=max_acceleration_hz_s,
                start_s=when.start_s,
            )
        except ValueError as error:
            raise AnalysisError(f'the speed cannot be estimated from channel "{name}": {error}') from None
        if found.phase is not None:
            return AngleSource(
                shaft=reference, phase=found.phase, estimated=SpeedFromVibration(channel=name, speed=found)
            )
        tried.append(f'channel "{name}": {_failure_reason(found)}')
    raise AnalysisError(
        f'the speed of "{reference}" cannot be estimated from the vibration: {"; ".join(tried)}. Narrow speed_range_hz '
        "(--speed-range), choose another channel, or record a tachometer."
    )


def _speed_estimation_orders(defect_orders: Sequence[DefectOrder], harmonics: int, *, below: float) -> list[float]:
    """Return the orders for the speed estimate: shafts, and harmonics of meshes (of shafts if there is no mesh)."""
    meshes = {row.order for row in defect_orders if row.kind == "gear_mesh"}
    shafts = {row.order for row in defect_orders if row.kind == "shaft"}
    harmonic_orders = {harmonic * order for order in meshes or shafts for harmonic in range(1, harmonics + 1)}
    return sorted(order for order in harmonic_orders | shafts if order <= below) or sorted(shafts)


def _failure_reason(found: SpeedEstimate) -> str:
    if found.status == "not found":
        return "no shaft shows in it"
    middle = np.nanmedian(found.speed_hz)
    others = [
        f"{np.nanmedian(other.speed_hz):.4g} rev/s ({other.ratio:.3g} times it, probability {other.probability:.2g})"
        for other in found.alternatives
    ]
    other = f", or {', '.join(others)}" if others else ""
    return f"the speed is ambiguous: it may be about {middle:.4g} rev/s{other}; {found.reason}"

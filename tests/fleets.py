"""Observations of a machine with two gears and two sensors, healthy or not."""

from datetime import UTC, datetime, timedelta

import numpy as np

from hums.fleet.monitor import MachineState, update
from hums.fleet.observation import MonitorSettings, Observation
from hums.fleet.result_files import StoredRecord
from hums.fleet.series import Numbers, Series, shared

FIRST = datetime(2026, 3, 1, tzinfo=UTC)
KEYS = tuple(
    Series(channel=channel, component=component, kind="gear", indicator=f"{name}", unit=unit)
    for channel in ("a", "b")
    for component in ("stage 1/pinion", "stage 1/wheel", "stage 2/pinion", "stage 2/wheel")
    for name, unit in (
        ("ratio 1", "1"),
        ("ratio 2", "1"),
        ("level 1", "g"),
        ("level 2", "g"),
        ("level 3", "g"),
        ("level 4", "g"),
    )
)


def valued(values):
    return Numbers(keys=shared(tuple(values)), values=np.array(list(values.values()), dtype=np.float64))


def items(seen):
    """The series of an observation and their values."""
    return zip(seen.values.keys, seen.values.values, strict=True)


def observed(number, *, component="", shift=0.0, gain=0.0, speed_hz=20.0, seed=0, faulty=(), record=""):
    rng = np.random.default_rng([seed, number])
    values = {
        key: float(0.1 * rng.standard_normal() + shift * (key.component == component) + gain * key.power)
        for key in KEYS
        if key.channel not in faulty
    }
    return Observation(
        machine="mill",
        record=record or f"record {number}",
        recorded_at=(FIRST + timedelta(days=number)).isoformat(),
        values=valued(values),
        covariates={"speed_hz": speed_hz * (1 + 0.01 * rng.standard_normal())},
        faulty=dict.fromkeys(faulty, "clipped"),
    )


LINES = shared(tuple((name, "order_spectrum", "stage 1/pinion", "gear", n, 0, "g") for name in "ab" for n in (1, 2, 3)))


def kept(seen, *, growth=1.0):
    """The results of an observation's record; its lines grow."""
    return StoredRecord(
        **vars(seen),
        lines=Numbers(keys=LINES, values=np.array([[growth * x, 2, 1] for x in (0.1, 0.3, 0.2) * 2], dtype=np.float32)),
        orders=np.array([23.0, 46.0, 69.0] * 2),
        indicators=valued({}),
    )


def followed(seen, *, state=None, work=(), settings=None):
    state = state or MachineState(machine="mill", settings=settings or MonitorSettings(baseline_records=20))
    return state, [update(state, one, work=work) for one in seen]


def alarms(found):
    return [alarm for one in found for alarm in one.alarms]


HEALTHY = [observed(number) for number in range(40)]
PINION = {"component": "stage 1/pinion", "shift": 1.0}

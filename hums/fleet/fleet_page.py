"""Fleet page: machines, most urgent first, with condition over time, driving series, and lines then and now."""

import math
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from hums.fleet.alarms import ACKNOWLEDGED, RAISED
from hums.fleet.monitor import Epoch, driving_series
from hums.fleet.observation import days_since_1970
from hums.fleet.result_files import StoredRecord
from hums.fleet.series import Series, vector
from hums.fleet.watched_machines import MachineHistory
from hums.gearbox.defect_orders import BEARING_KINDS
from hums.pages.page import Figure, figure_html, least_and_largest, packed, page_environment, stand_alone_page
from hums.records.fields import file_name
from hums.records.outputs import write_text

Array = NDArray[np.float64]
_DRAWN = 50  # machines with figures, 0.3 MB of each with 2,000 records; all of them are in the table
_COLUMNS = 500  # of a course, each with its least and its largest value: one for a pixel of the widest figure
_SMALL_COLUMNS = 100  # of the line in the table
_NAMED = 5  # components in colours and in the legend; the others are thin
_PANELS = 6  # series that drove the worst component
_LOG_FROM = 10.0  # largest index from which the axis is logarithmic, so that the limit can still be seen
_SELDOM = 1e9  # records, beyond which a tail that was measured at one in 10,000 says no more than that
_STYLES = {"raised": "alarm", "acknowledged": "watch", "normal": "calm"}


@dataclass(frozen=True, kw_only=True)
class _Course:
    """Records of a machine in chronological order: the result of each, and its time in days from the first."""

    records: Sequence[StoredRecord]
    days: Array
    start_ms: float | None

    def packed(self, values: Array) -> dict[str, Any]:
        """Return a curve over the records for the page, with every peak and trough."""
        known = np.flatnonzero(np.isfinite(values))
        shown, at = least_and_largest(values[known], columns=_COLUMNS)
        return {"x": packed(self.days[known][at]), "y": packed(shown)}


def write_page(
    histories: Sequence[MachineHistory], records: Sequence[StoredRecord], path: Path, *, gearbox: str = "GEARBOX"
) -> None:
    """Write ``fleet.html``: a self-contained page, the most urgent machine first.

    Parameters
    ----------
    histories : sequence of MachineHistory
        Histories of the monitored machines.
    records : sequence of StoredRecord
        Results of all records.
    path : Path
        Path of the page. Reports of records next to it are linked: ``reports/MACHINE RECORD/report.html``.
    gearbox : str
        Path or name of the gearbox, for the command that writes such a report.
    """
    found = {one.record: one for one in records}
    ranked = sorted(histories, key=_rank)
    machines = [
        _machine(history, found, number, path.parent, gearbox) | {"drawn": number < _DRAWN}
        for number, history in enumerate(ranked)
    ]
    environment = page_environment()
    environment.filters["short"] = _short
    ours = files("hums.fleet")
    body = environment.from_string((ours / "page.html").read_text(encoding="utf-8")).render(
        machines=machines,
        records=len(records),
        every=f"{histories[0].state.settings.false_alarm_every:,.0f}" if histories else "",
        undrawn=max(0, len(machines) - _DRAWN),
    )
    page = stand_alone_page(
        title="Fleet",
        body=body,
        style=(ours / "page.css").read_text(encoding="utf-8"),
        script=(ours / "page.js").read_text(encoding="utf-8"),
    )
    write_text(path, page)


def _rank(history: MachineHistory) -> tuple[bool, float, str]:
    """Return the sort key of a machine: standing alarms first, then by the largest condition index."""
    return _state(history) != "raised", -_worst(history)[1], history.state.machine


def _worst(history: MachineHistory) -> tuple[str, float]:
    """Return the most urgent component, one with a standing alarm first, and its condition index; "" if none."""
    if history.last is None:
        return "", -math.inf

    def key(item: tuple[str, float]) -> tuple[bool, float]:
        return history.state.alarms[item[0]].state == RAISED, item[1]

    known = {name: index for name, index in history.last.index.items() if math.isfinite(index)}
    return max(known.items(), key=key) if known else ("", -math.inf)


def _state(history: MachineHistory) -> str:
    lives = {alarm.state for alarm in history.state.alarms.values()}
    if RAISED in lives:
        return RAISED
    if history.last is None:
        return "unwatched" if history.state.unwatched_since else "learning"
    return ACKNOWLEDGED if ACKNOWLEDGED in lives else "normal"


def _machine(
    history: MachineHistory, found: dict[str, StoredRecord], number: int, folder: Path, gearbox: str
) -> dict[str, Any]:
    """Return the variables of the page's template for a machine."""
    state, (component, index) = history.state, _worst(history)
    last = history.records[-1]["record"] if history.records else ""
    standing = [alarm for alarm in history.alarms if alarm["state"] == "raised"]
    reported = standing[-1]["record"] if standing else last
    channel, driver, _ = history.last.growth[component] if history.last and component else ("", "", 0.0)
    seen = state.judged + state.refused
    report = folder / "reports" / file_name(f"{state.machine} {Path(reported).stem}") / "report.html"
    words = {
        "name": f"machine-{number}",
        "machine": state.machine,
        "state": _state(history),
        "style": _STYLES.get(_state(history), "unknown"),
        "index": f"{index:.2f}" if component else "",
        "component": component,
        "since": _short(state.alarms[component].since) if component else "",
        "driver": f"{driver.replace('_', ' ').replace('rms', 'RMS')}, {channel}" if driver else "",
        "course": _small_course(history),
        "refused": f"{state.refused / seen:.0%}" if seen else "",
        "alarms": history.alarms,
        "a_year": "" if math.isnan(history.false_alarms_a_year) else f"{history.false_alarms_a_year:.2g}",
        "last": _short(found[last].recorded_at or last) if last in found else last,
        "reported": reported,
        "report": quote(report.relative_to(folder).as_posix()) if report.is_file() else "",
        "command": _command(reported, gearbox, report.parent),
        "sentence": _sentence(history, component, index, driver, channel),
    }
    figures = _figures(history, found, component, f"machine-{number}") if number < _DRAWN else ()
    return words | {"figures": list(figures)}


def _small_course(history: MachineHistory) -> str:
    """Return the largest condition index of each record as a sparkline; x / (1 + x) puts the limit in the middle."""
    largest = np.array([max(filter(math.isfinite, one["index"].values()), default=math.nan) for one in history.records])
    known = np.flatnonzero(np.isfinite(largest))
    if not known.size:
        return ""
    groups = np.array_split(known, min(known.size, _SMALL_COLUMNS))
    heights = [float(largest[those].max()) for those in groups]
    places = [100 * float(those[-1] + 1) / largest.size for those in groups]
    points = " ".join(f"{x:.1f},{15 - 14 * y / (1 + y):.1f}" for x, y in zip(places, heights, strict=True))
    return (
        f'<svg class="course" viewBox="0 0 100 16" preserveAspectRatio="none" role="img" '
        f'aria-label="latest {heights[-1]:.2f}, largest {max(heights):.2f}"><line x2="100" y1="8" y2="8"/>'
        f'<polyline points="{points}"/></svg>'
    )


def _short(moment: str) -> str:
    """Return an ISO 8601 time without zero seconds, or midnight; UTC if it has no offset."""
    plain = moment.removesuffix("Z").removesuffix("+00:00").removesuffix("T00:00:00")
    return plain.removesuffix(":00").replace("T", " ") if "T" in plain else plain


def _unit(unit: str) -> str:
    unit = unit.replace("m s-1", "m/s").replace("m s-2", "m/s²")
    return f"{unit[:-1]}²" if unit.endswith("2") and not unit.endswith("-2") else unit


def _command(record: str, gearbox: str, folder: Path) -> str:
    """Return the command that writes the report of a record."""
    if not record.endswith((".h5", ".hdf5")):
        return ""
    return shlex.join(["hums", "analyze", record, "--gearbox", gearbox, "-o", str(folder)])


def _sentence(history: MachineHistory, component: str, index: float, driver: str, channel: str) -> str:
    state = history.state
    if not component:
        if state.unwatched_since:
            return f"Not monitored since {state.unwatched_since}: all later records were refused."
        pending = max((len(epoch.pending) for epoch in state.baselines), default=0)
        return f"Its baseline is being learned: {pending} records so far."
    if index < 1 and state.alarms[component].state != RAISED:
        text = f'No alarm. The largest condition index, {index:.2f}, is that of "{component}".'
    else:
        text = f"{component}: {driver.replace('_', ' ')} of {channel}"
        if math.isfinite(ratio := history.last.ratio[component] if history.last else math.nan):
            text += f" {ratio:,.3g} times normal"
        text += f", since {_short(since)}" if (since := state.alarms[component].since) else ""
        growth, seldom = history.growth_per_day(component), history.once_in_records(component)
        text += f", growing by {growth:.2g} standard deviations per day; inspect." if growth > 0 else "; inspect."
        often = f"once in {float(f'{seldom:.2g}'):,.0f}" if seldom < _SELDOM else f"less than once in {_SELDOM:,.0f}"
        text += f" An unchanged component reaches its condition index, {index:.2f}, {often} records."
        follows = state.standing.get(component, {}).get("consequences", "")
        text += f" Consequences: {follows}." if follows else ""
    if state.unwatched_since:
        text += f" Not monitored since {state.unwatched_since}: later records were refused."
    return text


# ---- figures ---------------------------------------------------------------------------------------------------------


def _figures(history: MachineHistory, found: dict[str, StoredRecord], component: str, name: str) -> Iterator[str]:
    """Yield the figures of a machine: condition, driving series, and lines of two records."""
    kept = [found[one["record"]] for one in history.records]
    if not component or not kept:
        return
    course = _course(kept)
    yield figure_html(_health(history, course, name), caption="Dashed: limit. Shaded: records of the baseline.")
    epoch = history.state.epochs[history.state.epoch_of(component.partition(": ")[0])]
    judged = [one for one, brought in zip(kept, history.records, strict=True) if not brought["why"]]
    drivers = driving_series(epoch, judged[-1].observation, component, most=_PANELS) if judged else ()
    if drivers:
        yield figure_html(
            _panels(epoch, course, drivers, component, name), caption="Dotted: normal value of the baseline."
        )
        spectrum = "envelope" if drivers[0].kind in BEARING_KINDS else "order_spectrum"
        lines = _stems(judged, drivers[0].channel, spectrum, name)
        if lines is not None:
            yield figure_html(lines)


def _course(kept: Sequence[StoredRecord]) -> _Course:
    days = days_since_1970(one.recorded_at for one in kept)
    if np.isfinite(days).all():
        return _Course(records=kept, days=days - days[0], start_ms=round(86_400_000 * float(days[0])))
    return _Course(records=kept, days=np.arange(len(kept), dtype=np.float64), start_ms=None)


def _health(history: MachineHistory, course: _Course, name: str) -> Figure:
    """Return condition indices of all components of a machine over time, with the limit, the baseline and alarms."""
    if history.last is None:
        raise ValueError("a machine without a judged record has no condition index; omit its figure.")
    now = {key: value if math.isfinite(value) else -math.inf for key, value in history.last.index.items()}
    worst = _worst(history)[0]
    order = sorted(now, key=lambda key: (key != worst, -now[key]))
    index = {
        key: np.array([one["index"].get(key, math.nan) for one in history.records], dtype=np.float64) for key in order
    }
    largest = max((float(np.nanmax(each)) for each in index.values() if np.isfinite(each).any()), default=1.0)
    places = {one.record: at for at, one in enumerate(course.records)}
    learned = [places[one] for epoch in history.state.baselines for one in epoch.records if one in places]
    raised = [alarm for alarm in history.alarms if alarm["record"] in places]
    data = {
        "start": course.start_ms,
        "components": [{"name": key, **course.packed(index[key])} for key in order],
        "named": _NAMED,
        "span": [float(course.days[0]), float(course.days[-1])],
        "baseline": [float(course.days[min(learned)]), float(course.days[max(learned)])] if learned else [],
        "alarms": {
            "x": [float(course.days[places[alarm["record"]]]) for alarm in raised],
            "y": [max(float(alarm["value"]), 0.02) for alarm in raised],
            "text": [f"{alarm['component']}: {alarm['indicator']}".replace("<", "&lt;") for alarm in raised],
        },
        "log": [-1.0, math.log10(largest) + 0.1] if largest > _LOG_FROM else None,
    }
    alt = f"Condition index of {history.state.machine or 'the machine'} over {len(course.records)} records; "
    alt += f"{worst} is now at {now[worst]:.2g}, where 1 is the limit."
    return Figure(name=f"{name}-health", alt=alt, title="Condition index", view="health", data=data, height_px=320)


def _panels(epoch: Epoch, course: _Course, drivers: tuple[Series, ...], component: str, name: str) -> Figure:
    """Return the series with the largest deviations, each in its unit against time."""
    center = dict(zip(epoch.series, epoch.learned[0].raw.center.tolist(), strict=True))
    logs = np.array([vector(one.observation.values, drivers) for one in course.records])
    panels = []
    for key, values in zip(drivers, np.exp(logs).T, strict=True):
        title = f"{key.words.replace('_', ' ').replace('rms', 'RMS')}, {key.channel}"
        title += "" if key.unit in ("", "1") else f", {_unit(key.unit)}"
        panels.append({"title": title, "normal": math.exp(center[key]), **course.packed(values)})
    alt = f"Indicators of {component} that deviate most: " + "; ".join(panel["title"] for panel in panels) + "."
    data = {"start": course.start_ms, "panels": panels}
    return Figure(
        name=f"{name}-drivers", alt=alt, title=f"Indicators: {component}", view="panels", data=data,
        height_px=150 * -(-len(panels) // 3) + 70,
    )  # fmt: skip


def _stems(judged: Sequence[StoredRecord], channel: str, spectrum: str, name: str) -> Figure | None:
    """Return the overlaid lines of a channel in its first judged and its last record, None without lines."""
    pairs, unit = [], ""
    for one in (judged[0], judged[-1]):
        rows = [
            (order, value, units)
            for (*of, _, _, _, _, units), order, value in zip(
                one.lines.keys, one.orders.tolist(), one.lines.values[:, 0].tolist(), strict=True
            )
            if of == [channel, spectrum] and math.isfinite(value)
        ]
        if not rows:
            return None
        orders, values, units = zip(*sorted(rows), strict=True)
        unit = units[0]
        pairs.append({"x": packed(orders), "y": packed(values)})
    first, last = (_short(one.recorded_at or one.record) for one in (judged[0], judged[-1]))
    data = {"first": pairs[0], "last": pairs[1], "firstName": f"first judged, {first}", "lastName": f"last, {last}"}
    where = "envelope" if spectrum == "envelope" else "order"
    return Figure(
        name=f"{name}-lines",
        alt=f"Lines in the {where} spectrum of {channel} in the first judged record and in the last.",
        title=f"Lines of the {where} spectrum of {channel}: first judged and last record",
        view="stems",
        data=data | {"unit": f"amplitude, {_unit(unit)}"},
        height_px=300,
    )

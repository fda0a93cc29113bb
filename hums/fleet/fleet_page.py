"""Fleet page: machines, most urgent first, with condition over time, driving series, and lines then and now."""

import math
import shlex
from collections.abc import Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from hums.fleet.monitor import RAISED, Epoch, driving_series
from hums.fleet.observation import ACKNOWLEDGED, days_since_1970, seconds_since_1970
from hums.fleet.result_files import StoredRecord
from hums.fleet.series import Series, vector
from hums.fleet.watched_machines import MachineHistory, component_row
from hums.gearbox.defect_orders import BEARING_KINDS
from hums.pages.page import Figure, figure_html, least_and_largest, packed, page_environment, stand_alone_page
from hums.records.fields import file_name
from hums.records.outputs import write_text

Array = NDArray[np.float64]
_DRAWN = 50  # machines with figures, 0.3 MB of each with 2,000 records; all of them are in the table
_COLUMNS = 500  # of a course, each with its least and its largest value: one for a pixel of the widest figure
_SMALL_COLUMNS = 100  # of the line in the table
_PANELS = 6  # series that drove the worst component
_STYLES = {"raised": "alarm", "acknowledged": "watch", "normal": "calm"}


def write_page(histories: Sequence[MachineHistory], path: Path, *, gearbox: str = "GEARBOX") -> None:
    """Write ``fleet.html``: a self-contained page, the most urgent machine first.

    Parameters
    ----------
    histories : sequence of MachineHistory
        Histories of the monitored machines, of one record or more.
    path : Path
        Path of the page. Reports of records next to it are linked: ``reports/MACHINE RECORD/report.html``.
    gearbox : str
        Path or name of the gearbox, for the command that writes such a report.
    """
    machines = [_machine(one, path.parent, gearbox) for one in histories]
    machines.sort(key=lambda one: (one["state"] != RAISED, -one["urgency"], one["worst"]["machine"]))
    for number, one in enumerate(machines):
        name, drawn = f"machine-{number}", number < _DRAWN
        figures = list(_figures(one["history"], one["worst"], name)) if drawn else []
        one |= {"name": name, "drawn": drawn, "figures": figures}
    environment = page_environment()
    environment.filters["short"] = _short
    body, style, script = (
        (files("hums.fleet") / f"page.{of}").read_text(encoding="utf-8") for of in ("html", "css", "js")
    )
    body = environment.from_string(body).render(machines=machines, most=_DRAWN)
    write_text(path, stand_alone_page(title="Fleet", body=body, style=style, script=script))


def _worst(history: MachineHistory) -> dict[str, Any]:
    """Return the row of the most urgent component, one with a standing alarm first; its name is empty without one."""
    index = history.last.index if history.last else {}
    known = [(history.state.alarms[name].state == RAISED, value, name) for name, value in index.items() if value >= 0]
    return component_row(history, max(known, default=(False, 0.0, ""))[2])


def _state(history: MachineHistory) -> str:
    lives = {alarm.state for alarm in history.state.alarms.values()}
    return RAISED if RAISED in lives else history.waiting or (ACKNOWLEDGED if ACKNOWLEDGED in lives else "normal")


def _machine(history: MachineHistory, folder: Path, gearbox: str) -> dict[str, Any]:
    """Return the variables of the page's template for a machine."""
    worst, last = _worst(history), history.records[-1]["seen"]
    reported = next((alarm["record"] for alarm in reversed(history.alarms) if alarm["state"] == RAISED), last.record)
    report = folder / "reports" / file_name(f"{worst['machine']} {Path(reported).stem}") / "report.html"
    command = ["hums", "analyze", reported, "--gearbox", gearbox, "-o", str(report.parent)]
    return {
        "history": history,
        "worst": worst,
        "urgency": float(np.nan_to_num(worst["condition_index"], nan=-np.inf)),
        "state": _state(history),
        "style": _STYLES.get(_state(history), "unknown"),
        "course": _small_course(history),
        "last": last.when,
        "reported": reported,
        "report": quote(report.relative_to(folder).as_posix()) if report.is_file() else "",
        "command": shlex.join(command) if reported.endswith((".h5", ".hdf5")) else "",
    }


def _small_course(history: MachineHistory) -> list[tuple[float, float]]:
    """Return a sparkline: place in percent, and the largest condition index of a record."""
    largest = np.array([max(filter(math.isfinite, one["index"].values()), default=math.nan) for one in history.records])
    known = np.flatnonzero(np.isfinite(largest))
    heights, at = least_and_largest(largest[known], columns=_SMALL_COLUMNS)
    return list(zip((100 * (known[at] + 1) / largest.size).tolist(), heights.tolist(), strict=True))


def _short(moment: str) -> str:
    """Return an ISO 8601 time without zero seconds, or midnight, in UTC if it has no offset; or a name as it is."""
    plain = moment.removesuffix("Z").removesuffix("+00:00").removesuffix("T00:00:00")
    return plain.removesuffix(":00").replace("T", " ") if math.isfinite(seconds_since_1970(moment)) else moment


def _unit(unit: str) -> str:
    unit = unit.replace("m s-1", "m/s").replace("m s-2", "m/s²")
    return f"{unit[:-1]}²" if unit.endswith("2") and not unit.endswith("-2") else unit


# ---- figures ---------------------------------------------------------------------------------------------------------


def _figures(history: MachineHistory, worst: dict[str, Any], name: str) -> Iterator[str]:
    """Yield the figures of a machine: condition, driving series, and lines of two records."""
    kept, component = [one["seen"] for one in history.records], worst["component"]
    if not component:
        return
    days = days_since_1970(one.recorded_at for one in kept)
    dated = bool(np.isfinite(days).all())
    start = {"start": round(86_400_000 * float(days[0])) if dated else None}
    days = days - days[0] if dated else np.arange(len(kept), dtype=np.float64)
    health = _health(history, days, component)
    alt = f"Condition index of {history.state.machine or 'the machine'} over {len(kept)} records; "
    alt += f"{component} is now at {worst['condition_index']:.2g}, where 1 is the limit."
    yield figure_html(
        Figure(
            name=f"{name}-health", alt=alt, title="Condition index", view="health", data=health | start, height_px=320
        ),
        caption="Dashed: limit. Shaded: records of the baseline.",
    )
    component = worst["indicator_of"]
    epoch = history.state.epochs[history.state.epoch_of(component.partition(": ")[0])]
    judged = [one["seen"] for one in history.records if not one["why"]]
    drivers: list[Series] = []
    if judged and component in epoch.names:
        driving = driving_series(epoch, epoch.read(judged[-1]), epoch.names.index(component), most=_PANELS)
        drivers = [key for key, departure, _ in driving if math.isfinite(departure)]
    if drivers:
        panels = _panels(epoch, kept, days, drivers)
        alt = f"Indicators of {component} that deviate most: " + "; ".join(panel["title"] for panel in panels) + "."
        yield figure_html(
            Figure(
                name=f"{name}-drivers", alt=alt, title=f"Indicators: {component}", view="panels",
                data=start | {"panels": panels}, height_px=150 * -(-len(panels) // 3) + 70,
            ),
            caption="Dotted: normal value of the baseline.",
        )  # fmt: skip
        in_envelope = drivers[0].kind in BEARING_KINDS or drivers[0].indicator.startswith("envelope")
        spectrum = "envelope" if in_envelope else "order_spectrum"
        if stems := _stems(judged, drivers[0].channel, spectrum):
            what = f"the {spectrum.removesuffix('_spectrum')} spectrum of {drivers[0].channel}"
            yield figure_html(
                Figure(
                    name=f"{name}-lines", alt=f"Lines in {what} in the first judged record and in the last.",
                    title=f"Lines of {what}: first judged and last record", view="stems", data=stems, height_px=300,
                )
            )  # fmt: skip


def _curve(days: Array, values: Array) -> dict[str, Any]:
    """Return a curve over the records for the page, with every peak and trough."""
    known = np.flatnonzero(np.isfinite(values))
    shown, at = least_and_largest(values[known], columns=_COLUMNS)
    return {"x": packed(days[known][at]), "y": packed(shown)}


def _health(history: MachineHistory, days: Array, worst: str) -> dict[str, Any]:
    """Return condition indices of all components of a machine over time, with the limit, the baseline and alarms."""
    now = history.last.index if history.last else {}
    order = sorted(now, key=lambda key: (key != worst, -np.nan_to_num(now[key], nan=-np.inf)))
    index = {key: np.array([one["index"].get(key, math.nan) for one in history.records]) for key in order}
    day_of = {one["seen"].record: float(day) for one, day in zip(history.records, days, strict=True)}
    learned = [day_of[one] for epoch in history.state.baselines for one in epoch.records if one in day_of]
    raised = [alarm for alarm in history.alarms if alarm["record"] in day_of]
    return {
        "components": [{"name": key, **_curve(days, index[key])} for key in order],
        "span": [float(days[0]), float(days[-1])],
        "baseline": [min(learned), max(learned)] if learned else [],
        "alarms": {
            "x": [day_of[alarm["record"]] for alarm in raised],
            "y": [max(float(alarm["value"]), 0.02) for alarm in raised],
            "text": [f"{alarm['component']}: {alarm['indicator']}".replace("<", "&lt;") for alarm in raised],
        },
    }


def _panels(epoch: Epoch, kept: Sequence[StoredRecord], days: Array, drivers: Sequence[Series]) -> list[dict[str, Any]]:
    """Return the series with the largest deviations, each in its unit against time."""
    center = dict(zip(epoch.series, epoch.learned[0].raw.center.tolist(), strict=True))
    panels = []
    for key, values in zip(drivers, np.exp([vector(one.values, tuple(drivers)) for one in kept]).T, strict=True):
        title = f"{key.words.replace('_', ' ').replace('rms', 'RMS')}, {key.channel}"
        title += "" if key.unit in ("", "1") else f", {_unit(key.unit)}"
        panels.append({"title": title, "normal": math.exp(center[key]), **_curve(days, values)})
    return panels


def _stems(judged: Sequence[StoredRecord], channel: str, spectrum: str) -> dict[str, Any]:
    """Return the lines of a channel in its first judged and its last record, nothing without lines."""
    found: dict[str, Any] = {}
    for which, one in (("first", judged[0]), ("last", judged[-1])):
        those = [n for n, key in enumerate(one.lines.keys) if key[:2] == (channel, spectrum)]
        those = sorted((n for n in those if math.isfinite(one.lines.values[n, 0])), key=one.orders.__getitem__)
        if not those:
            return {}
        found[which] = {"x": packed(one.orders[those]), "y": packed(one.lines.values[those, 0])}
        found["unit"] = f"amplitude, {_unit(one.lines.keys[those[0]][-1])}"
        found[f"{which}Name"] = f"{which}{' judged' if which == 'first' else ''}, {_short(one.when)}"
    return found

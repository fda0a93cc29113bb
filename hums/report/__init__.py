"""Report of an analysis: a self-contained HTML page, and tables as CSV files."""

import json
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, TypeAlias

from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.findings import NOTHING_FOUND
from hums.analysis.result import (
    Analysis,
    check_analysis,
    confidence_words,
    indicator_table,
    line_table,
    save_analysis,
    summary,
    track_table,
)
from hums.gearbox.defect_orders import BEARING_KINDS
from hums.gearbox.mechanism import undeclared_parts
from hums.gearbox.model import Gearbox
from hums.pages.page import page_environment, stand_alone_page
from hums.plots import coloured_components, draw_mechanism, svg
from hums.records.fields import plain_cell
from hums.records.outputs import check_outputs, make_folder, write_text
from hums.report.figures import Pictures, cursor_choices, sections
from hums.report.indicator_tables import UNIT_WORDS, indicator_tables, velocity_zones
from hums.report.verdict_strip import CLASSES, answer, component_styles, verdict_rows, with_hz
from signals._validation import checked

Units: TypeAlias = Literal["rpm", "Hz"]
# on the white ground of the drawing, in every light
_PART_COLOURS = {"alarm": "#b4380a", "watch": "#e0a526", "unknown": "#8b95a1", "calm": "#a9d5b8"}


def prepare_folder(folder: str | Path, *, inputs: Iterable[str | Path] = (), force: bool = False) -> Path:
    """Create a report's folder if necessary and return its path; call it before a long analysis, so that none is lost.

    Raises
    ------
    ValueError
        If `folder` is a file or cannot be written, or the report would overwrite one of the `inputs` or, without
        `force`, a file of another program.
    """
    folder = Path(folder)
    names = ("report.html", "analysis.h5", "orders.csv", "indicators.csv", "tracks.csv", "summary.json", "report.pdf")
    check_outputs((folder / name for name in names), inputs=inputs, force=force)
    make_folder(folder)
    return folder


@checked
def write_report(
    analysis: Analysis,
    folder: str | Path,
    *,
    baseline: Analysis | None = None,
    units: Units = "rpm",
    force: bool = False,
) -> Path:
    """Write the page ``report.html``, ``analysis.h5``, ``summary.json`` and tables into a folder.

    The tables are ``orders.csv``, ``indicators.csv`` and ``tracks.csv``.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.
    folder : str or Path
        Folder to write into, created if necessary. An existing file is replaced only when the new one is complete.
    baseline : xarray.DataTree, optional
        Analysis of an earlier record of the machine: verdicts state what has changed since, and its spectra are drawn
        behind those of this record.
    units : {"rpm", "Hz"}
        Unit in which speeds are stated first.
    force : bool
        Whether to overwrite files of the same names that other programs wrote.

    Returns
    -------
    Path
        Path of ``report.html``, which needs no other file.

    Raises
    ------
    ValueError
        If `folder` is a file, cannot be written, or, without `force`, holds files of these names from other programs.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> import hums
    >>> noise = np.random.default_rng(0).normal(size=8000)
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> record = hums.make_record({"housing": noise}, rate_hz=4000, units="g", angle=angle)
    >>> settings = hums.AnalysisSettings(envelope_band_hz=None)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"), settings=settings)
    >>> with TemporaryDirectory() as folder:
    ...     page = hums.write_report(analysis, folder)
    ...     print(page.name, sorted(path.name for path in page.parent.iterdir())[:2])
    report.html ['.hums-written', 'analysis.h5']
    """
    folder = prepare_folder(folder, force=force)
    save_analysis(analysis, folder / "analysis.h5", force=force)
    facts = summary(analysis)
    write_text(folder / "summary.json", json.dumps(facts, indent=1, allow_nan=False) + "\n")
    tables = [line_table(analysis, name).assign(spectrum=name) for name in (ORDER_SPECTRUM, ENVELOPE)]
    rows = [table.map(plain_cell).to_csv(index=False, header=number == 0) for number, table in enumerate(tables)]
    write_text(folder / "orders.csv", "".join(rows))
    write_text(folder / "indicators.csv", indicator_table(analysis).map(plain_cell).to_csv(index=False))
    write_text(folder / "tracks.csv", track_table(analysis).map(plain_cell).to_csv(index=False, float_format="%.7g"))
    page = folder / "report.html"
    write_text(page, _page(analysis, facts, baseline, units))
    return page


def render(analysis: Analysis, *, baseline: Analysis | None = None, units: Units = "rpm") -> str:
    """Return the report as self-contained HTML; see `write_report`."""
    check_analysis(analysis)
    return _page(analysis, summary(analysis), baseline, units)


def _page(analysis: Analysis, facts: dict[str, Any], baseline: Analysis | None, units: Units) -> str:
    past = None if baseline is None else summary(baseline)
    past_name = "" if past is None else f"baseline {past['recorded_at'] or past['record']}".strip()
    styles = component_styles(facts)
    faulty = {part: style for part, style in styles.items() if style != CLASSES[NOTHING_FOUND]}
    pictures = Pictures(analysis=analysis, facts=facts, styles=faulty, past=baseline, past_name=past_name)
    drawn = sections(pictures)
    machine = facts["machine"] or facts["record"] or facts["gearbox"]
    title = ", ".join(filter(None, [machine, facts["recorded_at"][:10]]))
    sensors = [f"{one['name']} ({one['sensor']})" if one.get("sensor") else one["name"] for one in facts["channels"]]
    about = [("Site", facts["site"]), ("Sensors", ", ".join(sensors)), ("Analyst", facts["analyst"])]
    choices = cursor_choices(facts)
    ours, environment = files("hums.report"), page_environment()
    environment.filters["words"] = lambda kind: str(kind).replace("_", " ")
    environment.filters["first_upper"] = _first_upper
    environment.filters["hz"] = lambda text: with_hz(text, facts["speed_hz"]["mean"])
    environment.filters["sentence"] = lambda text: f"{_first_upper(text).rstrip('.')}."
    page_facts = {name: facts[name] for name in ("reference", "findings", "speed_hz")} | {"choices": choices}
    tail = [("components", "Components"), ("indicators", "Indicators"), ("health", "Sensors"), ("settings", "Settings")]
    body = environment.from_string((ours / "page.html").read_text(encoding="utf-8")).render(
        facts=facts,
        title=title,
        about=[(name, text) for name, text in about if text],
        units=units,
        speed_text=speed_text(facts, units=units),
        contents=[("verdicts", "Verdicts"), *((section.name, section.title) for section in drawn), *tail],
        answer=answer(facts),
        verdicts=verdict_rows(facts, past),
        undeclared=undeclared_parts(_gearbox(analysis)),
        styles_of=CLASSES,
        zones=velocity_zones(facts["indicators"], facts["settings"].get("velocity_limits_mm_s")),
        machine_class=facts["settings"].get("machine_class", ""),
        mechanism=_mechanism(analysis, facts, styles),
        part_colours=_PART_COLOURS,
        sections=drawn,
        channels=[channel["name"] for channel in facts["channels"]],
        choices=choices,
        past_name=past_name,
        components=_components(facts),
        indicators=indicator_tables(facts["indicators"], facts["findings"]),
        sampled=_sampled(facts),
        settings=[
            (_words(name), _value(value)) for name, value in facts["settings"].items() if value not in (None, "")
        ],
        page_facts=json.dumps(page_facts).replace("<", "\\u003c"),
    )
    header = json.dumps(title).replace("<", "\\3c ")
    for unit, words in UNIT_WORDS.items():
        body = body.replace(unit, words)
    return stand_alone_page(
        title=title,
        body=body,
        style=(ours / "report.css").read_text(encoding="utf-8") + f"@page {{ @top-left {{ content: {header}; }} }}\n",
        script=(ours / "report.js").read_text(encoding="utf-8"),
    )


def speed_text(facts: Mapping[str, Any], *, units: Units = "rpm") -> str:
    """Return the speed of the reference in rpm and Hz, the chosen unit first, and how it was determined."""
    speed = facts["speed_hz"]
    if speed["mean"] is None:
        return "unknown: the record is a synchronous average"

    def span(factor: float, unit: str) -> str:
        low, high = f"{factor * speed['min']:.5g}", f"{factor * speed['max']:.5g}"
        return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"

    first, second = ((60.0, "rpm"), (1.0, "Hz")) if units == "rpm" else ((1.0, "Hz"), (60.0, "rpm"))
    known = ""
    if speed["nominal"]:
        known = ", declared (nominal)"
        if speed["declared"] is not None:
            known = f", refined from the declared {first[0] * speed['declared']:.5g} {first[1]} (nominal)"
    elif speed["tachometer"]:
        known = f", measured by {speed['tachometer']}"
    elif speed["estimated_from"]:
        sure = confidence_words(speed["confidence"])
        known = f", estimated from channel {speed['estimated_from']} with confidence {sure}"
    return f"{span(*first)} ({span(*second)}){known}"


def _gearbox(analysis: Analysis) -> Gearbox:
    return Gearbox.model_validate_json(analysis.attrs["gearbox_json"])


def _words(name: str) -> str:
    units = {"hz": "Hz", "hz_s": "Hz/s", "mm_s": "mm/s"}
    for ending, unit in sorted(units.items(), key=lambda pair: -len(pair[0])):
        if name.endswith(f"_{ending}"):
            return f"{name.removesuffix(f'_{ending}').replace('_', ' ')} ({unit})"
    return name.replace("most_", "maximum ").replace("_", " ")


def _value(value: object) -> str:
    """Return the value of a setting in words."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(_value, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _first_upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _sampled(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the sampling of each sensor in words, empty for one that was not analysed."""
    said = {item["name"]: "" for item in facts["health"]}
    for channel in facts["channels"]:
        sensor = f"{channel['sensor']}, " if "sensor" in channel else ""
        if "samples_per_rev" in channel:
            said[channel["name"]] = f"{channel['samples_per_rev']} samples per revolution, {channel['units']}"
            continue
        said[channel["name"]] = (
            f"{sensor}{channel['duration_s']:.4g} s at {channel['rate_hz']:g} Hz, {channel['units']}"
        )
    return said


def _mechanism(analysis: Analysis, facts: Mapping[str, Any], styles: Mapping[str, str]) -> str:
    """Return the drawing of the mechanism as SVG, every assessed part in the colour of its verdict."""
    gearbox = _gearbox(analysis)
    kinds = {*BEARING_KINDS, "tooth"}
    searched = {row["component"] for row in [*facts["orders"], *facts["envelope"]] if row["kind"] in kinds}
    verdicts = dict.fromkeys(searched, "calm") | dict(styles)
    drawn = coloured_components(gearbox)
    colours = {part: _PART_COLOURS[style] for part, style in verdicts.items() if part in drawn}
    return svg(lambda ax: draw_mechanism(gearbox, ax=ax, colours=colours), width=3.6, height=3.2)


def _components(facts: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the strongest line of each component and kind, in the channel that shows it best."""
    best: dict[tuple[str, str], dict[str, Any]] = {}
    rows = [row | {"spectrum": "order"} for row in facts["orders"]]
    rows += [row | {"spectrum": "envelope"} for row in facts["envelope"] if row["kind"] in BEARING_KINDS]
    for row in rows:
        key = (row["component"], row["kind"])
        if key not in best or _rank(row) > _rank(best[key]):
            best[key] = row
    return list(best.values())


def _rank(row: dict[str, Any]) -> tuple[bool, bool, float]:
    """Return the sort key of a line: significant ones first, by amplitude; among the others the fundamental."""
    fundamental = not row["claimed"] and row["harmonic"] == 1 and row["sideband"] == 0
    return row["claimed"], fundamental, row["amplitude"]

"""An analysis becomes one self-contained HTML page, and the tables beside it."""

import json
from collections.abc import Callable, Iterator
from functools import partial
from importlib.resources import files
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import xarray as xr
from jinja2 import Environment, StrictUndefined

from hums.findings import DIAGNOSED
from hums.layout import Analysis, check_analysis, group, save_analysis
from hums.orders import BEARING_KINDS
from hums.plots import plot_spectrum, plot_speed, plot_tracks, svg
from hums.report.indicators import indicator_tables
from hums.search import ENVELOPE, ORDER_SPECTRUM
from hums.store import written_beside
from hums.tables import envelope_bands, indicator_table, line_table, summary


def prepare_folder(folder: str | Path) -> Path:
    """Make sure that a folder can be written into, before the work and not after it.

    Raises
    ------
    ValueError
        A file of that name, or a folder that cannot be made or written.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file; name a folder for the report.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ValueError(f"{folder} cannot be written ({error.strerror}); name a folder of yours.") from None
    return folder


def write_report(analysis: Analysis, folder: str | Path) -> Path:
    """Write ``report.html``, ``analysis.h5``, ``orders.csv``, ``indicators.csv`` and ``summary.json`` into a folder.

    Each file is written beside and renamed. Returns the path of the page.
    """
    folder = prepare_folder(folder)
    save_analysis(analysis, folder / "analysis.h5")
    facts = summary(analysis)
    _write_text(folder / "summary.json", json.dumps(facts, indent=1, allow_nan=False) + "\n")
    tables = [line_table(analysis, name).assign(spectrum=name) for name in (ORDER_SPECTRUM, ENVELOPE)]
    rows = [table.to_csv(index=False, header=number == 0) for number, table in enumerate(tables)]
    _write_text(folder / "orders.csv", "".join(rows))
    _write_text(folder / "indicators.csv", indicator_table(analysis).to_csv(index=False))
    page = folder / "report.html"
    _write_text(page, _page(analysis, facts))
    return page


def render(analysis: Analysis) -> str:
    """Return the page: text and tables, figures as SVG inside it, no script and nothing to fetch."""
    check_analysis(analysis)
    return _page(analysis, summary(analysis))


def _page(analysis: Analysis, facts: dict[str, Any]) -> str:
    template = (files("hums.report") / "page.html").read_text(encoding="utf-8")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["words"] = lambda kind: str(kind).replace("_", " ")
    environment.filters["chance"] = _chance
    return environment.from_string(template).render(
        facts=facts,
        diagnosed=[finding for finding in facts["findings"] if finding["verdict"] == DIAGNOSED],
        indicated=[finding for finding in facts["findings"] if finding["verdict"] != DIAGNOSED],
        faint=_faint(facts),
        components=_components(facts),
        indicators=indicator_tables(facts["indicators"]),
        figures=list(_figures(analysis)),
    )


def _figures(analysis: Analysis) -> Iterator[dict[str, str]]:
    """Title, caption and SVG of every figure."""
    speed = group(analysis, "speed")
    yield _figure("Speed", "Mean over each revolution.", partial(plot_speed, speed), height=2.4)
    for name, title in ((ORDER_SPECTRUM, "Order spectrum"), (ENVELOPE, "Envelope order spectrum")):
        dataset = group(analysis, name)
        bands = {band["channel"]: _about_band(band) for band in envelope_bands(analysis)} if name == ENVELOPE else {}
        for channel in _channels(dataset):
            yield _figure(
                f"{title}, {channel}",
                f"{bands.get(channel, '')}{dataset.attrs['window'].capitalize()} window, resolution "
                f"{dataset.attrs['resolution_orders']:.2g} orders. Dots: claimed lines. Ticks: lines looked for and "
                "not claimed.",
                partial(plot_spectrum, dataset, channel=channel, logarithmic=name == ORDER_SPECTRUM),
            )
    tracks = group(analysis, "tracks")
    for channel in dict.fromkeys(tracks["track_channel"].to_numpy().tolist()) if "track" in tracks.sizes else []:
        yield _figure(
            f"Amplitude tracks, {channel}",
            f"The largest lines by Kalman smoother, bandwidths {float(tracks['bandwidth_orders'].min()):.2g} to "
            f"{float(tracks['bandwidth_orders'].max()):.2g} orders; bands are two standard deviations.",
            partial(plot_tracks, tracks, channel=channel),
        )


def _about_band(band: dict[str, Any]) -> str:
    edges = f"{band['low_hz']:.6g} to {band['high_hz']:.6g} Hz"
    if not band["chosen"]:
        return f"Band {edges}, as given. "
    return " ".join([f"Band {edges}, chosen from the record. {band['why']}", *band["doubts"]]) + " "


def _figure(title: str, caption: str, draw: Callable[..., object], **size: float) -> dict[str, str]:
    return {"title": title, "caption": caption, "svg": svg(lambda ax: draw(ax=ax), **size)}


def _channels(dataset: xr.Dataset) -> list[str]:
    return [str(name) for name in dataset["channel"].to_numpy()] if "channel" in dataset.coords else []


def _components(facts: dict[str, Any]) -> list[dict[str, Any]]:
    """One row a component, kind and channel: its strongest line as it was looked for."""
    best: dict[tuple[str, str, str], dict[str, Any]] = {}
    rows = [row | {"spectrum": "order"} for row in facts["orders"]]
    rows += [row | {"spectrum": "envelope"} for row in facts["envelope"] if row["kind"] in BEARING_KINDS]
    for row in rows:
        key = (row["component"], row["kind"], row["channel"])
        if key not in best or _weight(row) > _weight(best[key]):
            best[key] = row
    return list(best.values())


def _weight(row: dict[str, Any]) -> tuple[bool, bool, float]:
    """Claimed lines first, of these the largest; among unclaimed ones the fundamental."""
    fundamental = not row["claimed"] and row["harmonic"] == 1 and row["sideband"] == 0
    return row["claimed"], fundamental, row["amplitude"]


def _faint(facts: dict[str, Any]) -> list[dict[str, Any]]:
    """Bearing fundamentals that stand out and yet are not claimed: reported, not diagnosed."""
    return [
        row
        for row in facts["envelope"]
        if row["harmonic"] == 1
        and row["sideband"] == 0
        and row["kind"] in BEARING_KINDS
        and not row["claimed"]
        and (row["explained_by"] or row["false_alarm_probability"] < 0.5)  # noqa: PLR2004
    ]


def _chance(probability: float) -> str:
    if probability < 1e-6:  # noqa: PLR2004
        return "below one in a million"
    return f"{probability:.2g}"


def _write_text(path: Path, text: str) -> None:
    with written_beside(path) as part:
        part.write_text(text, encoding="utf-8")

"""Report of an analysis: one self-contained HTML page, and tables as files."""

import json
from collections.abc import Callable, Iterator
from functools import partial
from importlib.resources import files
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import xarray as xr
from jinja2 import Environment, StrictUndefined

from hums.analysis.findings import DIAGNOSED
from hums.analysis.lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.result import (
    Analysis,
    check_analysis,
    envelope_bands,
    group,
    indicator_table,
    line_table,
    save_analysis,
    summary,
)
from hums.gearbox.orders import BEARING_KINDS
from hums.plots import plot_spectrum, plot_speed, plot_tracks, svg
from hums.records.store import atomic_write
from hums.report.indicators import indicator_tables
from signals._validation import checked


def prepare_folder(folder: str | Path) -> Path:
    """Create a folder if necessary and return its path; called before an analysis, so that no work is lost.

    Raises
    ------
    ValueError
        If it is a file, or cannot be created or written.
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


@checked
def write_report(analysis: Analysis, folder: str | Path) -> Path:
    """Write ``report.html``, ``analysis.h5``, ``orders.csv``, ``indicators.csv`` and ``summary.json`` into a folder.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.
    folder : str or Path
        Folder to write into, created if necessary. An existing file is replaced only when the new one is complete.

    Returns
    -------
    Path
        ``report.html``, a page without scripts that needs no other file.

    Raises
    ------
    ValueError
        If `folder` is a file, or cannot be created or written.

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
    report.html ['analysis.h5', 'indicators.csv']
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
    """Return the report as HTML, with the figures as SVG, without scripts or references to other files."""
    check_analysis(analysis)
    return _page(analysis, summary(analysis))


def _page(analysis: Analysis, facts: dict[str, Any]) -> str:
    """Return the HTML page of an analysis."""
    template = (files("hums.report") / "page.html").read_text(encoding="utf-8")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["words"] = lambda kind: str(kind).replace("_", " ")
    environment.filters["chance"] = _probability_text
    return environment.from_string(template).render(
        facts=facts,
        diagnosed=[finding for finding in facts["findings"] if finding["verdict"] == DIAGNOSED],
        indicated=[finding for finding in facts["findings"] if finding["verdict"] != DIAGNOSED],
        faint=_unexplained_bearing_lines(facts),
        components=_components(facts),
        indicators=indicator_tables(facts["indicators"]),
        figures=list(_figures(analysis)),
    )


def _figures(analysis: Analysis) -> Iterator[dict[str, str]]:
    """Yield title, caption and SVG of every figure."""
    speed = group(analysis, "speed")
    yield _figure("Speed", "Mean over each revolution.", partial(plot_speed, speed), height=2.4)
    for name, title in ((ORDER_SPECTRUM, "Order spectrum"), (ENVELOPE, "Envelope order spectrum")):
        dataset = group(analysis, name)
        bands = {band["channel"]: _band_caption(band) for band in envelope_bands(analysis)} if name == ENVELOPE else {}
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


def _band_caption(band: dict[str, Any]) -> str:
    edges = f"{band['low_hz']:.6g} to {band['high_hz']:.6g} Hz"
    if not band["chosen"]:
        return f"Band {edges}, as given. "
    return " ".join([f"Band {edges}, chosen from the record. {band['why']}", *band["doubts"]]) + " "


def _figure(title: str, caption: str, draw: Callable[..., object], **size: float) -> dict[str, str]:
    return {"title": title, "caption": caption, "svg": svg(lambda ax: draw(ax=ax), **size)}


def _channels(dataset: xr.Dataset) -> list[str]:
    return [str(name) for name in dataset["channel"].to_numpy()] if "channel" in dataset.coords else []


def _components(facts: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the strongest line of each component, kind and channel."""
    best: dict[tuple[str, str, str], dict[str, Any]] = {}
    rows = [row | {"spectrum": "order"} for row in facts["orders"]]
    rows += [row | {"spectrum": "envelope"} for row in facts["envelope"] if row["kind"] in BEARING_KINDS]
    for row in rows:
        key = (row["component"], row["kind"], row["channel"])
        if key not in best or _rank(row) > _rank(best[key]):
            best[key] = row
    return list(best.values())


def _rank(row: dict[str, Any]) -> tuple[bool, bool, float]:
    """Return the sort key of a line: significant ones first, by amplitude; among the others the fundamental."""
    fundamental = not row["claimed"] and row["harmonic"] == 1 and row["sideband"] == 0
    return row["claimed"], fundamental, row["amplitude"]


def _unexplained_bearing_lines(facts: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the bearing fundamentals that exceed the background without being significant."""
    return [
        row
        for row in facts["envelope"]
        if row["harmonic"] == 1
        and row["sideband"] == 0
        and row["kind"] in BEARING_KINDS
        and not row["claimed"]
        and (row["explained_by"] or row["false_alarm_probability"] < 0.5)  # noqa: PLR2004
    ]


def _probability_text(probability: float) -> str:
    if probability < 1e-6:  # noqa: PLR2004
        return "below one in a million"
    return f"{probability:.2g}"


def _write_text(path: Path, text: str) -> None:
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")

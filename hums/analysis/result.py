"""Schema of an analysis, a tree of datasets: its groups, its check, and its HDF5 file."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
import xarray as xr

from hums.analysis.evidence import AssessedLine
from hums.analysis.expected_lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.settings import AnalysisError, AnalysisSettings
from hums.gearbox.model import Gearbox
from hums.records.fields import RecordError
from hums.records.outputs import check_outputs
from hums.records.quantities import mean_quantities
from hums.records.store import open_tree, write_tree
from signals._validation import checked, choice
from signals.spectra.spectra import AmplitudeSpectrum

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray


Analysis: TypeAlias = xr.DataTree
Row = TypeVar("Row")
SCHEMA = "hums-analysis/6"
_FACTS = ("machine", "regime", "site", "analyst", "recorded_at")  # that an analysis states as its record does
_version = cache(version)  # which reads the package's files
_NUMBERS = (float, "float")  # types of a field that is a number, as annotated
GROUPS = ("speed", "health", ORDER_SPECTRUM, ENVELOPE, "tracks", "indicators", "findings", "verdicts", "unexplained")


@dataclass(frozen=True, kw_only=True)
class EnvelopeBand:
    """Demodulated band in Hz; if it was chosen from the record, with the reason."""

    low_hz: float
    high_hz: float
    chosen: bool
    why: str = ""

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lower and upper edge in Hz."""
        return self.low_hz, self.high_hz


@dataclass(frozen=True, kw_only=True)
class SensorCondition:
    """Condition of a sensor: status "ok", "suspect" or "faulty", and a sentence for each reason.

    ``missing`` is the fraction of samples without signal; ``not_judged`` lists the checks for which the record is too
    short or its sampling rate too low.
    """

    name: str
    sensor: str
    status: str
    reasons: str = ""
    missing: float = 0.0
    not_judged: str = ""


@dataclass(frozen=True, kw_only=True)
class IndicatorValue:
    """One condition indicator of one component in one channel.

    ``kind`` is the kind of component (channel, shaft, gear, planetary, or the race or element of a bearing); ``takes``
    names the signal the indicator is computed from. ``value`` is NaN exactly where ``withheld`` gives the reason;
    ``noise_limit`` is the value that noise alone seldom exceeds, NaN where unknown.
    """

    channel: str
    component: str
    kind: str
    indicator: str
    value: float
    unit: str
    noise_limit: float
    takes: str
    source: str
    withheld: str = ""


@dataclass(frozen=True, kw_only=True)
class Unmeasured:
    """A component without a measured line, and what a verdict on it requires."""

    component: str
    kind: str
    why: str
    least_change: str


@dataclass(frozen=True, kw_only=True)
class ChannelPictures:
    """Datasets of one channel by the name of their group, without those that cannot be computed."""

    channel: str
    datasets: Mapping[str, xr.Dataset]


@checked
def save_analysis(analysis: Analysis, path: str | Path, *, force: bool = False) -> None:
    """Write an analysis to one HDF5 file; an existing file is replaced only when the new one is complete.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.
    path : str or Path
        File to write, ``.h5``.
    force : bool
        Whether a file that another program wrote is replaced.

    Raises
    ------
    AnalysisError
        If `analysis` lacks the schema or a group of an analysis.
    RecordError
        If `path` is a file of another program.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> import hums
    >>> noise = np.random.default_rng(0).normal(size=8000)
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> record = hums.make_record({"housing": noise}, rate_hz=4000, units="g", angle=angle)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> with TemporaryDirectory() as folder:
    ...     hums.save_analysis(analysis, f"{folder}/analysis.h5")
    ...     with hums.open_analysis(f"{folder}/analysis.h5") as reopened:
    ...         print(hums.summary(reopened) == hums.summary(analysis))
    True
    """
    check_analysis(analysis)
    check_outputs([Path(path)], force=force)
    write_tree(analysis, path)


@checked
def open_analysis(path: str | Path) -> Analysis:
    """Open an analysis written by `save_analysis`; arrays are read on access.

    Parameters
    ----------
    path : str or Path
        The ``analysis.h5`` of a report, or another file of `save_analysis`.

    Returns
    -------
    xarray.DataTree
        The analysis; it holds the file open and is a context manager that closes it.

    Raises
    ------
    AnalysisError
        If the file is not HDF5, or not an analysis.
    RecordError
        If there is no such file.

    Examples
    --------
    See `save_analysis` for the round trip. A record is not an analysis:

    >>> from tempfile import TemporaryDirectory
    >>> import hums
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> record = hums.make_record({"housing": [0.0, 1.0]}, rate_hz=4000, units="g", angle=angle)
    >>> with TemporaryDirectory() as folder:
    ...     hums.save_record(record, f"{folder}/record.h5")
    ...     try:
    ...         hums.open_analysis(f"{folder}/record.h5")
    ...     except hums.AnalysisError as error:
    ...         print("this is not an analysis" in str(error))
    True
    """
    try:
        tree = open_tree(path)
    except RecordError:
        if not Path(path).is_file():
            raise
        raise AnalysisError(
            f"{path}: not an HDF5 file that can be read, so no analysis; give the analysis.h5 that the earlier "
            "analysis wrote next to its report."
        ) from None
    try:
        check_analysis(tree)
    except AnalysisError as error:
        tree.close()
        raise AnalysisError(f"{path}: {error}") from None
    return tree


def confidence_words(confidence: float) -> str:
    """Return a confidence to three decimals, as a bound if it would round to 1.000, which would state certainty."""
    text = f"{confidence:.3f}"
    return "> 0.999" if text == "1.000" else text


def group(analysis: Analysis, name: str) -> xr.Dataset:
    """Return one group of an analysis, such as ``"speed"``, as a dataset."""
    return analysis.children[name].to_dataset(inherit=False)


def _table(analysis: Analysis, name: str) -> "pd.DataFrame":
    """Return the rows of one group of an analysis."""
    return group(analysis, name).to_dataframe().reset_index(drop=True)


def root_attributes(
    record: xr.Dataset,
    gearbox: Gearbox,
    reference: str,
    settings: AnalysisSettings,
    *,
    channels: Sequence[Mapping[str, Any]],
    notes: Sequence[str],
) -> dict[str, str]:
    """Return the attributes of an analysis: what was analysed, with which gearbox and settings, and its caveats."""
    return {
        "schema": SCHEMA,
        "record": Path(str(record.encoding.get("source", ""))).name,
        "version": _version("hums-toolkit"),
        "channels_json": json.dumps(channels),
        **{name: str(record.attrs.get(name, "")) for name in _FACTS},
        "gearbox": gearbox.name,
        "gearbox_json": gearbox.model_dump_json(exclude_none=True),
        "reference": reference,
        "measured_json": json.dumps({name: mean for name, (mean, _) in mean_quantities(record).items()}),
        "settings_json": settings.model_dump_json(),
        "notes_json": json.dumps(notes),
    }


def check_analysis(tree: Analysis) -> None:
    """Raise AnalysisError unless `tree` has the schema and groups of an analysis."""
    if tree.attrs.get("schema") != SCHEMA:
        raise AnalysisError(
            f'this is not an analysis: its schema is {tree.attrs.get("schema")!r}, not "{SCHEMA}"; make one with '
            "hums.analyze."
        )
    missing = [group for group in GROUPS if group not in tree.children]
    if missing:
        raise AnalysisError(f"this analysis lacks the groups {', '.join(missing)}; make it again with hums.analyze.")


def spectrum_dataset(
    spectra: Sequence[tuple[str, str, AmplitudeSpectrum]],
    lines: Sequence[AssessedLine],
    *,
    bands: Mapping[str, EnvelopeBand] | None = None,
) -> xr.Dataset:
    """Return the spectra of all channels (name, units, spectrum) on a common order axis, with their line table.

    `bands` holds the demodulated band of each channel if the spectra are those of envelopes.
    """
    columns = _line_columns(lines)
    if not spectra:
        return xr.Dataset(columns)
    names, units, alike = zip(*spectra, strict=True)
    size = min(spectrum.axis.size for spectrum in alike)
    amplitude = np.stack([spectrum.amplitude[:size] for spectrum in alike])
    return xr.Dataset(
        columns | {"amplitude": (("channel", "order"), amplitude, {"long_name": "peak amplitude"})},
        coords={
            "channel": list(names),
            "units": ("channel", list(units)),
            "order": ("order", alike[0].axis[:size], {"units": "cycles per revolution of the reference"}),
        }
        | ({} if bands is None else _band_columns([bands[name] for name in names])),
        attrs={
            "window": alike[0].window,
            "bin_width_orders": alike[0].bin_width,
            "resolution_orders": alike[0].resolution,
        },
    )


def _band_columns(bands: Sequence[EnvelopeBand]) -> dict[str, tuple[str, Any]]:
    return {
        "band_low_hz": ("channel", [band.low_hz for band in bands]),
        "band_high_hz": ("channel", [band.high_hz for band in bands]),
        "band_chosen": ("channel", np.array([band.chosen for band in bands], dtype=np.int8)),
        "band_why": ("channel", [band.why for band in bands]),
    }


def _line_columns(lines: Sequence[AssessedLine]) -> dict[str, Any]:
    """Return the assessed lines as variables along `line`."""
    found, expected, text = ([line.measured.line for line in lines], [line.measured.expected for line in lines], "<U1")
    columns: dict[str, NDArray[Any]] = {
        "component": np.array([w.component for w in expected], dtype=None if expected else text),
        "kind": np.array([w.kind for w in expected], dtype=None if expected else text),
        "harmonic": np.array([w.harmonic for w in expected], dtype=np.int64),
        "sideband": np.array([w.sideband for w in expected], dtype=np.int64),
        "line_channel": np.array([line.measured.channel for line in lines], dtype=None if lines else text),
        "line_units": np.array([line.measured.units for line in lines], dtype=None if lines else text),
        "line_order": np.array([w.order for w in expected], dtype=np.float64),
        "order_found": np.array([f.found for f in found], dtype=np.float64),
        "line_amplitude": np.array([f.amplitude for f in found], dtype=np.float64),
        "line_amplitude_std": np.array([f.amplitude_std for f in found], dtype=np.float64),
        "background": np.array([f.background for f in found], dtype=np.float64),
        "snr": np.array([f.snr for f in found], dtype=np.float64),
        "false_alarm_probability": np.array([line.false_alarm_probability for line in lines], dtype=np.float64),
        "claimed": np.array([line.significant for line in lines], dtype=np.int8),
        "explained_by": np.array([line.explained_by for line in lines], dtype=None if lines else text),
    }
    return {name: ("line", values) for name, values in columns.items()}


def rows_dataset(rows: Sequence[object], kind: type, *, dim: str) -> xr.Dataset:
    """Return dataclass rows of one kind as a dataset along `dim`, with one variable for each field.

    Numbers and strings are stored as they are, tuples as JSON; `rows_of` reads them back.
    """
    columns: dict[str, NDArray[Any]] = {}
    for field in fields(kind):
        values = [getattr(row, field.name) for row in rows]
        values = [json.dumps(value) if isinstance(value, tuple) else value for value in values]
        dtype = np.float64 if field.type in _NUMBERS else None if rows else "<U1"
        columns[field.name] = np.array(values, dtype=dtype)
    return xr.Dataset({name: (dim, values) for name, values in columns.items()})


def rows_of(dataset: xr.Dataset, kind: type[Row]) -> list[Row]:
    """Return the dataclass rows that `rows_dataset` wrote."""
    if lacking := [field.name for field in fields(kind) if field.name not in dataset]:  # type: ignore[arg-type]
        raise AnalysisError(
            f"this analysis lacks {', '.join(lacking)}, from which verdicts are derived; make it again with "
            "hums.analyze."
        )
    read = {int: int, float: float, str: str, bool: bool}
    columns = {
        field.name: [
            read[field.type](value) if field.type in read else tuple(json.loads(str(value)))
            for value in dataset.variables[field.name].to_numpy().tolist()
        ]
        for field in fields(kind)  # type: ignore[arg-type]
    }
    return [kind(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]


# ---- Tables and a JSON summary of an analysis, as written to `orders.csv`, `indicators.csv` and `summary.json` -------


SUMMARY_SCHEMA = "hums-summary/2"


@checked
def line_table(analysis: Analysis, name: str) -> "pd.DataFrame":
    """Return the measured values of the expected lines of one spectrum, one row per line and channel.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.
    name : str
        ``"order_spectrum"`` or ``"envelope"``.

    Returns
    -------
    pandas.DataFrame
        component, kind, harmonic and sideband of the line; channel; order (expected) and order_found, in cycles per
        revolution of the reference; amplitude (peak) and amplitude_std (of each quadrature, from the background) in
        units; snr, the ratio of the amplitude to the background; false_alarm_probability, the probability that noise
        alone exceeds this amplitude at any line of the record that can raise a finding; claimed, whether the line
        is significant and not explained by a stronger one; explained_by, a description of that stronger line.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> times_s = np.arange(8000) / 4000
    >>> tone = 0.5 * np.cos(2 * np.pi * 23 * 20 * times_s)  # 23 teeth at 20 rev/s
    >>> noise = np.random.default_rng(0).normal(0, 0.05, times_s.size)
    >>> pulses = hums.PulseTimes(times_s=np.arange(41) / 20, shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"housing": tone + noise}, rate_hz=4000, units="g", angle=pulses)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> lines = hums.line_table(analysis, "order_spectrum")
    >>> lines[lines["claimed"]][["component", "harmonic", "order", "amplitude"]].round(2).values.tolist()
    [['stage 1', 1, 23.0, 0.5]]
    """
    choice(name, name="name", choices=(ORDER_SPECTRUM, ENVELOPE))
    dataset = group(analysis, name)
    table = dataset[[column for column in dataset.data_vars if dataset[column].dims == ("line",)]].to_dataframe()
    plain = table.rename(columns=lambda column: str(column).removeprefix("line_")).reset_index(drop=True)
    plain["claimed"] = plain["claimed"].astype(bool)
    return plain[
        [
            "component",
            "kind",
            "harmonic",
            "sideband",
            "channel",
            "order",
            "order_found",
            "amplitude",
            "amplitude_std",
            "units",
            "snr",
            "false_alarm_probability",
            "claimed",
            "explained_by",
        ]
    ]


@checked
def track_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the tracked amplitudes of all channels, one row per line and output.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.

    Returns
    -------
    pandas.DataFrame
        channel; spectrum, ``"order_spectrum"`` for lines of the record and ``"envelope"`` for those of its envelope;
        component, kind, harmonic and sideband of the line; time_s; speed_hz of the reference in rev/s; order in cycles
        per revolution of the reference; amplitude (peak) and phase_deg of a cosine relative to the angle of the
        reference, of envelope lines to that of the line; std and half_width of the 95 % interval, both in units.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> times_s = np.arange(8000) / 4000
    >>> tone = 0.5 * np.cos(2 * np.pi * 23 * 20 * times_s)  # 23 teeth at 20 rev/s
    >>> noise = np.random.default_rng(0).normal(0, 0.05, times_s.size)
    >>> pulses = hums.PulseTimes(times_s=np.arange(41) / 20, shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"housing": tone + noise}, rate_hz=4000, units="g", angle=pulses)
    >>> tracks = hums.track_table(hums.analyze(record, hums.load_gearbox("two-stage")))
    >>> tracks[["order", "speed_hz", "amplitude"]].mean().round(2).tolist()
    [23.0, 20.0, 0.5]
    """
    import pandas as pd  # noqa: PLC0415

    tables = []
    for name, spectrum in (("tracks", ORDER_SPECTRUM), ("envelope_tracks", ENVELOPE)):
        tracks = group(analysis, name)
        if not tracks:
            continue
        value = tracks["complex_amplitude"]
        tracks = tracks.assign(amplitude=abs(value), phase_deg=(value.dims, np.degrees(np.angle(value))))
        plain = tracks.to_dataframe().reset_index().assign(spectrum=spectrum)
        tables.append(plain.rename(columns=lambda column: column.removeprefix("track_")))
    columns = ["channel", "spectrum", "component", "kind", "harmonic", "sideband", "time_s", "speed_hz", "order"]
    columns += ["amplitude", "phase_deg", "std", "half_width", "units"]
    return pd.concat(tables, ignore_index=True)[columns] if tables else pd.DataFrame(columns=columns)


@checked
def findings_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the findings, one row per component and kind of defect, the most certain first.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.

    Returns
    -------
    pandas.DataFrame
        component and kind of the defect; alike, other components indistinguishable from it; channel that
        shows it best; verdict, ``"diagnosed"`` or ``"indicated"``;
        evidence in words; false_alarm_probability; snr; order_found in cycles per revolution of the reference;
        amplitude (peak) in units.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> noise = np.random.default_rng(0).normal(size=8000)
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> record = hums.make_record({"housing": noise}, rate_hz=4000, units="g", angle=angle)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> len(hums.findings_table(analysis))  # white noise holds no defect
    0
    """
    return _table(analysis, "findings")


@checked
def verdict_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the verdict on every kind of defect of every component, findings first.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.

    Returns
    -------
    pandas.DataFrame
        The columns of `findings_table`; verdict is also ``"not judged"``, with the reason in evidence, or ``"nothing
        found"`` if a defect would have been detected. Every bearing, gear and shaft of the drawing that can fail has a
        row for each of its kinds of damage; least_change states the smallest change that would alter the verdict.
        `hums.derive_verdicts` recomputes the rows from the analysis.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> times_s = np.arange(80_000) / 4000
    >>> meshes = sum(np.cos(2 * np.pi * order * 20 * times_s) for order in (23, 46, 23 * 19 / 67))
    >>> x = meshes + np.random.default_rng(0).normal(size=times_s.size)
    >>> angle = hums.PulseTimes(times_s=np.arange(0, 20, 1 / 20), shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"housing": x}, rate_hz=4000, units="g", angle=angle)
    >>> verdicts = hums.verdict_table(hums.analyze(record, hums.load_gearbox("two-stage")))
    >>> set(verdicts.loc[verdicts["kind"] != "shaft", "verdict"])
    {'nothing found'}
    >>> set(verdicts.loc[verdicts["kind"] == "shaft", "evidence"])
    {'not judged: no baseline or limits.'}
    """
    import pandas as pd  # noqa: PLC0415

    tables = [_table(analysis, name) for name in ("findings", "verdicts")]
    filled = [table for table in tables if len(table)] or tables[:1]
    return pd.concat(filled, ignore_index=True)


@checked
def unexplained_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the lines of the order spectra that no component of the drawing explains, by channel, largest first.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.

    Returns
    -------
    pandas.DataFrame
        channel; order in cycles per revolution of the reference and frequency_hz at the mean speed; amplitude (peak) in
        units; ratio to the median of the background; spacing, the order of which this and other lines are multiples,
        NaN for a single line; might_be, the possible source of the family.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> times_s = np.arange(40000) / 4000
    >>> x = np.cos(2 * np.pi * 333 * times_s) + np.random.default_rng(0).normal(0, 0.05, times_s.size)
    >>> pulses = hums.PulseTimes(times_s=np.arange(201) / 20, shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"housing": x}, rate_hz=4000, units="g", angle=pulses)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> hums.unexplained_table(analysis)[["order", "frequency_hz", "amplitude"]].round(2).values.tolist()
    [[16.65, 333.0, 1.0]]
    """
    return _table(analysis, "unexplained")


@checked
def indicator_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the condition indicators, one row per channel, component and indicator.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.

    Returns
    -------
    pandas.DataFrame
        channel, component, kind (of component) and indicator; value in unit; noise_limit, which noise alone seldom
        exceeds, NaN where unknown; takes, the signal the indicator is computed from; source, the publication;
        withheld, the reason if the value is NaN.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> noise = np.random.default_rng(0).normal(size=8000)
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> record = hums.make_record({"housing": noise}, rate_hz=4000, units="g", angle=angle)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> values = hums.indicator_table(analysis).set_index(["component", "indicator"])["value"]
    >>> bool(abs(values["record", "kurtosis"] - 3) < 5 * np.sqrt(24 / 8000))  # Gaussian noise
    True
    """
    return _table(analysis, "indicators")


@checked
def health_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the condition of every sensor, one row each, the tachometer last.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.

    Returns
    -------
    pandas.DataFrame
        name; sensor, ``"vibration"`` or ``"tachometer"``; status, ``"ok"``, ``"suspect"`` or ``"faulty"``; reasons for
        a status other than ``"ok"``; missing, the fraction of samples without signal; not_judged, the checks for which
        the record is too short or its sampling rate too low.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> noise = np.random.default_rng(0).normal(size=8000)
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> record = hums.make_record({"housing": noise}, rate_hz=4000, units="g", angle=angle)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> hums.health_table(analysis)[["name", "status"]].values.tolist()
    [['housing', 'ok']]
    """
    return _table(analysis, "health")


def envelope_bands(analysis: Analysis) -> list[dict[str, Any]]:
    """Return the demodulated band of each channel in Hz, whether it was chosen from the record, and why."""
    dataset = group(analysis, ENVELOPE)
    if "band_low_hz" not in dataset.coords:
        return []
    return [
        {
            "channel": str(one["channel"].item()),
            "low_hz": float(one["band_low_hz"]),
            "high_hz": float(one["band_high_hz"]),
            "chosen": bool(one["band_chosen"]),
            "why": str(one["band_why"].item()),
        }
        for one in (dataset.isel(channel=number) for number in range(dataset.sizes["channel"]))
    ]


@checked
def summary(analysis: Analysis) -> dict[str, Any]:
    """Return the speed, sensor health, lines, indicators and findings of an analysis as plain JSON types.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.

    Returns
    -------
    dict
        The content of ``summary.json``: keys ``schema``, ``record``, ``gearbox``, ``reference``, ``channels``,
        ``settings``, ``notes``, ``speed_hz``, ``health``, ``envelope_bands``, ``orders``, ``envelope``, ``indicators``,
        ``findings`` and others; tables are lists of rows.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> noise = np.random.default_rng(0).normal(size=8000)
    >>> angle = hums.NominalSpeed(rpm=1200, shaft="input")
    >>> record = hums.make_record({"housing": noise}, rate_hz=4000, units="g", angle=angle)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> facts = hums.summary(analysis)
    >>> facts["reference"], round(facts["speed_hz"]["mean"], 6), facts["findings"]
    ('input', 20.0, [])
    """
    attrs = analysis.attrs
    return {
        "schema": SUMMARY_SCHEMA,
        "record": attrs["record"],
        "machine": attrs["machine"],
        "site": attrs["site"],
        "analyst": attrs["analyst"],
        "recorded_at": attrs["recorded_at"],
        "gearbox": attrs["gearbox"],
        "reference": attrs["reference"],
        "version": attrs["version"],
        "channels": json.loads(attrs["channels_json"]),
        "settings": json.loads(attrs["settings_json"]),
        "notes": json.loads(attrs["notes_json"]),
        "speed_hz": _speed_facts(group(analysis, "speed")),
        "measured": json.loads(attrs["measured_json"]),
        "health": _records(health_table(analysis)),
        "envelope_bands": envelope_bands(analysis),
        "orders": _records(line_table(analysis, ORDER_SPECTRUM)),
        "envelope": _records(line_table(analysis, ENVELOPE)),
        "indicators": _records(indicator_table(analysis)),
        "findings": _records(findings_table(analysis)),
        "verdicts": _records(verdict_table(analysis)),
        "unexplained": _records(unexplained_table(analysis)),
    }


def _speed_facts(motion: xr.Dataset) -> dict[str, Any]:
    """Return the speed of the reference as plain types; None if the record states none, as an average in angle."""
    speed, attrs = motion["speed_hz"], motion.attrs
    known = speed.size > 0
    return {
        "min": float(speed.min()) if known else None,
        "max": float(speed.max()) if known else None,
        "mean": speed.size / float((1 / speed).sum()) if known else None,
        "nominal": bool(attrs["nominal"]),
        "declared": float(attrs["declared_hz"]) if "declared_hz" in attrs else None,
        "tachometer": str(attrs["tachometer"]),
        "estimated_from": str(attrs.get("estimated_from", "")),
        "confidence": float(attrs["confidence"]) if "confidence" in attrs else None,
    }


def _records(table: "pd.DataFrame") -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(table.to_json(orient="records", double_precision=12))
    return rows

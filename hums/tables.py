"""Tables and a JSON summary of an analysis, as written to `orders.csv`, `indicators.csv` and `summary.json`."""

import json
from typing import TYPE_CHECKING, Any

from hums.layout import Analysis, group
from hums.search import ENVELOPE, ORDER_SPECTRUM

if TYPE_CHECKING:
    import pandas as pd

SCHEMA = "hums-summary/1"


def line_table(analysis: Analysis, name: str) -> "pd.DataFrame":
    """Return the expected lines of one spectrum as measured, one row per line and channel.

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


def findings_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the findings, one row per component and kind of defect, the most certain first.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.

    Returns
    -------
    pandas.DataFrame
        component and kind of the defect; channel that shows it best; verdict, ``"diagnosed"`` or ``"indicated"``;
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
    return group(analysis, "findings").to_dataframe().reset_index(drop=True)


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
        withheld, the reason where the value is NaN.

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
    return group(analysis, "indicators").to_dataframe().reset_index(drop=True)


def health_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the condition of every sensor, one row each, the tachometer last.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` or `open_analysis`.

    Returns
    -------
    pandas.DataFrame
        name; sensor, ``"vibration"`` or ``"tachometer"``; status, ``"ok"``, ``"suspect"`` or ``"sick"``; reasons for a
        status other than ``"ok"``; missing, the fraction of samples without signal; not_judged, the checks for which
        the record is too short or too slowly sampled.

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
    return group(analysis, "health").to_dataframe().reset_index(drop=True)


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
            "doubts": json.loads(one["band_doubts_json"].item()),
        }
        for one in (dataset.isel(channel=number) for number in range(dataset.sizes["channel"]))
    ]


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
    attrs, motion = analysis.attrs, group(analysis, "speed")
    speed = motion["speed_hz"]
    return {
        "schema": SCHEMA,
        "record": attrs["record"],
        "machine": attrs["machine"],
        "recorded_at": attrs["recorded_at"],
        "gearbox": attrs["gearbox"],
        "reference": attrs["reference"],
        "version": attrs["version"],
        "channels": json.loads(attrs["channels_json"]),
        "settings": json.loads(attrs["settings_json"]),
        "notes": json.loads(attrs["notes_json"]),
        "speed_hz": {
            "min": float(speed.min()),
            "max": float(speed.max()),
            "mean": speed.size / float((1 / speed).sum()),
            "nominal": bool(motion.attrs["nominal"]),
            "tachometer": str(motion.attrs["tachometer"]),
            "estimated_from": str(motion.attrs.get("estimated_from", "")),
            "confidence": float(motion.attrs["confidence"]) if "confidence" in motion.attrs else None,
        },
        "health": _records(health_table(analysis)),
        "envelope_bands": envelope_bands(analysis),
        "orders": _records(line_table(analysis, ORDER_SPECTRUM)),
        "envelope": _records(line_table(analysis, ENVELOPE)),
        "indicators": _records(indicator_table(analysis)),
        "findings": _records(findings_table(analysis)),
    }


def _records(table: "pd.DataFrame") -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(table.to_json(orient="records", double_precision=12))
    return rows

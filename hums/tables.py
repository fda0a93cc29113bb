"""An analysis as plain tables: what goes into `summary.json` and `orders.csv`."""

import json
from typing import TYPE_CHECKING, Any

from hums.layout import Analysis, group
from hums.search import ENVELOPE, ORDER_SPECTRUM

if TYPE_CHECKING:
    import pandas as pd

SCHEMA = "hums-summary/1"


def line_table(analysis: Analysis, name: str) -> "pd.DataFrame":
    """Return the lines looked for in `/order_spectrum` or `/envelope`, a row each.

    Columns: component, kind, harmonic, sideband, channel, order (nominal), order_found, amplitude (peak),
    amplitude_std (of each quadrature, from the surroundings), units, snr, false_alarm_probability (for the
    whole record), claimed, explained_by.
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
    """Return the findings, ranked, a row each."""
    return group(analysis, "findings").to_dataframe().reset_index(drop=True)


def indicator_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the condition indicators, a row each.

    Columns: channel, component, kind, indicator, value, unit, noise_limit, takes, source, withheld; the value is NaN
    where the last one says why.
    """
    return group(analysis, "indicators").to_dataframe().reset_index(drop=True)


def health_table(analysis: Analysis) -> "pd.DataFrame":
    """Return the verdict on every sensor, a row each: name, sensor, status, reasons, missing, not_judged."""
    return group(analysis, "health").to_dataframe().reset_index(drop=True)


def envelope_bands(analysis: Analysis) -> list[dict[str, Any]]:
    """Return by channel which band was demodulated, whether it was chosen from the record, and why."""
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
    """Return everything a machine wants to read of an analysis, as plain JSON types."""
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

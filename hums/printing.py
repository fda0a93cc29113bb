"""Console output of tables of orders and of records."""

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["print_orders", "print_record"]


def print_orders(table: "pd.DataFrame", *, csv: bool, json: bool) -> None:
    """Print a table of orders as text, CSV or JSON."""
    fractions = table["exact"].map(str, na_action="ignore")
    if csv:
        spacings = table["sidebands"].map(lambda row: " ".join(map(str, row)))
        typer.echo(table.assign(sidebands=spacings).to_csv(index=False), nl=False)
    elif json:
        spacings = table["sidebands"].map(lambda row: [float(spacing) for spacing in row])
        plain = table.assign(exact=fractions, sidebands=spacings)
        typer.echo(plain.to_json(orient="records", double_precision=15))
    else:
        plain = table.assign(exact=fractions.fillna("")).drop(columns="sidebands")
        typer.echo(plain.to_string(index=False, formatters={"order": "{:.6f}".format}))


def print_record(record: "xr.Dataset") -> None:
    """Print what a record holds, a line for each channel and tachometer."""
    from hums.record import nominal_speed, sampling, speed_percentiles, tachometers, vibration_channels  # noqa: PLC0415

    for label, key in (("machine", "machine"), ("recorded at", "recorded_at")):
        if record.attrs.get(key):
            typer.echo(f"{label:<12} {record.attrs[key]}")
    for name in vibration_channels(record):
        when, attrs = sampling(record, name), record[name].attrs
        where = "".join(f", {attrs[key]}" for key in ("sensor", "direction") if key in attrs)
        typer.echo(
            f"{'channel':<12} {name}: {when.count} samples at {when.rate_hz:g} Hz, "
            f"{when.count / when.rate_hz:.3f} s from {when.start_s:g} s, in {attrs['units']}{where}"
        )
    for name in tachometers(record):
        attrs, speeds = record[name].attrs, speed_percentiles(record[name])
        about = "" if speeds is None else ", about {:.4g} rev/s (98 % of revolutions {:.4g} to {:.4g})".format(*speeds)
        typer.echo(
            f"{'tachometer':<12} {name}: {record[name].size} pulses, {attrs['pulses_per_rev']} a revolution of "
            f"{attrs['shaft']}{about}"
        )
    declared = nominal_speed(record)
    if declared is not None:
        typer.echo(f"{'speed':<12} {float(declared) * 60:g} rpm of {declared.attrs['shaft']}, declared (nominal)")
    truth = [str(name) for name in record.data_vars if str(name).startswith("truth_")]
    if truth:
        typer.echo(f"{'truth':<12} {', '.join(truth)}")

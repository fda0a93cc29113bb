"""Command `hums info`, and the lines in which it prints a record."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["info", "print_record"]


def info(record: Annotated[Path, typer.Argument(help="A record, .h5.")]) -> None:
    """Print what is inside a record."""
    from hums.readers.process import ReaderProcess  # noqa: PLC0415

    with ReaderProcess() as reader, reader.open_record(record) as opened:
        print_record(opened)


def print_record(record: "xr.Dataset") -> None:
    """Print what a record holds, a line for each channel and tachometer."""
    from hums.records.record import nominal_speed, sampling, speed_percentiles, tachometers, vibration_channels  # noqa: PLC0415

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

"""Command `hums info`, and the printed summary of a record."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hums.cli.options import Force, echo

if TYPE_CHECKING:
    import xarray as xr


def info(
    record: Annotated[Path, typer.Argument(help="Record, .h5, or dataset folder; with --draft, a file to import.")],
    draft: Annotated[
        Path | None,
        typer.Option(
            metavar="TOML",
            help="Draft an import description: what the file states, and blanks for what it does not.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Show the contents of a record, or the size of a dataset and its first record."""
    from hums.readers.process import ReaderProcess  # noqa: PLC0415

    if draft is not None:
        _write_draft(record, draft, force=force)
    elif record.is_dir():
        _print_dataset(record)
    else:
        with ReaderProcess() as reader, reader.open_record(record) as opened:
            print_record(opened)


def _write_draft(source: Path, target: Path, *, force: bool) -> None:
    from hums.conversion import find_sources  # noqa: PLC0415
    from hums.readers.process import ReaderProcess  # noqa: PLC0415
    from hums.records.outputs import atomic_write, check_outputs  # noqa: PLC0415

    check_outputs([target], inputs=[source], force=force)  # a draft has no mark: it is filled in
    with ReaderProcess() as reader, atomic_write(target) as part:
        part.write_text(reader.draft(find_sources([source])[0].path), encoding="utf-8")
    echo(f"wrote {target}; fill in what is missing, then run: hums convert {source} ... -d {target}")


def _print_dataset(folder: Path) -> None:
    from hums.records.dataset_store import dataset_files, dataset_record, is_begun  # noqa: PLC0415

    if not is_begun(folder):
        raise ValueError(f"{folder} is not a dataset written by hums dataset or hums convert; name a record in it.")
    echo(f"{'dataset':<12} {len(dataset_files(folder))} records; the first:")
    with dataset_record(folder, 0) as first:
        print_record(first)


def print_record(record: "xr.Dataset") -> None:
    """Print the contents of a record, one line per channel, tachometer and measured quantity."""
    from hums.records import channels  # noqa: PLC0415
    from hums.records.quantities import mean_quantities  # noqa: PLC0415
    from hums.records.snapshots import is_snapshots  # noqa: PLC0415

    for label, key in (("machine", "machine"), ("recorded at", "recorded_at"), ("notes", "notes")):
        if record.attrs.get(key):
            echo(f"{label:<12} {record.attrs[key]}")
    if is_snapshots(record):
        echo(f"{'snapshots':<12} {_snapshots_text(record)}")
    if channels.is_average(record):
        attrs = record.attrs
        over = f", over {attrs['averaged_over']} revolutions" if "averaged_over" in attrs else ""
        echo(f"{'average of':<12} {attrs['average_of']}, {attrs['samples_per_rev']} samples per revolution{over}")
    for name in channels.vibration_channels(record):
        when, attrs = channels.sampling(record, name), record[name].attrs
        where = "".join(f", {attrs[key]}" for key in ("sensor", "direction") if key in attrs)
        span = (
            f"{when.count} samples, {when.count / when.rate_hz:g} revolutions"
            if channels.is_average(record)
            else f"{when.count} samples at {when.rate_hz:g} Hz, {when.count / when.rate_hz:.3f} s "
            f"from {when.start_s:g} s"
        )
        echo(f"{'channel':<12} {name}: {span}, in {attrs['units']}{where}")
    for name in channels.tachometers(record):
        echo(f"{'tachometer':<12} {name}: {_pulses_text(record[name])}")
    declared = channels.nominal_speed(record)
    if declared is not None:
        rpm = 60 * declared.values
        span = f"{float(rpm.min()):g}" + (f" to {float(rpm.max()):g}" if rpm.min() < rpm.max() else "")
        echo(f"{'speed':<12} {span} rpm of {declared.attrs['shaft']}, declared (nominal)")
    for name, (mean, units) in mean_quantities(record).items():
        echo(f"{'measured':<12} {name}: {mean:.5g} {units}{' on average' if record[name].ndim else ''}")
    truth = [str(name) for name in record.data_vars if str(name).startswith("truth_")]
    if truth:
        echo(f"{'truth':<12} {', '.join(truth)}")


def _snapshots_text(record: "xr.Dataset") -> str:
    count = record.sizes["snapshot"]
    if "snapshot_s" not in record.coords:
        return f"{count}, times unknown"
    starts_s = record["snapshot_s"].values
    spacing = f", every {float((starts_s[-1] - starts_s[0]) / (count - 1)):.4g} s on average" if count > 1 else ""
    return f"{count}{spacing}, the last {float(starts_s[-1]):g} s after the first"


def _pulses_text(pulses: "xr.DataArray") -> str:
    from hums.records.channels import speed_percentiles  # noqa: PLC0415

    attrs = pulses.attrs
    of = f"{attrs['pulses_per_rev']} per revolution of {attrs['shaft']}"
    if pulses.ndim > 1:
        return f"{int(pulses.notnull().sum())} pulses in all snapshots, {of}"
    speeds = speed_percentiles(pulses)
    about = "" if speeds is None else ", about {:.4g} rev/s (98% of revolutions {:.4g} to {:.4g})".format(*speeds)
    return f"{pulses.size} pulses, {of}{about}"

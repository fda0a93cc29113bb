"""Command `hums convert`."""

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hums.cli.info import print_record
from hums.cli.options import RECORD_SUFFIXES, Scheduler, WorkerCount, check_record_target, say, workers_of

__all__ = ["convert"]

SHOWN_REFUSALS = 5
FEW_FILES = 200  # which one process converts in the time in which others start


def convert(  # noqa: PLR0917 - each option is one
    source: Annotated[
        list[Path] | None,
        typer.Argument(
            show_default=False,
            help="A .mat, .wav, .csv, .txt, .tdms, .uff, .h5, .nc, .npy or .npz file; or many: files, folders, "
            'patterns as "acc_*.csv", and names that state the time as "data-%Y%m%dT%H%M%SZ.mat".',
        ),
    ] = None,
    target: Annotated[
        Path | None, typer.Argument(show_default=False, help="The record to write, .h5; of many files a folder.")
    ] = None,
    channel: Annotated[
        list[str] | None,
        typer.Option(
            help="Vibration channel; repeat. Struct fields by dotted path. Without one the file's are listed."
        ),
    ] = None,
    units: Annotated[
        list[str] | None,
        typer.Option(help='Units of all channels, such as g or "m s-2"; or repeat, in the order of the channels.'),
    ] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option(help="Samples a second; the file, or a column of times in it, may state them."),
    ] = None,
    time_unit: Annotated[
        Literal["s", "ms", "us"] | None, typer.Option(help='Of a column "time" whose header states none.')
    ] = None,
    tach_times: Annotated[str | None, typer.Option(help="Variable that holds pulse times, s.")] = None,
    tach_waveform: Annotated[str | None, typer.Option(help="Channel that holds a tachometer waveform.")] = None,
    shaft_rpm: Annotated[float | None, typer.Option(help="Declared constant speed, rpm.")] = None,
    speed_column: Annotated[
        str | None, typer.Option(help="Column of the shaft's measured speed, steady within 2 %; with --speed-units.")
    ] = None,
    speed_units: Annotated[str, typer.Option(help="Units of that speed: rpm or Hz.")] = "",
    shaft: Annotated[str | None, typer.Option(help="Shaft that the tachometer or the speed belongs to.")] = None,
    pulses_per_rev: Annotated[int | None, typer.Option(help="Tachometer pulses a revolution.")] = None,
    no_tachometer: Annotated[
        bool,
        typer.Option("--no-tachometer", help="No shaft angle is measured; hums analyze --speed-range estimates it."),
    ] = False,
    measured: Annotated[
        list[str] | None,
        typer.Option(metavar="COLUMN=UNITS", help='Load, temperature, ... as "torque=N m" or oil=degC; repeat.'),
    ] = None,
    average_of: Annotated[
        str | None, typer.Option(metavar="COMPONENT", help="The channels are averages in angle of this link already.")
    ] = None,
    samples_per_rev: Annotated[
        int | None, typer.Option(metavar="N", help="Samples in one revolution of it; instead of --rate-hz.")
    ] = None,
    averaged_over: Annotated[
        int | None, typer.Option(metavar="REVOLUTIONS", help="Number of revolutions averaged, if known.")
    ] = None,
    scale: Annotated[float, typer.Option(help="Factor from the file's numbers to the units.")] = 1.0,
    machine: Annotated[str, typer.Option(help="Name of the machine.")] = "",
    recorded_at: Annotated[
        str | None, typer.Option(help="Time of the record, ISO 8601 with offset; with --every of the first.")
    ] = None,
    time_column: Annotated[
        str | None, typer.Option(help="Column of times, whose first is that of the record: s since 1970, or ISO 8601.")
    ] = None,
    time_pattern: Annotated[
        str | None, typer.Option(metavar="PATTERN", help="Many: time in the names, as acc_%Y%m%d_%H%M%S.csv.")
    ] = None,
    utc_offset: Annotated[
        str | None, typer.Option(metavar="+HH:MM", help="Many: offset from UTC of the times in the names.")
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", help="Many: time from one number in the names to the next. Else an order only."
        ),
    ] = None,
    files: Annotated[bool, typer.Option("--files", help="Many: a record each, not one packed dataset.")] = False,
    snapshots: Annotated[
        int, typer.Option(metavar="N", help="Many: join each N successive files to one record of snapshots.")
    ] = 1,
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
    most_bytes: Annotated[
        int | None, typer.Option(help="Bytes that one array may take. Default 100 times the file's size.")
    ] = None,
    decimal: Annotated[
        Literal[".", ","] | None, typer.Option(help="Decimal sign of text whose numbers do not show which it is.")
    ] = None,
    trust: Annotated[
        Literal["declared", "file"] | None,
        typer.Option(help="Which holds where the file contradicts an option. Else that is refused."),
    ] = None,
) -> None:
    """Turn other programs' files into records: one into a record, many into a dataset or a record each.

    The same again goes on with what was stopped, and with files that are new or changed. What cannot be read is a row
    of refused.csv.
    """
    given = locals()
    from hums.readers import convert as convert_file  # noqa: PLC0415

    of_convert = given.keys() & inspect.signature(convert_file).parameters.keys() - {"source", "recorded_at"}
    declared = {name: given[name] for name in sorted(of_convert)} | {
        "channels": channel or [],
        "units": _units_of(channel or [], units or []),
        "measured": _units_by_column(measured or []),
    }
    if not source or target is None:
        named = f"{target} alone is named" if target else "no file is named"
        raise ValueError(f"{named}; name the files to read and, last, the record or folder to write.")
    one = source[0] if len(source) == 1 else None
    of_many = {"--time-pattern": time_pattern, "--utc-offset": utc_offset, "--every": every, "--files": files}
    of_many |= {"--snapshots": snapshots if snapshots != 1 else None}
    if one is not None and not one.is_dir() and (one.exists() or not _is_pattern(one)):
        if meaningless := [option for option, value in of_many.items() if value]:
            raise ValueError(f"{meaningless[0]} is for many files, and {one} is one; leave it out, or name a folder.")
        _convert_one(one, target, declared | {"recorded_at": recorded_at})
        return
    if recorded_at is not None and every is None:
        raise ValueError(
            f"--recorded-at {recorded_at} would be the time of every file; add --every SECONDS, or let the names state "
            "their times."
        )
    if target.suffix.lower() in RECORD_SUFFIXES:
        raise ValueError(f"{target}: many files make a folder of records; name one, as {target.with_suffix('')}.")
    from hums.conversion import convert_files, find_sources  # noqa: PLC0415
    from hums.jobs import Serial  # noqa: PLC0415
    from signals._validation import plain_message  # noqa: PLC0415

    found = find_sources(source, time_pattern=time_pattern, utc_offset=utc_offset, every_s=every, first_at=recorded_at)
    few = len(found) <= FEW_FILES and workers is None and scheduler is None
    result = convert_files(
        found,
        target,
        form="files" if files else "packed",
        snapshots=snapshots,
        workers=Serial() if few else workers_of(workers, scheduler),
        progress=True,
        **declared,
    )
    typer.echo(
        f"{result.records} records; {result.done} files read now, {result.kept} before, {len(result.refused)} refused"
    )
    for file, reason in list(result.refused.items())[:SHOWN_REFUSALS]:
        typer.echo(plain_message(f"refused {file}: {reason}"))
    if len(result.refused) > SHOWN_REFUSALS:
        typer.echo(f"and {len(result.refused) - SHOWN_REFUSALS} more: see refused.csv")
    if not any((time_pattern, time_column, every)) and not all(file.recorded_at for file in found):
        typer.echo(
            "no time is known: neither names nor options state when the files were recorded, so that their numbers are "
            "an order only and there are no trends; give --time-pattern, --time-column, or --every with --recorded-at"
        )
    typer.echo(f"wrote {target}")


def _is_pattern(source: Path) -> bool:
    return any(sign in source.name for sign in "*?[%")


def _units_of(channels: list[str], units: list[str]) -> str | dict[str, str] | None:
    """Return one unit for all channels, or that of each."""
    if len(units) <= 1:
        return units[0] if units else None
    if len(units) != len(channels):
        raise ValueError(
            f"--units {' --units '.join(units)}: give one for all {len(channels)} channels, or one for each."
        )
    return dict(zip(channels, units, strict=True))


def _units_by_column(texts: list[str]) -> dict[str, str]:
    found = {}
    for text in texts:
        column, separator, units = text.rpartition("=")
        if not separator or not column:
            raise ValueError(f'--measured "{text}": write COLUMN=UNITS, as in --measured "torque=N m".')
        found[column] = units
    return found


def _convert_one(source: Path, target: Path, declared: Mapping[str, Any]) -> None:
    from hums.readers.process import ReaderProcess  # noqa: PLC0415
    from hums.records.store import save_record  # noqa: PLC0415

    check_record_target(target, inputs=[source])
    say(f"reading {source}")
    with ReaderProcess() as reader:
        record = reader.convert(source, **declared)
        save_record(record, target)
        typer.echo(f"wrote {target}")
        print_record(record)

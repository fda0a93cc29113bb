"""Command `hums convert`."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from hums.cli.info import print_record
from hums.cli.options import say

__all__ = ["convert"]

RECORD_SUFFIXES = (".h5", ".hdf5")


def convert(
    source: Annotated[Path, typer.Argument(help="A .mat, .wav, .csv, .tdms, .uff or .h5 file.")],
    target: Annotated[Path, typer.Argument(help="The record to write, .h5.")],
    channel: Annotated[
        list[str] | None,
        typer.Option(
            help="Vibration channel; repeat. Struct fields by dotted path. Without one the file's are listed."
        ),
    ] = None,
    units: Annotated[
        str | None,
        typer.Option(
            help='Units of the channels, such as g or "m s-2"; a header "DE [g]", .tdms or .uff may state them.'
        ),
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
    shaft: Annotated[str | None, typer.Option(help="Shaft that the tachometer or the speed belongs to.")] = None,
    pulses_per_rev: Annotated[int | None, typer.Option(help="Tachometer pulses a revolution.")] = None,
    no_tachometer: Annotated[
        bool,
        typer.Option("--no-tachometer", help="No shaft angle is measured; hums analyze --speed-range estimates it."),
    ] = False,
    scale: Annotated[float, typer.Option(help="Factor from the file's numbers to the units.")] = 1.0,
    machine: Annotated[str, typer.Option(help="Name of the machine.")] = "",
    recorded_at: Annotated[str | None, typer.Option(help="Time of the record, ISO 8601 with offset.")] = None,
    most_bytes: Annotated[
        int | None, typer.Option(help="Bytes that one array may take. Default 100 times the file's size.")
    ] = None,
) -> None:
    """Turn another program's file into a record."""
    from hums.readers.process import ReaderProcess  # noqa: PLC0415
    from hums.records.store import save_record  # noqa: PLC0415

    if source.exists() and target.exists() and source.samefile(target):
        raise ValueError(f"{target}: the record would overwrite its own source, {source}; name another target.")
    if target.suffix.lower() not in RECORD_SUFFIXES:
        raise ValueError(f"{target}: a record is HDF5, so name it so: {target.with_suffix('.h5')}.")
    say(f"reading {source}")
    with ReaderProcess() as reader:
        record = reader.convert(
            source,
            channels=channel or (),
            rate_hz=rate_hz,
            units=units,
            tach_times=tach_times,
            tach_waveform=tach_waveform,
            pulses_per_rev=pulses_per_rev,
            shaft=shaft,
            shaft_rpm=shaft_rpm,
            no_tachometer=no_tachometer,
            scale=scale,
            time_unit=time_unit,
            machine=machine,
            recorded_at=recorded_at,
            most_bytes=most_bytes,
        )
        save_record(record, target)
        typer.echo(f"wrote {target}")
        print_record(record)

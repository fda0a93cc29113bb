"""Command `hums convert`."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hums.cli.info import print_record
from hums.cli.options import (
    RECORD_SUFFIXES,
    Force,
    Scheduler,
    UsageError,
    WorkerCount,
    check_record_target,
    echo,
    end_with_refusals,
    option_values,
    say,
    workers_of,
)


def convert(  # noqa: PLR0917 - each option is one
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="SOURCE... [TARGET]",
            show_default=False,
            help="A .mat, .wav, .csv, .txt, .tdms, .lvm, .mf4, .uff, .h5, .nc, .npy or .npz file, a folder, or a "
            'pattern such as "acc_*.csv"; then the output. Several sources need -o.',
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Output record, .h5; for several files, a folder.")
    ] = None,
    description: Annotated[
        Path | None,
        typer.Option(
            "--description",
            "-d",
            metavar="TOML",
            help="Import description, drafted by hums info FILE --draft TOML; options take precedence.",
        ),
    ] = None,
    channel: Annotated[
        list[str] | None,
        typer.Option(
            help="Vibration channel, fields of structs by dotted path; repeatable. If omitted, the channels are listed."
        ),
    ] = None,
    units: Annotated[
        list[str] | None,
        typer.Option(help='Units, such as g or "m s-2": once for all channels, or once per channel, in their order.'),
    ] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option(help="Sampling rate in Hz, if neither the file nor its time column states it."),
    ] = None,
    shaft_rpm: Annotated[float | None, typer.Option(help="Constant nominal speed in rpm.")] = None,
    shaft: Annotated[str | None, typer.Option(help="Shaft to which the tachometer or the speed refers.")] = None,
    tach_times: Annotated[str | None, typer.Option(help="Variable with the pulse times in s.")] = None,
    tach_waveform: Annotated[str | None, typer.Option(help="Channel with the tachometer waveform.")] = None,
    pulses_per_rev: Annotated[int | None, typer.Option(help="Tachometer pulses per revolution.")] = None,
    no_tachometer: Annotated[
        bool,
        typer.Option("--no-tachometer", help="Shaft angle not measured; hums analyze --speed-range estimates it."),
    ] = False,
    machine: Annotated[str | None, typer.Option(help="Name of the machine.")] = None,
    recorded_at: Annotated[
        str | None, typer.Option(help="Start time, ISO 8601 with UTC offset; with every_s, that of the first record.")
    ] = None,
    trust: Annotated[
        Literal["declared", "file"] | None,
        typer.Option(help="Which prevails if file and declaration disagree. Default: such files are refused."),
    ] = None,
    files: Annotated[bool, typer.Option("--files", help="Write one record per file, not a packed dataset.")] = False,
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
    force: Force = False,
) -> None:
    """Convert files of other programs: one into a record, several into a dataset or separate records.

    Re-running resumes where it stopped and reads new or changed files. Files that cannot be read are listed in
    refused.csv.
    """
    given = locals()
    paths = paths or []
    if out is None and len(paths) != 2:  # noqa: PLR2004 - SOURCE TARGET
        named = "no file is" if not paths else f"only {paths[0]} is" if len(paths) == 1 else f"{len(paths)} paths are"
        raise UsageError(f"{named} given; name one source and the record or folder to write, or several and -o FOLDER.")
    *source, target = [*paths, *([out] if out else [])]
    if not source:
        raise UsageError(f"only the output {target} is given; name the files to read.")
    from hums.conversion import convert_files, find_sources  # noqa: PLC0415
    from hums.jobs import Serial  # noqa: PLC0415
    from hums.readers.description import ImportDescription, describe  # noqa: PLC0415

    declared = {name: given[name] for name in ImportDescription.model_fields if name in given}
    declared |= {"channels": channel or None, "no_tachometer": no_tachometer or None}
    declared |= {"units": (units if len(units) > 1 else units[0]) if units else None}
    with nullcontext() if description else option_values():
        spec = describe(description, **declared)
    found = find_sources(source, spec)
    one = source[0] if len(source) == 1 and source[0].is_file() else None
    if one is not None:
        declared = spec.keys() | ({"recorded_at": found[0].recorded_at} if spec.time_in_names else {})
        declared.pop("time_in_names", None)
        _convert_one(one, target, declared, force=force)
        return
    if spec.recorded_at is not None and spec.every_s is None:
        raise UsageError(
            f"recorded_at={spec.recorded_at} would apply to every file; add every_s, the interval between files in s, "
            "to the description, or time_in_names if the file names state their times."
        )
    if target.suffix.lower() in RECORD_SUFFIXES:
        raise UsageError(f"{target}: several files are written to a folder; name one, as {target.with_suffix('')}.")
    few_files = 200  # one process converts as many while worker processes would start
    few = len(found) <= few_files and workers is None and scheduler is None
    result = convert_files(
        found,
        target,
        description=spec,
        form="files" if files else "packed",
        workers=Serial() if few else workers_of(workers, scheduler),
        progress=True,
        force=force,
    )
    echo(f"{result.records} records; {result.done} files read now, {result.kept} before, {len(result.refused)} refused")
    echo(f"wrote {target}")
    end_with_refusals("refused", result.refused, len(found), "refused.csv")


def _convert_one(source: Path, target: Path, declared: dict[str, Any], *, force: bool) -> None:
    from hums.readers.process import ReaderProcess  # noqa: PLC0415
    from hums.records.store import save_record  # noqa: PLC0415

    check_record_target(target, inputs=[source], force=force)
    say(f"reading {source}")
    with ReaderProcess() as reader:
        record = reader.convert(source, **declared)
        save_record(record, target, force=force)
        echo(f"wrote {target}")
        print_record(record)

"""Command `hums fleet`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from hums.cli.options import (
    SHARED_SETTINGS,
    Force,
    Out,
    Scheduler,
    UsageError,
    WorkerCount,
    echo,
    end_with_refusals,
    option_values,
    with_settings,
    workers_of,
)

if TYPE_CHECKING:
    from hums.analysis.settings import AnalysisSettings


@with_settings(SHARED_SETTINGS, most_tracks=0, pictures=False)
def fleet(
    records: Annotated[list[Path], typer.Argument(help="Records, folders of records, or datasets.")],
    gearbox: Annotated[str, typer.Option(help="Gearbox file, .toml, or a catalogue name.")],
    out: Out,
    *,
    settings: "AnalysisSettings",
    baseline_records: Annotated[
        int, typer.Option(metavar="N", help="Learn the baseline from the first N records of a machine.")
    ] = 30,
    baseline_span: Annotated[
        Optional[tuple[str, str]],  # noqa: UP045  (typer reads this form)
        typer.Option(metavar="FROM UNTIL", help="Learn the baseline from the records of this period, ISO 8601."),
    ] = None,
    healthy: Annotated[
        list[str] | None, typer.Option(help="Learn the baseline from this record, declared healthy; repeatable.")
    ] = None,
    false_alarm_every: Annotated[
        float, typer.Option(metavar="RECORDS", help="Mean number of records per machine between false alarms.")
    ] = 10_000.0,
    maintenance: Annotated[
        Path | None, typer.Option(help="CSV file: date, component, machine, action (replaced or acknowledged).")
    ] = None,
    append: Annotated[
        bool, typer.Option("--append", help="Add the records to those of earlier runs in this folder.")
    ] = False,
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
    force: Force = False,
) -> None:
    """Analyse many records into one table with trends and alarms; re-run to resume, or --append new records."""
    from hums.fleet.fleet_analysis import FILES, analyze_fleet  # noqa: PLC0415
    from hums.fleet.observation import MonitorSettings  # noqa: PLC0415
    from hums.fleet.table import NO_PYARROW  # noqa: PLC0415

    if baseline_span and healthy:
        raise UsageError("--baseline-span and --healthy are both given; keep one.")
    span = baseline_span or ("", "")
    with option_values():
        monitoring = MonitorSettings(
            baseline_records=baseline_records,
            baseline_from=span[0],
            baseline_until=span[1],
            healthy=tuple(healthy or ()),
            false_alarm_every=false_alarm_every,
        )
    result = analyze_fleet(
        records,
        gearbox,
        out,
        settings=settings,
        workers=workers_of(workers, scheduler),
        progress=True,
        monitoring=monitoring,
        maintenance=maintenance,
        append=append,
        force=force,
    )
    echo(f"{result.records} records: {result.analysed} analysed now, {result.kept} before, {result.failed} failed")
    if result.no_trends:
        echo(result.no_trends)
    echo(f"{result.alarms} alarms; expected false alarms: one per {false_alarm_every:g} records of a machine")
    for machine in result.learning:
        echo(
            f"not judged: {machine or 'the machine'}, whose baseline is incomplete: it needs {baseline_records} "
            "records (--baseline-records)"
        )
    for name in FILES:
        echo(f"wrote {result.folder / name}")
    parquet = result.folder / "indicators.parquet"
    echo(f"wrote {parquet}" if parquet.is_file() else NO_PYARROW)
    end_with_refusals("failed", result.errors, result.records, "column error of fleet.csv")

"""Command `hums analyze`."""

from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hums.cli.options import SETTINGS, Force, Out, SpeedUnits, echo, say, with_settings

if TYPE_CHECKING:
    from collections.abc import Iterator

    import xarray as xr

    from hums.analysis.settings import AnalysisSettings
    from hums.readers.process import ReaderProcess


@with_settings(SETTINGS)
def analyze(
    record: Annotated[Path, typer.Argument(help="Record to analyse, .h5.")],
    gearbox: Annotated[str, typer.Option(help="Gearbox file, .toml, or a catalogue name.")],
    out: Out,
    *,
    settings: "AnalysisSettings",
    baseline: Annotated[
        Path | None,
        typer.Option(help="analysis.h5 of the previous record, which supplies the variances of NA4 and NB4."),
    ] = None,
    units: SpeedUnits = "rpm",
    force: Force = False,
) -> None:
    """Analyse a record and write a report."""
    from hums.analysis.findings import not_judged_words, where_none_is_named  # noqa: PLC0415
    from hums.analysis.record_analysis import analyze as run  # noqa: PLC0415
    from hums.analysis.result import summary  # noqa: PLC0415
    from hums.gearbox.mechanism import undeclared_parts  # noqa: PLC0415
    from hums.gearbox.model import load_gearbox  # noqa: PLC0415
    from hums.readers.process import ReaderProcess  # noqa: PLC0415
    from hums.report import prepare_folder, speed_text, write_report  # noqa: PLC0415
    from hums.report.verdict_strip import part_words, with_hz  # noqa: PLC0415

    with (
        ReaderProcess() as reader,
        reader.open_record(record) as opened,
        _past(reader, baseline) if baseline else nullcontext() as past,
    ):
        prepare_folder(out, inputs=[record, gearbox, *([baseline] if baseline else [])], force=force)
        declared = load_gearbox(gearbox)
        analysis = run(opened, declared, settings=settings, baseline=past)
        say("writing the report")
        page = write_report(analysis, out, baseline=past, units=units, force=force)
    facts = summary(analysis)
    echo(f"speed of {facts['reference']}: {speed_text(facts, units=units)}")
    for note in facts["notes"]:
        echo(f"note: {note}")
    for item in facts["health"]:
        if item["status"] != "ok":
            echo(f"{item['status']} {item['sensor']} {item['name']}: {item['reasons']}")
    for finding in facts["findings"]:
        kind = finding["kind"].replace("_", " ")
        evidence = with_hz(finding["evidence"], facts["speed_hz"]["mean"])
        echo(f"{finding['verdict']}: {part_words(finding)}, {kind}: {evidence}")
    if not facts["findings"]:
        echo(": ".join(where_none_is_named(facts["verdicts"])))
    elif unjudged := not_judged_words(facts["verdicts"]):
        echo(f"not judged: {unjudged}")
    for sentence in undeclared_parts(declared):
        echo(f"not declared: {sentence}")
    echo(f"report: {page}")


@contextmanager
def _past(reader: "ReaderProcess", path: Path) -> "Iterator[xr.DataTree]":
    """Open an earlier analysis in the reader process."""
    from hums.analysis.result import check_analysis  # noqa: PLC0415

    with reader.open_tree(path) as tree:
        try:
            check_analysis(tree)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        yield tree

"""Command `hums report`."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from hums.cli.options import Force, SpeedUnits, echo, say


def report(
    analysis: Annotated[Path, typer.Argument(help="analysis.h5, or the folder that holds it.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Output folder. Default: that of the analysis.")
    ] = None,
    baseline: Annotated[Path | None, typer.Option(help="analysis.h5 of an earlier record to compare with.")] = None,
    units: SpeedUnits = "rpm",
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Also print report.pdf, a summary of about four pages, with Chromium.")
    ] = False,
    full: Annotated[bool, typer.Option("--full", help="Print the whole report to report.pdf instead.")] = False,
    force: Force = False,
) -> None:
    """Regenerate the report from a saved analysis."""
    from hums.analysis.result import open_analysis  # noqa: PLC0415
    from hums.report import prepare_folder, write_report  # noqa: PLC0415
    from hums.report.pdf import write_pdf  # noqa: PLC0415

    analysis = analysis / "analysis.h5" if analysis.is_dir() else analysis
    out = out or analysis.parent
    prepare_folder(out, inputs=[baseline] if baseline else [], force=force)
    with open_analysis(analysis) as opened:
        loaded = opened.load()  # closed before analysis.h5 is written again in its own folder
    with open_analysis(baseline) if baseline else nullcontext() as past:
        say("writing the report")
        page = write_report(loaded, out, baseline=past, units=units, force=force)
    echo(f"report: {page}")
    if pdf or full:
        say("printing")
        echo(f"printed: {write_pdf(page, full=full, force=force)}")

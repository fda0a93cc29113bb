"""Command `hums demo`."""

from pathlib import Path
from typing import Annotated

import typer

from hums.cli.options import Force, Out, echo, say


def demo(
    out: Out = Path("hums-demo"),
    seed: Annotated[int, typer.Option(help="Random seed.")] = 1,
    force: Force = False,
) -> None:
    """Simulate a gearbox with a cracked tooth and an inner-race fault; compare its analysis with ground truth."""
    from data_synth import load_scene, simulate  # noqa: PLC0415
    from hums.analysis.record_analysis import AnalysisSettings  # noqa: PLC0415
    from hums.analysis.record_analysis import analyze as run  # noqa: PLC0415
    from hums.analysis.result import summary  # noqa: PLC0415
    from hums.gearbox.model import load_gearbox  # noqa: PLC0415
    from hums.records.outputs import check_outputs  # noqa: PLC0415
    from hums.records.store import open_record, save_record  # noqa: PLC0415
    from hums.report import prepare_folder, write_report  # noqa: PLC0415
    from hums.report.verdict_strip import part_words  # noqa: PLC0415
    from hums.scoring import score  # noqa: PLC0415

    scene = load_scene("demo")
    prepare_folder(out, force=force)
    check_outputs([out / "record.h5"], force=force)
    say("simulating a gearbox with two faults")
    save_record(simulate(scene, seed=seed), out / "record.h5", force=force)
    with open_record(out / "record.h5") as record:
        analysis = run(record, load_gearbox("two-stage"), settings=AnalysisSettings(envelope_band_hz=(6000.0, 10000.0)))
        result = score(analysis, record)
    say("writing the report")
    page = write_report(analysis, out, force=force)
    echo("True and estimated peak amplitudes in g:")
    columns = ["component", "kind", "order", "true_amplitude", "amplitude", "std", "normalised_rms"]
    echo(result.tracks[columns].to_string(index=False, float_format="{:.4f}".format))
    echo(f"\nThe errors are {result.normalised_rms:.2f} times as large as their stated uncertainty, std.\n")
    echo("Faults of the scene and their verdicts:")
    echo(result.faults.to_string(index=False))
    echo("\nFindings:")
    for finding in summary(analysis)["findings"]:
        echo(f"  {finding['verdict']}: {part_words(finding)}, {finding['kind'].replace('_', ' ')}")
    echo(f"\nreport: {page.resolve()}")

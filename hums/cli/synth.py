"""Command `hums synth`."""

from pathlib import Path
from typing import Annotated

import typer

from hums.cli.info import print_record
from hums.cli.options import Force, UsageError, check_record_target, echo, say


def synth(
    scene: Annotated[str, typer.Argument(help="Scene, .toml, or a catalogue name.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Output record, .h5.")] = None,
    seed: Annotated[int, typer.Option(help="Random seed.")] = 0,
    explain: Annotated[bool, typer.Option("--explain", help="Print the chosen model, why, and its cost.")] = False,
    by_source: Annotated[bool, typer.Option("--by-source", help="Also store the clean signal of each source.")] = False,
    phases: Annotated[bool, typer.Option("--phases", help="Also store exact angles of shafts and rollers.")] = False,
    mechanics: Annotated[
        bool, typer.Option("--mechanics", help="Also store mesh deflections, forces, stiffnesses and all speeds.")
    ] = False,
    detectability: Annotated[
        bool, typer.Option("--detectability", help="Also store the detectability of each fault in dB.")
    ] = False,
    force: Force = False,
) -> None:
    """Simulate a record and store it with its ground truth."""
    from data_synth import explain as explained  # noqa: PLC0415
    from data_synth import simulate  # noqa: PLC0415
    from data_synth.cost import refuse_too_large  # noqa: PLC0415
    from hums.records.store import save_record  # noqa: PLC0415

    if explain:
        echo(str(explained(scene, by_source=by_source, phases=phases, mechanics=mechanics)))
    if out is None:
        if explain:
            return
        raise UsageError("--out is missing; name the record to write, as in -o record.h5, or use --explain.")
    check_record_target(out, inputs=[scene], force=force)
    refuse_too_large(scene, out, by_source=by_source, phases=phases, mechanics=mechanics)
    say(f"simulating {scene}")
    record = simulate(
        scene, seed=seed, by_source=by_source, phases=phases, mechanics=mechanics, detectability=detectability
    )
    save_record(record, out, force=force)
    echo(f"wrote {out}")
    print_record(record)

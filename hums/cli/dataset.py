"""Command `hums dataset`."""

from pathlib import Path
from typing import Annotated

import typer

from hums.cli.options import Force, Scheduler, WorkerCount, echo, workers_of


def dataset(
    plan: Annotated[str, typer.Argument(help="Plan, .toml, or a catalogue name.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the dataset; re-running resumes it.")],
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
    force: Force = False,
) -> None:
    """Simulate a labelled dataset of records, or resume an interrupted one."""
    from data_synth import load_plan, make_dataset  # noqa: PLC0415
    from data_synth.dataset_folder import dataset_cost  # noqa: PLC0415

    declared, chosen = load_plan(plan), workers_of(workers, scheduler)
    cost = dataset_cost(declared)
    echo(
        f"{declared.records} records of {declared.record_bytes / 1e6:.3g} MB: {cost.size_bytes / 1e6:.3g} MB of "
        f"samples and up to {cost.truth_bytes / 1e6:.3g} MB of truth; about {cost.seconds / 60:.2g} minutes on one "
        "core."
    )
    tally = make_dataset(declared, out, workers=chosen, progress=True, force=force)
    before = f", {tally.kept} of their {tally.kept + tally.done} files from earlier runs" if tally.kept else ""
    echo(f"{out}: {declared.records} records{before}")
    echo(f"classes: {', '.join(declared.classes)}")
    echo(f'open with: hums.open_dataset("{out}")')

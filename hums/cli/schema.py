"""Command `hums schema`."""

from typing import Annotated, Literal

import typer

from hums.cli.options import echo


def schema(
    of: Annotated[
        Literal["gearbox", "scene", "plan"],
        typer.Argument(metavar="KIND", help="Kind of file: gearbox, scene, or plan of a dataset."),
    ],
) -> None:
    """Print the JSON schema of a hand-written file, for validation and completion in editors."""
    import json  # noqa: PLC0415

    from data_synth.scene_schema import plan_schema, scene_schema  # noqa: PLC0415
    from hums.gearbox.model import gearbox_schema  # noqa: PLC0415

    gearbox = gearbox_schema()
    schemas = {"gearbox": lambda: gearbox, "scene": lambda: scene_schema(gearbox), "plan": plan_schema}
    echo(json.dumps(schemas[of](), indent=2))

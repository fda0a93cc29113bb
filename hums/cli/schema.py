"""Command `hums schema`."""

from typing import Annotated, Literal

import typer

__all__ = ["schema"]


def schema(
    of: Annotated[
        Literal["gearbox", "scene", "plan"],
        typer.Argument(metavar="KIND", help="The kind of file: gearbox, scene or plan (of a dataset)."),
    ],
) -> None:
    """Print the JSON schema of a hand-written file, for editors that check and complete it."""
    import json  # noqa: PLC0415

    from data_synth.schema import plan_schema, scene_schema  # noqa: PLC0415
    from hums.gearbox.model import gearbox_schema  # noqa: PLC0415

    gearbox = gearbox_schema()
    schemas = {"gearbox": lambda: gearbox, "scene": lambda: scene_schema(gearbox), "plan": plan_schema}
    typer.echo(json.dumps(schemas[of](), indent=2))

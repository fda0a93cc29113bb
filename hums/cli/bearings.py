"""Command `hums bearings`."""

from typing import Annotated, Optional

import typer

from hums.cli.options import echo


def bearings(
    designation: Annotated[Optional[str], typer.Argument(help="Designation, or part of one.")] = None,  # noqa: UP045
) -> None:
    """Run the command."""
    from hums.gearbox.bearing_catalogue import bearing_catalogue  # noqa: PLC0415

    rows = bearing_catalogue()
    shown = [row for row in rows if designation is None or designation.lower() in row.name.lower()]
    if not shown:
        raise ValueError(f'no bearing "{designation}" in the catalogue; it has {", ".join(row.name for row in rows)}.')
    for row in shown:
        echo(
            f"{row.name}: {row.elements} elements of {row.element_diameter_mm:g} mm, pitch diameter "
            f"{row.pitch_diameter_mm:g} mm, contact angle {row.contact_angle_deg:g} degrees. {row.source}"
        )

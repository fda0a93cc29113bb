"""Command `hums bearings`."""

from typing import Annotated, Optional

import typer

from hums.cli.options import echo


def bearings(
    designation: Annotated[
        Optional[str],  # noqa: UP045
        typer.Argument(help="Designation, with or without manufacturer and suffixes, or the beginning of a series."),
    ] = None,
) -> None:
    """Run the command."""
    from hums.gearbox.bearing_catalogue import bearing_catalogue, bearings_named, typical_bearing  # noqa: PLC0415
    from hums.gearbox.components import closest  # noqa: PLC0415

    rows = bearing_catalogue()
    if designation is None:
        rows = tuple(row for row in rows if not row.boundary_mm)
        echo(
            "also by designation, with typical geometry: series 62, 63, NU2, NU3 (likewise NJ, NUP, N), 222, 223, 302 "
            "and 320, as in hums bearings 6205"
        )
    else:
        named = bearings_named(designation)
        if named and len({row.elements for row in named}) == 1:
            typical = typical_bearing(designation, named)
            rows = (typical, *(row for row in named if row != typical))
        elif named:
            echo(f"{designation}: numbers of rolling elements differ by maker; name one of these in a gearbox file")
            rows = named
        else:
            rows = tuple(row for row in rows if designation.lower() in row.name.lower())
    if not rows:
        names = {name for row in bearing_catalogue() for name in (row.name, *row.designations)}
        raise ValueError(f'no bearing "{designation}" in the catalogue{closest(designation or "", names)}')
    for row in rows:
        size = f" {' x '.join(f'{mm:g}' for mm in row.boundary_mm)} mm," if row.boundary_mm else ""
        of_spread = f", all within {row.spread:.1%}" if row.spread else ""
        inner, outer, element, cage = row.orders
        echo(
            f"{row.name}:{size} {row.elements} rolling elements of {row.element_diameter_mm:g} mm, pitch diameter "
            f"{row.pitch_diameter_mm:g} mm, contact angle {row.contact_angle_deg:g} degrees; orders: BPFI {inner:.4g}, "
            f"BPFO {outer:.4g}, 2 BSF {element:.4g}, FTF {cage:.4g}{of_spread}. {row.source}"
        )

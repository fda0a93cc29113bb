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
    """List bearings of the catalogue by designation, with the source of each geometry."""
    import pandas as pd  # noqa: PLC0415

    from hums.gearbox.bearing_catalogue import bearing_catalogue, bearings_named, typical_bearing  # noqa: PLC0415
    from hums.gearbox.components import closest  # noqa: PLC0415

    rows = bearing_catalogue()
    if designation is None:
        rows = tuple(row for row in rows if not row.boundary_mm)
        echo("also series 62, 63, NU2, NU3 (likewise NJ, NUP, N), 222, 223, 302 and 320, as in hums bearings 6205\n")
    else:
        named, start = bearings_named(designation), designation.lower()
        if named and len({row.elements for row in named}) == 1:
            typical = typical_bearing(designation, named)
            rows = (typical, *(row for row in named if row != typical))
        elif named:
            echo(f"{designation}: numbers of rolling elements differ by maker; name one of these in a gearbox file\n")
            rows = named
        else:
            names = {name: row for row in rows for name in (row.name, *row.designations)}
            rows = tuple(dict.fromkeys(row for name, row in names.items() if name.lower().startswith(start)))
            if not rows:
                raise ValueError(f'no bearing "{designation}" in the catalogue{closest(designation, set(names))}')
    sources = list(dict.fromkeys(row.source for row in rows))
    table = [
        {"bearing": row.name, "d x D x B": " x ".join(f"{mm:g}" for mm in row.boundary_mm)}
        | {"Z": row.elements, "Dw": row.element_diameter_mm, "Dpw": row.pitch_diameter_mm}
        | {"angle": f"{row.contact_angle_deg:g}"}
        | dict(zip(("BPFI", "BPFO", "2 BSF", "FTF"), row.orders, strict=True))
        | {"spread": f"{row.spread:.1%}" if row.spread else "", "source": f"[{sources.index(row.source) + 1}]"}
        for row in rows
    ]
    echo(pd.DataFrame(table).to_string(index=False, float_format="{:.4g}".format))
    echo(
        "\nDw, Dpw: diameters of element and pitch circle; sizes in mm, angle in degrees; orders per revolution of one "
        "ring relative to the other, and their largest deviation among makers"
    )
    for number, source in enumerate(sources):
        echo(f"[{number + 1}] {source}")

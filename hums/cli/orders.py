"""Command `hums orders`."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from hums.cli.options import LinkSpeeds, UsageError, echo, parse_speeds

if TYPE_CHECKING:
    import pandas as pd


def orders(
    gearbox: Annotated[str, typer.Argument(help="Gearbox file, .toml, or a catalogue name.")],
    reference: Annotated[str | None, typer.Option(help="Reference shaft of the orders.")] = None,
    speed: LinkSpeeds = None,
    csv: Annotated[bool, typer.Option("--csv", help="Print comma-separated values.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    redundant: Annotated[bool, typer.Option("--redundant", help="Print only the redundant meshes.")] = False,
    rpm: Annotated[
        float | None, typer.Option(help="Speed of the reference in rpm; adds frequencies in Hz and CPM.")
    ] = None,
) -> None:
    """Print the defect orders of a gearbox.

    Orders are cycles per revolution of the reference shaft. rolling_element is 2 BSF, as a defect strikes both
    races; tooth is the rate at which one tooth meets its mates; assembly_phase is the mesh order divided by the
    greatest common divisor of the tooth numbers.
    """
    from hums.gearbox.defect_orders import defect_orders  # noqa: PLC0415
    from hums.gearbox.kinematics import redundant_meshes, solve_kinematics  # noqa: PLC0415
    from hums.gearbox.mechanism import undeclared_parts  # noqa: PLC0415
    from hums.gearbox.model import load_gearbox  # noqa: PLC0415

    if csv and json:
        raise UsageError("--csv and --json are both given; keep one.")
    if rpm is not None and not (math.isfinite(rpm) and rpm):
        raise UsageError(f"--rpm {rpm:g}: give a non-zero speed of the reference in rpm.")
    kinematics = solve_kinematics(load_gearbox(gearbox))
    if redundant:
        echo("\n".join(redundant_meshes(kinematics)) or "no mesh is redundant")
        return
    table = defect_orders(kinematics, reference=reference, speeds=parse_speeds(speed, kinematics))
    if rpm is not None:
        table.insert(list(table.columns).index("exact"), "hz", table["order"] * abs(rpm) / 60)
        table.insert(list(table.columns).index("exact"), "cpm", table["order"] * abs(rpm))
    _print_orders(table, csv=csv, json=json)
    for sentence in () if csv or json else undeclared_parts(kinematics.gearbox):
        echo(f"note: {sentence.split(':')[0]}.", err=True)


def _print_orders(table: "pd.DataFrame", *, csv: bool, json: bool) -> None:
    """Print a table of orders as text, CSV or JSON."""
    fractions = table["exact"].map(str, na_action="ignore")
    if csv:
        from hums.records.fields import plain_cell  # noqa: PLC0415

        spacings = table["sidebands"].map(lambda row: " ".join(map(str, row)))
        echo(table.assign(sidebands=spacings).map(plain_cell).to_csv(index=False), nl=False)
    elif json:
        spacings = table["sidebands"].map(lambda row: [float(spacing) for spacing in row])
        plain = table.assign(exact=fractions, sidebands=spacings)
        echo(plain.to_json(orient="records", double_precision=15))
    else:
        plain = table.assign(exact=fractions.fillna("")).drop(columns="sidebands")
        echo(
            plain.to_string(
                index=False, formatters={"order": "{:.6f}".format, "hz": "{:.6g}".format, "cpm": "{:.6g}".format}
            )
        )

"""Command `hums orders`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from hums.cli.options import parse_speeds

if TYPE_CHECKING:
    import pandas as pd

    from hums.gearbox.kinematics import Kinematics

__all__ = ["orders"]

DRAWN_RPM = 3000.0


def orders(
    gearbox: Annotated[str, typer.Argument(help="A .toml file or a catalogue name.")],
    reference: Annotated[str | None, typer.Option(help="Shaft whose revolutions orders count.")] = None,
    speed: Annotated[list[str] | None, typer.Option(metavar="LINK=RPM", help="Speed of a link; repeat.")] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Print comma-separated values.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    plot: Annotated[Path | None, typer.Option(help="Draw the lines against speed: .svg, .png or .pdf.")] = None,
    rpm: Annotated[
        float | None, typer.Option(help="Speed of the reference: adds the frequencies in Hz and CPM.")
    ] = None,
    plot_rpm: Annotated[
        Optional[tuple[float, float]],  # noqa: UP045  (typer reads this form)
        typer.Option(metavar="LOW HIGH", help="Speeds of the reference to draw, up to the given one or 3000."),
    ] = None,
) -> None:
    """Print the defect orders of a gearbox.

    Orders count per revolution of the reference. A rolling element strikes both races, twice per turn of its own
    (2 BSF); a tooth's order is how often it meets its mates; assembly_phase is the mesh over the common divisor of the
    teeth.
    """
    from hums.gearbox.kinematics import solve_kinematics  # noqa: PLC0415
    from hums.gearbox.model import load_gearbox  # noqa: PLC0415
    from hums.gearbox.orders import defect_orders  # noqa: PLC0415
    from hums.gearbox.undeclared import undeclared_parts  # noqa: PLC0415
    from hums.records.outputs import check_outputs  # noqa: PLC0415

    if csv and json:
        raise ValueError("--csv and --json are both given; keep one.")
    check_outputs([plot] if plot else [], inputs=[gearbox])
    if plot_rpm and not plot:
        raise ValueError("--plot-rpm says which speeds to draw; add --plot FILE.")
    if rpm is not None and not (math.isfinite(rpm) and rpm):
        raise ValueError(f"--rpm {rpm:g}: give the speed of the reference, in rpm, other than 0.")
    speeds = parse_speeds(speed)
    kinematics = solve_kinematics(load_gearbox(gearbox))
    table = defect_orders(kinematics, reference=reference, speeds=speeds)
    top = abs(rpm) if rpm is not None else _reference_rpm(kinematics, reference, speeds)
    if rpm is not None:
        table.insert(list(table.columns).index("exact"), "hz", table["order"] * top / 60)
        table.insert(list(table.columns).index("exact"), "cpm", table["order"] * top)
    if plot:
        _plot_orders(table, plot_rpm or (top / 10, top), plot)
    _print_orders(table, csv=csv, json=json)
    for sentence in () if csv or json else undeclared_parts(kinematics.gearbox):
        typer.echo(f"note: {sentence.split(':')[0]}.", err=True)


def _print_orders(table: "pd.DataFrame", *, csv: bool, json: bool) -> None:
    """Print a table of orders as text, CSV or JSON."""
    fractions = table["exact"].map(str, na_action="ignore")
    if csv:
        spacings = table["sidebands"].map(lambda row: " ".join(map(str, row)))
        typer.echo(table.assign(sidebands=spacings).to_csv(index=False), nl=False)
    elif json:
        spacings = table["sidebands"].map(lambda row: [float(spacing) for spacing in row])
        plain = table.assign(exact=fractions, sidebands=spacings)
        typer.echo(plain.to_json(orient="records", double_precision=15))
    else:
        plain = table.assign(exact=fractions.fillna("")).drop(columns="sidebands")
        typer.echo(
            plain.to_string(
                index=False, formatters={"order": "{:.6f}".format, "hz": "{:.6g}".format, "cpm": "{:.6g}".format}
            )
        )


def _plot_orders(table: "pd.DataFrame", reference_rpm: tuple[float, float], path: Path) -> None:
    from hums.plots import save_figure, speed_order_chart  # noqa: PLC0415

    save_figure(lambda ax: speed_order_chart(table, reference_rpm=reference_rpm, ax=ax), path, width=10.0, height=7.0)
    typer.echo(f"wrote {path}", err=True)  # standard output stays what --csv and --json promise


def _reference_rpm(kinematics: "Kinematics", reference: str | None, speeds: dict[str, float] | None) -> float:
    link, frame = reference or kinematics.gearbox.reference, kinematics.gearbox.frame
    if speeds is None or link is None:
        return DRAWN_RPM
    return abs(float(kinematics.relative_speed(link, seen_from=frame, speeds=speeds)))

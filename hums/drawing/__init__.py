"""Animated page of a mechanism: drawing, velocity vectors and defect orders at adjustable speeds."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from fractions import Fraction
from importlib.resources import files
from pathlib import Path
from typing import Any

from markupsafe import Markup

from hums.gearbox.defect_orders import rate_forms
from hums.gearbox.kinematics import Kinematics, solve_kinematics
from hums.gearbox.layout import layout_of, transverse_axes
from hums.gearbox.model import Gearbox, GearboxError
from hums.gearbox.rational import Form, add_pivot, evaluate, reduced
from hums.pages.page import page_environment, page_head
from hums.records.outputs import check_outputs, write_text

__all__ = ["START_RPM", "free_links", "write_drawing"]

START_RPM = 1500  # the synchronous speed of a four-pole motor at 50 Hz


def write_drawing(
    gearbox: Gearbox | Kinematics,
    path: str | Path,
    *,
    speeds_rpm: Mapping[str, float | Fraction] | None = None,
    force: bool = False,
) -> Path:
    """Write a self-contained page that animates a mechanism at speeds set by sliders.

    It shows the drawing, the angular velocity vectors, and the defect orders with exact fractions and frequencies.

    Parameters
    ----------
    gearbox : Gearbox or Kinematics
        The gearbox, or its kinematics if `solve_kinematics` was given further constraints.
    path : str or Path
        File to write, ``.html``. An existing file is replaced only when the new one is complete.
    speeds_rpm : mapping of link to rpm, optional
        Links with a slider and their initial speeds, one per degree of freedom. Default: the reference at 1500 rpm and,
        with several degrees of freedom, further shafts at rest.
    force : bool
        Whether to overwrite a file that another program wrote.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ValueError
        If the suffix is not .html, the number of speeds is wrong, or, without `force`, another program wrote the file.
    GearboxError
        If the gearbox has no reference, or the speeds do not determine all others.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import hums
    >>> from hums.drawing import write_drawing
    >>> with TemporaryDirectory() as folder:
    ...     page = write_drawing(hums.load_gearbox("two-stage"), f"{folder}/two-stage.html")
    ...     print(page.stat().st_size < 1_000_000)
    True
    """
    path = Path(path)
    if path.suffix.lower() not in {".html", ".htm"}:
        raise ValueError(f'"{path}" has the suffix "{path.suffix}"; use .html.')
    check_outputs([path], force=force)
    kinematics = gearbox if isinstance(gearbox, Kinematics) else solve_kinematics(gearbox)
    write_text(path, _page(kinematics, speeds_rpm))
    return path


def free_links(kinematics: Kinematics) -> tuple[str, ...]:
    """Return the reference and further shafts whose speeds determine all others, one per degree of freedom.

    Examples
    --------
    >>> import hums
    >>> from hums.drawing import free_links
    >>> free_links(hums.solve_kinematics(hums.load_gearbox("car-differential")))
    ('cage', 'left wheel')
    """
    frame = kinematics.mechanism.frame
    shafts = [body for body, joint in kinematics.joints.items() if joint.carried_by == frame]
    chosen: list[str] = []
    known: dict[str, Form] = {}
    for link in dict.fromkeys([kinematics.gearbox.reference or shafts[0], *shafts]):
        speed = reduced(reduced(kinematics.spin(link), kinematics.pivots), known)
        if speed:  # not determined by those chosen before
            add_pivot(known, speed, next(iter(speed)))
            chosen.append(link)
    return tuple(chosen)


def _page(kinematics: Kinematics, speeds_rpm: Mapping[str, float | Fraction] | None) -> str:
    folder = files("hums.drawing")
    template = page_environment().from_string((folder / "page.html").read_text(encoding="utf-8"))
    data = _data(kinematics, speeds_rpm)
    script = (folder / "page.js").read_text(encoding="utf-8")
    text: str = template.render(
        data=data,
        # "<" is escaped so that no name can end the script
        json=Markup(json.dumps(data, allow_nan=False).replace("<", "\\u003c")),  # noqa: S704
        script=Markup(script),  # noqa: S704  - ours
        head=Markup(page_head(script)),  # noqa: S704  - ours
    )
    return text


def _data(kinematics: Kinematics, speeds_rpm: Mapping[str, float | Fraction] | None) -> dict[str, Any]:
    """Return the data of the page: inputs, rates as linear forms in them, and the drawing."""
    gearbox = kinematics.gearbox
    if gearbox.reference is None:
        raise GearboxError(
            f'gearbox "{gearbox.name}" declares no reference shaft for its orders; add reference = "LINK".'
        )
    links = free_links(kinematics)
    given = dict.fromkeys(links, 0) | {links[0]: START_RPM} if speeds_rpm is None else speeds_rpm
    start = {link: float(rpm) for link, rpm in given.items()}
    if len(start) != kinematics.dof:
        raise ValueError(
            f'gearbox "{gearbox.name}" needs speeds of {kinematics.dof} links, but {len(start)} are given '
            f"({', '.join(start) or 'none'}); give those of {', '.join(links)}, for example."
        )
    at_one = [kinematics.rates({link: Fraction(link == name) for link in start}) for name in start]
    layout = layout_of(gearbox)
    normal = layout.normal
    shapes = asdict(layout)
    for gear in shapes["gears"]:
        gear["e1"], gear["e2"] = transverse_axes(gear["axis"], normal)
    for bearing in shapes["bearings"]:
        bearing["e1"], bearing["e2"] = transverse_axes(bearing["axis"], normal)
        bodies = [kinematics.bodies[bearing[ring]] for ring in ("inner", "outer")]
        carriers = [kinematics.joints[body].carried_by for body in bodies if body in kinematics.joints]
        bearing["carrier"] = next((body for body in carriers if body in bodies), carriers[0])
    for pair in shapes["pairs"]:
        pair["rate"] = [_number(rates[pair["body"]]) for rates in at_one]
    top = max(1.0, *(abs(rpm) for rpm in start.values()))
    return {
        "name": gearbox.name,
        "frame": kinematics.mechanism.frame,
        "reference": gearbox.reference,
        "inputs": [{"link": link, "rpm": rpm, "top": 2 * top} for link, rpm in start.items()],
        "links": [
            {"link": link, "body": body, "declared": gearbox.copy_links.get(link, link)}
            for link, body in kinematics.bodies.items()
        ],
        "referenceForm": [_number(evaluate(kinematics.spin(gearbox.reference), rates)) for rates in at_one],
        "rows": [
            {
                "component": row.component,
                "kind": row.kind,
                "sources": row.sources,
                "seen_from": row.seen_from,
                "factors": [_number(factor) for factor in row.factors],
            }
            for row in rate_forms(kinematics, tuple(start))
        ],
        "drawing": shapes | {"axial": layout.axial, "normal": normal},
    }


def _number(value: Fraction | float) -> str | float:
    """Return a fraction as text such as ``437/4087``, for exact computation in the page, and a float unchanged."""
    return str(value) if isinstance(value, Fraction) else value

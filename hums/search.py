"""Which lines a gearbox can make, and what a spectrum shows at each of them."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from hums.kinematics import Kinematics
from hums.orders import BEARING_KINDS, DefectOrder, defects
from signals.lines import Line, find_line
from signals.spectra import AmplitudeSpectrum

ORDER_SPECTRUM, ENVELOPE = "order_spectrum", "envelope"
TOOTH_KINDS = ("tooth", "planet_tooth")
_SAME_ORDER = 1e-9
# Jitter of a once-per-revolution tachometer spreads a mesh line over half an order on either side; its sidebands are
# weighed against what is that close to them, too.
_CLOSE_ORDERS = 0.25


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """A line to look for.

    `fundamental` lines raise a finding when claimed: the first harmonic of a bearing defect in the envelope, and the
    sidebands of a mesh, `spacing` apart for the turn of one of its gears. All others identify the machine or support
    a finding.
    """

    component: str
    kind: str
    harmonic: int
    sideband: int
    order: float
    tolerance: float
    spectrum: str
    spacing: float = 0.0
    fundamental: bool = False


@dataclass(frozen=True, kw_only=True)
class FoundLine:
    """A line that was looked for in one channel, and what was there."""

    wanted: Wanted
    channel: str
    units: str
    bin_width: float
    line: Line

    @property
    def family(self) -> tuple[str, str]:
        """Component and kind: the lines of one family stand or fall together."""
        return self.wanted.component, self.wanted.kind


@dataclass(frozen=True, kw_only=True)
class SearchPlan:
    """How far the search goes: harmonics and sidebands, and how far lines may lie from nominal (relative)."""

    harmonics: int
    sidebands: int
    slip: float
    speed_tolerance: float
    envelope: bool


def wanted_lines(kinematics: Kinematics, plan: SearchPlan) -> list[Wanted]:
    """List every line to look for: shafts, meshes and their sidebands; teeth and bearings in the envelope.

    A tooth of a planet, or of a gear seen from a carrier, meets the others at a rate that is no shaft's own. In the
    envelope these rates raise nothing: they tell the impacts of a tooth from those of a bearing.
    """
    rows = defects(kinematics)
    lines = [*_shaft_lines(rows, plan), *_mesh_lines(kinematics, rows, plan)]
    if plan.envelope:
        lines += [*_tooth_lines(rows, plan), *_bearing_lines(rows, plan)]
    return [line for line in lines if line.order > 0]


def _shaft_lines(rows: Iterable[DefectOrder], plan: SearchPlan) -> Iterator[Wanted]:
    spectra = (ORDER_SPECTRUM, ENVELOPE) if plan.envelope else (ORDER_SPECTRUM,)
    for row in (row for row in rows if row.kind == "shaft"):
        for spectrum in spectra:
            for harmonic in range(1, plan.harmonics + 1):
                order = harmonic * row.order
                yield Wanted(
                    component=row.component,
                    kind="shaft",
                    harmonic=harmonic,
                    sideband=0,
                    order=order,
                    tolerance=plan.speed_tolerance * order,
                    spectrum=spectrum,
                )


def _mesh_lines(kinematics: Kinematics, rows: Iterable[DefectOrder], plan: SearchPlan) -> Iterator[Wanted]:
    gears = {contact.mesh: contact.gears for contact in kinematics.contacts}
    rows = tuple(rows)
    for row in (row for row in rows if row.kind == "gear_mesh"):
        mesh = row.component
        labels = [tooth.component for tooth in rows if tooth.kind == "tooth" and tooth.component.startswith(f"{mesh}/")]
        spacings = dict(zip(labels, (row.order / abs(number) for _, number in gears[mesh]), strict=True))
        for harmonic in range(1, plan.harmonics + 1):
            centre = harmonic * row.order
            tolerance = plan.speed_tolerance * centre
            yield Wanted(
                component=mesh,
                kind="gear_mesh",
                harmonic=harmonic,
                sideband=0,
                order=centre,
                tolerance=tolerance,
                spectrum=ORDER_SPECTRUM,
            )
            for gear, spacing in spacings.items():
                for sideband in (*range(-plan.sidebands, 0), *range(1, plan.sidebands + 1)):
                    yield Wanted(
                        component=gear,
                        kind="tooth",
                        harmonic=harmonic,
                        sideband=sideband,
                        order=centre + sideband * spacing,
                        tolerance=min(tolerance, spacing / 4),
                        spectrum=ORDER_SPECTRUM,
                        spacing=spacing,
                        fundamental=True,
                    )


def _tooth_lines(rows: Iterable[DefectOrder], plan: SearchPlan) -> Iterator[Wanted]:
    rows = tuple(rows)
    taken = [row.order for row in rows if row.kind == "shaft"]
    for row in (row for row in rows if row.kind in TOOTH_KINDS):
        if any(math.isclose(row.order, order, rel_tol=_SAME_ORDER) for order in taken):
            continue  # what turns about a fixed axis meets once a turn; and a planet's flanks meet sun and ring alike
        taken.append(row.order)
        yield from _envelope_comb(row, plan, relative_tolerance=plan.speed_tolerance, fundamental=False)


def _bearing_lines(rows: Iterable[DefectOrder], plan: SearchPlan) -> Iterator[Wanted]:
    for row in (row for row in rows if row.kind in BEARING_KINDS):
        yield from _envelope_comb(row, plan, relative_tolerance=plan.slip, fundamental=True)


def _envelope_comb(
    row: DefectOrder, plan: SearchPlan, *, relative_tolerance: float, fundamental: bool
) -> Iterator[Wanted]:
    for harmonic in range(1, plan.harmonics + 1):
        order = harmonic * row.order
        yield Wanted(
            component=row.component,
            kind=row.kind,
            harmonic=harmonic,
            sideband=0,
            order=order,
            tolerance=relative_tolerance * order,
            spectrum=ENVELOPE,
            fundamental=fundamental and harmonic == 1,
        )


def envelope_sidebands(found: FoundLine, spacings: Iterable[float]) -> list[Wanted]:
    """Return the first sidebands to look for beside a bearing line that was found, at its found order."""
    return [
        Wanted(
            component=found.wanted.component,
            kind=found.wanted.kind,
            harmonic=found.wanted.harmonic,
            sideband=side,
            order=found.line.found + side * spacing,
            tolerance=0.0,
            spectrum=ENVELOPE,
        )
        for spacing in spacings
        for side in (-1, 1)
        if found.line.found + side * spacing > 0
    ]


def search(
    spectrum: AmplitudeSpectrum, wanted: Iterable[Wanted], *, channel: str, units: str
) -> tuple[list[FoundLine], list[Wanted]]:
    """Look for lines in one spectrum; return what was found and the lines beyond the reach of the record.

    Out of reach are lines past the end of the spectrum and lines with too few bins around them.
    """
    found, beyond = [], []
    for line in wanted:
        try:
            closer = _CLOSE_ORDERS if line.kind == "tooth" and line.spectrum == ORDER_SPECTRUM else None
            result = find_line(spectrum, expected=line.order, tolerance=line.tolerance, closer=closer)
        except ValueError:
            beyond.append(line)
            continue
        found.append(FoundLine(wanted=line, channel=channel, units=units, bin_width=spectrum.bin_width, line=result))
    return found, beyond

"""Expected lines of a gearbox, and their measurement in a spectrum."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

from hums.gearbox.defect_orders import BEARING_KINDS, DefectOrder, defects
from hums.gearbox.kinematics import Kinematics
from signals.spectra.lines import BACKGROUND_WIDTH, Line, find_lines
from signals.spectra.spectra import AmplitudeSpectrum

ORDER_SPECTRUM, ENVELOPE = "order_spectrum", "envelope"
TOOTH_KINDS = ("tooth", "planet_tooth")
LOBE_BINS = 2.0  # half width of the main lobe
_SAME_ORDER = 1e-9
# Jitter of a once-per-revolution tachometer spreads a mesh line over half an order on either side; the background of
# its sidebands is therefore also measured this close to them.
# In an envelope a level that wanders fills the lowest orders: a line there is also compared with what lies within half
# its order.
_CLOSE_ORDERS = 0.25


@dataclass(frozen=True, kw_only=True)
class ExpectedLine:
    """A line that the gearbox can produce: its source, order, search tolerance in orders, and spectrum.

    A significant `fundamental` line raises a finding: the first harmonic of a bearing defect in the envelope, and the
    sidebands of a mesh, whose `spacing` in orders is the rotation of one of its gears. All other lines identify the
    machine or support a finding.
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
class MeasuredLine:
    """An expected line as measured in the spectrum of one channel.

    `level` is the mean of its envelope, 0 in an order spectrum; `searches` the number of bands searched.
    """

    expected: ExpectedLine
    channel: str
    units: str
    bin_width: float
    line: Line
    level: float = 0.0
    searches: int = 1

    @property
    def depth(self) -> float:
        """Modulation depth: amplitude over the mean of the envelope."""
        return self.line.amplitude / self.level if self.level > 0 else 0.0

    @property
    def family(self) -> tuple[str, str]:
        """Component and kind, common to the harmonics and sidebands of one source."""
        return self.expected.component, self.expected.kind


@dataclass(frozen=True, kw_only=True)
class SearchPlan:
    """Number of harmonics and sidebands searched, and largest relative deviations from the nominal order."""

    harmonics: int
    sidebands: int
    slip: float
    speed_tolerance: float
    envelope: bool


@lru_cache(maxsize=8)  # the same ones for every record of a machine
def expected_lines(kinematics: Kinematics, plan: SearchPlan) -> tuple[ExpectedLine, ...]:
    """Return all expected lines: shafts, meshes and sidebands; with an envelope also teeth and bearings.

    The contact rate of a tooth on a planet or relative to a carrier is not a shaft order. Its envelope lines raise no
    finding; they separate the impacts of a tooth from those of a bearing.
    """
    rows = defects(kinematics)
    lines = [*_shaft_lines(rows, plan), *_mesh_lines(kinematics, rows, plan)]
    if plan.envelope:
        lines += [*_tooth_lines(rows, plan), *_bearing_lines(rows, plan)]
    return tuple(line for line in lines if line.order > 0)


def _shaft_lines(rows: Iterable[DefectOrder], plan: SearchPlan) -> Iterator[ExpectedLine]:
    """Yield the harmonics of every shaft."""
    spectra = (ORDER_SPECTRUM, ENVELOPE) if plan.envelope else (ORDER_SPECTRUM,)
    for row in (row for row in rows if row.kind == "shaft"):
        for spectrum in spectra:
            for harmonic in range(1, plan.harmonics + 1):
                order = harmonic * row.order
                yield ExpectedLine(
                    component=row.component,
                    kind="shaft",
                    harmonic=harmonic,
                    sideband=0,
                    order=order,
                    tolerance=plan.speed_tolerance * order,
                    spectrum=spectrum,
                )


def _mesh_lines(kinematics: Kinematics, rows: Iterable[DefectOrder], plan: SearchPlan) -> Iterator[ExpectedLine]:
    """Yield the harmonics of every mesh and their sidebands spaced by the rotation of each gear."""
    gears = {contact.mesh: contact.gears for contact in kinematics.contacts}
    rows = tuple(rows)
    for row in (row for row in rows if row.kind == "gear_mesh"):
        mesh = row.component
        labels = [tooth.component for tooth in rows if tooth.kind == "tooth" and tooth.component.startswith(f"{mesh}/")]
        spacings = dict(zip(labels, (row.order / abs(number) for _, number in gears[mesh]), strict=True))
        for harmonic in range(1, plan.harmonics + 1):
            centre = harmonic * row.order
            tolerance = plan.speed_tolerance * centre
            yield ExpectedLine(
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
                    yield ExpectedLine(
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


def _tooth_lines(rows: Iterable[DefectOrder], plan: SearchPlan) -> Iterator[ExpectedLine]:
    rows = tuple(rows)
    present = [row.order for row in rows if row.kind == "shaft"]
    for row in (row for row in rows if row.kind in TOOTH_KINDS):
        if any(math.isclose(row.order, order, rel_tol=_SAME_ORDER) for order in present):
            continue  # a gear on a fixed axis has its shaft's order; a planet's two flanks have the same order
        present.append(row.order)
        yield from _envelope_harmonics(row, plan, relative_tolerance=plan.speed_tolerance, fundamental=False)


def _bearing_lines(rows: Iterable[DefectOrder], plan: SearchPlan) -> Iterator[ExpectedLine]:
    for row in (row for row in rows if row.kind in BEARING_KINDS):
        yield from _envelope_harmonics(row, plan, relative_tolerance=max(plan.slip, row.tolerance), fundamental=True)


def _envelope_harmonics(
    row: DefectOrder, plan: SearchPlan, *, relative_tolerance: float, fundamental: bool
) -> Iterator[ExpectedLine]:
    """Yield the envelope harmonics of one defect order."""
    for harmonic in range(1, plan.harmonics + 1):
        order = harmonic * row.order
        yield ExpectedLine(
            component=row.component,
            kind=row.kind,
            harmonic=harmonic,
            sideband=0,
            order=order,
            tolerance=relative_tolerance * order,
            spectrum=ENVELOPE,
            fundamental=fundamental and harmonic == 1,
        )


def envelope_sidebands(found: MeasuredLine, spacings: Iterable[float]) -> list[ExpectedLine]:
    """Return the first-order sidebands expected on either side of a measured bearing line."""
    return [
        ExpectedLine(
            component=found.expected.component,
            kind=found.expected.kind,
            harmonic=found.expected.harmonic,
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
    spectrum: AmplitudeSpectrum,
    expected: Iterable[ExpectedLine],
    *,
    channel: str,
    units: str,
    level: float = 0.0,
    searches: int = 1,
    background_width: float = BACKGROUND_WIDTH,
    seen: float = 1.0,
) -> tuple[list[MeasuredLine], list[ExpectedLine]]:
    """Return the lines measured in one spectrum, and the expected ones outside its range.

    The background of a line is measured within `background_width` orders on either side; the leakage of others to it if
    its false-alarm probability is at most `seen`.

    Outside the range are lines above the end of the spectrum, and those with too few bins for a background.
    """
    looked_for, found, out_of_range = list(expected), [], []
    results = find_lines(
        spectrum,
        expected=[line.order for line in looked_for],
        tolerance=[line.tolerance for line in looked_for],
        closer=[_closer(line) for line in looked_for],
        background_width=background_width,
        seen=seen,
    )
    for line, result in zip(looked_for, results, strict=True):
        if isinstance(result, ValueError):
            out_of_range.append(line)
            continue
        measured = MeasuredLine(
            expected=line,
            channel=channel,
            units=units,
            bin_width=spectrum.bin_width,
            line=result,
            level=level,
            searches=searches,
        )
        found.append(measured)
    return found, out_of_range


def _closer(line: ExpectedLine) -> float:
    """Return the orders on either side of the second background measurement, NaN for none."""
    if line.spectrum == ENVELOPE:
        return line.order / 2
    return _CLOSE_ORDERS if line.kind == "tooth" else math.nan


def is_support(line: MeasuredLine) -> bool:
    """Whether a line is a harmonic or sideband of a bearing defect, significant only with its fundamental."""
    return line.expected.kind in BEARING_KINDS and not line.expected.fundamental


def supports(line: MeasuredLine, fundamental: MeasuredLine) -> bool:
    """Whether a harmonic or sideband belongs to a fundamental: same family and channel, at the right spacing."""
    if line.family != fundamental.family or line.channel != fundamental.channel or not fundamental.expected.fundamental:
        return False
    if line.expected.sideband:
        return True  # its order was computed from the measured fundamental
    return abs(line.line.found - line.expected.harmonic * fundamental.line.found) <= (
        line.expected.harmonic * LOBE_BINS * line.bin_width
    )

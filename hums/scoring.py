"""An analysis of a synthetic record against the truth the record carries."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from hums.findings import DIAGNOSED
from hums.layout import Analysis, AnalysisError, group
from hums.search import ORDER_SPECTRUM

if TYPE_CHECKING:
    import pandas as pd

_SAME_ORDER = 1e-6


@dataclass(frozen=True, kw_only=True)
class Score:
    """Truth against estimate.

    Attributes
    ----------
    tracks : one row a tracked order: component, kind, order, true and estimated mean amplitude, their `std`, and
        the RMS of the error of each quadrature over `std`.
    normalised_rms : RMS over all tracks and outputs of the error of each quadrature over its `std`; 1 when the
        stated uncertainty is the real one.
    faults : one row a fault of the scene: component, kind, and the verdict on it. Damage of a shaft and wear show in
        lines that sound machines have, too, and raise no finding: theirs is "measured" where such lines are claimed,
        since only a trend tells more. "missed" where there is nothing.
    false_findings : diagnosed components that have no fault.
    """

    tracks: "pd.DataFrame"
    normalised_rms: float
    faults: "pd.DataFrame"
    false_findings: tuple[str, ...]


def score(analysis: Analysis, record: xr.Dataset) -> Score:
    """Compare an analysis with the `truth_` variables of the record it was made from.

    Raises
    ------
    AnalysisError
        A record without truth, or none of whose true orders was tracked.
    """
    import pandas as pd  # noqa: PLC0415

    if "truth_amplitude" not in record:
        raise AnalysisError("the record carries no truth_amplitude, so there is nothing to score against.")
    tracks = group(analysis, "tracks")
    rows, errors = [], []
    for number in range(tracks.sizes.get("track", 0)):
        track = tracks.isel(track=number)
        truth = _true_amplitude(record, track)
        if truth is None:
            continue
        estimate, std = track["complex_amplitude"].to_numpy(), track["std"].to_numpy()
        error = (estimate - truth) / std
        errors.append(np.concatenate([error.real, error.imag]))
        rows.append(
            {
                "component": track["component"].item(),
                "kind": track["kind"].item(),
                "order": track["track_order"].item(),
                "true_amplitude": float(np.mean(np.abs(truth))),
                "amplitude": float(np.mean(np.abs(estimate))),
                "std": float(np.median(std)),
                "normalised_rms": float(np.sqrt(np.mean(errors[-1] ** 2))),
            }
        )
    if not errors:
        raise AnalysisError("none of the tracked orders is an order of the truth; track mesh or shaft lines.")
    faults, false_findings = _verdicts(analysis, record)
    return Score(
        tracks=pd.DataFrame(rows),
        normalised_rms=float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        faults=pd.DataFrame(faults, columns=["component", "kind", "verdict"]),
        false_findings=false_findings,
    )


def _true_amplitude(record: xr.Dataset, track: xr.Dataset) -> np.ndarray | None:
    """Truth of one tracked order at the times of its outputs, or None where the truth has no such order."""
    truth = record["truth_amplitude"].sel(truth_channel=track["track_channel"].item())
    order = track["track_order"].item()
    near = np.flatnonzero(np.abs(truth["truth_order"].to_numpy() - order) < _SAME_ORDER * max(1.0, order))
    if not near.size:
        return None
    values = truth.isel(truth_order=int(near[0])).to_numpy()
    coarse, fine = record["truth_time"].to_numpy(), track["time_s"].to_numpy()
    return np.asarray(np.interp(fine, coarse, values.real) + 1j * np.interp(fine, coarse, values.imag))


MEASURED, MISSED = "measured", "missed"
# sidebands of a mesh tell of a tooth; what every machine has some of, lines of a shaft and of a mesh, raises no finding
_KIND_OF_FAULT = {
    **dict.fromkeys(
        ("tooth_crack", "chipping", "missing_tooth", "spall", "pitting", "eccentricity", "misalignment"), "tooth"
    ),
    "wear": "gear_mesh",
    **dict.fromkeys(("imbalance", "bent_shaft", "shaft_misalignment"), "shaft"),
}


def _verdicts(analysis: Analysis, record: xr.Dataset) -> tuple[list[tuple[str, str, str]], tuple[str, ...]]:
    found = group(analysis, "findings")
    verdict = {
        (str(component), str(kind)): str(word)
        for component, kind, word in zip(
            *(found[name].to_numpy() for name in ("component", "kind", "verdict")), strict=True
        )
    }
    true = [
        (str(component), _KIND_OF_FAULT.get(str(kind), str(kind)))
        for component, kind in zip(
            record["truth_fault_component"].to_numpy(), record["truth_fault_kind"].to_numpy(), strict=True
        )
    ]
    false = tuple(
        f"{component} {kind}"
        for (component, kind), word in verdict.items()
        if word == DIAGNOSED and (component, kind) not in true
    )
    measured = _measured(analysis)
    words = [verdict.get(fault, MEASURED if fault in measured else MISSED) for fault in true]
    return [(*fault, word) for fault, word in zip(true, words, strict=True)], false


def _measured(analysis: Analysis) -> set[tuple[str, str]]:
    """Return the shafts, and the gears whose mesh, have a claimed line in the order spectrum."""
    lines = group(analysis, ORDER_SPECTRUM)
    rows = list(zip(*(lines[name].to_numpy() for name in ("component", "kind", "claimed")), strict=True))
    claimed = {(str(component), str(kind)) for component, kind, is_claimed in rows if is_claimed}
    gears = {str(component) for component, kind, _ in rows if kind == "tooth"}
    of_mesh = {(gear, "gear_mesh") for gear in gears if (gear.rpartition("/")[0], "gear_mesh") in claimed}
    return of_mesh | {(component, kind) for component, kind in claimed if kind == "shaft"}

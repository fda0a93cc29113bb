"""Scores of the analysis of a synthetic record against its true amplitudes and faults."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from hums.analysis.expected_lines import ORDER_SPECTRUM
from hums.analysis.findings import DIAGNOSED
from hums.analysis.result import Analysis, group
from hums.analysis.settings import AnalysisError
from signals._validation import checked

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class Score:
    """Errors of the amplitude tracks and verdicts on the faults of a synthetic record.

    Attributes
    ----------
    tracks : pandas.DataFrame
        One row per tracked order: component, kind, order, true_amplitude and amplitude (means of the peak amplitude,
        in units of the channel), std (median), and normalised_rms, the RMS of the quadrature errors over `std`.
    normalised_rms : float
        RMS of the quadrature errors over their `std`, over all tracks and outputs; 1 if `std` is correct.
    faults : pandas.DataFrame
        One row per fault of the scene: component, kind, and verdict. Distributed faults raise no finding, since their
        lines also occur in healthy machines: their verdict is ``"measured"`` if these lines are identified. It is
        ``"missed"`` if there is neither a finding nor such a line.
    false_findings : tuple of str
        Diagnosed components that have no fault.

    Examples
    --------
    >>> import pandas as pd
    >>> import hums
    >>> none = pd.DataFrame()
    >>> hums.Score(tracks=none, normalised_rms=1.0, faults=none, false_findings=()).normalised_rms
    1.0
    """

    tracks: "pd.DataFrame"
    normalised_rms: float
    faults: "pd.DataFrame"
    false_findings: tuple[str, ...]


@checked
def score(analysis: Analysis, record: xr.Dataset) -> Score:
    """Return the errors of an analysis against the `truth_` variables of its synthetic record.

    Parameters
    ----------
    analysis : xarray.DataTree
        Result of `analyze` for `record`.
    record : xarray.Dataset
        Synthetic record with ``truth_amplitude`` (truth_channel, truth_order, truth_time), the complex amplitude of
        every true order, and ``truth_fault_component`` and ``truth_fault_kind`` (truth_fault).

    Returns
    -------
    Score
        Errors of the tracks, verdicts on the faults, and false findings.

    Raises
    ------
    AnalysisError
        If the record has no truth, or none of its true orders was tracked.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> times_s = np.arange(8000) / 4000
    >>> tone = 0.5 * np.cos(2 * np.pi * 23 * 20 * times_s)  # 23 teeth at 20 rev/s
    >>> noise = np.random.default_rng(0).normal(0, 0.05, times_s.size)
    >>> pulses = hums.PulseTimes(times_s=np.arange(41) / 20, shaft="input", pulses_per_rev=1)
    >>> record = hums.make_record({"housing": tone + noise}, rate_hz=4000, units="g", angle=pulses)
    >>> analysis = hums.analyze(record, hums.load_gearbox("two-stage"))
    >>> record["truth_amplitude"] = (("truth_channel", "truth_order", "truth_time"), np.full((1, 1, 2), 0.5 + 0j))
    >>> record = record.assign_coords(truth_channel=["housing"], truth_order=[23.0], truth_time=[0.0, 2.0])
    >>> record["truth_fault_component"] = record["truth_fault_kind"] = ("truth_fault", np.array([], dtype=str))
    >>> result = hums.score(analysis, record)
    >>> result.tracks["amplitude"].round(2).tolist(), 0.7 < result.normalised_rms < 1.4
    ([0.5], True)
    """
    import pandas as pd  # noqa: PLC0415

    if "truth_amplitude" not in record:
        raise AnalysisError("the record has no truth_amplitude to score against; use a record of hums synth.")
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
        raise AnalysisError("none of the tracked orders is among the true ones; track mesh or shaft lines.")
    faults, false_findings = _verdicts(analysis, record)
    return Score(
        tracks=pd.DataFrame(rows),
        normalised_rms=float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        faults=pd.DataFrame(faults, columns=["component", "kind", "verdict"]),
        false_findings=false_findings,
    )


def _true_amplitude(record: xr.Dataset, track: xr.Dataset) -> np.ndarray | None:
    """Return the true amplitude of one tracked order at its output times, or None if the truth lacks the order."""
    truth = record["truth_amplitude"].sel(truth_channel=track["track_channel"].item())
    order = track["track_order"].item()
    same_order = 1e-6
    near = np.flatnonzero(np.abs(truth["truth_order"].to_numpy() - order) < same_order * max(1.0, order))
    if not near.size:
        return None
    values = truth.isel(truth_order=int(near[0])).to_numpy()
    coarse, fine = record["truth_time"].to_numpy(), track["time_s"].to_numpy()
    return np.asarray(np.interp(fine, coarse, values.real) + 1j * np.interp(fine, coarse, values.imag))


# Kind of line in which each kind of fault appears. Lines of shafts, meshes and sidebands also occur in healthy machines
# and raise no finding.
_KIND_OF_FAULT = {
    **dict.fromkeys(("tooth_crack", "chipping", "missing_tooth", "spall", "pitting"), "tooth"),
    **dict.fromkeys(("eccentricity", "misalignment"), "sidebands"),
    "wear": "gear_mesh",
    **dict.fromkeys(("imbalance", "bent_shaft", "shaft_misalignment"), "shaft"),
}


def _verdicts(analysis: Analysis, record: xr.Dataset) -> tuple[list[tuple[str, str, str]], tuple[str, ...]]:
    """Return component, kind and verdict of every true fault, and the diagnosed components without a fault."""
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
    words = [verdict.get(fault, "measured" if fault in measured else "missed") for fault in true]
    return [(*fault, word) for fault, word in zip(true, words, strict=True)], false


def _measured(analysis: Analysis) -> set[tuple[str, str]]:
    """Return shafts with an identified line in the order spectrum, and gears with an identified mesh or sideband."""
    lines = group(analysis, ORDER_SPECTRUM)
    rows = list(zip(*(lines[name].to_numpy() for name in ("component", "kind", "claimed")), strict=True))
    claimed = {(str(component), str(kind)) for component, kind, is_claimed in rows if is_claimed}
    gears = {str(component) for component, kind, _ in rows if kind == "tooth"}
    of_mesh = {(gear, "gear_mesh") for gear in gears if (gear.rpartition("/")[0], "gear_mesh") in claimed}
    sidebands = {(component, "sidebands") for component, kind in claimed if kind == "tooth"}
    return of_mesh | sidebands | {(component, kind) for component, kind in claimed if kind == "shaft"}

"""The layout of an analysis: a tree of datasets, checked, written to one file and opened again."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import xarray as xr

from hums.findings import Finding, JudgedLine
from hums.search import ENVELOPE, ORDER_SPECTRUM
from hums.store import open_tree, write_tree
from signals.spectra import AmplitudeSpectrum

if TYPE_CHECKING:
    from numpy.typing import NDArray

Analysis: TypeAlias = xr.DataTree
SCHEMA = "hums-analysis/1"
GROUPS = ("speed", ORDER_SPECTRUM, ENVELOPE, "tracks", "findings")


class AnalysisError(ValueError):
    """A record, gearbox or setting that does not fit an analysis."""


def save_analysis(analysis: Analysis, path: str | Path) -> None:
    """Write an analysis to one HDF5 file, beside and renamed."""
    check_analysis(analysis)
    write_tree(analysis, path)


def open_analysis(path: str | Path) -> Analysis:
    """Open an analysis that `save_analysis` wrote; values are read when used."""
    tree = open_tree(path)
    try:
        check_analysis(tree)
    except AnalysisError as error:
        tree.close()
        raise AnalysisError(f"{path}: {error}") from None
    return tree


def group(analysis: Analysis, name: str) -> xr.Dataset:
    """Return one group of an analysis, such as ``"speed"``, as a dataset."""
    return analysis.children[name].to_dataset(inherit=False)


def check_analysis(tree: Analysis) -> None:
    """Raise AnalysisError unless `tree` has the schema and groups of an analysis."""
    if tree.attrs.get("schema") != SCHEMA:
        raise AnalysisError(
            f'this is not an analysis: its schema is {tree.attrs.get("schema")!r}, not "{SCHEMA}"; make one with '
            "hums.analyze."
        )
    missing = [group for group in GROUPS if group not in tree.children]
    if missing:
        raise AnalysisError(f"this analysis lacks the groups {', '.join(missing)}; make it again with hums.analyze.")


def spectrum_dataset(spectra: Sequence[tuple[str, str, AmplitudeSpectrum]], lines: Sequence[JudgedLine]) -> xr.Dataset:
    """Return the spectra of all channels (name, units, spectrum) on their common axis, and their table of lines."""
    table = _line_table(lines)
    if not spectra:
        return table
    names, units, alike = zip(*spectra, strict=True)
    size = min(spectrum.axis.size for spectrum in alike)
    amplitude = np.stack([spectrum.amplitude[:size] for spectrum in alike])
    return (
        table.assign(amplitude=(("channel", "order"), amplitude, {"long_name": "peak amplitude"}))
        .assign_coords(
            channel=list(names),
            units=("channel", list(units)),
            order=("order", alike[0].axis[:size], {"units": "cycles per revolution of the reference"}),
        )
        .assign_attrs(
            window=alike[0].window,
            bin_width_orders=alike[0].bin_width,
            resolution_orders=alike[0].resolution,
        )
    )


def _line_table(lines: Sequence[JudgedLine]) -> xr.Dataset:
    found, wanted, text = ([line.found.line for line in lines], [line.found.wanted for line in lines], "<U1")
    columns: dict[str, NDArray[Any]] = {
        "component": np.array([w.component for w in wanted], dtype=None if wanted else text),
        "kind": np.array([w.kind for w in wanted], dtype=None if wanted else text),
        "harmonic": np.array([w.harmonic for w in wanted], dtype=np.int64),
        "sideband": np.array([w.sideband for w in wanted], dtype=np.int64),
        "line_channel": np.array([line.found.channel for line in lines], dtype=None if lines else text),
        "line_units": np.array([line.found.units for line in lines], dtype=None if lines else text),
        "line_order": np.array([w.order for w in wanted], dtype=np.float64),
        "order_found": np.array([f.found for f in found], dtype=np.float64),
        "line_amplitude": np.array([f.amplitude for f in found], dtype=np.float64),
        "line_amplitude_std": np.array([f.amplitude_std for f in found], dtype=np.float64),
        "background": np.array([f.background for f in found], dtype=np.float64),
        "snr": np.array([f.snr for f in found], dtype=np.float64),
        "false_alarm_probability": np.array([line.false_alarm_probability for line in lines], dtype=np.float64),
        "claimed": np.array([line.claimed for line in lines], dtype=np.int8),
        "explained_by": np.array([line.explained_by for line in lines], dtype=None if lines else text),
    }
    return xr.Dataset({name: ("line", values) for name, values in columns.items()})


def findings_dataset(found: Sequence[Finding]) -> xr.Dataset:
    """Return the findings, ranked, as one variable a field."""
    text = ("component", "kind", "channel", "verdict", "evidence", "units")
    numbers = ("false_alarm_probability", "snr", "order_found", "amplitude")
    columns: dict[str, NDArray[Any]] = {
        name: np.array([getattr(finding, name) for finding in found], dtype=None if found else "<U1") for name in text
    }
    columns |= {name: np.array([getattr(finding, name) for finding in found], dtype=np.float64) for name in numbers}
    return xr.Dataset({name: ("finding", values) for name, values in columns.items()})

"""Records too long to be held at once: they are analysed in stretches of equal length, which are joined.

- Spectra are averaged by power, onto the orders of the first stretch: linearly between its bins, and as they are where
  the stretches have as many revolutions. Envelopes are averaged over the stretches that chose the commonest band.
- Each row of a table (line, indicator, evidence for a part) is that of the stretch in which it has its median, of an
  even number the lower one; a row that fewer than half of the stretches have is left out. Verdicts are derived from the
  rows so joined: a part is named by what at least half of the stretches show.
- The condition of a sensor is its worst, the part of its samples that is missing the mean. Tracks follow each other.
- The angle of a tachometer or a declared speed is that of the whole record. An estimated speed is estimated for each
  stretch, and its revolutions count anew.

A median of probabilities is one again, but for a factor: at level p, half of the stretches agree by chance in at most
2 p of healthy records whatever the dependence between them [1]_, and far more seldom where they are independent.

References
----------
.. [1] B. Rüger, Das maximale Signifikanzniveau des Tests: Lehne H0 ab, wenn k unter n gegebenen Tests zur Ablehnung
   führen, Metrika 25 (1978), 171-178.
"""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from hums.analysis.findings import Finding, findings
from hums.analysis.lines import ENVELOPE, ORDER_SPECTRUM
from hums.analysis.result import Analysis, group, rows_dataset
from hums.analysis.settings import AnalysisError
from hums.analysis.verdicts import UNLIKE, derive_verdicts
from hums.records.channels import names_of
from hums.records.record import sampling

__all__ = ["LONGEST", "analyse_stretches", "is_long", "joined", "median_rows"]

LONGEST = 4_000_000  # samples of a channel at once: a gigabyte beside the record, two minutes at 33 kHz
_SAME_LINE = 2.0  # bins between the places of one line in two stretches
_BANDS = ("band_low_hz", "band_high_hz")
# of the tables: their dimension, what names a row, and by what its median is taken
_TABLES: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    ORDER_SPECTRUM: ("line", ("line_channel", "component", "kind", "harmonic", "sideband"), ("snr",)),
    ENVELOPE: ("line", ("line_channel", "component", "kind", "harmonic", "sideband"), ("snr",)),
    "indicators": ("row", ("channel", "component", "kind", "indicator"), ("value",)),
    "evidence": ("part", ("channel", "component", "kind"), ("strength", "depth")),
    "gears": ("gear", ("channel", "component"), ("strength",)),
    "shafts": ("shaft", ("channel", "component"), ("level",)),
    "unmeasured": ("part", ("component", "kind"), ()),
}
_WORST = ("ok", "suspect", "sick")


@dataclass
class _MeanSpectra:
    """Mean power of the spectra of each channel, and band where there is one."""

    order: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    power: dict[tuple[Any, ...], NDArray[np.float64]] = field(default_factory=dict)
    count: dict[tuple[Any, ...], int] = field(default_factory=dict)
    about: dict[tuple[Any, ...], dict[str, Any]] = field(default_factory=dict)

    def add(self, spectra: xr.Dataset) -> None:
        """Add the spectra of a stretch."""
        if "amplitude" not in spectra:
            return
        order = spectra["order"].to_numpy()
        self.order = self.order if self.order.size else order
        for channel in spectra["channel"].to_numpy().tolist():
            one = spectra.sel(channel=channel)
            about = {str(name): one[name].item() for name in spectra.coords if spectra[name].dims == ("channel",)}
            key = (channel, *(about[name] for name in _BANDS if name in about))
            power = one["amplitude"].to_numpy() ** 2
            on_grid = power if np.array_equal(order, self.order) else np.interp(self.order, order, power)
            self.power[key] = self.power.get(key, 0.0) + on_grid
            self.count[key] = self.count.get(key, 0) + 1
            self.about.setdefault(key, about)

    def dataset(self) -> xr.Dataset:
        """Return the root mean square of each channel's amplitudes, in the band that most stretches chose."""
        chosen: dict[str, tuple[Any, ...]] = {}
        for key in self.count:
            if key[0] not in chosen or self.count[key] > self.count[chosen[key[0]]]:
                chosen[key[0]] = key
        if not chosen:
            return xr.Dataset()
        rows = [np.sqrt(self.power[key] / self.count[key]) for key in chosen.values()]
        coords = {name: ("channel", [self.about[key][name] for key in chosen.values()]) for name in self.about[key]}
        return xr.Dataset({"amplitude": (("channel", "order"), np.stack(rows))}, coords=coords | {"order": self.order})


def is_long(record: xr.Dataset, names: Sequence[str]) -> bool:
    """Return whether a record has a channel with more samples than are analysed at once."""
    return max((sampling(record, name).count for name in names), default=0) > LONGEST


def analyse_stretches(
    record: xr.Dataset, names: Sequence[str], analyse: Callable[[xr.Dataset, bool], Analysis]
) -> Analysis:
    """Return the joined analysis of a long record.

    Parameters
    ----------
    record : xarray.Dataset
        The record; of one that is open, each stretch is read when it is analysed.
    names : sequence of str
        Channels to analyse.
    analyse : callable
        Returns the analysis of a part of the record; the second argument says whether with pictures, which are those of
        the first stretch.

    Raises
    ------
    AnalysisError
        If no stretch can be analysed.
    """
    analyses: list[Analysis] = []
    starts: list[float] = []
    left_out: list[str] = []
    spectra = {ORDER_SPECTRUM: _MeanSpectra(), ENVELOPE: _MeanSpectra()}
    spans = list(_spans(record, names))
    for start_s, stop_s in spans:
        try:
            found = analyse(_cut(record, start_s, stop_s), not analyses)
        except AnalysisError as error:
            left_out.append(f"From {start_s:.6g} to {stop_s:.6g} s nothing is analysed: {error}")
            continue
        for name, mean in spectra.items():
            own = group(found, name)
            mean.add(own)
            if analyses:  # else they stay in memory, as large as the stretch
                found[name] = xr.DataTree(own.drop_dims("order", errors="ignore"))
        analyses.append(found)
        starts.append(start_s)
    if not analyses:
        raise AnalysisError(left_out[0])
    first, last = spans[0][0], spans[-1][1]
    note = (
        f"The record of {last - first:.6g} s is analysed in {len(spans)} stretches of equal length: spectra are "
        "averaged, rows of tables are those of the median stretch, pictures those of the first."
    )
    return joined(analyses, starts, spectra, [note, *left_out])


def _spans(record: xr.Dataset, names: Sequence[str]) -> Iterator[tuple[float, float]]:
    """Yield start and stop of each stretch in s."""
    whens = [sampling(record, name) for name in names]
    count = max(math.ceil(when.count / LONGEST) for when in whens)
    first, last = min(when.start_s for when in whens), max(when.start_s + when.count / when.rate_hz for when in whens)
    for number in range(count):
        yield first + (last - first) * number / count, first + (last - first) * (number + 1) / count


def _cut(record: xr.Dataset, start_s: float, stop_s: float) -> xr.Dataset:
    """Return what a record has from `start_s` to before `stop_s`, with all pulses of its tachometers."""
    parts = {}
    for name in names_of(record, "vibration", "waveform"):
        when = sampling(record, name)
        ends = (math.ceil(round((moment - when.start_s) * when.rate_hz, 3)) for moment in (start_s, stop_s))
        parts[record[name].dims[0]] = slice(*(min(max(end, 0), when.count) for end in ends))
    return record.isel(parts)


def joined(
    analyses: Sequence[Analysis],
    starts: Sequence[float],
    spectra: dict[str, _MeanSpectra],
    remarks: Sequence[str],
) -> Analysis:
    """Return the analysis of the whole of the analyses of its stretches, which start at `starts` in s."""
    base = analyses[0]
    tree = base.copy()
    for name, (dim, keys, by) in _TABLES.items():
        rows = [group(one, name) for one in analyses]
        table = median_rows(rows, starts, dim=dim, keys=keys, by=by)
        if name in spectra:
            table = table.merge(spectra[name].dataset(), combine_attrs="override")
        tree[name] = xr.DataTree(table.assign_attrs(rows[0].attrs))
    measured = {key for name in ("evidence", "gears") for key in _parts(group(tree, name))}
    kept = [key not in measured for key in _parts(group(tree, "unmeasured"))]
    tree["unmeasured"] = xr.DataTree(group(tree, "unmeasured").isel(part=np.flatnonzero(kept)))
    tree["unexplained"] = xr.DataTree(_unexplained(analyses, starts))
    tree["health"] = xr.DataTree(_health([group(one, "health") for one in analyses]))
    for name in ("tracks", "envelope_tracks"):
        tree[name] = xr.DataTree(_tracks([group(one, name) for one in analyses]))
    speeds = [group(one, "speed") for one in analyses]
    if len(speeds) > 1 and not speeds[0].equals(speeds[1]):
        tree["speed"] = xr.DataTree(_speed(speeds))
    tree.attrs |= _root(analyses, remarks)
    judged = derive_verdicts(tree)
    named = findings(judged)
    tree["findings"] = xr.DataTree(rows_dataset(named, Finding, dim="finding"))
    tree["verdicts"] = xr.DataTree(rows_dataset([one for one in judged if one not in named], Finding, dim="part"))
    return tree


def median_rows(
    tables: Sequence[xr.Dataset], starts: Sequence[float], *, dim: str, keys: Sequence[str], by: Sequence[str]
) -> xr.Dataset:
    """Return of each row that at least half of the tables have the one with its median, the lower of two.

    Parameters
    ----------
    tables : sequence of xarray.Dataset
        Rows along `dim`; what has other dimensions is left out.
    starts : sequence of float
        Start of the stretch of each table in s; written as ``stretch_s`` of the rows taken from it.
    dim : str
    keys : sequence of str
        Columns that name a row.
    by : sequence of str
        Column, and what decides between equals, of which the median is taken; a row without such a number (NaN) is
        taken only where no stretch has one.
    """
    columns = [str(name) for name in tables[0].variables if tables[0][name].dims == (dim,)]
    frames = [
        table[columns].to_dataframe().reset_index(drop=True)[columns].assign(stretch_s=start)
        for table, start in zip(tables, starts, strict=True)
        if set(columns) <= set(map(str, table.variables))
    ]
    every = pd.concat([frame for frame in frames if len(frame)] or frames[:1], ignore_index=True)
    chosen = []
    for _, rows in every.groupby(list(keys), sort=False, dropna=False):
        if 2 * len(rows) < len(tables):
            continue
        finite = rows[rows[by[0]].notna()] if by else rows
        ranked = finite.sort_values(list(by), kind="stable") if len(finite) and by else rows
        chosen.append(ranked.index[(len(ranked) - 1) // 2])
    picked = every.loc[chosen]
    attrs = {name: tables[0][name].attrs for name in columns}
    return xr.Dataset({name: (dim, _column(picked[name]), attrs.get(name, {})) for name in (*columns, "stretch_s")})


def _column(values: "pd.Series[Any]") -> NDArray[Any]:
    """Return a column as an array; words as such, also where there is none."""
    if values.dtype != object and not isinstance(values.dtype, pd.StringDtype):
        return np.asarray(values)
    return np.array([str(value) for value in values], dtype=None if len(values) else "<U1")


def _parts(table: xr.Dataset) -> list[tuple[str, str]]:
    """Return component and kind of each row; of a gear's, which has no kind, its tooth."""
    components = table["component"].to_numpy().tolist()
    kinds = table["kind"].to_numpy().tolist() if "kind" in table else ["tooth"] * len(components)
    return list(zip(components, kinds, strict=True))


def _unexplained(analyses: Sequence[Analysis], starts: Sequence[float]) -> xr.Dataset:
    """Return the unexplained lines that at least half of the stretches have at one place, the largest first."""
    tables = [group(one, "unexplained") for one in analyses]
    width = _SAME_LINE * max(
        float(group(one, ORDER_SPECTRUM).attrs.get("bin_width_orders", math.nan)) for one in analyses
    )
    orders = np.concatenate([table["order"].to_numpy() for table in tables])
    names = np.concatenate([table["channel"].to_numpy().astype(object) for table in tables])
    places = np.zeros(orders.size, dtype=int)
    for name in dict.fromkeys(names.tolist()):
        own = np.flatnonzero(names == name)
        ranked = own[np.argsort(orders[own])]
        places[ranked] = np.concatenate([[0], np.cumsum(np.diff(orders[ranked]) > width)])
    ends = np.cumsum([0, *(table["order"].size for table in tables)])
    placed = [
        table.assign(place=("line", places[a:b])) for table, a, b in zip(tables, ends[:-1], ends[1:], strict=True)
    ]
    found = median_rows(placed, starts, dim="line", keys=("channel", "place"), by=("amplitude",)).drop_vars("place")
    return found.isel(line=np.argsort(-found["amplitude"].to_numpy(), kind="stable"))


def _health(tables: Sequence[xr.Dataset]) -> xr.Dataset:
    """Return the worst condition of each sensor in any stretch, and the mean part of its samples that is missing."""
    every = pd.concat([table.to_dataframe() for table in tables], ignore_index=True)
    every["rank"] = [-_WORST.index(status) for status in every["status"]]
    rows = [rows.sort_values("rank", kind="stable").iloc[0] for _, rows in every.groupby("name", sort=False)]
    missing = every.groupby("name", sort=False)["missing"].mean()
    worst = pd.DataFrame(rows).assign(missing=missing.to_numpy())
    return xr.Dataset({str(name): ("item", _column(worst[name])) for name in tables[0].data_vars})


def _speed(tables: Sequence[xr.Dataset]) -> xr.Dataset:
    """Return the speeds of stretches one after the other; of estimated ones with the worst doubt of any stretch."""
    whole = xr.concat(tables, dim="revolution", combine_attrs="override")
    for name, worst in (("confidence", min), ("phase_std_rev", max)):
        if name in whole.attrs:
            whole.attrs[name] = worst(table.attrs[name] for table in tables)
    return whole


def _tracks(tables: Sequence[xr.Dataset]) -> xr.Dataset:
    """Return the tracks of all stretches one after the other, NaN where a stretch does not follow a line."""
    there = [table for table in tables if "complex_amplitude" in table]
    if not there:
        return xr.Dataset()
    about = [str(name) for name in there[0].coords if there[0][name].dims == ("track",)]
    keys = [name for name in about if name not in {"track_order", "bandwidth_orders", "level", "method"}]
    identity: dict[tuple[Any, ...], dict[str, Any]] = {}
    rows = []
    for table in there:
        own = list(zip(*(table[name].to_numpy().tolist() for name in keys), strict=True))
        rows.append(own)
        for place, key in enumerate(own):
            identity.setdefault(key, {name: table[name].to_numpy()[place] for name in about})
    values: dict[str, Any] = {}
    for name in (str(name) for name in there[0].data_vars):
        parts = []
        for table, own in zip(there, rows, strict=True):
            given = table[name].to_numpy()
            part = np.full((len(identity), given.shape[1]), math.nan, dtype=given.dtype)
            part[[list(identity).index(key) for key in own]] = given
            parts.append(part)
        values[name] = (("track", "output"), np.concatenate(parts, axis=1), there[0][name].attrs)
    along = {
        str(name): ("output", np.concatenate([table[name].to_numpy() for table in there]), there[0][name].attrs)
        for name in there[0].coords
        if there[0][name].dims == ("output",)
    }
    coords = {
        name: ("track", np.array([one[name] for one in identity.values()]), there[0][name].attrs) for name in about
    }
    return xr.Dataset(values, coords=coords | along, attrs=there[0].attrs)


def _root(analyses: Sequence[Analysis], remarks: Sequence[str]) -> dict[str, str]:
    """Return the attributes of the whole: durations add up, notes are those of any stretch."""
    channels: dict[str, dict[str, Any]] = {}
    for one in analyses:
        for channel in json.loads(one.attrs["channels_json"]):
            known = channels.setdefault(channel["name"], channel | {"duration_s": 0.0})
            known["duration_s"] += channel["duration_s"]
    notes = dict.fromkeys(note for one in analyses for note in json.loads(one.attrs["notes_json"]))
    unlike = [reason for one in analyses if (reason := str(one.attrs[UNLIKE]))]
    return {
        "channels_json": json.dumps(list(channels.values())),
        "notes_json": json.dumps([*remarks, *notes]),
        UNLIKE: unlike[0] if 2 * len(unlike) > len(analyses) else "",
    }

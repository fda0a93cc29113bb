"""Variances of earlier records of a machine, to which NA4 and NB4 refer."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

from hums.analysis.result import Analysis, AnalysisError, check_analysis, group
from hums.analysis.settings import AnalysisSettings
from signals.angle.residual import MeshBand, ResidualSignal
from signals.indicators import VarianceHistory

HISTORIES = "histories_json"
Key = tuple[str, str, str]  # channel, component, indicator


@dataclass
class Baseline:
    """Histories of variance by channel, component and indicator, updated while a record is analysed."""

    histories: dict[Key, VarianceHistory]
    limit_std: float | None
    freeze: bool

    def update(self, key: Key, signal: ResidualSignal | MeshBand) -> VarianceHistory:
        """Add this record to a history and return it."""
        history = self.histories.get(key, VarianceHistory(limit_std=self.limit_std))
        if self.freeze and history.records:
            history = history.freeze()
        history = history.update(signal)
        self.histories[key] = history
        return history

    def to_json(self) -> str:
        """Return the histories as JSON, for the attributes of `/indicators`."""
        rows = [
            {"channel": channel, "component": component, "indicator": indicator}
            | {field.name: getattr(history, field.name) for field in fields(history)}
            for (channel, component, indicator), history in sorted(self.histories.items())
        ]
        return json.dumps(rows)


def read_baseline(previous: Analysis | None, settings: AnalysisSettings, *, units: Mapping[str, str]) -> Baseline:
    """Return the histories in the analysis of the previous record, or empty ones.

    Parameters
    ----------
    previous : xarray.DataTree, optional
        Analysis of the previous record; it holds the variances of all earlier records.
    settings : AnalysisSettings
        Settings of the analysis, of which the limit and the freezing of the baseline are used.
    units : mapping of str to str
        Units of the channels of the record to analyse, in which the histories must be.

    Raises
    ------
    AnalysisError
        If `previous` is not an analysis or has other units, or there is no baseline to freeze.
    """
    limit = settings.baseline_limit_std
    if previous is None:
        if settings.freeze_baseline:
            raise AnalysisError(
                "freeze_baseline is set, but there is no baseline to freeze; pass baseline=, the analysis of the last "
                "record of the sound machine (on the command line --baseline analysis.h5)."
            )
        return Baseline(histories={}, limit_std=limit, freeze=False)
    check_analysis(previous)
    channels = json.loads(previous.attrs["channels_json"])
    for channel in channels:
        now = units.get(channel["name"], channel["units"])
        if now != channel["units"]:
            raise AnalysisError(
                f'baseline: channel "{channel["name"]}" was in {channel["units"]} and is in {now} now; variances of '
                "other units are no baseline."
            )
    histories = {}
    for row in json.loads(group(previous, "indicators").attrs[HISTORIES]):
        key = (row.pop("channel"), row.pop("component"), row.pop("indicator"))
        history = VarianceHistory(**row)
        histories[key] = history if limit is None else replace(history, limit_std=limit)
    return Baseline(histories=histories, limit_std=limit, freeze=settings.freeze_baseline)

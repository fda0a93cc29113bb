"""What earlier records of a machine were like: the variances that NA4 and NB4 are held against."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

from hums.layout import Analysis, AnalysisError, check_analysis, group
from hums.settings import AnalysisSettings
from signals.indicators import VarianceHistory
from signals.residues import MeshBand, ResidualSignal

HISTORIES = "histories_json"
Key = tuple[str, str, str]  # channel, component, indicator


@dataclass
class Baseline:
    """The histories by channel, component and indicator, brought up to date as a record is analysed."""

    histories: dict[Key, VarianceHistory]
    limit_std: float | None
    freeze: bool

    def updated(self, key: Key, signal: ResidualSignal | MeshBand) -> VarianceHistory:
        """Return the history with this record in it, and keep it for the next one."""
        history = self.histories.get(key, VarianceHistory(limit_std=self.limit_std))
        if self.freeze and history.records:
            history = history.freeze()
        history = history.update(signal)
        self.histories[key] = history
        return history

    def to_json(self) -> str:
        """Return the histories as text, for the attributes of `/indicators`."""
        rows = [
            {"channel": channel, "component": component, "indicator": indicator}
            | {field.name: getattr(history, field.name) for field in fields(history)}
            for (channel, component, indicator), history in sorted(self.histories.items())
        ]
        return json.dumps(rows)


def baseline_of(previous: Analysis | None, settings: AnalysisSettings, *, units: Mapping[str, str]) -> Baseline:
    """Return what the analysis of the record before left, or an empty start.

    Parameters
    ----------
    previous : Analysis, optional
        Of the record before, of the same gearbox; it carries the state of all before it.
    settings : AnalysisSettings
    units : mapping of channel to units
        Of the record to analyse: variances in other units are no baseline.

    Raises
    ------
    AnalysisError
        A baseline that is no analysis, of other units, or none to freeze.
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

"""Gearboxes, accelerometer records and findings: labelled data above the arrays of `signals`."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hums.analysis.record_analysis import AnalysisSettings as AnalysisSettings
    from hums.analysis.record_analysis import analyze as analyze
    from hums.analysis.result import Analysis as Analysis
    from hums.analysis.result import findings_table as findings_table
    from hums.analysis.result import health_table as health_table
    from hums.analysis.result import indicator_table as indicator_table
    from hums.analysis.result import line_table as line_table
    from hums.analysis.result import open_analysis as open_analysis
    from hums.analysis.result import save_analysis as save_analysis
    from hums.analysis.result import summary as summary
    from hums.analysis.result import unexplained_table as unexplained_table
    from hums.analysis.result import verdict_table as verdict_table
    from hums.analysis.settings import AnalysisError as AnalysisError
    from hums.analysis.verdicts import derive_verdicts as derive_verdicts
    from hums.fleet.fleet_analysis import Fleet as Fleet
    from hums.fleet.fleet_analysis import FleetError as FleetError
    from hums.fleet.fleet_analysis import analyze_fleet as analyze_fleet
    from hums.fleet.maintenance import MaintenanceError as MaintenanceError
    from hums.fleet.maintenance import Work as Work
    from hums.fleet.maintenance import read_maintenance as read_maintenance
    from hums.fleet.monitor import Judgement as Judgement
    from hums.fleet.monitor_settings import MonitorError as MonitorError
    from hums.fleet.monitor_settings import MonitorSettings as MonitorSettings
    from hums.fleet.watch import watch as watch
    from hums.gearbox.adjacency import from_adjacency_table as from_adjacency_table
    from hums.gearbox.defect_orders import defect_orders as defect_orders
    from hums.gearbox.kinematics import Kinematics as Kinematics
    from hums.gearbox.kinematics import solve_kinematics as solve_kinematics
    from hums.gearbox.model import Gearbox as Gearbox
    from hums.gearbox.model import GearboxError as GearboxError
    from hums.gearbox.model import GearboxWarning as GearboxWarning
    from hums.gearbox.model import load_gearbox as load_gearbox
    from hums.gearbox.order_families import collisions as collisions
    from hums.gearbox.order_families import order_families as order_families
    from hums.gearbox.torques import TorqueError as TorqueError
    from hums.gearbox.torques import Torques as Torques
    from hums.gearbox.torques import solve_torques as solve_torques
    from hums.jobs import Cluster as Cluster
    from hums.jobs import JobError as JobError
    from hums.jobs import Processes as Processes
    from hums.jobs import Serial as Serial
    from hums.readers import convert as convert
    from hums.readers.description import ImportDescription as ImportDescription
    from hums.records.calibration import calibrated as calibrated
    from hums.records.dataset_store import dataset_record as dataset_record
    from hums.records.dataset_store import open_dataset as open_dataset
    from hums.records.quantities import AngularAverage as AngularAverage
    from hums.records.quantities import Measured as Measured
    from hums.records.record import Channel as Channel
    from hums.records.record import NominalSpeed as NominalSpeed
    from hums.records.record import PulseTimes as PulseTimes
    from hums.records.record import RecordError as RecordError
    from hums.records.record import TachometerWaveform as TachometerWaveform
    from hums.records.record import UnknownAngle as UnknownAngle
    from hums.records.record import make_record as make_record
    from hums.records.snapshots import join_snapshots as join_snapshots
    from hums.records.snapshots import snapshot_record as snapshot_record
    from hums.records.store import open_record as open_record
    from hums.records.store import save_record as save_record
    from hums.report import write_report as write_report
    from hums.scoring import Score as Score
    from hums.scoring import score as score

_NAMES = {
    "hums.analysis.record_analysis": "AnalysisSettings analyze",
    "hums.analysis.result": "Analysis findings_table health_table indicator_table line_table open_analysis "
    "save_analysis summary unexplained_table verdict_table",
    "hums.analysis.settings": "AnalysisError",
    "hums.analysis.verdicts": "derive_verdicts",
    "hums.fleet.fleet_analysis": "Fleet FleetError analyze_fleet",
    "hums.fleet.maintenance": "MaintenanceError Work read_maintenance",
    "hums.fleet.monitor": "Judgement",
    "hums.fleet.monitor_settings": "MonitorError MonitorSettings",
    "hums.fleet.watch": "watch",
    "hums.gearbox.adjacency": "from_adjacency_table",
    "hums.gearbox.kinematics": "Kinematics solve_kinematics",
    "hums.gearbox.model": "Gearbox GearboxError GearboxWarning load_gearbox",
    "hums.gearbox.order_families": "collisions order_families",
    "hums.gearbox.defect_orders": "defect_orders",
    "hums.gearbox.torques": "TorqueError Torques solve_torques",
    "hums.jobs": "Cluster JobError Processes Serial",
    "hums.readers": "convert",
    "hums.readers.description": "ImportDescription",
    "hums.records.calibration": "calibrated",
    "hums.records.dataset_store": "dataset_record open_dataset",
    "hums.records.quantities": "AngularAverage Measured",
    "hums.records.record": "Channel NominalSpeed PulseTimes RecordError TachometerWaveform UnknownAngle make_record",
    "hums.records.snapshots": "join_snapshots snapshot_record",
    "hums.records.store": "open_record save_record",
    "hums.report": "write_report",
    "hums.scoring": "Score score",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'hums' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]

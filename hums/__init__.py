"""Gearboxes, accelerometer records and findings: labelled data above the arrays of `signals`."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hums.adjacency import from_adjacency_table as from_adjacency_table
    from hums.analysis import AnalysisSettings as AnalysisSettings
    from hums.analysis import analyze as analyze
    from hums.calibration import calibrated as calibrated
    from hums.families import collisions as collisions
    from hums.families import order_families as order_families
    from hums.fleet import Fleet as Fleet
    from hums.fleet import FleetError as FleetError
    from hums.fleet import analyze_fleet as analyze_fleet
    from hums.gearbox import Gearbox as Gearbox
    from hums.gearbox import GearboxError as GearboxError
    from hums.gearbox import GearboxWarning as GearboxWarning
    from hums.gearbox import load_gearbox as load_gearbox
    from hums.jobs import Cluster as Cluster
    from hums.jobs import JobError as JobError
    from hums.jobs import Processes as Processes
    from hums.jobs import Serial as Serial
    from hums.kinematics import Kinematics as Kinematics
    from hums.kinematics import solve_kinematics as solve_kinematics
    from hums.layout import Analysis as Analysis
    from hums.layout import AnalysisError as AnalysisError
    from hums.layout import open_analysis as open_analysis
    from hums.layout import save_analysis as save_analysis
    from hums.orders import defect_orders as defect_orders
    from hums.readers import convert as convert
    from hums.record import Channel as Channel
    from hums.record import NominalSpeed as NominalSpeed
    from hums.record import PulseTimes as PulseTimes
    from hums.record import RecordError as RecordError
    from hums.record import TachometerWaveform as TachometerWaveform
    from hums.record import UnknownAngle as UnknownAngle
    from hums.record import make_record as make_record
    from hums.report import write_report as write_report
    from hums.scoring import Score as Score
    from hums.scoring import score as score
    from hums.shards import dataset_record as dataset_record
    from hums.shards import open_dataset as open_dataset
    from hums.store import open_record as open_record
    from hums.store import save_record as save_record
    from hums.tables import findings_table as findings_table
    from hums.tables import health_table as health_table
    from hums.tables import indicator_table as indicator_table
    from hums.tables import line_table as line_table
    from hums.tables import summary as summary
    from hums.torques import TorqueError as TorqueError
    from hums.torques import Torques as Torques
    from hums.torques import solve_torques as solve_torques

_HOME = {
    "Analysis": "hums.layout",
    "AnalysisError": "hums.layout",
    "AnalysisSettings": "hums.analysis",
    "Channel": "hums.record",
    "Cluster": "hums.jobs",
    "Fleet": "hums.fleet",
    "FleetError": "hums.fleet",
    "Gearbox": "hums.gearbox",
    "GearboxError": "hums.gearbox",
    "GearboxWarning": "hums.gearbox",
    "JobError": "hums.jobs",
    "Kinematics": "hums.kinematics",
    "NominalSpeed": "hums.record",
    "PulseTimes": "hums.record",
    "Processes": "hums.jobs",
    "RecordError": "hums.record",
    "Score": "hums.scoring",
    "Serial": "hums.jobs",
    "TachometerWaveform": "hums.record",
    "TorqueError": "hums.torques",
    "Torques": "hums.torques",
    "UnknownAngle": "hums.record",
    "analyze": "hums.analysis",
    "analyze_fleet": "hums.fleet",
    "calibrated": "hums.calibration",
    "collisions": "hums.families",
    "convert": "hums.readers",
    "dataset_record": "hums.shards",
    "defect_orders": "hums.orders",
    "findings_table": "hums.tables",
    "from_adjacency_table": "hums.adjacency",
    "health_table": "hums.tables",
    "indicator_table": "hums.tables",
    "line_table": "hums.tables",
    "load_gearbox": "hums.gearbox",
    "make_record": "hums.record",
    "open_analysis": "hums.layout",
    "open_dataset": "hums.shards",
    "open_record": "hums.store",
    "order_families": "hums.families",
    "save_analysis": "hums.layout",
    "save_record": "hums.store",
    "score": "hums.scoring",
    "solve_kinematics": "hums.kinematics",
    "solve_torques": "hums.torques",
    "summary": "hums.tables",
    "write_report": "hums.report",
}
__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'hums' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_HOME]

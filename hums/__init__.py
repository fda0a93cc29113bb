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
    from hums.gearbox import Gearbox as Gearbox
    from hums.gearbox import GearboxError as GearboxError
    from hums.gearbox import GearboxWarning as GearboxWarning
    from hums.gearbox import load_gearbox as load_gearbox
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
    from hums.record import make_record as make_record
    from hums.report import write_report as write_report
    from hums.scoring import Score as Score
    from hums.scoring import score as score
    from hums.store import open_record as open_record
    from hums.store import save_record as save_record
    from hums.tables import findings_table as findings_table
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
    "Gearbox": "hums.gearbox",
    "GearboxError": "hums.gearbox",
    "GearboxWarning": "hums.gearbox",
    "Kinematics": "hums.kinematics",
    "NominalSpeed": "hums.record",
    "PulseTimes": "hums.record",
    "RecordError": "hums.record",
    "Score": "hums.scoring",
    "TachometerWaveform": "hums.record",
    "TorqueError": "hums.torques",
    "Torques": "hums.torques",
    "analyze": "hums.analysis",
    "calibrated": "hums.calibration",
    "collisions": "hums.families",
    "convert": "hums.readers",
    "defect_orders": "hums.orders",
    "findings_table": "hums.tables",
    "from_adjacency_table": "hums.adjacency",
    "line_table": "hums.tables",
    "load_gearbox": "hums.gearbox",
    "make_record": "hums.record",
    "open_analysis": "hums.layout",
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

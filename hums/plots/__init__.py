"""Figures: functions that draw on given matplotlib Axes, and functions that write a figure as SVG text or a file."""

from hums.plots.analysis import plot_spectrum, plot_speed, plot_tracks
from hums.plots.dynamics_figures import (
    plot_campbell,
    plot_mode_shape,
    plot_stability_map,
)
from hums.plots.export import save_figure, svg
from hums.plots.graph import mechanism_graph
from hums.plots.mechanism_drawing import coloured_components, draw_mechanism
from hums.plots.speed_chart import speed_order_chart
from hums.plots.style import KIND_COLOURS
from hums.plots.velocities import velocity_diagram

__all__ = [
    "KIND_COLOURS",
    "coloured_components",
    "draw_mechanism",
    "mechanism_graph",
    "plot_campbell",
    "plot_mode_shape",
    "plot_spectrum",
    "plot_speed",
    "plot_stability_map",
    "plot_tracks",
    "save_figure",
    "speed_order_chart",
    "svg",
    "velocity_diagram",
]

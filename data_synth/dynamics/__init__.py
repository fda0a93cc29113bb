"""Gear dynamics: a gearbox as equations of motion, with their modes, stability, steady states and time integrators.

`assemble` turns a declared gearbox with its masses and stiffnesses into M, C, G and K(phase); `build_system` builds any
other system from bodies and elements. `solve_modes` and `campbell` give natural frequencies, `floquet` and
`stability_map` parametric stability, `periodic_state` the steady state, and `integrate` the response over time.
`docs/dynamics.md` is a guided tour.
"""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)

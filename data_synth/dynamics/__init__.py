"""Gear dynamics: a gearbox as equations of motion, with their modes, stability, steady states and time integrators.

The drawing and its masses and stiffnesses become M, C, G and K(phase) by `assemble`; systems that are no gearbox are
built from bodies and elements by `build_system`. `solve_modes` and `campbell` give natural frequencies, `floquet` and
`stability_map` parametric stability, `periodic_state` the steady response, and `integrate` the response over time.
`docs/dynamics.md` walks through all of it.
"""

from signals._lazy import exports

__getattr__, __dir__, __all__ = exports(__name__)

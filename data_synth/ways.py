"""Transfer paths that a scene declares from sources to sensors, in the units of the sensors."""

import math

import numpy as np

from data_synth.frf import ModeOfPath, Transfer
from data_synth.path import ringing_time_s
from data_synth.scene import Scene
from data_synth.transfer import MeasuredPath, ModalPath

_STANDARD_GRAVITY = 9.80665
TransferPath = ModalPath | MeasuredPath
TransferPaths = dict[tuple[str, str], TransferPath]


def transfer_paths(scene: Scene) -> TransferPaths:
    """Return the declared paths by source and sensor: response, in the units of the sensors' motion, for one N."""
    return {(item.source, item.sensor): _transfer_path(item, scene.sensors[0].units) for item in scene.transfers}


def longest_ringing_s(scene: Scene, source: str) -> float:
    """Return the time after an impact at a source at which its response has decayed in every channel."""
    ringing = [path.ringing_time_s() for (of, _), path in transfer_paths(scene).items() if of == source]
    return max([ringing_time_s(scene.resonance), *ringing])


def _transfer_path(transfer: Transfer, units: str) -> TransferPath:
    """Return a declared path in the units of the sensors."""
    one = {("m s-2", "g"): 1 / _STANDARD_GRAVITY, ("g", "m s-2"): _STANDARD_GRAVITY}
    factor = one.get((transfer.units, units), 1.0)
    if transfer.lines is not None:
        hz, real, imaginary = np.array(transfer.lines).T
        return MeasuredPath(frequencies_hz=hz, values=factor * (real + 1j * imaginary))
    modes = transfer.modes or ()
    return ModalPath(
        frequencies_hz=np.array([mode.frequency_hz for mode in modes]),
        damping_ratios=np.array([mode.damping_ratio for mode in modes]),
        residues=factor * np.array([_residue(mode) for mode in modes], dtype=np.complex128),
    )


def _residue(mode: ModeOfPath) -> complex:
    """Return the residue of a mode, from ``gain w_n^2 / (w_n^2 - w^2 + 2 j zeta w_n w)`` where its gain is declared."""
    if mode.residue is not None:
        return complex(*mode.residue)
    # of gain w_n^2 / (w_n^2 - w^2 + 2 j zeta w_n w)
    natural = 2 * math.pi * mode.frequency_hz
    return -0.5j * (mode.gain or 0.0) * natural / math.sqrt(1 - mode.damping_ratio**2)

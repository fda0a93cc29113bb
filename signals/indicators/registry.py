"""Table of all indicators: arguments, unit, source and the faults that raise each of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from signals.angle.averaging import SynchronousAverage
from signals.angle.residual import DifferenceSignal, MeshBand, RegularSignal, ResidualSignal
from signals.indicators import bearing, gear, mesh, planet, shaft, statistics
from signals.spectra.spectra import AmplitudeSpectrum

Part = Literal["channel", "shaft", "gear", "bearing", "planetary"]


@dataclass(frozen=True, kw_only=True)
class Indicator:
    """A condition indicator with its arguments, unit and source; calling it computes it.

    Attributes
    ----------
    name : str
        Its key in `INDICATORS`.
    part : str
        The part it monitors: "channel", "shaft", "gear", "bearing" or "planetary".
    takes : tuple of type
        Types of the signals it takes, in order; `numpy.ndarray` is the raw signal.
    needs : tuple of str
        Its keyword arguments.
    unit : str
        "signal": the unit of the record; "1": dimensionless; else the unit itself.
    source : str
        Author and year of its definition.
    raised_by : str
        Faults that make it rise.
    function : callable
        Returns a float, or, for a bearing, a `DefectEnergy`.

    Examples
    --------
    >>> from signals.indicators import INDICATORS
    >>> indicator = INDICATORS["crest_factor"]
    >>> indicator.part, indicator.unit, indicator([1.0, -1.0, 1.0, -1.0])
    ('channel', '1', 1.0)
    """

    name: str
    part: Part
    takes: tuple[type, ...]
    needs: tuple[str, ...]
    unit: str
    source: str
    raised_by: str
    function: Callable[..., Any]

    def __call__(self, *signals: object, **settings: object) -> Any:  # noqa: ANN401
        """Compute the indicator from signals as in `takes` and keyword arguments as in `needs`."""
        return self.function(*signals, **settings)


_RAW: tuple[type, ...] = (np.ndarray,)
_AVERAGE, _BAND = (SynchronousAverage,), (MeshBand,)
_DIFFERENCE, _RESIDUAL = (DifferenceSignal,), (ResidualSignal,)
_BECHHOEFER = "Bechhoefer & Kingsley 2009"
_VECER = "Večeř, Kreidl & Šmíd 2005"
_CARRIER = ("ring_teeth", "planets", "harmonic", "sidebands")
_DEFECT = ("order", "harmonics", "tolerance", "background_width")

_ROWS: tuple[tuple[str, Part, tuple[type, ...], tuple[str, ...], str, str, str, Callable[..., Any]], ...] = (
    ("rms", "channel", _RAW, (), "signal", "the baseline of all", "any louder machine, also more load", statistics.rms),
    ("peak", "channel", _RAW, (), "signal", "the baseline of all", "impacts", statistics.peak),
    ("crest_factor", "channel", _RAW, (), "1", "Lebold et al. 2000", "early, rare impacts", statistics.crest_factor),
    ("kurtosis", "channel", _RAW, (), "1", "Dyer & Stewart 1978", "impacts, until they overlap", statistics.kurtosis),
    ("so1", "shaft", _AVERAGE, (), "signal", _VECER, "unbalance, a bent shaft", shaft.so1),
    ("so2", "shaft", _AVERAGE, (), "signal", _VECER, "misalignment, a coupling", shaft.so2),
    ("so3", "shaft", _AVERAGE, (), "signal", _VECER, "misalignment, a coupling", shaft.so3),
    ("fm0", "gear", _AVERAGE, ("teeth", "harmonics"), "1", "Stewart 1977", "broken teeth, heavy wear", gear.fm0),
    ("fm4", "gear", _DIFFERENCE, (), "1", "Stewart 1977", "damage to one or two teeth", gear.fm4),
    ("m6a", "gear", _DIFFERENCE, (), "1", "Martin 1989", "as FM4, more sharply", gear.m6a),
    ("m8a", "gear", _DIFFERENCE, (), "1", "Martin 1989", "as FM4, more sharply still", gear.m8a),
    ("na4", "gear", _RESIDUAL, ("history",), "1", "Zakrajsek et al. 1993", "damage, also spreading", gear.na4),
    ("nb4", "gear", _BAND, ("history",), "1", "Zakrajsek et al. 1994", "damage of few teeth", mesh.nb4),
    (
        "energy_ratio",
        "gear",
        (DifferenceSignal, RegularSignal),
        (),
        "1",
        "Swansson 1980",
        "heavy, even wear",
        gear.energy_ratio,
    ),
    ("energy_operator", "gear", _RESIDUAL, (), "1", "Ma 1995", "short impacts of one tooth", gear.energy_operator),
    ("sideband_index", "gear", _AVERAGE, ("teeth",), "signal", _VECER, "eccentricity", gear.sideband_index),
    (
        "sideband_level_factor",
        "gear",
        _AVERAGE,
        ("teeth",),
        "1",
        "Lebold et al. 2000",
        "a bent shaft, misalignment",
        gear.sideband_level_factor,
    ),
    ("narrowband_kurtosis", "gear", _BAND, (), "1", _BECHHOEFER, "one bad tooth", mesh.narrowband_kurtosis),
    (
        "amplitude_modulation",
        "gear",
        _BAND,
        (),
        "1",
        "McFadden 1986",
        "eccentricity, cracks",
        mesh.amplitude_modulation,
    ),
    ("phase_modulation", "gear", _BAND, (), "rad", "McFadden 1986", "cracks, pitch errors", mesh.phase_modulation),
    ("frequency_modulation", "gear", _BAND, (), "1", "McFadden 1986", "cracks", mesh.frequency_modulation),
    (
        "amplitude_modulation_kurtosis",
        "gear",
        _BAND,
        (),
        "1",
        _BECHHOEFER,
        "one bad tooth",
        mesh.amplitude_modulation_kurtosis,
    ),
    (
        "frequency_modulation_kurtosis",
        "gear",
        _BAND,
        (),
        "1",
        _BECHHOEFER,
        "one cracked tooth",
        mesh.frequency_modulation_kurtosis,
    ),
    (
        "defect_energy",
        "bearing",
        (AmplitudeSpectrum,),
        _DEFECT,
        "the spectrum's, squared",
        "McFadden & Smith 1984; Randall & Antoni 2011",
        "a spall on the race or element of that order",
        bearing.defect_energy,
    ),
    (
        "carrier_sideband_ratio",
        "planetary",
        _AVERAGE,
        _CARRIER,
        "1",
        "McFadden & Smith 1985; Keller & Grabill 2003",
        "a cracked carrier, one bad planet",
        planet.carrier_sideband_ratio,
    ),
)

INDICATORS: Mapping[str, Indicator] = MappingProxyType(
    {
        name: Indicator(
            name=name,
            part=part,
            takes=takes,
            needs=needs,
            unit=unit,
            source=source,
            raised_by=raised_by,
            function=function,
        )
        for name, part, takes, needs, unit, source, raised_by, function in _ROWS
    }
)
"""Every indicator by name."""

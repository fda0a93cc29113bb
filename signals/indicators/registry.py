"""Table of all indicators: arguments, unit, source and the faults that increase each of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from inspect import signature
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from signals.indicators import bearing, gear, mesh, statistics

Part = Literal["channel", "shaft", "gear", "bearing", "planetary"]


@dataclass(frozen=True, kw_only=True)
class Indicator:
    """A condition indicator with its arguments, unit and source; calling it evaluates it.

    Attributes
    ----------
    name : str
        Its key in `INDICATORS`.
    part : str
        Component it monitors: "channel", "shaft", "gear", "bearing" or "planetary".
    takes : tuple of type
        Types of the signals it takes, in order; `numpy.ndarray` is the raw signal.
    needs : tuple of str
        Its keyword arguments.
    unit : str
        "signal" for the unit of the record, "1" if dimensionless, otherwise the unit itself.
    source : str
        Author and year of its definition.
    raised_by : str
        Faults that increase it.
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


def _indicator(part: Part, function: Callable[..., Any], unit: str, source: str, raised_by: str) -> Indicator:
    """Return an indicator with name, signals and keyword arguments from the signature of its function."""
    parameters = signature(function).parameters.values()
    signals = [one.annotation for one in parameters if one.kind is not one.KEYWORD_ONLY]
    return Indicator(
        name=function.__name__,
        part=part,
        takes=tuple(kind if isinstance(kind, type) else np.ndarray for kind in signals),
        needs=tuple(one.name for one in parameters if one.kind is one.KEYWORD_ONLY),
        unit=unit,
        source=source,
        raised_by=raised_by,
        function=function,
    )


INDICATORS: Mapping[str, Indicator] = MappingProxyType(
    {
        indicator.name: indicator
        for indicator in (
            _indicator(
                "channel", statistics.rms, "signal", "reference for all others", "higher vibration, also from load"
            ),
            _indicator("channel", statistics.peak, "signal", "reference for all others", "impacts"),
            _indicator("channel", statistics.crest_factor, "1", "Lebold et al. 2000", "early, rare impacts"),
            _indicator("channel", statistics.kurtosis, "1", "Dyer & Stewart 1978", "impacts, until they overlap"),
            _indicator("shaft", gear.so1, "signal", "Večeř, Kreidl & Šmíd 2005", "unbalance, a bent shaft"),
            _indicator("shaft", gear.so2, "signal", "Večeř, Kreidl & Šmíd 2005", "misalignment, a coupling"),
            _indicator("shaft", gear.so3, "signal", "Večeř, Kreidl & Šmíd 2005", "misalignment, a coupling"),
            _indicator("gear", gear.fm0, "1", "Stewart 1977", "broken teeth, heavy wear"),
            _indicator("gear", gear.fm4, "1", "Stewart 1977", "damage to one or two teeth"),
            _indicator("gear", gear.m6a, "1", "Martin 1989", "as FM4, more sharply"),
            _indicator("gear", gear.m8a, "1", "Martin 1989", "as FM4, more sharply still"),
            _indicator("gear", gear.na4, "1", "Zakrajsek et al. 1993", "damage, including spreading damage"),
            _indicator("gear", mesh.nb4, "1", "Zakrajsek et al. 1994", "damage to a few teeth"),
            _indicator("gear", gear.energy_ratio, "1", "Swansson 1980", "heavy, uniform wear"),
            _indicator("gear", gear.energy_operator, "1", "Ma 1995", "short impacts of one tooth"),
            _indicator("gear", gear.sideband_index, "signal", "Večeř, Kreidl & Šmíd 2005", "eccentricity"),
            _indicator("gear", gear.sideband_level_factor, "1", "Lebold et al. 2000", "a bent shaft, misalignment"),
            _indicator("gear", mesh.narrowband_kurtosis, "1", "Bechhoefer & Kingsley 2009", "tooth damage"),
            _indicator("gear", mesh.amplitude_modulation, "1", "McFadden 1986", "eccentricity, cracks"),
            _indicator("gear", mesh.phase_modulation, "rad", "McFadden 1986", "cracks, pitch errors"),
            _indicator("gear", mesh.frequency_modulation, "1", "McFadden 1986", "cracks"),
            _indicator("gear", mesh.amplitude_modulation_kurtosis, "1", "Bechhoefer & Kingsley 2009", "tooth damage"),
            _indicator(
                "gear", mesh.frequency_modulation_kurtosis, "1", "Bechhoefer & Kingsley 2009", "one cracked tooth"
            ),
            _indicator(
                "bearing",
                bearing.defect_energy,
                "unit of the spectrum squared",
                "McFadden & Smith 1984; Randall & Antoni 2011",
                "a spall on the race or rolling element of that order",
            ),
            _indicator(
                "planetary",
                gear.carrier_sideband_ratio,
                "1",
                "McFadden & Smith 1985; Keller & Grabill 2003",
                "a cracked carrier, one damaged planet",
            ),
        )
    }
)
"""All indicators by name."""

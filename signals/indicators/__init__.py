"""Condition indicators: each a function of the one signal it is defined on, with its source.

The raw signal is an array; averages and signals cut out of them have types of their own, so an indicator refuses a
signal it is not defined on. `INDICATORS` lists all of them. NA4 and NB4 are normalised with the mean variance of
earlier records, a `VarianceHistory`: immutable, an update returns a new one.
"""

from signals.indicators.bearing import DefectEnergy, defect_energy
from signals.indicators.gear import (
    energy_operator,
    energy_ratio,
    fm0,
    fm4,
    m6a,
    m8a,
    na4,
    sideband_index,
    sideband_level_factor,
)
from signals.indicators.history import VarianceHistory
from signals.indicators.mesh import (
    amplitude_modulation,
    amplitude_modulation_kurtosis,
    frequency_modulation,
    frequency_modulation_kurtosis,
    narrowband_kurtosis,
    nb4,
    phase_modulation,
)
from signals.indicators.planet import CarrierSidebands, carrier_sideband_ratio, carrier_sidebands
from signals.indicators.registry import INDICATORS, Indicator
from signals.indicators.shaft import shaft_order, so1, so2, so3
from signals.indicators.statistics import crest_factor, kurtosis, peak, rms, teager_energy

__all__ = [
    "INDICATORS",
    "CarrierSidebands",
    "DefectEnergy",
    "Indicator",
    "VarianceHistory",
    "amplitude_modulation",
    "amplitude_modulation_kurtosis",
    "carrier_sideband_ratio",
    "carrier_sidebands",
    "crest_factor",
    "defect_energy",
    "energy_operator",
    "energy_ratio",
    "fm0",
    "fm4",
    "frequency_modulation",
    "frequency_modulation_kurtosis",
    "kurtosis",
    "m6a",
    "m8a",
    "na4",
    "narrowband_kurtosis",
    "nb4",
    "peak",
    "phase_modulation",
    "rms",
    "shaft_order",
    "sideband_index",
    "sideband_level_factor",
    "so1",
    "so2",
    "so3",
    "teager_energy",
]

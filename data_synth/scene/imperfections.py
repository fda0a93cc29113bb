"""Imperfections of healthy machines and their measurement, as declared in ``[imperfections]`` of a scene.

Every table is off unless it is named; named without numbers, it has the defaults of this module. These were fixed from
the sources below before any detector was run on records with them, and must not be tuned to one. Numbers without a
source are marked "ours, illustrative". `DEFAULTS_VERSION` changes with any of them.

Sources: ISO 1328-1:2013 (flank tolerances), ISO 286-1 (tolerance grades of bores), ISO 21940-11:2016 (balance quality),
ISO 6336-1 (tooth stiffness), ISO 10816-1:1995 (vibration of housings), EN 50160 (harmonics of the mains), Guo and
Keller (2020, AGMA Fall Technical Meeting: loads of planets), Wardle (1988, Proc. Inst. Mech. Eng. C 202: orders of
waviness), Kraemer (1993, Dynamics of Rotors and Foundations: stiffness of ball bearings), Rifai, Ortmeyer and McQuillan
(2000, IEEE Trans. Power Delivery 15: interharmonics of inverters), Serridge and Licht (1987, Piezoelectric
Accelerometers and Vibration Preamplifiers, Bruel & Kjaer: mounting resonances), Lessmeier et al. (2016, PHM Society
European Conference: temperatures of a bearing test rig).
"""

from typing import Annotated, Self

from pydantic import Field, model_validator

from data_synth.scene.operation import ByName, NotNegative, Share
from hums.gearbox.components import Declared, Name, Positive

DEFAULTS_VERSION = "1.1"
"""Version of the defaults of this module and of `data_synth.scene.machine_history.History`."""

Ratio = Annotated[float, Field(gt=0, lt=1)]


class GearQuality(Declared):
    """Run-out and pitch deviations of every gear: the tolerances of an ISO 1328-1:2013 `grade`, or micrometres.

    A gear has the run-out `runout_um` and the largest single pitch deviation `single_pitch_um`, both along its pitch
    circle, at random teeth; by default they are the tolerances of the grade. In a kinematic scene a tooth shifts the
    phase of its mesh by its cumulative deviation, and raises its amplitude by the single pitch deviation over
    `deflection_um`, the deflection of loaded teeth.
    """

    grade: Annotated[int, Field(ge=1, le=11)] = 6  # industrial gears, 5 to 8; ours, illustrative
    runout_um: NotNegative | None = None
    single_pitch_um: NotNegative | None = None
    deflection_um: Positive = 10.0  # 200 N/mm on 20 N/(mm um), the mesh stiffness of steel spur gears by ISO 6336-1


class UnequalPlanets(Declared):
    """Planets displaced on their carrier, and their unequal loads.

    Tangential displacements are drawn with the standard deviation `position_um`. If gears vibrate, unequal loads follow
    from them; in a kinematic scene the loads have the relative standard deviation `load_std`.
    """

    position_um: NotNegative = 10.0  # pin holes within IT7, 35 um at 80 to 120 mm by ISO 286-1: 35 / sqrt(12)
    # largest of three loads 8 % above the mean on average, 10 % at most: 1.08 measured by Guo and Keller (2020), and
    # 1.10 allowed by IEC 61400-4
    load_std: Share = 0.07


class ResidualImbalance(Declared):
    """Residual imbalance of every shaft: balance quality `grade` G in mm/s, eccentricity times top angular speed.

    The top speed is that at `rated_rpm` of the reference; by default, at the highest speed of the record. `rotor_kg` is
    the mass of every shaft, or of each by name.
    """

    grade: Positive = 6.3  # gears and general machinery: ISO 21940-11:2016, table 1
    rated_rpm: Positive | None = None
    rotor_kg: Positive | ByName[Positive] = 2.0  # a steel disc of 100 by 32 mm; ours, illustrative


class RaceWaviness(Declared):
    """Waviness of both races of every bearing: weak lines at the defect orders of a healthy bearing.

    Lobes of the outer race next to multiples of the number of elements give lines at n BPFO, those of the inner race at
    n BPFI +- its rotation (Wardle 1988). The force is `stiffness_n_m` times ``waviness_um / n``.
    """

    waviness_um: Positive = 0.02  # amplitude of the first; ours, illustrative
    stiffness_n_m: Positive = 1e8  # a 6205 (9 balls of 7.94 mm) under 1 kN has 1.1e8 N/m: Kraemer (1993)
    harmonics: Annotated[int, Field(ge=1)] = 2  # ours, illustrative


class Inverter(Declared):
    """An inverter that feeds the motor: lines at ``m mains + n output`` for (m, n, share) in `lines`.

    The output frequency is `output_hz`, or follows the `link` of the motor (default: the reference) as
    ``pole_pairs speed / (1 - slip)``. `share` is the amplitude relative to the mains.
    """

    output_hz: Positive | None = None
    link: Name | None = None
    pole_pairs: Annotated[int, Field(ge=1)] = 2  # 1500 rpm at 50 Hz; ours, illustrative
    slip: Annotated[float, Field(ge=0, lt=1)] = 0.02  # induction motors at rated load, 1 to 5 %; ours, illustrative
    # (6 k +- 1) mains +- 6 n output with a six-pulse bridge: Rifai, Ortmeyer and McQuillan (2000); harmonics 5 and 7 of
    # the output as 1 / n, those of a six-step wave; other shares are ours
    lines: tuple[tuple[int, int, NotNegative], ...] = (
        (0, 1, 1.0),
        (0, 5, 0.2),
        (0, 6, 0.5),
        (0, 7, 0.14),
        (1, 6, 0.1),
        (-1, 6, 0.1),
        (5, 6, 0.05),
        (-5, 6, 0.05),
    )


class TachometerPickUp(Declared):
    """Mains pick-up in the tachometer cable: modulated pulse times, and false pulses at crests.

    `jitter_s` is the amplitude of the modulation, `extra_share` the fraction of crests that cause a pulse.
    """

    jitter_s: NotNegative = 2e-6  # 10 mV on an edge of 5 V in 1 ms; ours, illustrative
    extra_share: Share = 1e-3  # ours, illustrative


class Electrical(Declared):
    """Electrical lines in all sensor cables: mains harmonic k has ``decay ** (k - 1)`` times the first amplitude."""

    mains_hz: Positive = 50.0  # 60 in the Americas: IEC 60038
    amplitude_m_s2: Positive = 0.05  # read as motion; ours, illustrative
    harmonics: Annotated[int, Field(ge=1)] = 3  # ours, illustrative
    decay: Share = 0.4  # the third, 5 % of the mains by EN 50160, through a capacity: 3 x 5 % = 0.39^2
    inverter: Inverter | None = None
    tachometer: TachometerPickUp | None = None


class Neighbour(Declared):
    """A neighbouring machine at its own constant speed: harmonics of shaft and mesh, sidebands, impacts.

    Harmonic k has ``decay ** (k - 1)`` times the first amplitude; each mesh harmonic has one sideband on either side,
    `sideband` times as large. Impacts, `impacts_per_rev` per revolution, excite its own mode. Numbers without a source
    are ours.
    """

    speed_hz: Positive = 24.3  # an induction motor of four poles at 50 Hz, slip 2.8 %; ours, illustrative
    teeth: Annotated[int, Field(ge=5)] = 31
    shaft_m_s2: NotNegative = 0.05  # 0.23 mm/s rms: a third of the good zone of small machines in ISO 10816-1:1995
    mesh_m_s2: NotNegative = 0.1
    harmonics: Annotated[int, Field(ge=1)] = 3
    decay: Share = 0.5
    sideband: Share = 0.2
    impact_m_s2: NotNegative = 0.5
    impacts_per_rev: Positive = 3.58  # outer race of a 6205
    frequency_hz: Positive = 3100.0
    damping_ratio: Ratio = 0.04


class Knocks(Declared):
    """Random external impacts: a Poisson process of mean rate `per_second`, with exponentially distributed amplitudes.

    They excite the resonance of the scene. All numbers are ours, illustrative.
    """

    per_second: Positive = 0.5
    mean_m_s2: Positive = 3.0


class NoiseLevel(Declared):
    """A varying noise level: Gaussian in dB about the declared one, correlated over `time_scale_s`.

    All numbers are ours, illustrative.
    """

    std_db: Positive = 1.5
    time_scale_s: Positive = 5.0


class Mounts(Declared):
    """A mounting resonance of each sensor that declares none, log-normally distributed about `frequency_hz`."""

    frequency_hz: Positive = 28_000.0  # wax; stud 31 kHz, magnet 7 kHz: Serridge and Licht (1987)
    spread: NotNegative = 0.1  # standard deviation of its logarithm; ours, illustrative
    damping_ratio: Ratio = 0.03  # ours, illustrative


class Gains(Declared):
    """Gain differences between sensors: calibration errors with this standard deviation."""

    std_db: Positive = 0.4  # 5 %, half of the 10 % that data sheets of industrial sensors allow; ours, illustrative


class Temperature(Declared):
    """Sensor temperature T, linear in time, which changes the sensitivity by the factor ``1 + per_k (T - 23 C)``."""

    celsius: Annotated[float, Field(gt=-273.15, allow_inf_nan=False)] = 45.0  # 45 to 50 in Lessmeier et al. (2016)
    drift_k_per_h: Annotated[float, Field(allow_inf_nan=False)] = 5.0  # ours, illustrative
    # piezoelectric ceramics, 0.05 to 0.15 %/K; ours, illustrative
    per_k: Annotated[float, Field(gt=-0.01, lt=0.01)] = 1e-3


class Imperfections(Declared):
    """Imperfections of healthy machines: each table is off unless named, with defaults for numbers not given.

    Accelerations are divided by standard gravity if sensors are in g. Imbalance and waviness act as forces on the
    housing, `dynamics.housing_kg`, or on declared transfers; with gears in motion, across the shaft. Each imperfection
    draws from its own random stream.

    Examples
    --------
    >>> from data_synth.scene.imperfections import Imperfections
    >>> table = Imperfections.model_validate({"imbalance": {}, "gears": {"grade": 8}})
    >>> table.imbalance.grade, table.gears.grade, table.planets
    (6.3, 8, None)
    """

    gears: GearQuality | None = None
    planets: UnequalPlanets | None = None
    imbalance: ResidualImbalance | None = None
    bearings: RaceWaviness | None = None
    electrical: Electrical | None = None
    neighbour: Neighbour | None = None
    knocks: Knocks | None = None
    noise: NoiseLevel | None = None
    mounts: Mounts | None = None
    gains: Gains | None = None
    temperature: Temperature | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        inverter = self.electrical.inverter if self.electrical is not None else None
        if inverter is not None and inverter.output_hz is not None and inverter.link is not None:
            raise ValueError("electrical.inverter has both output_hz and link; keep one")
        return self

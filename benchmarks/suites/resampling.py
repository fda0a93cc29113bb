"""From time to angle: the tachometer's pulses, the phase through them, the record over it."""

import numpy as np

import signals
from signals import angular_blocks, angular_resample, pulse_times, shaft_phase

SAMPLES = 200_000
RATE_HZ = 51_200.0


class _Shaft:
    """A shaft at 50 Hz whose speed swings by a tenth, one pulse a revolution."""

    def setup(self, *_: object) -> None:
        """Make SAMPLES of noise and of the tachometer."""
        t = np.arange(SAMPLES) / RATE_HZ
        turns = 50 * (t + 0.1 * (1 - np.cos(np.pi * t)) / np.pi)
        self.x = np.random.default_rng(0).standard_normal(SAMPLES)
        self.waveform = np.where(turns % 1 < 0.1, 5.0, 0.0)  # noqa: PLR2004
        self.phase = shaft_phase(pulse_times(self.waveform, rate_hz=RATE_HZ).times_s)


class Resampling(_Shaft):
    """By samples a revolution: 256 are coarser than the record, 1,024 both coarser and finer."""

    params = (256, 1024)
    param_names = ("samples_per_rev",)

    def setup(self, samples_per_rev: int) -> None:
        """Make the record over angle too."""
        super().setup()
        self.settings = {"rate_hz": RATE_HZ, "phase": self.phase, "samples_per_rev": samples_per_rev}
        self.over_angle = angular_resample(self.x, **self.settings)

    def time_resample(self, samples_per_rev: int) -> None:  # noqa: ARG002
        """Time the anti-aliased change of grid."""
        angular_resample(self.x, **self.settings)

    def time_resample_linear(self, samples_per_rev: int) -> None:  # noqa: ARG002
        """Time finding the angles, and straight lines."""
        angular_resample(self.x, method="linear", **self.settings)

    def time_blocks(self, samples_per_rev: int) -> None:  # noqa: ARG002
        """Time the same in blocks of 4,096 samples."""
        for _ in angular_blocks(np.split(self.x, range(4096, SAMPLES, 4096)), **self.settings):
            pass

    def time_back(self, samples_per_rev: int) -> None:  # noqa: ARG002
        """Time the way back to an even grid of time."""
        signals.time_resample(self.over_angle, phase=self.phase, rate_hz=RATE_HZ)


class Tachometer(_Shaft):
    """What comes before."""

    def time_pulses(self) -> None:
        """Time finding the pulses in the waveform, and the phase through them."""
        shaft_phase(pulse_times(self.waveform, rate_hz=RATE_HZ).times_s)

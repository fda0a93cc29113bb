"""The door to the trackers: ten orders of a shaft that runs up, two estimators, one to three poles."""

from typing import Any

import numpy as np

from signals import harmonics  # asv would take a bare `track_orders` for a benchmark of its own

SAMPLES = 200_000
RATE_HZ = 50_000.0
ORDERS = (1.0, 2.0, 3.0, 4.6, 7.1, 12.3, 20.0, 27.0, 36.0, 54.0)


class _Record:
    """Noise: what a record holds does not change how long it takes."""

    def setup(self, *_: object) -> None:
        """Make a record of SAMPLES; asv calls what it times once before, which compiles."""
        t = np.arange(SAMPLES) / RATE_HZ
        self.x = np.random.default_rng(0).standard_normal(SAMPLES)
        self.phase_rad = 2 * np.pi * (10 * t + 0.75 * t**2)

    def track(self, **settings: Any) -> object:  # noqa: ANN401
        """Track ORDERS, 2 Hz wide."""
        given: dict[str, Any] = {"phase_rad": self.phase_rad, "orders": ORDERS, "bandwidth_hz": 2.0, "rate_hz": RATE_HZ}
        return harmonics.track_orders(self.x, **given, **settings)


class Smoother(_Record):
    """By poles and samples between outputs."""

    params = ((1, 2, 3), (1, 200))
    param_names = ("poles", "output_every")

    def time_fast(self, poles: int, output_every: int) -> None:
        """Time the fast method."""
        self.track(method="fast", poles=poles, output_every=output_every)

    def peakmem_fast(self, poles: int, output_every: int) -> None:
        """Weigh the fast method."""
        self.track(method="fast", poles=poles, output_every=output_every)


class Sweeps(_Record):
    """The sample-by-sample kernels: forward for the filter, both ways for the smoother."""

    params = (("filter", "smoother"), (1, 2))
    param_names = ("estimator", "poles")

    def time_exact(self, estimator: str, poles: int) -> None:
        """Time the exact method, outputs few."""
        self.track(method="exact", estimator=estimator, poles=poles, output_every=200)


class Filter(_Record):
    """The causal estimator with every output, by the method it picks itself."""

    params = (1, 2)
    param_names = ("poles",)

    def time_auto(self, poles: int) -> None:
        """Time every output."""
        self.track(estimator="filter", poles=poles)

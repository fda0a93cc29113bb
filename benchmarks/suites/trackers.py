"""The doors to the trackers: ten orders of a shaft that runs up, or turns evenly in angle."""

from typing import Any

import numpy as np

from signals import harmonics  # asv would take a bare `track_orders` for a benchmark of its own

SAMPLES = 200_000
RATE_HZ = 50_000.0
SAMPLES_PER_REV = 512
ORDERS = (1.0, 2.0, 3.0, 4.6, 7.1, 12.3, 20.0, 27.0, 36.0, 54.0)
BLOCK = 4096


class _Record:
    """Noise: what a record holds hardly changes how long it takes."""

    def setup(self, *_: object) -> None:
        """Make a record of SAMPLES; asv calls what it times once before, which compiles."""
        t = np.arange(SAMPLES) / RATE_HZ
        self.x = np.random.default_rng(0).standard_normal(SAMPLES)
        self.phase_rad = 2 * np.pi * (10 * t + 0.75 * t**2)
        self.even_phase_rad = 2 * np.pi / SAMPLES_PER_REV * np.arange(SAMPLES)

    def track(self, **settings: Any) -> harmonics.OrderTracks:  # noqa: ANN401
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

    def time_std(self, poles: int) -> None:
        """Time every output and its standard deviation."""
        _ = self.track(estimator="filter", poles=poles).std


class Settled(_Record):
    """The causal estimator where gains settle: a record sampled in angle, every output."""

    params = (1, 2, 3, 4)
    param_names = ("poles",)

    def time_fast(self, poles: int) -> None:
        """Time the start, and the settled gains after it."""
        harmonics.track_orders(
            self.x,
            phase_rad=self.even_phase_rad,
            orders=ORDERS,
            bandwidth_orders=0.03,
            samples_per_rev=SAMPLES_PER_REV,
            poles=poles,
            estimator="filter",
            method="fast",
        )


class Channels(_Record):
    """Several records with one phase."""

    params = ((1, 8), (("smoother", "fast"), ("filter", "exact")))
    param_names = ("channels", "way")

    def setup(self, channels: int, _: object) -> None:
        """Make so many records."""
        super().setup()
        self.x = np.random.default_rng(0).standard_normal((channels, SAMPLES))

    def time_channels(self, _: int, way: tuple[str, str]) -> None:
        """Time all together, outputs few."""
        self.track(estimator=way[0], method=way[1], output_every=200)


class Stream(_Record):
    """The tracker that is fed block by block: causal, and with a lag of 5,000 samples."""

    params = (None, 5000)
    param_names = ("lag",)

    def time_blocks(self, lag: int | None) -> None:
        """Time blocks of 4,096 samples, outputs few."""
        tracker = harmonics.OrderTracker(
            orders=ORDERS, bandwidth_hz=2.0, rate_hz=RATE_HZ, noise_variance=1.0, lag=lag, output_every=200
        )
        for start in range(0, SAMPLES, BLOCK):
            block = slice(start, start + BLOCK)
            tracker.update(self.x[block], phase_rad=self.phase_rad[block])
        tracker.finish()


class Slip(_Record):
    """A line that slips by one per cent."""

    params = ("smoother", "filter")
    param_names = ("estimator",)

    def setup(self, estimator: str) -> None:
        """Put the line into the noise."""
        super().setup(estimator)
        self.x += np.cos(9.46 * 0.99 * self.even_phase_rad)

    def time_slip(self, estimator: str) -> None:
        """Time the search for the line, and the estimate."""
        harmonics.track_slipping_order(
            self.x,
            phase_rad=self.even_phase_rad,
            order=9.46,
            largest_slip=0.02,
            slip_change_per_rev=1e-4,
            bandwidth_orders=0.02,
            samples_per_rev=SAMPLES_PER_REV,
            estimator=estimator,
        )


class Likelihood(_Record):
    """The search for the likeliest bandwidth of each order."""

    params = (1, 2)
    param_names = ("poles",)

    def time_search(self, poles: int) -> None:
        """Time it, up to 3 Hz."""
        harmonics.likely_bandwidth(
            self.x,
            phase_rad=self.phase_rad,
            orders=ORDERS,
            largest_bandwidth_hz=3.0,
            rate_hz=RATE_HZ,
            poles=poles,
        )

"""The stored time axis, and files written and opened beside h5netcdf: python benchmarks/file_layout.py."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

import hums


def cpu_ms(action: Callable[[], object], runs: int = 5) -> float:
    """Return the CPU time of the fastest of some runs, in ms."""
    taken = []
    for _ in range(runs):
        began = time.process_time()
        action()
        taken.append(time.process_time() - began)
    return 1e3 * min(taken)


def noise_record(count: int, rate_hz: float, channels: int = 1) -> xr.Dataset:
    """Return a record of noise."""
    rng = np.random.default_rng(0)
    values = {f"c{number}": rng.normal(size=count) for number in range(channels)}
    return hums.make_record(
        values, rate_hz=rate_hz, units="g", angle=hums.NominalSpeed(rpm=1200, shaft="input"), machine="m"
    )


def main(folder: Path) -> None:
    """Print bytes of the time axis for each sample, then CPU times of writing and opening."""
    for count in (20_000, 1_000_000):
        for rate_hz in (25_600.0, 50_000.0, 12_345.67):
            hums.save_record(noise_record(count, rate_hz), folder / "record.h5")
            with xr.open_dataset(folder / "record.h5", engine="h5netcdf") as opened:
                opened.drop_vars("time").to_netcdf(folder / "bare.h5", engine="h5netcdf")
            more = (folder / "record.h5").stat().st_size - (folder / "bare.h5").stat().st_size
            print(f"{count} samples at {rate_hz:g} Hz: {more / count:.2f} bytes a sample")  # noqa: T201
    settings = hums.AnalysisSettings(envelope_band_hz=None, pictures=True)
    analysis = hums.analyze(noise_record(40_000, 4000.0), hums.load_gearbox("two-stage"), settings=settings)
    large, small = noise_record(1_000_000, 25_600.0, channels=4), noise_record(2000, 25_600.0, channels=2)
    encoding = {name: {"fletcher32": True, "chunksizes": (62_500,)} for name in large.data_vars if "c" in name}
    ways = {
        "record of 4 x 1,000,000": (large, hums.save_record, hums.open_record, xr.open_dataset, {"encoding": encoding}),
        "record of 2 x 2,000": (small, hums.save_record, hums.open_record, xr.open_dataset, {}),
        "analysis": (analysis, hums.save_analysis, hums.open_analysis, xr.open_datatree, {}),
    }
    ours, theirs = folder / "ours.h5", folder / "theirs.h5"
    for name, (what, save, open_own, open_with, options) in ways.items():
        own = cpu_ms(lambda what=what, save=save: save(what, ours))
        other = cpu_ms(lambda what=what, more=options: what.to_netcdf(theirs, engine="h5netcdf", **more))
        opened = cpu_ms(lambda opens=open_own: opens(ours).close())
        by_other = cpu_ms(lambda opens=open_with: opens(ours, engine="h5netcdf").close())
        times = f"write {own:.0f} ms, by h5netcdf {other:.0f} ms; open {opened:.0f} and {by_other:.0f} ms"
        print(f"{name}: {times}")  # noqa: T201


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        main(Path(made))

"""Error against time of what a user chooses between: python benchmarks/choices.py [PAGE].

Fills the tables of a page (default docs/benchmarks/choices.md) between their marks, and draws the picture next to it.
All records are synthetic, with known truth.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from page_files import table
from tracking.clock import Effort, time_in_ffts

import hums
import signals
from data_synth import Scene, load_plan, simulate
from hums.gearbox.defect_orders import defect_orders
from hums.gearbox.kinematics import solve_kinematics
from hums.plots import save_figure
from signals.demodulation.envelope import bank_bands, bank_envelopes
from signals.harmonics import order_waveform, track_orders

Floats = NDArray[np.float64]
RATE_HZ, PER_REV, BEARING_ORDER, EDGE = 20_000.0, 1024, 3.585, 6000


def times(x: Floats, calls: Mapping[str, Callable[[], object]], effort: Effort) -> dict[str, str]:
    """Return the time of each call in rffts of a record, in turn with it."""
    return {name: f"{time_in_ffts(call, x, effort):.3g}" for name, call in calls.items()}


def db(power: float) -> str:
    """Return a ratio of powers in dB."""
    return f"{10 * np.log10(power):.1f}"


# ---- separation of deterministic and random parts --------------------------------------------------------------------

GEARED = np.array([23 * h + side for h in range(1, 9) for side in (-2, -1, 0, 1, 2)])


def geared(duration_s: float, wander: float) -> tuple[signals.ShaftPhase, Floats, Floats, Floats]:
    """Return the phase of a shaft, the lines of its gear, a bearing with slip, and noise."""
    rng = np.random.default_rng(1)
    t = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    turns = 25 * (t + wander * np.sqrt(2) * np.sin(0.6 * np.pi * t) / (0.6 * np.pi))
    heights = 0.85 ** (GEARED / 23) / (1 + 2 * np.abs((GEARED + 11) % 23 - 11))
    lines = sum(a * np.cos(2 * np.pi * (k * turns + rng.random())) for k, a in zip(GEARED, heights, strict=True))
    lines = lines * (1 + 20 * wander * np.cos(0.4 * np.pi * t))
    hits, passed = np.zeros(t.size), np.cumsum(1 + 0.01 * rng.standard_normal(int(4 * turns[-1]))) / BEARING_ORDER
    hits[np.searchsorted(turns, passed[passed < turns[-1]])] = 1
    bearing = np.convolve(hits, np.exp(-754 * t[:600]) * np.sin(8400 * np.pi * t[:600]))[: t.size]
    noise = 0.3 * rng.standard_normal(t.size)
    phase = signals.ShaftPhase(times_s=t, revolutions=turns)
    return phase, lines / lines.std(), 0.3 * bearing / bearing.std(), noise


def locked(x: Floats, turns: Floats) -> float:
    """Return the power of the lines in a record, fitted in every fourth second."""
    part, powers = int(RATE_HZ), []
    for at in range(0, x.size - part + 1, 4 * part):
        angle = 2 * np.pi * np.outer(turns[at : at + part], GEARED)
        basis = np.hstack([np.cos(angle), np.sin(angle)])
        powers.append(np.mean((basis @ np.linalg.solve(basis.T @ basis, basis.T @ x[at : at + part])) ** 2))
    return float(np.mean(powers))


def separators(phase: signals.ShaftPhase, size: int) -> dict[str, Callable[[Floats], Floats]]:
    """Return the methods by name: each returns the random part, from the first sample of the record."""
    angle = phase.angle_rad(np.arange(size) / RATE_HZ)

    def random_part(x: Floats) -> Floats:
        parts = signals.discrete_random_separation(x, window_length=8192, delay=8192)
        return np.pad(parts.random, parts.start)

    def over_angle(x: Floats, separate: Callable[[Floats], Floats]) -> Floats:
        signal = signals.angular_resample(x, rate_hz=RATE_HZ, phase=phase, samples_per_rev=PER_REV)
        left = replace(signal, values=separate(signal.values))
        return signals.time_resample(left, phase=phase, rate_hz=RATE_HZ, start_s=0.0).values

    def tracked(x: Floats) -> Floats:
        tracks = track_orders(x, phase_rad=angle, orders=GEARED, bandwidth_hz=1.0, rate_hz=RATE_HZ)
        return np.asarray(x - order_waveform(tracks, phase_rad=angle))

    return {
        "no separation": np.copy,
        "`linear_prediction`, order 50": lambda x: signals.linear_prediction(x, order=50).random,
        "`linear_prediction`, order 1000": lambda x: signals.linear_prediction(x, order=1000).random,
        "`cepstrum_prewhitening`": lambda x: signals.cepstrum_prewhitening(x).random,
        "`discrete_random_separation`": random_part,
        "`discrete_random_separation`, over angle": lambda x: over_angle(x, random_part),
        "synchronous average": lambda x: over_angle(
            x, lambda y: y - np.resize(y.reshape(-1, PER_REV).mean(axis=0), y.size)
        ),
        "`track_orders`": tracked,
    }


def separation(duration_s: float, effort: Effort) -> list[str]:
    """Return the table on separation."""
    cells: dict[str, list[str]] = {}
    over = {"rate_hz": RATE_HZ, "samples_per_rev": 64, "start_s": EDGE / RATE_HZ}
    settings: list[dict[str, Any]] = [over | {"band_hz": band} for band in ((3200.0, 5200.0), (10.0, 9900.0))]
    for wander in (0.0, 0.01):
        phase, lines, bearing, noise = geared(duration_s, wander)
        x, middle = lines + bearing + noise, slice(EDGE, -EDGE)
        turns, known = phase.revolutions_at(np.arange(x.size) / RATE_HZ)[middle], bearing[middle]
        methods = separators(phase, x.size)
        took = times(x, {name: partial(method, x) for name, method in methods.items()}, effort)
        methods["bearing and noise alone"] = lambda _, sought=bearing + noise: sought
        for name, method in methods.items():
            left = np.pad(method(x), (0, EDGE))[middle.start :][: known.size]
            spectra = (signals.envelope_order_spectrum(left, phase=phase, **setting) for setting in settings)
            found = (signals.find_line(spectrum, expected=BEARING_ORDER, tolerance=0.03).snr for spectrum in spectra)
            share = locked(left, turns) / locked(lines[middle], turns)
            cells.setdefault(name, []).extend(
                (db(share), f"{left @ known / (known @ known):.2f}", *(f"{each:.0f}" for each in found))
            )
        took["bearing and noise alone"] = "-"
    head = ("removed by", *("lines, dB", "bearing", "line in band", "line without") * 2, "time")
    return table(head, ([name, *row, took[name]] for name, row in cells.items()))


# ---- windows ---------------------------------------------------------------------------------------------------------

WINDOWS = ("boxcar", "hann", "hamming", "blackman", "blackmanharris", "flattop")
SIZE, AWAY = 4096, np.array([0.5, 1.5, 3.5, 6.5, 20.5])  # samples of a line, bins from it


def windows(effort: Effort) -> list[str]:
    """Return the table on windows."""
    noise, at, rows = np.random.default_rng(2).standard_normal((200, SIZE)), 2 * np.pi * np.arange(SIZE) / SIZE, []
    calls = {name: partial(signals.amplitude_spectrum, noise.ravel(), rate=1.0, window=name) for name in WINDOWS}
    took = times(noise.ravel(), calls, effort)
    for name in WINDOWS:
        of = partial(signals.amplitude_spectrum, rate=SIZE, window=name)
        between, padded = of(np.cos(400.5 * at), padding=1), of(np.cos(400.5 * at))
        found = (f"{20 * np.log10(np.interp(400.5 - away, between.axis, between.amplitude)):.1f}" for away in AWAY)
        wide = np.mean([of(x, padding=1).amplitude[9:-9] ** 2 for x in noise]) * SIZE / 4
        rows.append([name, *found, f"{wide:.2f}", f"{padded.amplitude.max() - 1:+.2%}", took[name]])
    head = ("window", *(f"{away:g} bins off, dB" for away in AWAY), "noise, bins", "padded", "time")
    return table(head, rows)


# ---- machines --------------------------------------------------------------------------------------------------------

PLAN, MACHINES = "benchmark-1", ("one-stage 5", "one-stage 3")
DURATION_S, SPREAD, HISTORY, QUANTILE = 2.0, 0.01, 20, 0.99
CHANNEL, SHAFT, GEAR, BEARING = "input vertical", "input", "stage 1/input", "input bearing"


def machine(name: str) -> tuple[Scene, int | None]:
    """Return the scene of a sound machine of the plan, as its first record has it, and its seed."""
    plan = load_plan(PLAN)
    number = next(number for number in range(plan.records) if plan.labels(number)["machine"] == name)
    return plan.scene(number).changed(faults=(), duration_s=DURATION_S), plan.machine_seed_of(number)


def record(scene: Scene, machine_seed: int | None, seed: int, fault: Mapping[str, object] | None = None) -> xr.Dataset:
    """Return a record at a speed and a load drawn within one per cent."""
    speed, load = 1 + SPREAD * np.random.default_rng(seed).uniform(-1, 1, 2)
    drive = {"link": SHAFT, "rpm": 1500 * speed}
    load_nm = {"link": "output", "nm": 0.5 * scene.torque.full_load_nm * load}
    changed = scene.changed(speed=drive, torque=load_nm, faults=(fault,) if fault else ())
    return simulate(changed, seed=seed, machine_seed=machine_seed)


def phase_of(made: xr.Dataset) -> signals.ShaftPhase:
    """Return the true phase of the reference."""
    return signals.ShaftPhase(times_s=made["truth_time"].to_numpy(), revolutions=made["truth_revolutions"].to_numpy())


# ---- residual and difference signal ----------------------------------------------------------------------------------


def leftovers(effort: Effort) -> list[str]:
    """Return the table on residual and difference signals."""
    cells: dict[str, list[str]] = {}
    for name in MACHINES:
        scene, seed = machine(name)
        teeth = next(gear.teeth for gear in scene.gearbox.meshes[0].gears if gear.link == SHAFT)
        crack = {"kind": "tooth_crack", "component": GEAR, "depth_mm": 1.5}
        made = [record(scene, seed, 1), record(scene, seed, 1, crack)]
        over: dict[str, Any] = {"rate_hz": scene.rate_hz, "phase": phase_of(made[0]), "samples_per_rev": PER_REV}
        turns = (signals.angular_resample(one[CHANNEL].to_numpy(), **over) for one in made)
        sound, cracked = map(signals.synchronous_average, turns)
        added, last = replace(sound, values=cracked.values - sound.values), int(sound.passband_orders)
        cut = {"teeth": teeth, "harmonics": last // teeth, "shaft_orders": (1, 2), "max_order": last}
        makers = {"average": lambda a: a, "`residual_signal`": partial(signals.residual_signal, **cut)} | {
            f"`difference_signal`, `sidebands={count}`": partial(signals.difference_signal, sidebands=count, **cut)
            for count in (1, 2, 3, 5)
        }
        took = times(sound.values, {which: partial(make, sound) for which, make in makers.items()}, effort)
        for which, make in makers.items():
            left, kept = (float(np.var(make(a).values)) for a in (sound, added))
            row = db(left / np.var(sound.values)), db(kept / np.var(added.values)), db(kept / left)
            cells.setdefault(which, []).extend(row)
    head = ("signal", *("sound, dB", "crack, dB", "crack to sound, dB") * len(MACHINES), "time")
    return table(head, ([which, *row, took[which]] for which, row in cells.items()))


# ---- windows about the passes of a planet ----------------------------------------------------------------------------

TEETH, SEQUENCES = signals.PlanetaryTeeth(ring=82, planet=31, sun=20, planets=3), (1, 4, 16)
PASS_WINDOWS = {
    **{f"rectangular, {n}": signals.PassWindow.rectangular(n) for n in (1, 5, 15)},
    **{f"Hann, {n}": signals.PassWindow.hann(n) for n in (2, 5, 10, 20)},
    **{f"Tukey, {n} with tapers of {n / 5:g}": signals.PassWindow.tukey(n, taper_teeth=n / 5) for n in (5, 10)},
}


def planets(effort: Effort) -> list[str]:
    """Return the table on planet windows."""
    rng, per_rev, turn = np.random.default_rng(3), 8 * TEETH.ring, 8 * TEETH.planet
    carrier = np.arange((SEQUENCES[-1] * TEETH.planet_reset + 1) * per_rev) / per_rev
    teeth = np.arange(turn) / 8
    own = np.cos(2 * np.pi * teeth) + 0.3 * np.repeat(rng.standard_normal((3, TEETH.planet)), 8, axis=1)
    own[0] += 3 * np.exp(-0.5 * ((teeth - 7.5) / 0.2) ** 2)
    x = np.zeros(carrier.size)
    for waveform, place in zip(own, TEETH.positions_rev, strict=True):
        angle = carrier - 0.5 + float(place)
        seen = 0.1 + 0.9 * np.cos(np.pi / 2 * np.clip(((angle + 0.5) % 1 - 0.5) * 9, -1, 1)) ** 2
        x += seen * np.interp(angle * 8 * TEETH.ring % turn, np.arange(turn + 1), np.append(waveform, waveform[0]))
    x += x.std() * rng.standard_normal(x.size)

    def average(window: signals.PassWindow, sequences: int) -> Floats:
        values = x[: (sequences * TEETH.planet_reset + 1) * per_rev]
        signal = signals.AngularSignal(values=values, samples_per_rev=per_rev, start_rev=0.0, passband_orders=300.0)
        return signals.planet_average(signal, teeth=TEETH, planet=0, first_pass_rev=0.5, window=window).values

    calls = {name: partial(average, window, SEQUENCES[-1]) for name, window in PASS_WINDOWS.items()}
    took, rows, true = times(x, calls, effort), [], own[0] - own[0].mean()
    for name, window in PASS_WINDOWS.items():
        found = (average(window, count) for count in SEQUENCES)
        errors = (np.std(each * (each @ true) / (each @ each) - true) / np.std(true) for each in found)
        rows.append([name, *(f"{error:.3f}" for error in errors), took[name]])
    return table(("window, teeth", *(f"{n * TEETH.planet_reset} passes" for n in SEQUENCES), "time"), rows)


# ---- which indicator sees which fault --------------------------------------------------------------------------------

SIZES_MM: Mapping[str, tuple[str, float, float]] = {
    "tooth_crack": (GEAR, 0.1, 4.8),
    "chipping": (GEAR, 0.05, 15),
    "missing_tooth": (GEAR, 0.1, 11.25),
    **dict.fromkeys(("spall", "pitting"), (GEAR, 0.005, 0.5)),
    "wear": (GEAR, 1e-4, 0.03),
    "eccentricity": (GEAR, 0.001, 0.3),
    "misalignment": (GEAR, 0.005, 15),
    **dict.fromkeys(("imbalance", "bent_shaft", "shaft_misalignment"), (SHAFT, 5e-4, 1)),
    **dict.fromkeys(("inner_race", "outer_race", "rolling_element", "cage"), (BEARING, 0.002, 5)),
}
EXTRA: Mapping[str, dict[str, float]] = {BEARING: {"impact_per_mm": 0.015}, "imbalance": {"rotor_kg": 5}}
Key = tuple[str, str]  # indicator, and fault


def least_sizes(name: str, *, sizes: int, seeds: int, healthy: int) -> Mapping[Key, float]:
    """Return the smallest size of a fault that an indicator sees, infinite where it sees none."""
    scene, machine_seed = machine(name)
    before: hums.Analysis | None = None

    def readings(seed: int, fault: Mapping[str, object] | None = None) -> dict[Key, float]:
        nonlocal before
        made = record(scene, machine_seed, seed, fault)
        settings = hums.AnalysisSettings(freeze_baseline=seed >= HISTORY)
        found = hums.analyze(made, scene.gearbox, settings=settings, baseline=before)
        before = before if seed >= HISTORY else found
        rows = found["indicators"].to_dataset().to_dataframe()
        rows = rows[rows.component.isin(("record", SHAFT, GEAR, BEARING))]
        defects = rows.kind.where(rows.component == BEARING, "")
        return dict(zip(zip(rows.indicator, defects, strict=True), rows.value, strict=True))

    sound = [readings(seed) for seed in range(HISTORY + healthy)][HISTORY:]
    limits = {key: np.quantile([row[key] for row in sound], QUANTILE) for key in sound[0]}
    least: dict[Key, float] = {}
    for kind, (place, *ends) in SIZES_MM.items():
        for size in np.geomspace(*ends, sizes):
            amount = {"depth_mm" if kind == "tooth_crack" else "size_mm": size}
            fault = {"kind": kind, "component": place, **amount, **EXTRA.get(place, {}), **EXTRA.get(kind, {})}
            found = [readings(1000 + seed, fault) for seed in range(seeds)]
            for key, limit in limits.items():
                if key[1] in ("", kind) or (place != BEARING and key[1] == "outer_race"):
                    seen = all(row[key] > limit for row in found)
                    least[key[0], kind] = min(least.get((key[0], kind), np.inf), size if seen else np.inf)
    return least


def seen_faults(found: Sequence[Mapping[Key, float]]) -> list[str]:
    """Return the table on indicators and faults."""
    rows = [["range", *(f"{low:g} to {high:g}" for _, low, high in SIZES_MM.values())]]
    for indicator in dict.fromkeys(name for name, _ in found[0]):
        sizes = ([least[indicator, kind] for least in found] for kind in SIZES_MM)
        cells = (" / ".join(f"{size:.2g}" if np.isfinite(size) else "-" for size in pair) for pair in sizes)
        rows.append([f"`{indicator}`", *("-" if cell == "- / -" else cell for cell in cells)])
    return table(("indicator", *(kind.replace("_", " ") for kind in SIZES_MM)), rows)


def draw(ax: Any, found: Sequence[Mapping[Key, float]]) -> None:  # noqa: ANN401
    """Draw which share of the range of sizes, in logarithms, each indicator sees of each fault."""
    names, kinds = list(dict.fromkeys(name for name, _ in found[0])), list(SIZES_MM)
    low, high = np.log([ends for _, *ends in SIZES_MM.values()]).T
    least = np.log([[[each[name, kind] for kind in kinds] for name in names] for each in found])
    seen = np.where(np.isfinite(least), (high - least + 0.1) / (high - low + 0.1), 0).mean(axis=0)
    image = ax.imshow(np.where(seen > 0, seen, np.nan), vmin=0, vmax=1, aspect="auto", cmap="viridis_r")
    ax.figure.colorbar(image, label="share of the size range detected, mean of both machines")
    ax.set_xticks(range(len(kinds)), [kind.replace("_", " ") for kind in kinds], rotation=60, ha="right")
    ax.set_yticks(range(len(names)), names, fontsize=7)


# ---- band of demodulation --------------------------------------------------------------------------------------------

FALSE_ALARM, DEFECTS, SEVERITIES = 1e-3, ("inner race", "outer race", "element"), (0.5, 0.65, 0.8)


def searched(
    made: xr.Dataset, rate_hz: float, order: float, stated_hz: tuple[float, float]
) -> tuple[Floats, dict[str, Callable[[], float]]]:
    """Return a record and the ways to a line in it, each of which returns its false-alarm probability."""
    x, phase = made[CHANNEL].to_numpy(), phase_of(made)

    def probability(spectrum: signals.AmplitudeSpectrum) -> float:
        line = signals.find_line(spectrum, expected=order, tolerance=0.003 * order)
        return 1.0 if line.at_edge else line.false_alarm_probability

    def of_band(band_hz: tuple[float, float]) -> float:
        over = {"rate_hz": rate_hz, "phase": phase, "samples_per_rev": 64}
        return probability(signals.envelope_order_spectrum(x, band_hz=band_hz, **over))

    def of_bank() -> float:
        bands_hz, found = bank_bands(rate_hz=rate_hz, least_width_hz=500.0), []
        for rate, values in bank_envelopes(x, rate_hz=rate_hz, bands_hz=bands_hz, highest_hz=1200.0):
            over = signals.angular_resample(values, rate_hz=rate, phase=phase, samples_per_rev=64)
            found.append(probability(signals.order_spectrum(over)))
        return min(found) * len(bands_hz)

    def of_chosen() -> float:
        return of_band(signals.choose_band(x, rate_hz=rate_hz).band_hz)

    whole = partial(of_band, (100.0, 0.49 * rate_hz))
    return x, {
        "stated": partial(of_band, stated_hz),
        "`choose_band`": of_chosen,
        "bank": of_bank,
        "all frequencies": whole,
    }


def with_and_without(number: int, severity: float) -> Iterator[tuple[Floats, dict[str, Callable[[], float]]]]:
    """Yield a record of the plan with its fault, and without."""
    plan = load_plan(PLAN)
    scene = plan.scene(number, {"severity": severity}).changed(duration_s=2 * DURATION_S)
    (defect,), rows = scene.faults, defect_orders(solve_kinematics(scene.gearbox))
    (order,) = rows.order[(rows.component == defect.component) & (rows.kind == defect.kind)].astype(float)
    top = max(mode.frequency_hz for path in scene.transfers if path.source == defect.component for mode in path.modes)
    for faults in ((defect,), ()):
        seeds = {"seed": plan.seed_of(number), "machine_seed": plan.machine_seed_of(number)}
        made = simulate(scene.changed(faults=faults), **seeds)
        yield searched(made, scene.rate_hz, order * (1 - defect.mean_slip), (0.85 * top, min(1.15 * top, 12_000.0)))


def bands(count: int, effort: Effort) -> list[str]:
    """Return the table on bands."""
    plan = load_plan(PLAN)
    numbers = [*islice((n for n in range(plan.records) if plan.class_of(n) in DEFECTS), count)]
    found: dict[str, list[int]] = {}
    for place, severity in enumerate(SEVERITIES):
        for number in numbers:
            (x, ways), (_, sound) = with_and_without(number, severity)
            for column, of in ((place, ways), (len(SEVERITIES), sound))[: 1 if place else 2]:
                for name, way in of.items():
                    found.setdefault(name, [0] * (len(SEVERITIES) + 1))[column] += way() < FALSE_ALARM
    took = times(x, ways, effort)
    head = ("band", *(f"severity {severity:g}" for severity in SEVERITIES), "false", "time")
    return table(head, ([name, *(f"{each / count:.0%}" for each in row), took[name]] for name, row in found.items()))


# ---- the page --------------------------------------------------------------------------------------------------------


def main(page: Path) -> None:
    """Measure, and write tables and picture."""
    effort = Effort(repeats=7, slow_repeats=2)
    seen = [least_sizes(name, sizes=4, seeds=2, healthy=50) for name in MACHINES]
    tables = {"separation": separation(12.0, effort), "windows": windows(effort), "signals": leftovers(effort)}
    tables |= {"planets": planets(effort), "indicators": seen_faults(seen), "bands": bands(10, effort)}
    text = page.read_text(encoding="utf-8")
    for name, lines in tables.items():
        before, mark, rest = text.partition(f"<!-- {name} -->\n")
        text = before + mark + "\n".join(lines) + rest[rest.index("<!-- end -->") :]
    page.write_text(text, encoding="utf-8")
    save_figure(lambda ax: draw(ax, seen), page.with_suffix(".svg"), width=8, height=6)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "benchmarks" / "choices.md")

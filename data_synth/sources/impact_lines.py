"""Lines of strictly periodic impacts: the harmonics of a damaged tooth that a kinematic scene strikes once a turn."""

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from data_synth.kinematic.gear_faults import ImpactTrain
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.sources.prepared import PreparedScene
from data_synth.transfer.paths import impact_line, ringing

FLOOR = 1e-2  # of the loudest line of the same impacts
_BELOW_NYQUIST = 0.98
_SEARCHED = 33  # instants at which loud lines are looked for


def impact_lines(
    prepared: PreparedScene, *, listed: frozenset[Fraction] = frozenset()
) -> Iterator[tuple[ImpactTrain, list[Fraction], ComplexArray]]:
    """Yield each periodic train of impacts, the orders of its loud lines, and their Z (sensor, line, instant).

    Impacts of several teeth of one gear interfere, so loud is what their sum has above `FLOOR` of its loudest line, and
    every order in `listed`.
    """
    scene = prepared.scene
    top = _BELOW_NYQUIST * scene.rate_hz / 2 / prepared.drive.angle.top_speed_hz(0.0, scene.duration_s)
    few = np.unique(np.linspace(0, prepared.instants_s.size - 1, _SEARCHED).round().astype(int))
    together: dict[tuple[str, Fraction], list[tuple[int, ImpactTrain]]] = {}
    for number, train in prepared.trains:
        if train.order is not None and train.amplitudes.any():
            together.setdefault((train.component, train.order), []).append((number, train))
    for (_, order), trains in together.items():
        harmonics = np.arange(1, int(top / float(order)) + 1)
        if not harmonics.size:
            continue
        summed = sum((_lines(prepared, *item, harmonics, few) for item in trains), np.zeros(1, dtype=np.complex128))
        sizes = np.max(np.abs(summed), axis=(0, 2))
        known = np.array([harmonic * order in listed for harmonic in harmonics.tolist()])
        loud = harmonics[known | (sizes > FLOOR * np.max(sizes))]
        every = np.arange(prepared.instants_s.size)
        for number, train in trains:
            orders = [harmonic * order for harmonic in loud.tolist()]
            yield train, orders, _lines(prepared, number, train, loud, every)


def _lines(
    prepared: PreparedScene, number: int, train: ImpactTrain, harmonics: NDArray[np.int_], instants: NDArray[np.int_]
) -> ComplexArray:
    """Return Z (sensor, line, instant) of harmonics of a train of fault `number`, at some instants of the truth."""
    load = prepared.impact_factor(number, prepared.instants_s[instants])
    speed_hz = prepared.speed_hz[instants]
    frequency = harmonics[:, None] * float(train.order or 0) * speed_hz
    found = []
    for sensor, gain, chain in zip(prepared.scene.sensors, prepared.gains[train.source], prepared.chains, strict=True):
        path = prepared.paths.get((train.source, sensor.name))
        rung = impact_line(
            train,
            harmonic=harmonics[:, None],
            speed_hz=speed_hz,
            load=load,
            path=path or ringing(prepared.scene.resonance),
        )
        found.append((abs(gain) if path is None else 1.0) * chain.response(frequency) * rung)
    return np.stack(found)

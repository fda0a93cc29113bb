"""Slow variation between the records of a machine, of gain, temperature, noise and load, as declared in a plan.

Each is the sum of two stationary Gauss-Markov processes over the record number, correlated over few and over many
records, and of a season (a sine):

    x_i = std (sqrt((1 - s) / 2) (u_i + v_i) + sqrt(2 s) sin(2 pi i / season + phase)),  u_i = a u_(i-1) + innovation

with a = exp(-1 / records). A state depends only on the seed and the record number: the innovations have their own
streams, and those older than `_REMEMBERED` correlation lengths are neglected (1e-7 of the deviation).
"""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from data_synth.scene.imperfections import Imperfections, Temperature
from data_synth.scene.operation import NotNegative, Share
from data_synth.scene.random_streams import random_stream
from data_synth.scene.scene import Scene, SceneError
from hums.gearbox.components import Declared, Positive

_REMEMBERED = 16  # correlation lengths
_BLOCK = 256  # innovations drawn at once
_FLOOR = 0.05  # of the declared torque


class History(Declared):
    """Standard deviations and correlation of the slow variation between records; 0 disables a quantity.

    Records alternate between independent `machines`; the properties of a machine (teeth, imbalance, phases, gains and
    mounts of sensors) are the same in all its records (`machine_seed` of `data_synth.simulate`). `gain_db` is common to
    all sensors, `noise_db` is that of the noise level, and `load_share` that of the torque relative to the declared
    one. All numbers are ours, illustrative.

    Examples
    --------
    >>> from data_synth.scene.machine_history import History
    >>> history = History(gain_db=0, machines=2)
    >>> sorted(history.state(5, seed=1)), history.state(5, seed=1) == history.state(5, seed=1)
    (['load', 'noise_db', 'temperature_k'], True)
    """

    machines: Annotated[int, Field(ge=1)] = 1
    short_records: Positive = 5.0
    long_records: Positive = 50.0
    season_records: Positive = 365.0  # a record a day
    season_share: Share = 0.2
    gain_db: NotNegative = 0.2
    temperature_k: NotNegative = 5.0
    noise_db: NotNegative = 1.5
    load_share: Annotated[float, Field(ge=0, le=0.3)] = 0.1

    def machine(self, number: int) -> int:
        """Return the index of the machine of a record, from 0."""
        return number % self.machines

    def state(self, number: int, *, seed: int) -> dict[str, float]:
        """Return the state of a record: its deviations of gain_db, temperature_k, noise_db and load."""
        deviations = {
            "gain_db": self.gain_db,
            "temperature_k": self.temperature_k,
            "noise_db": self.noise_db,
            "load": self.load_share,
        }
        own, place = self.machine(number), number // self.machines
        return {name: std * self._standard(name, own, place, seed) for name, std in deviations.items() if std}

    def scene(self, scene: Scene, number: int, *, seed: int) -> Scene:
        """Return the scene of a record with its state.

        Raises
        ------
        SceneError
            A varying load in a scene without torque.
        """
        state = self.state(number, seed=seed)
        changes: dict[str, object] = {}
        if "gain_db" in state:
            factor = 10 ** (state["gain_db"] / 20)
            changes["sensors"] = tuple(sensor.changed(gain=(sensor.gain or 1.0) * factor) for sensor in scene.sensors)
        if "temperature_k" in state:
            imperfections = scene.imperfections or Imperfections()
            declared = imperfections.temperature or Temperature()
            warmer = declared.changed(celsius=declared.celsius + state["temperature_k"])
            changes["imperfections"] = imperfections.changed(temperature=warmer)
        if "noise_db" in state:
            changes["noise"] = scene.noise.changed(rms=scene.noise.rms * 10 ** (state["noise_db"] / 20))
        if "load" in state:
            changes["torque"] = _loaded(scene, max(1 + state["load"], _FLOOR))
        return scene.changed(**changes) if changes else scene

    def _standard(self, name: str, machine: int, place: int, seed: int) -> float:
        """Return x_i for a standard deviation of 1."""
        slow, fast = (
            _gauss_markov(records, place, words=(f"history {name} {which}", machine), seed=seed)
            for which, records in (("long", self.long_records), ("short", self.short_records))
        )
        turn = place / self.season_records + random_stream(seed, f"history {name} season", machine).random()
        season = math.sqrt(2 * self.season_share) * math.sin(2 * math.pi * turn)
        return math.sqrt((1 - self.season_share) / 2) * (slow + fast) + season


def _loaded(scene: Scene, factor: float) -> object:
    torque = scene.torque
    if torque is None:
        raise SceneError("history.load_share scales the torque, but the scene has none; add torque, or set it to 0.")
    rows = tuple((time_s, nm * factor) for time_s, nm in torque.rows)
    full_nm = torque.full_load_nm or max(abs(nm) for _, nm in torque.rows) or None
    return torque.changed(**{"steps" if torque.steps is not None else "nm": rows, "full_load_nm": full_nm})


def _gauss_markov(records: float, place: int, *, words: tuple[str, int], seed: int) -> float:
    """Return one value of a stationary Gauss-Markov sequence of unit variance, correlated over `records`."""
    ages = np.arange(math.ceil(_REMEMBERED * records))
    first = place - ages[-1] + ages.size  # number of the oldest innovation; numbers start one memory before record 0
    blocks = range(first // _BLOCK, (place + ages.size) // _BLOCK + 1)
    drawn = np.concatenate([random_stream(seed, *words, block).standard_normal(_BLOCK) for block in blocks])
    newest = place + ages.size - blocks.start * _BLOCK
    decay = math.exp(-1 / records)
    return float(math.sqrt(1 - decay**2) * (decay**ages @ drawn[newest - ages]))

"""The data card of a dataset: its files, labels, classes and machines."""

from collections import Counter
from importlib.metadata import version

import numpy as np

from data_synth.plan import Plan
from data_synth.scene.faults import DIMENSIONS

_TEXT = """\
# {title}

{records:,} records of {duration:g} s at {rate:g} Hz: {channels}, and a tachometer on "{link}"; pulses per revolution:
{pulses}. Seed {seed}. All records are simulated; no machine was measured.
{about}
`shards/*.h5` hold the records (HDF5 in netCDF4 layout) with their ground truth, `index.h5` and `labels.csv` all
labels{parquet}. `plan.toml` states every range and every default; `hums dataset plan.toml` of hums-toolkit {package}
reproduces the files byte for byte. `checksums.sha256` has the SHA-256 of every file, for `sha256sum -c`.

## Labels

| label | meaning | unit | values |
|---|---|---|---|
{labels}

## Classes

| class | {splits} | fault | size |
|---|{rule}---|---|
{classes}
"""

_MACHINES = """
## Machines

Records of a machine share its gears with their errors and damage (`machine_seed`).{in_splits}

| machine | split | records | teeth | modules, mm |
|---|---|---|---|---|
{machines}
"""
_IN_SPLITS = " No machine is in two splits."

_MEANINGS = {
    "class": "fault class",
    "class_number": "index of the class in the list below, from 0",
    "component": "damaged component; empty if healthy",
    "seed": "seed of the record",
    "machine": "machine, from the list below",
    "machine_seed": "seed of what all records of a machine share",
    "split": "training, validation or test",
    "detectability_db": "signal-to-noise ratio of the filter matched to the contribution of the fault after the "
    "measurement chain, against sensor noise, from the start of the record, scaled to its length; NaN without a fault",
}
_UNITS = {
    "db": "dB",
    "deg": "deg",
    "hz": "Hz",
    "kg": "kg",
    "mm": "mm",
    "nm": "N m",
    "rpm": "rev min-1",
    "s": "s",
    "um": "um",
}


def data_card(plan: Plan) -> str:
    """Return the data card of a plan, in Markdown.

    Examples
    --------
    >>> from data_synth import load_plan
    >>> from data_synth.card import data_card
    >>> data_card(load_plan("benchmark-1").changed(records=20)).splitlines()[0]
    '# benchmark-1 3.1: synthetic gearbox vibration with labelled faults'
    """
    scene = plan.scene(0)
    rows = [plan.labels(number) for number in range(plan.records)]
    values = {name: [row[name] for row in rows] for name in rows[0]}
    if plan.table.detectability_s is not None:
        values["detectability_db"] = []
    splits = tuple(dict.fromkeys(row.get("split", "") for row in rows))
    counts = Counter((row["class"], row.get("split", "")) for row in rows)
    text = _TEXT.format(
        title=plan.table.title or "Synthetic gearbox vibration",
        records=plan.records,
        duration=scene.duration_s,
        rate=scene.rate_hz,
        channels=", ".join(f"`{sensor.name}` ({sensor.channel_units})" for sensor in scene.sensors),
        pulses=scene.tachometer.pulses_per_rev,
        link=scene.tachometer.link,
        seed=plan.seed,
        parquet=", `records.parquet` samples and labels, one row per record" if plan.table.parquet else "",
        about=f"\n{plan.table.about.strip()}\n" if plan.table.about else "",
        package=version("hums-toolkit"),
        labels="\n".join(_label_row(name, column) for name, column in values.items()),
        splits=" | ".join(split or "records" for split in splits),
        rule="---|" * len(splits),
        classes="\n".join(_class_row(plan, name, [counts[name, split] for split in splits]) for name in plan.classes),
    )
    if not plan.machines:
        return text
    own = Counter(row["machine"] for row in rows)
    machines = "\n".join(_machine_row(plan, n, own) for n in range(min(plan.records, len(plan.machines))))
    return text + _MACHINES.format(machines=machines, in_splits=_IN_SPLITS if any(splits) else "")


def _label_row(name: str, column: list[object]) -> str:
    unit = _UNITS.get(name.replace(".", "_").rpartition("_")[2], "")
    numbers = np.array([value for value in column if isinstance(value, float) and value == value])  # noqa: PLR0124
    texts = dict.fromkeys(str(value) for value in column if isinstance(value, str) and value)
    shown = f"{numbers.min():.3g} to {numbers.max():.3g}" if numbers.size else ", ".join(texts)
    return f"| `{name}` | {_MEANINGS.get(name, 'value drawn; empty if none is')} | {unit} | {shown} |"


def _class_row(plan: Plan, name: str, counts: list[int]) -> str:
    number = next((n for n in range(plan.records) if plan.class_of(n) == name), None)
    faults = plan.scene(number).faults if number is not None else ()
    kinds, sizes = [fault.kind for fault in faults], [DIMENSIONS[fault.kind] for fault in faults]
    return f"| {name} | {' | '.join(map(str, counts))} | {', '.join(kinds)} | {', '.join(sizes)} |"


def _machine_row(plan: Plan, number: int, counts: Counter[str]) -> str:
    machine, gearbox = plan.machines[number], plan.scene(number).gearbox
    teeth = ", ".join("/".join(str(gear.teeth) for gear in mesh.gears) for mesh in gearbox.meshes)
    modules = ", ".join("" if mesh.module_mm is None else f"{mesh.module_mm:g}" for mesh in gearbox.meshes)
    return f"| {machine.name} | {machine.split} | {counts[machine.name]} | {teeth} | {modules} |"

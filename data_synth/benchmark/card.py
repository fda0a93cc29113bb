"""The data card of a benchmark: what is in the folder, how it was made, and what it is not."""

from data_synth.benchmark import records as benchmark
from data_synth.benchmark.conditions import FAULTS, IMPERFECTIONS, LOAD_SHARES, SPEED_SHARES
from data_synth.scene.faults import DIMENSIONS

__all__ = ["data_card"]

_UNITS = {
    "mm": "mm",
    "module": "of the module",
    "face": "of the face width",
    "grade": "mm/s, eccentricity times speed of the shaft",
}
_FURTHER_WORDS = {
    "missing tooth": ", 2.25 modules: all of it",
    "spall": ", whose length rises with it to 0.8 pitches",
    "imbalance": "; the column size_mm has it in mm",
}

_TEXT = """\
# {name} {version}: synthetic gearbox vibration with labelled faults

{records} records of {duration:g} s at {rate:g} Hz, one accelerometer (m/s2) and a tachometer of one pulse a turn of the
input. Seed {seed}. All of it is simulated; no machine was measured.

## How it was made

`hums dataset {name}` of hums-toolkit; name, version and seed fix every byte for a version of the package and its
libraries. Gears move in the plane across their shafts (fidelity `lateral`): mesh stiffness from the strain energy of
the teeth, faults of gears by what they do to it or to the transmission error, integrated with an error of {error:g} of
the RMS. Bearing forces reach the sensor through modes of the housing. Defects of bearings are impacts with slip,
imbalance is a force on the rigid housing. Each record has its whole scene in the attribute `truth_scene`, and its truth
beside it.

Version 1.5 has a truth whose lines are, where speed or load varies, those of a harmonic balance and what the signal has
beside them, fitted together, where each had a window of its own in 1.4, and whose amplitudes are of single precision;
its samples are those of 1.4. `truth_line_change` is what halving the window changes, about the error of the line.
Version 1.4 has the height of the tooth as `size_mm` of a missing one, where 1.3 had the face width; its samples are
those of 1.3. Version 1.3 differs from 1.2 in the last
digits of samples, whose every operation is now rounded as IEEE 754 says, and in `detectability_db`: of the record's
own beginning, at its own speed, where 1.2 drew the wandering speed of a short record again. 1.2 has only the lines in
its truth that the window of the projection determines, which it does not at spacings below three of its periods
(attribute `truth_mesh_lines` states the windows, and by how much halving them changes the lines); before, samples
were those of 1.1.

## Licence

BSD-3-Clause, as the package; cite name, version and seed.

## Splits

Gearboxes and paths of a split are in no other, so the test has machines that training has not seen. The order of the
records is shuffled; every gearbox of a split has every class about equally often.

| split | share | gearboxes | paths |
|---|---|---|---|
{splits}

## Classes

Column `class`; `class_number` counts the eleven classes from 0, and is -1 for the further labels {further}.
Sizes are drawn evenly in the logarithm; `severity` is 0 at the least and 1 at the greatest. A missing tooth is gross by
nature: it has one size and severity 1. What breaks off a part of a tooth is `chipping`.

| class | records in 25 | size | range |
|---|---|---|---|
{classes}

`detectability_db` is the signal-to-noise ratio of the filter matched to what the fault adds behind the measurement
chain: 10 log10 of the sum of its squares, each over the variance of the noise at that instant, from the record's first
{trial:g} s without noise, with and without the fault, scaled to 10 s. NaN for healthy records. Below some 15 dB no
method finds the fault; above it a method that does not know the machine may still miss it.

## Gearboxes

Spur gears of 20 degrees, drawn once for this version. Bearings are drawn for each record.

| name | split | teeth | modules, mm | full torque at output, N m | top speed of input, rpm |
|---|---|---|---|---|---|
{gearboxes}

## Operation and healthy imperfections

The input turns at {low_speed:g} to {high_speed:g} of its top speed under {low_load:g} to {high_load:g} of full torque,
each steady within 0.2 %, wandering by 3 % (RMS), in a ramp or in a step (columns `speed_kind`, `torque_kind`; `rpm` and
`load_share` are those at the beginning). Every record, healthy or not, has:

{imperfections}

## Limits

- Parallel spur gearboxes of one to three stages; no helical, bevel or planetary gears.
- Ranges of paths, impacts, noise and loads are illustrative, not of a population of machines.
- Where speed varies, no window separates all lines of a slow shaft and follows them through resonances: the lines of
  the truth add up to more than 99.9 % of the power of gears in motion, and to more than 97 % of what a fault adds, in
  four records that were measured, but how neighbours share what a harmonic balance leaves is uncertain, of weak lines
  above all. `truth_line_change` says how far each line is known.
- One sensor. No backlash, no friction, no lubricant, no temperature, no wear of a record's own duration.
- Faults come alone and do not grow.
- Gear misalignment stands for all misalignment; couplings are not modelled.
"""


def data_card(plan: benchmark.BenchmarkRecords) -> str:
    """Return the data card of a benchmark, in Markdown.

    Parameters
    ----------
    plan : BenchmarkRecords

    Returns
    -------
    str

    Examples
    --------
    >>> from data_synth import load_plan
    >>> from data_synth.benchmark.card import data_card
    >>> data_card(load_plan("benchmark-1")).splitlines()[0]
    '# benchmark-1 1.5: synthetic gearbox vibration with labelled faults'
    """
    total = sum(split.share for split in benchmark.SPLITS.values())
    split_of = {name: split for split, pool in benchmark.SPLITS.items() for name in pool.gearboxes}
    return _TEXT.format(
        name=benchmark.NAME,
        version=benchmark.VERSION,
        records=f"{plan.records:,}",
        duration=plan.duration_s,
        rate=benchmark.RATE_HZ,
        seed=plan.seed,
        error=benchmark.ERROR,
        trial=min(benchmark.TRIAL_S, plan.duration_s),
        further=" and ".join(f"`{name}`" for name in benchmark.FURTHER),
        splits="\n".join(
            f"| {name} | {split.share / total:.0%} | {split.gearboxes[0]} to {split.gearboxes[-1]} | "
            f"{split.paths[0]} to {split.paths[-1]} |"
            for name, split in benchmark.SPLITS.items()
        ),
        classes="\n".join(_class_row(name) for name in (*benchmark.CLASSES, *benchmark.FURTHER)),
        gearboxes="\n".join(
            f"| {name} | {split_of[name]} | {', '.join('{}/{}'.format(*stage.teeth) for stage in drawn.stages)} | "
            f"{', '.join(f'{stage.module_mm:g}' for stage in drawn.stages)} | {drawn.full_torque_nm:g} | "
            f"{drawn.top_rpm:g} |"
            for name, drawn in benchmark.gearboxes().items()
        ),
        low_speed=SPEED_SHARES[0],
        high_speed=SPEED_SHARES[1],
        low_load=LOAD_SHARES[0],
        high_load=LOAD_SHARES[1],
        imperfections="\n".join(_imperfection_line(each.__doc__ or "") for each in IMPERFECTIONS),
    )


def _class_row(name: str) -> str:
    share = benchmark.SHARES[name]
    if name == "healthy":
        return f"| {name} | {share} | | |"
    family = FAULTS[name]
    low, high = family.sizes
    span = f"{low:g} to {high:g}" if low < high else f"{low:g}"
    words = DIMENSIONS[family.kind] + _FURTHER_WORDS.get(name, "")
    return f"| {name} | {share} | {words} | {span} {_UNITS[family.unit]} |"


def _imperfection_line(doc: str) -> str:
    """Return the first sentence of a docstring without its verb, as an item of a list."""
    return "- " + doc.splitlines()[0].removeprefix("Return ")

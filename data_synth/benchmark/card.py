"""The data card of a benchmark: what is in the folder, how it was made, and what it is not."""

from collections import Counter
from importlib.metadata import version as package_version

from data_synth.benchmark import records as benchmark
from data_synth.benchmark.conditions import FAULTS, IMPERFECTIONS, LOAD_SHARES, SPEED_SHARES
from data_synth.scene.faults import DIMENSIONS

__all__ = ["data_card"]

BASELINE = "0.29"
"""Balanced accuracy of a plain classifier, measured by `benchmarks/dataset.py` on 1,000 records of this version."""

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
imbalance is a force that turns with its shaft and acts in its bearing. Each record has its whole scene in the attribute
`truth_scene`, and its truth beside it.

What belongs to a gearbox, its teeth, imbalance and phases, is the same in all its records (`machine_seed`), each of
which begins some turns later. Mount and calibration of the sensor belong to the path, all else to the record.

2.8 has the scenes, labels and samples of 2.5 to 2.7, and states lines at sums of the orders of a damaged tooth and an
uneven gear; in 2.7 lines of a stiffness that jumps are more exact than in 2.6, which states what rings after a jump
(`truth_ringing`) as well. 2.5 has the scenes of 2.4, and samples that differ
by 0.1 % as a rule and up to 2 %: loads that vary and errors that jump are integrated more exactly. Versions 2.2 to 2.4
have the scenes, labels and samples of 2.1, each a more exact truth; 2.1 has other samples than 2.0. Version 2.0 has
imperfections, sizes and places of faults of its own: none of its records is one of 1.x. Before it, 1.5 changed the
truth of 1.4, 1.4 a label of 1.3, and 1.3 the last digits of 1.2.

## Authors, licence, citation

The HUMS toolkit developers, 2026. BSD-3-Clause, as the package. Cite as:

> The HUMS toolkit developers (2026), {name} {version}, seed {seed}, {records} records, hums-toolkit {package}.

`checksums.sha256` has the SHA-256 of every file, as `sha256sum -c` reads them: equal sums are the same dataset.

## Files and columns

`shards/*.h5` hold the records, HDF5 in netCDF4 layout, `index.h5` and `labels.csv` the labels of all of them, and
`plan.toml` what `hums dataset` makes them from again. Each record has the channel
`{sensor}` in m s-2, pulse times of the tachometer in s, and its truth. Columns:

| column | what | unit |
|---|---|---|
{columns}

## Splits

Gearboxes and paths of a split are in no other, so the test has machines that training has not seen. The order of the
records is shuffled; every gearbox of a split has every class about equally often.

| split | share | records | gearboxes | paths |
|---|---|---|---|---|
{splits}

## Classes

Column `class`; `class_number` counts the eleven classes from 0, and is -1 for the further labels {further}.
Sizes are drawn evenly in the logarithm; `severity` is 0 at the least and 1 at the greatest. A missing tooth is gross by
nature: it has one size and severity 1. What breaks off a part of a tooth is `chipping`.

| class | train | validation | test | size | range |
|---|---|---|---|---|---|
{classes}

Healthy shafts are balanced to G 6.3 or better, and healthy gears run out by what grade 8 allows: an imbalance below
severity 0.53 and an eccentricity below some 0.57 are within what sound machines have. They are labelled, and no method
can be expected to call them faults without having seen the machine before.

`detectability_db` is the signal-to-noise ratio of the filter matched to what the fault adds behind the measurement
chain: 10 log10 of the sum of its squares, each over the variance of the noise at that instant, from the record's first
{trial:g} s without noise, with and without the fault, scaled to 10 s; what speed and load do later in the record is not
in it. The noise is the sensor's: lines of the mains, knocks and the neighbour are not part of it. NaN for healthy
records. Below some 15 dB no method finds the fault; above it a method that does not know the machine may still miss it.
Where teeth part for moments, at light load, motions that differ by next to nothing drift apart, and even a tiny fault
has a number above that.

A plain classifier, multinomial logistic regression on the condition indicators and lines of the package, has a balanced
accuracy of {baseline} on the test records of seed 1, where a guess has 0.09 (`docs/benchmarks/dataset.md` of the
package).

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
- Where speed or torque varies, the lines of the truth leave out those at sums of the orders of different shafts; what
  rings after a jump is in `truth_ringing`. Where teeth part, lines are projected from the signal, and
  `truth_line_change` says how far each is known (without it, none is projected). `docs/benchmarks/truth.md` of the
  package has how much of the power all of them add up to.
- One sensor. No friction of teeth, no lubricant; backlash is the generator's default.
- Faults come alone and do not grow.
- Gear misalignment stands for all misalignment; couplings are not modelled.
"""


_COLUMNS = {
    "class": ("what is wrong, or healthy", ""),
    "class_number": ("of the eleven classes; -1 for the further labels", ""),
    "seed": ("of the record", ""),
    "machine_seed": ("of the gearbox: the same in all its records", ""),
    "split": ("train, validation or test", ""),
    "gearbox": ("name, as in the table below", ""),
    "stages": ("of the gearbox", ""),
    "path": ("transfer paths from the bearings to the sensor", ""),
    "component": ("what the fault sits on", ""),
    "severity": ("0 at the least and 1 at the greatest size; NaN if healthy", ""),
    "size_mm": ("the one dimension of the fault, as in the table of classes", "mm"),
    "speed_kind": ("steady, wander, ramp or step", ""),
    "torque_kind": ("steady, wander, ramp or step", ""),
    "rpm": ("speed of the input at the beginning", "rev min-1"),
    "load_share": ("torque of the output over full torque, at the beginning", ""),
    "detectability_db": ("signal-to-noise ratio of the matched filter, see below; NaN if healthy", "dB"),
}


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
    '# benchmark-1 2.8: synthetic gearbox vibration with labelled faults'
    """
    total = sum(split.share for split in benchmark.SPLITS.values())
    counts = Counter(plan.split_and_class(number) for number in range(plan.records))
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
        sensor=benchmark.SENSOR,
        baseline=BASELINE,
        package=package_version("hums-toolkit"),
        columns="\n".join(f"| {name} | {what} | {unit} |" for name, (what, unit) in _COLUMNS.items()),
        further=" and ".join(f"`{name}`" for name in benchmark.FURTHER),
        splits="\n".join(
            f"| {name} | {split.share / total:.0%} | {sum(n for (own, _), n in counts.items() if own == name)} | "
            f"{split.gearboxes[0]} to {split.gearboxes[-1]} | "
            f"{split.paths[0]} to {split.paths[-1]} |"
            for name, split in benchmark.SPLITS.items()
        ),
        classes="\n".join(_class_row(name, counts) for name in (*benchmark.CLASSES, *benchmark.FURTHER)),
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


def _class_row(name: str, counts: Counter[tuple[str, str]]) -> str:
    own = " | ".join(str(counts[split, name]) for split in benchmark.SPLITS)
    if name == "healthy":
        return f"| {name} | {own} | | |"
    family = FAULTS[name]
    low, high = family.sizes
    span = f"{low:g} to {high:g}" if low < high else f"{low:g}"
    words = DIMENSIONS[family.kind] + _FURTHER_WORDS.get(name, "")
    return f"| {name} | {own} | {words} | {span} {_UNITS[family.unit]} |"


def _imperfection_line(doc: str) -> str:
    """Return the first sentence of a docstring without its verb, as an item of a list."""
    return "- " + doc.splitlines()[0].removeprefix("Return ")

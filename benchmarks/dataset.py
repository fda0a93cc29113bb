"""The score of a plain classifier on benchmark-1.

    python benchmarks/dataset.py [--records N] [--workers N] [--data DIR] [--out DIR]

Makes the first N records of the benchmark (or goes on with those in DIR), analyses each with `hums.analyze`, and writes
dataset.md into --out (default docs/benchmarks). The classifier is multinomial logistic regression with an L2 penalty:
trained on the training split, its penalty chosen on the validation split, its score that of the test split.
"""

import argparse
import resource
import tempfile
import time
import tomllib
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from page_files import table, write_page
from scipy.optimize import minimize
from scipy.special import logsumexp, softmax

import hums
from data_synth import load_plan, make_dataset
from data_synth.plan import plans

Array = NDArray[np.float64]

CLASSES = tuple(each["name"] for each in tomllib.loads(plans()["benchmark-1"].read_text("utf-8"))["class"])
PENALTIES = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1, 1.0)
SEVERITIES = ((0.0, 1 / 3), (1 / 3, 2 / 3), (2 / 3, 1.01))
DETECTABLE_DB = (-np.inf, 15.0, 30.0, 50.0, np.inf)
NAMED_DB = 40.0  # as on the page of verdicts
KINDS = dict.fromkeys(("crack", "chipping", "missing tooth", "spall"), "tooth") | {
    "inner race": "inner_race",
    "outer race": "outer_race",
    "element": "rolling_element",
    "cage": "cage",
}
Findings = list[tuple[str, str, str]]  # component, kind, verdict

NOTE = """\
Made by `python benchmarks/dataset.py --records {records} --workers 2`: the first {records:,} records of {name},
seed {seed}; {train} for training, {validation} for the penalty ({penalty:g}), {test} for the score, from four gearboxes
that training has not seen.

The {features} features are from one `hums.analyze` with the drawing of the record: the logarithms of each indicator and
of the signal-to-noise ratio of each kind of line in the order and envelope spectra, maximum and mean over the parts of
the gearbox, so that gearboxes of one and of three stages have the same features. The classifier is multinomial logistic
regression with an L2 penalty on standardised features, with equal class weights. A recall of n records has a standard
deviation of up to 0.5 / sqrt(n)."""

VERDICTS = """\
Verdicts of the same analyses on all records, without a baseline. *Named first*: faults of at least {detectable:.0f} dB
whose part leads the findings; *of its shaft*: those with another gear of the shaft in the lead. *Diagnosed wrongly*:
records with a diagnosis of another part than the damaged one. Faults that affect a whole gear or shaft uniformly are
named only by limits or a baseline. The matched filter of the detectability knows the fault, and only noise limits it: a
fault of 40 dB may lie far below the mesh lines."""


# ---- Features ----------------------------------------------------------------------------------------------------


def features_of(record: "object") -> tuple[dict[str, float], Findings]:
    """Return the features of a record, by name, NaN where an indicator is withheld, and its findings."""
    gearbox = hums.Gearbox.from_mapping(tomllib.loads(record.attrs["truth_scene"])["gearbox"])  # type: ignore[attr-defined]
    tree = hums.analyze(record, gearbox, settings=hums.AnalysisSettings(most_tracks=0))  # type: ignore[arg-type]
    found: dict[str, float] = {}
    table = tree["indicators"].to_dataset().to_dataframe()
    for (kind, name), rows in table.groupby(["kind", "indicator"]):
        _add(found, f"{kind}, {name}", rows["value"].to_numpy(dtype=float))
    for spectrum in ("order_spectrum", "envelope"):
        lines = tree[spectrum].to_dataset()[["kind", "harmonic", "sideband", "snr"]].to_dataframe()
        lines["side"] = lines["sideband"] != 0
        for (kind, harmonic, side), rows in lines.groupby(["kind", "harmonic", "side"]):
            where = f"{spectrum}, {kind} {harmonic}{', sidebands' if side else ''}"
            _add(found, where, rows["snr"].to_numpy(dtype=float))
    findings = hums.findings_table(tree)
    return found, [*zip(findings["component"], findings["kind"], findings["verdict"], strict=True)]


def _add(found: dict[str, float], name: str, values: Array) -> None:
    logarithms = np.log10(np.abs(values[np.isfinite(values)]) + 1e-6)
    found[f"{name}, largest"] = float(np.max(logarithms)) if logarithms.size else np.nan
    found[f"{name}, mean"] = float(np.mean(logarithms)) if logarithms.size else np.nan


# ---- Classifier --------------------------------------------------------------------------------------------------


def fitted(x: Array, classes: NDArray[np.int64], *, penalty: float) -> Array:
    """Return the weights (features + 1, classes) of multinomial logistic regression, classes weighted equally."""
    count = len(CLASSES)
    design = np.column_stack([x, np.ones(len(x))])
    weight = 1 / np.maximum(np.bincount(classes, minlength=count), 1)[classes]
    weight /= weight.sum()
    target = np.eye(count)[classes]

    def loss(flat: Array) -> tuple[float, Array]:
        weights = flat.reshape(design.shape[1], count)
        scores = design @ weights
        value = weight @ (logsumexp(scores, axis=1) - np.sum(scores * target, axis=1))
        slope = design.T @ (weight[:, None] * (softmax(scores, axis=1) - target))
        held = weights * (np.arange(design.shape[1]) < x.shape[1])[:, None]  # the intercept is free
        return value + penalty / 2 * np.sum(held**2), (slope + penalty * held).ravel()

    start = np.zeros(design.shape[1] * count)
    return np.asarray(minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 500}).x).reshape(-1, count)


def predicted(x: Array, weights: Array) -> NDArray[np.int64]:
    """Return the most probable class of each row."""
    return np.argmax(np.column_stack([x, np.ones(len(x))]) @ weights, axis=1)


def balanced_accuracy(true: NDArray[np.int64], guess: NDArray[np.int64]) -> float:
    """Return the mean recall of the classes that occur."""
    return float(np.mean([np.mean(guess[true == each] == each) for each in np.unique(true)]))


def standardised(table: pd.DataFrame, train: NDArray[np.bool_]) -> Array:
    """Return features (records, features) in standard deviations of the training split, its medians where missing."""
    values = table.to_numpy(dtype=float)
    with_values = values[:, np.isfinite(values[train]).any(axis=0)]
    medians = np.nanmedian(with_values[train], axis=0)
    filled = np.where(np.isfinite(with_values), with_values, medians)
    spread = filled[train].std(axis=0)
    kept = spread > 0
    # a gearbox beyond all of training says no more than one at its edge
    return np.clip(((filled - filled[train].mean(axis=0)) / np.where(kept, spread, 1))[:, kept], -4, 4)


# ---- Page --------------------------------------------------------------------------------------------------------


def page(folder: Path, plan: "object", cost: str, *, workers: int) -> str:
    """Return the page of a dataset, with a sentence on what it cost."""
    opened = hums.open_dataset(folder)
    labels = pd.DataFrame({name: opened[name].to_numpy() for name in opened.coords if opened[name].dims == ("record",)})
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        rows = [*pool.map(partial(_features, folder), range(len(labels)), chunksize=10)]
    table, findings = pd.DataFrame([features for features, _ in rows]), [found for _, found in rows]
    return page_of(labels, table, findings, tomllib.loads(plan.text), cost)  # type: ignore[attr-defined]


def _features(folder: Path, number: int) -> tuple[dict[str, float], Findings]:
    return features_of(hums.dataset_record(folder, number))


def page_of(
    labels: pd.DataFrame, features: pd.DataFrame, findings: list[Findings], plan: dict[str, Any], cost: str
) -> str:
    """Return the page of labels, features and findings, a row for each record, of a plan as TOML has it."""
    said = verdicts_of(labels, findings)
    split = {name: (labels["split"] == name).to_numpy() for name in ("train", "validation", "test")}
    x, classes = standardised(features, split["train"]), np.array([CLASSES.index(name) for name in labels["class"]])

    def score(penalty: float) -> float:
        weights = fitted(x[split["train"]], classes[split["train"]], penalty=penalty)
        return balanced_accuracy(classes[split["validation"]], predicted(x[split["validation"]], weights))

    penalty = max(PENALTIES, key=score)
    weights = fitted(x[split["train"]], classes[split["train"]], penalty=penalty)
    test = labels[split["test"]].assign(true=classes[split["test"]], guess=predicted(x[split["test"]], weights))
    own = predicted(x[split["train"]], weights)
    note = NOTE.format(
        records=plan["records"],
        name=plan["title"].partition(":")[0],
        seed=plan["seed"],
        penalty=penalty,
        features=x.shape[1],
        **{name: int(mask.sum()) for name, mask in split.items()},
    )
    right = test["true"] == test["guess"]
    lines = ["# Dataset benchmark-1: a plain classifier", "", note, ""]
    lines.append(
        f"Balanced accuracy {balanced_accuracy(test['true'].to_numpy(), test['guess'].to_numpy()):.2f} on test "
        f"({balanced_accuracy(classes[split['train']], own):.2f} on training); "
        f"a guess has {1 / len(CLASSES):.2f}."
    )
    rows: list[tuple[object, ...]] = []
    for number, name in enumerate(CLASSES):
        mine, called = test[test["true"] == number], test[test["guess"] == number]
        wrong = mine[mine["guess"] != number]["guess"].value_counts()
        taken = CLASSES[int(wrong.index[0])] if len(wrong) else ""
        recall = f"{np.mean(mine['guess'] == number):.2f}" if len(mine) else ""
        precision = f"{np.mean(called['true'] == number):.2f}" if len(called) else ""
        rows.append((name, len(mine), recall, precision, taken))
    lines += ["", *table(("class", "test records", "recall", "precision", "most often taken for"), rows)]
    faulty, rows = test["true"] > 0, []
    for low, high in SEVERITIES:
        here = faulty & (test["severity"] >= low) & (test["severity"] < high)
        rows.append((f"severity {low:.2f} to {min(high, 1):.2f}", here.sum(), _share(right[here])))
    for low, high in pairwise(DETECTABLE_DB):
        here = faulty & (test["detectability_db"] >= low) & (test["detectability_db"] < high)
        span = f"below {high:g}" if low == -np.inf else f"above {low:g}" if high == np.inf else f"{low:g} to {high:g}"
        rows.append((f"detectability {span} dB", here.sum(), _share(right[here])))
    lines += table(("faults of", "test records", "right class"), rows)
    return "\n".join([*lines, *said, cost]).rstrip() + "\n"


def verdicts_of(labels: pd.DataFrame, findings: list[Findings]) -> list[str]:
    """Return the lines of the table of verdicts, a row for each class."""
    rows: list[tuple[object, ...]] = []
    for name in CLASSES:
        mine = [
            (row, found) for (_, row), found in zip(labels.iterrows(), findings, strict=True) if row["class"] == name
        ]
        detectable = [(row, found) for row, found in mine if row["detectability_db"] >= NAMED_DB]
        kind, first, beside = KINDS.get(name), 0, 0
        for row, found in detectable:
            component = found[0][0] if found else ""
            first += bool(found) and (component, found[0][1]) == (row["component"], kind)
            beside += (
                kind == "tooth"
                and component not in ("", row["component"])
                and _shaft(component) == _shaft(row["component"])
            )
        wrong = sum(
            any(verdict == "diagnosed" and (part, what) != (row["component"], kind) for part, what, verdict in found)
            for row, found in mine
        )
        counts = (len(detectable), first, beside if kind == "tooth" else "") if kind else ("", "", "")
        rows.append((name, len(mine), *counts, wrong))
    head = ("class", "records", "of them detectable", "named first", "of its shaft", "diagnosed wrongly")
    return ["## Verdicts", "", VERDICTS.format(detectable=NAMED_DB), "", *table(head, rows)]


def _shaft(component: str) -> str:
    return component.rpartition("/")[2]


def _share(right: pd.Series) -> str:
    return f"{right.mean():.2f}" if len(right) else ""


def _cpu_s() -> float:
    """Return the time of the processor that this process and its children have had, s."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


def main() -> None:
    """Make the records, score the classifier, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks"))
    chosen = parser.parse_args()
    plan = load_plan("benchmark-1").changed(records=chosen.records)
    with tempfile.TemporaryDirectory() as scratch:
        folder = chosen.data or Path(scratch) / "benchmark-1"
        begun, used = time.perf_counter(), _cpu_s()
        workers = hums.Processes(count=chosen.workers) if chosen.workers > 1 else None
        cost = ""
        if not make_dataset(plan, folder, workers=workers).kept:
            cost = (
                f"Making a record took {(_cpu_s() - used) / plan.records:.2f} s of one core, all of them "
                f"{(time.perf_counter() - begun) / 60:.1f} minutes; worker processes: {chosen.workers}."
            )
        text = page(folder, plan, cost, workers=chosen.workers)
    write_page(chosen.out / "dataset.md", [text])


if __name__ == "__main__":
    main()

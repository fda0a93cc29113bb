"""The data card of a dataset: its files, labels, classes and machines."""

from collections import Counter
from importlib.metadata import version
from pathlib import Path

import numpy as np

from data_synth.plan import Plan
from data_synth.scene.faults import DIMENSIONS


def data_card(plan: Plan) -> str:
    """Return the data card of a plan, in Markdown.

    Examples
    --------
    >>> from data_synth import load_plan
    >>> from data_synth.card import data_card
    >>> data_card(load_plan("benchmark-1").changed(records=20)).splitlines()[0]
    '# benchmark-1 3.1: synthetic gearbox vibration with labelled faults'
    """
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415 - heavy

    rows = [plan.labels(number) for number in range(plan.records)]
    labels = {name: _shown([row[name] for row in rows]) for name in rows[0]}
    if plan.table.detectability_s is not None:
        labels["detectability_db"] = ""
    first = {plan.class_of(number): number for number in reversed(range(plan.records))}
    page = Environment(autoescape=False, trim_blocks=True, undefined=StrictUndefined)  # noqa: S701 - no HTML
    return page.from_string(Path(__file__).with_name("data-card.md.jinja").read_text(encoding="utf-8")).render(
        plan=plan,
        scene=plan.scene(0),
        package=version("hums-toolkit"),
        labels=labels,
        splits=list(dict.fromkeys(row.get("split", "") for row in rows)),
        counts=Counter((row["class"], row.get("split", "")) for row in rows),
        classes={name: plan.scene(first[name]).faults if name in first else () for name in plan.classes},
        dimensions=DIMENSIONS,
        machines=[(machine, plan.scene(number)) for number, machine in enumerate(plan.machines[: plan.records])],
        of_machine=Counter(row.get("machine") for row in rows),
    )


def _shown(column: list[object]) -> str:
    """Return the values of a label as text: the range of its numbers, or the list of its texts."""
    numbers = np.array([value for value in column if isinstance(value, float) and value == value])  # noqa: PLR0124
    texts = dict.fromkeys(str(value) for value in column if isinstance(value, str) and value)
    return f"{numbers.min():.3g} to {numbers.max():.3g}" if numbers.size else ", ".join(texts)

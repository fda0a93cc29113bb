"""Detectability of the least, the middle and the greatest size of every class of benchmark-1.

    python benchmarks/detectability.py --records 2

prints the table of `docs/datasets.md`: decibels for the first records of each class in gearboxes of one or two stages,
from half a second, scaled to a record of ten.
"""

import argparse
import math
import sys
from itertools import islice

from data_synth import Plan, load_plan
from data_synth.simulation import fault_detectability

SECONDS = 0.5
SEVERITIES = (0.0, 0.5, 1.0)
SCALE_DB = 10 * math.log10(10 / SECONDS)  # to a record of ten


def detectability_db(plan: Plan, number: int, severity: float) -> float:
    """Return the detectability of a record's fault at another severity."""
    scene = plan.scene(number, {"severity": severity}).changed(duration_s=SECONDS)
    return (
        float(fault_detectability(scene, seed=plan.seed_of(number), machine_seed=plan.machine_seed_of(number))[0, 0])
        + SCALE_DB
    )


def main(arguments: list[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=2, help="of each class")
    asked = parser.parse_args(arguments)
    plan = load_plan("benchmark-1")
    labels = [plan.labels(number) for number in range(plan.records)]
    print("| class | severity 0 | 0.5 | 1 |\n|---|---|---|---|")  # noqa: T201 - what the command is for
    for name in plan.classes[1:]:
        here = (n for n, own in enumerate(labels) if own["class"] == name and "three" not in own["machine"])
        numbers = [*islice(here, asked.records)]
        cells = [
            ", ".join(f"{detectability_db(plan, number, severity):.0f}" for number in numbers)
            for severity in SEVERITIES
        ]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""What the solver may cost: work and memory that grow with the links, where a dense solution grows with their cube."""

import tracemalloc

import pytest
from counting import calls

from hums.gearbox.defect_orders import defect_orders
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox


def train(links):
    """A train of gears in a row, each on an axis of its own."""
    axes = {f"a{i}": ["frame", f"s{i}"] for i in range(links - 1)}
    mesh = [{"teeth": {f"s{i}": 20 + i % 7, f"s{i + 1}": 31 + i % 5}} for i in range(links - 2)]
    return Gearbox.from_mapping({"name": "t", "frame": "frame", "reference": "s0", "axes": axes, "mesh": mesh})


def solve(gearbox):
    last = f"s{len(gearbox.links) - 2}"
    return solve_kinematics(gearbox).relative_speed(last, seen_from="frame")


@pytest.mark.parametrize("action", [solve, defect_orders])
def test_twice_the_links_are_twice_the_work(action):
    counts = {}
    for links in (60, 120):
        gearbox = train(links)
        action(gearbox)  # whatever is imported and cached by the first call
        counts[links] = calls(lambda gearbox=gearbox: action(gearbox))
    # each link once for each before it would be four times as many, pairs of pairs eight times
    assert counts[120] < 2.2 * counts[60]


def test_a_thousand_links_take_no_dense_matrix():
    gearbox = train(1000)
    kinematics = solve_kinematics(gearbox)
    assert len(kinematics.links) == 1000
    tracemalloc.start()
    solve(gearbox)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # a matrix of all links by all meshes has a million numbers
    assert peak < 8 * 1000**2 / 2

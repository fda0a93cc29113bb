import gzip

import pytest
from fleets import HEALTHY, PINION, followed, observed

from hums.fleet.monitor import update
from hums.fleet.monitor_settings import MonitorError
from hums.fleet.state import read_state, write_state

LATER = [observed(number, **PINION) for number in range(40, 50)]


@pytest.mark.parametrize("stopped", [7, 30, 42])
def test_saved_and_resumed_it_goes_on_bit_for_bit(tmp_path, stopped):
    course = [*HEALTHY, *LATER]
    through, found = followed(course)
    state, _ = followed(course[:stopped])
    write_state(state, tmp_path / "state")
    resumed = read_state(tmp_path / "state")
    again = [update(resumed, one) for one in course[stopped:]]
    assert [one.index for one in again] == [one.index for one in found[stopped:]]
    write_state(through, tmp_path / "through")
    write_state(resumed, tmp_path / "resumed")
    assert (tmp_path / "through").read_bytes() == (tmp_path / "resumed").read_bytes()


def test_its_size_does_not_grow(tmp_path):
    sizes = []
    state, _ = followed(HEALTHY)
    for number in range(40, 400):
        update(state, observed(number))
        if number in (60, 399):
            write_state(state, tmp_path / "state")
            sizes.append((tmp_path / "state").stat().st_size)
    assert sizes[1] < 1.1 * sizes[0]  # numbers of other digits compress a little differently


@pytest.mark.parametrize(
    "damaged",
    [
        b"nothing",
        gzip.compress(b"[]"),
        gzip.compress(b'{"schema": "hums-watch/13", "state": ["array", "O", [2], [1]]}'),
        gzip.compress(b"[" * 100_000),
        gzip.compress(b"{}" * 1000)[:-20] + bytes(20),
    ],
    ids=["text", "list", "array", "deep", "torn"],
)
def test_what_is_no_state(tmp_path, damaged):
    (tmp_path / "state").write_bytes(damaged)
    with pytest.raises(MonitorError, match=r"not a state of hums\.watch"):
        read_state(tmp_path / "state")

import copy
import mmap
import threading

import numpy as np
import pytest

from signals import _memory
from signals._memory import LARGE, SPACIOUS, WAITING, room

COUNT = LARGE // 8
kept = pytest.mark.skipif(not hasattr(mmap, "MADV_FREE"), reason="this system takes all memory back at once")


@pytest.fixture(autouse=True)
def _nothing_waits():
    _memory._waiting.clear()
    yield
    _memory._waiting.clear()


def place(array):
    return array.ctypes.data


@pytest.mark.parametrize("count", [1, 1000, COUNT - 1, COUNT, COUNT + 3])
def test_room_has_the_size_asked_for_and_begins_a_line(count):
    array = room(count)
    array[:] = 1.5
    assert array.shape == (count,)
    assert array.sum() == 1.5 * count
    assert place(array) % 64 == 0


@pytest.mark.parametrize("shape", [(3, 5), (2, COUNT // 4, 3)])
def test_room_has_the_shape_asked_for(shape):
    assert room(*shape).shape == shape


@kept
def test_room_of_a_result_that_is_gone_is_used_again():
    first = room(COUNT)
    where = place(first)
    del first
    assert place(room(COUNT)) == where


@kept
def test_room_is_held_as_long_as_any_view_of_it():
    first = room(COUNT)
    view = first.view(np.complex128).reshape(4, -1)[2, 5:9].real
    view[:] = [1, 2, 3, 4]
    del first
    other = room(COUNT)
    other[:] = 0.0
    np.testing.assert_array_equal(view, [1, 2, 3, 4])
    assert not np.shares_memory(view, other)


@kept
def test_a_room_much_too_large_is_left_to_others():
    large = room(int(4 * SPACIOUS * COUNT))
    where = place(large)
    del large
    assert place(room(COUNT)) != where
    assert place(room(int(2 * SPACIOUS * COUNT))) == where


@kept
def test_no_more_rooms_wait_than_are_said_to():
    rooms = [room(COUNT) for _ in range(3 * WAITING)]
    assert len({place(one) for one in rooms}) == 3 * WAITING
    del rooms
    assert len(_memory._waiting) == WAITING


@kept
def test_threads_never_get_the_same_room():
    broken = []

    def work(number):
        for _ in range(200):
            array = room(COUNT)
            array[::512] = number
            if not (array[::512] == number).all():
                broken.append(number)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not broken


def test_a_copied_array_stands_on_its_own():
    array = room(COUNT)
    array[:] = np.arange(COUNT)
    again = copy.deepcopy(array)
    np.testing.assert_array_equal(again, array)
    assert not np.shares_memory(again, array)


def test_without_offers_to_the_system_nothing_waits(monkeypatch):
    monkeypatch.setattr(_memory, "_OFFER", None)
    array = room(COUNT)
    assert place(array) % 64 == 0
    del array
    assert not _memory._waiting

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from signals._validation import ArgumentTypeError, checked

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike


@checked
def taken(
    number: float | None = None,
    *,
    x: ArrayLike = (),
    pair: tuple[float, float] | None = None,
    rows: Sequence[str] = (),
    table: Mapping[str, float] | None = None,
) -> None:
    """Take arguments of several kinds."""


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("number", 3, 10**400),  # larger than a float
        ("number", 3.0, "3"),
        ("x", [[1, 2], [3, 4]], [[1, 2], [3]]),
        ("pair", (1.0, 2.0), (1.0, "2")),
        ("pair", np.zeros(2), np.zeros(3)),
        ("rows", ["a", "b"], ["a", 1]),
        ("table", {"a": 1.0}, {"a": "1"}),
    ],
)
def test_a_value_of_a_type_that_agreed_is_refused_for_what_it_holds(name, good, bad):
    taken(**{name: good})
    taken(**{name: good})
    with pytest.raises(ArgumentTypeError, match=f"taken takes .* for {name}, not"):
        taken(**{name: bad})

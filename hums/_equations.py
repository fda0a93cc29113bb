"""Linear equations in named unknowns with a constant term, solved one by one in rational arithmetic."""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction

from hums._forms import Form, add_pivot, reduced

CONSTANT = ""  # the name of a form's constant term; no unknown has an empty name
_ZERO = Fraction(0)


def add(form: Form, more: Form) -> None:
    """Add one form to another in place; terms that cancel stay as zeros."""
    for name, factor in more.items():
        form[name] = form.get(name, _ZERO) + factor


def solve(equations: Iterable[Form]) -> tuple[dict[str, Form], list[Fraction]]:
    """Solve ``form = 0`` for all: unknowns by those left open, and what is left over of each equation."""
    solved: dict[str, Form] = {}
    left_over = [join(form, solved) for form in equations]
    return solved, left_over


def join(form: Form, solved: dict[str, Form], *, last: Sequence[str] = ()) -> Fraction:
    """Add the equation ``form = 0``, solved for an unknown that comes late in `last`.

    Returns the constant of the form where no unknown is left to satisfy it, otherwise zero.
    """
    left = reduced(form, solved)
    unknowns = [name for name in left if name != CONSTANT]
    if not unknowns:
        return left.get(CONSTANT, _ZERO)
    unknown = max(unknowns, key=last.index) if last else unknowns[0]
    add_pivot(solved, left, unknown)
    return _ZERO


def determined(solved: Mapping[str, Form]) -> dict[str, Fraction]:
    """Return the unknowns whose expression holds no other unknown."""
    return {name: terms.get(CONSTANT, _ZERO) for name, terms in solved.items() if set(terms) <= {CONSTANT}}

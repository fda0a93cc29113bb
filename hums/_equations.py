"""Systems of linear equations in named unknowns with constant terms, by Gauss-Jordan elimination in fractions."""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction

from hums._forms import Form, add_pivot, reduced

CONSTANT = ""  # the name of a form's constant term; no unknown has an empty name
_ZERO = Fraction(0)


def add(form: Form, more: Form) -> None:
    """Add one form to another in place; terms that cancel remain as zeros."""
    for name, factor in more.items():
        form[name] = form.get(name, _ZERO) + factor


def solve(equations: Iterable[Form]) -> tuple[dict[str, Form], list[Fraction]]:
    """Solve the equations ``form = 0``.

    Returns
    -------
    solved : dict of str to form
        Each unknown that the equations fix, expressed by the free ones and the constant.
    residuals : list of Fraction
        Of each equation: zero, or the constant that contradicts the equations before it.
    """
    solved: dict[str, Form] = {}
    residuals = [eliminate(form, solved) for form in equations]
    return solved, residuals


def eliminate(form: Form, solved: dict[str, Form], *, last: Sequence[str] = ()) -> Fraction:
    """Solve the equation ``form = 0`` for the unknown that comes last in `last`, and substitute it in `solved`.

    Returns the residual: the constant of the form where it has no unknown left, otherwise zero.
    """
    residual = reduced(form, solved)
    unknowns = [name for name in residual if name != CONSTANT]
    if not unknowns:
        return residual.get(CONSTANT, _ZERO)
    unknown = max(unknowns, key=last.index) if last else unknowns[0]
    add_pivot(solved, residual, unknown)
    return _ZERO


def determined(solved: Mapping[str, Form]) -> dict[str, Fraction]:
    """Return the values of the unknowns whose expression contains no free unknown."""
    return {name: terms.get(CONSTANT, _ZERO) for name, terms in solved.items() if set(terms) <= {CONSTANT}}

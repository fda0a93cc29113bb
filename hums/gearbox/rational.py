"""Linear equations in named unknowns with constant terms, solved by Gauss-Jordan elimination in rational arithmetic."""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction

# ---- Sparse linear forms in named unknowns, for the solvers of speeds and torques ------------------------------------
# Equations are eliminated one by one: `pivots` holds each unknown expressed by the free ones.


Form = dict[str, Fraction]  # non-zero factor of each unknown
ZERO, ONE = Fraction(0), Fraction(1)


def difference(a: Form, b: Form) -> Form:
    """Return the difference of two forms, without terms that cancel."""
    total = dict(a)
    for body, factor in b.items():
        total[body] = total.get(body, ZERO) - factor
    return {body: factor for body, factor in total.items() if factor}


def evaluate(form: Mapping[str, Fraction], rates: Mapping[str, Fraction]) -> Fraction:
    """Return the value of a linear form in the joint rates."""
    terms = [rates[body] if factor == 1 else factor * rates[body] for body, factor in form.items()]
    return terms[0] if len(terms) == 1 else sum(terms, ZERO)


def reduced(form: Mapping[str, Fraction], pivots: Mapping[str, Form]) -> Form:
    """Return `form` with every pivot replaced by its expression in free unknowns."""
    result: Form = {}
    for name, factor in form.items():
        if name not in pivots:
            result[name] = result.get(name, ZERO) + factor
            continue
        for other, coefficient in pivots[name].items():
            result[other] = result.get(other, ZERO) + factor * coefficient
    return {name: factor for name, factor in result.items() if factor}


def add_pivot(pivots: dict[str, Form], row: Form, name: str, *, users: dict[str, set[str]] | None = None) -> None:
    """Solve ``row = 0`` for `name` and substitute it in all pivots.

    `users`, an index of the pivots whose expression contains an unknown, makes this faster and is updated.
    """
    scale = -1 / row[name]
    expression = {other: factor * scale for other, factor in row.items() if other != name}
    used_by = pivots if users is None else users.pop(name, set())
    for earlier in tuple(used_by):
        terms = pivots[earlier]
        if name in terms:
            pivots[earlier] = reduced(terms, {name: expression})
            _add_user(users, earlier, expression)
    pivots[name] = expression
    _add_user(users, name, expression)


def _add_user(users: dict[str, set[str]] | None, pivot: str, expression: Form) -> None:
    if users is not None:
        for other in expression:
            users.setdefault(other, set()).add(pivot)


# ---- Rational --------------------------------------------------------------------------------------------------------


CONSTANT = ""  # name of a form's constant term, as no unknown has an empty name


def add(form: Form, more: Form) -> None:
    """Add one form to another in place; terms that cancel remain as zeros."""
    for name, factor in more.items():
        form[name] = form.get(name, ZERO) + factor


def solve(equations: Iterable[Form]) -> tuple[dict[str, Form], list[Fraction]]:
    """Solve the equations ``form = 0``.

    Returns
    -------
    solved : dict of str to form
        Each dependent unknown, expressed by the free ones and the constant.
    residuals : list of Fraction
        For each equation, zero or the constant by which it contradicts earlier ones.
    """
    solved: dict[str, Form] = {}
    residuals = [eliminate(form, solved) for form in equations]
    return solved, residuals


def eliminate(form: Form, solved: dict[str, Form], *, last: Sequence[str] = ()) -> Fraction:
    """Solve the equation ``form = 0`` for the unknown that comes last in `last`, and substitute it in `solved`.

    Returns the residual: the constant of the form if it has no unknown left, otherwise zero.
    """
    residual = reduced(form, solved)
    unknowns = [name for name in residual if name != CONSTANT]
    if not unknowns:
        return residual.get(CONSTANT, ZERO)
    unknown = max(unknowns, key=last.index) if last else unknowns[0]
    add_pivot(solved, residual, unknown)
    return ZERO


def determined(solved: Mapping[str, Form]) -> dict[str, Fraction]:
    """Return the values of the unknowns whose expression contains no free unknown."""
    return {name: terms.get(CONSTANT, ZERO) for name, terms in solved.items() if set(terms) <= {CONSTANT}}

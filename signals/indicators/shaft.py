"""Indicators of a shaft: the amplitudes of its own first orders in its average.

Večeř, Kreidl & Šmíd (2005), "Condition indicators for gearbox condition monitoring systems", Acta Polytechnica 45(6).
"""

from signals._checks import whole
from signals.averaging import SynchronousAverage
from signals.indicators._kinds import expect


def shaft_order(average: SynchronousAverage, *, order: int) -> float:
    """Return the peak amplitude of one order of the shaft, in the unit of the record.

    Parameters
    ----------
    average : SynchronousAverage
        Of that shaft.
    order : int
        1: unbalance, bow. 2: misalignment, ovality, a coupling. 3: a three-jaw coupling, misalignment.
    """
    expect(average, SynchronousAverage, indicator=f"SO{order}")
    return line_amplitude(average, order)


def so1(average: SynchronousAverage) -> float:
    """Return the once-per-revolution amplitude of a shaft's average (Večeř, Kreidl & Šmíd 2005)."""
    return shaft_order(average, order=1)


def so2(average: SynchronousAverage) -> float:
    """Return the twice-per-revolution amplitude of a shaft's average (Večeř, Kreidl & Šmíd 2005)."""
    return shaft_order(average, order=2)


def so3(average: SynchronousAverage) -> float:
    """Return the three-per-revolution amplitude of a shaft's average (Večeř, Kreidl & Šmíd 2005)."""
    return shaft_order(average, order=3)


def line_amplitude(average: SynchronousAverage, order: int) -> float:
    """Return the peak amplitude of a whole order of an average, or refuse one that it does not pass.

    Raises
    ------
    ValueError
        An order above what the average passes unchanged.
    """
    whole(order, name="order", least=1)
    last = int(min(average.passband_orders, (average.samples_per_rev - 1) // 2))
    if order > last:
        raise ValueError(
            f"order {order} lies above {last}, the highest that this average of {average.samples_per_rev} samples "
            "a revolution passes; take more samples a revolution."
        )
    return float(abs(average.complex_amplitude[order]))

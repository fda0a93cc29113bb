"""Indicators of a shaft: the amplitudes of its first orders in its time synchronous average.

Večeř, Kreidl & Šmíd (2005), "Condition indicators for gearbox condition monitoring systems", Acta Polytechnica 45(6).

The examples start from what the docstring of `signals.indicators` defines.
"""

from signals._validation import checked, whole
from signals.angle.averaging import SynchronousAverage
from signals.indicators._kinds import expect


@checked
def shaft_order(average: SynchronousAverage, *, order: int) -> float:
    """Return the peak amplitude of one order of the shaft, in the unit of the record.

    Parameters
    ----------
    average : SynchronousAverage
        Of that shaft.
    order : int
        1: unbalance, bow. 2: misalignment, ovality, a coupling. 3: a three-jaw coupling, misalignment.

    Raises
    ------
    ValueError
        An order above the passband of the average.

    Examples
    --------
    >>> from signals.indicators import shaft_order
    >>> round(shaft_order(average_of(3 * np.cos(angle) + np.cos(2 * angle)), order=1), 6)
    3.0
    """
    expect(average, SynchronousAverage, indicator=f"SO{order}")
    return line_amplitude(average, order)


@checked
def so1(average: SynchronousAverage) -> float:
    """Return the peak amplitude at order 1 of a shaft's average, in the unit of the record (Večeř et al. 2005).

    Parameters
    ----------
    average : SynchronousAverage
        Of that shaft.

    Examples
    --------
    >>> from signals.indicators import so1
    >>> round(so1(average_of(2 * np.cos(angle))), 6)
    2.0
    """
    return shaft_order(average, order=1)


@checked
def so2(average: SynchronousAverage) -> float:
    """Return the peak amplitude at order 2 of a shaft's average, in the unit of the record (Večeř et al. 2005).

    Parameters
    ----------
    average : SynchronousAverage
        Of that shaft.

    Examples
    --------
    >>> from signals.indicators import so2
    >>> round(so2(average_of(2 * np.cos(2 * angle))), 6)
    2.0
    """
    return shaft_order(average, order=2)


@checked
def so3(average: SynchronousAverage) -> float:
    """Return the peak amplitude at order 3 of a shaft's average, in the unit of the record (Večeř et al. 2005).

    Parameters
    ----------
    average : SynchronousAverage
        Of that shaft.

    Examples
    --------
    >>> from signals.indicators import so3
    >>> round(so3(average_of(2 * np.cos(3 * angle))), 6)
    2.0
    """
    return shaft_order(average, order=3)


def line_amplitude(average: SynchronousAverage, order: int) -> float:
    """Return the peak amplitude of a whole order of an average, or refuse an order above its passband."""
    whole(order, name="order", least=1)
    last = int(min(average.passband_orders, (average.samples_per_rev - 1) // 2))
    if order > last:
        raise ValueError(
            f"order {order} lies above {last}, the highest that this average of {average.samples_per_rev} samples "
            "per revolution resolves; take more samples per revolution."
        )
    return float(abs(average.complex_amplitude[order]))

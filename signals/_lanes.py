"""Four or eight numbers side by side, as a processor's vector register holds them, for use inside compiled kernels.

The compiler vectorises a plain loop as it sees fit: with checks for overlapping arrays before it and single numbers
after it, which for rows of twenty numbers cost more than the loop. Kernels written in lanes say what they want.
`multiply_add` rounds once, on every machine, and takes single numbers too. Lanes are four numbers of a row, `WIDE`
ones eight samples; a processor whose registers hold fewer takes several for them.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

LANES, WIDE = 4, 8

_DOUBLE = ir.DoubleType()
_INDEX = ir.IntType(32)


class LanesType(types.Type):
    """The type kernels give to some numbers side by side."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.vector = ir.VectorType(_DOUBLE, count)
        super().__init__(name=f"Lanes({count})")  # type: ignore[no-untyped-call]


Lanes = Any
_LANES = cast("Any", LanesType)(LANES)
_WIDE = wide_type = cast("Any", LanesType)(WIDE)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: object, kernel_type: LanesType) -> None:
        super().__init__(manager, kernel_type, kernel_type.vector)


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:  # noqa: ANN401
    return builder.gep(context.make_array(array_type)(context, builder, array).data, [index])


def _shuffled(builder: Any, a: Any, b: Any, lanes: list[int]) -> Any:  # noqa: ANN401
    """Lanes of two vectors, those of the second counted on from those of the first."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_INDEX, len(lanes)), lanes))


def _spread_value(builder: Any, value: Any, kind: Any) -> Any:  # noqa: ANN401
    undefined = ir.Constant(kind.vector, ir.Undefined)
    return _shuffled(builder, builder.insert_element(undefined, value, _INDEX(0)), undefined, [0] * kind.count)


def _load(kind: Any) -> Callable[..., Any]:  # noqa: ANN401
    def typed(_: object, array: Any, index: object) -> Any:  # noqa: ANN401, ARG001
        def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
            place = _pointer(context, builder, signature.args[0], *values)
            return builder.load(builder.bitcast(place, kind.vector.as_pointer()), align=8)

        return kind(array, types.intp), build

    return typed


def _repeat(kind: Any) -> Callable[..., Any]:  # noqa: ANN401
    def typed(_: object, array: Any, index: object) -> Any:  # noqa: ANN401, ARG001
        def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
            value = builder.load(_pointer(context, builder, signature.args[0], *values))
            return _spread_value(builder, value, kind)

        return kind(array, types.intp), build

    return typed


def _spread(kind: Any) -> Callable[..., Any]:  # noqa: ANN401
    def typed(_: object, value: object) -> Any:  # noqa: ANN401, ARG001
        def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
            return _spread_value(builder, values[0], kind)

        return kind(types.float64), build

    return typed


def _store(_: object, array: Any, index: object, lanes: Any) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        place = _pointer(context, builder, signature.args[0], *values[:2])
        builder.store(values[2], builder.bitcast(place, lanes.vector.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), build


def _total(_: object, lanes: Any) -> Any:  # noqa: ANN401
    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        parts, count = values[0], lanes.count
        while count > LANES:
            count //= 2
            low, high = (list(range(first, first + count)) for first in (0, count))
            parts = builder.fadd(_shuffled(builder, parts, parts, low), _shuffled(builder, parts, parts, high))
        ends = [builder.extract_element(parts, _INDEX(lane)) for lane in range(LANES)]
        return builder.fadd(builder.fadd(ends[0], ends[1]), builder.fadd(ends[2], ends[3]))

    return types.float64(lanes), build


def _powers(_: object, value: object) -> Any:  # noqa: ANN401, ARG001
    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        ones = ir.Constant(_WIDE.vector, [1.0] * WIDE)
        power, product = _spread_value(builder, values[0], _WIDE), ones
        for bit in (1, 2, 4):
            lanes = [lane + WIDE if lane & bit else lane for lane in range(WIDE)]
            product = builder.fmul(product, _shuffled(builder, ones, power, lanes))
            power = builder.fmul(power, power)
        return product

    return _WIDE(types.float64), build


def _running_sums(_: object, lanes: Any) -> Any:  # noqa: ANN401
    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        sums, zeros, shift = values[0], ir.Constant(lanes.vector, None), 1
        while shift < lanes.count:
            # Of two neighbours of so many lanes, the last sum of the first adds to all of the second.
            end = [lane // shift * shift - 1 + lanes.count if lane & shift else lane for lane in range(lanes.count)]
            sums = builder.fadd(sums, _shuffled(builder, zeros, sums, end))
            shift *= 2
        return sums

    return lanes(lanes), build


def _interleave(_: object, even: Any, odd: object, target: Any, at: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        count = even.count
        for half in range(2):
            first = half * count // 2
            lanes = [lane + part * count for lane in range(first, first + count // 2) for part in range(2)]
            index = builder.add(values[3], ir.Constant(values[3].type, half * count))
            place = builder.bitcast(
                _pointer(context, builder, signature.args[2], values[2], index), even.vector.as_pointer()
            )
            builder.store(_shuffled(builder, values[0], values[1], lanes), place, align=8)
        return context.get_dummy_value()

    return types.void(even, even, target, types.intp), build


def _multiply_add(_: object, a: Any, b: object, c: object) -> Any:  # noqa: ANN401, ARG001
    wide = isinstance(a, LanesType)
    kind, name, value = (a, f"llvm.fma.v{a.count}f64", a.vector) if wide else (types.float64, "llvm.fma.f64", _DOUBLE)

    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        function = cast("Any", cgutils).get_or_insert_function(
            builder.module, ir.FunctionType(value, [value] * 3), name
        )
        return builder.call(function, values)

    return kind(kind, kind, kind), build


def _pairwise(operation: str) -> Callable[..., Any]:
    def typed(_: object, a: Any, b: object) -> Any:  # noqa: ANN401, ARG001
        kind = a if isinstance(a, LanesType) else types.float64

        def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
            return getattr(builder, operation)(*values)

        return kind(kind, kind), build

    return typed


def _negative(_: object, a: Any) -> Any:  # noqa: ANN401
    kind = a if isinstance(a, LanesType) else types.float64

    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        return builder.fneg(*values)

    return kind(kind), build


load: Callable[..., Lanes] = intrinsic(_load(_LANES))
load_wide: Callable[..., Lanes] = intrinsic(_load(_WIDE))
repeat: Callable[..., Lanes] = intrinsic(_repeat(_LANES))
repeat_wide: Callable[..., Lanes] = intrinsic(_repeat(_WIDE))
spread: Callable[..., Lanes] = intrinsic(_spread(_LANES))
spread_wide: Callable[..., Lanes] = intrinsic(_spread(_WIDE))
store: Callable[..., None] = intrinsic(_store)
total: Callable[..., Any] = intrinsic(_total)
powers: Callable[..., Lanes] = intrinsic(_powers)  # 1, v, ... v^7
running_sums: Callable[..., Lanes] = intrinsic(_running_sums)
interleave: Callable[..., None] = intrinsic(_interleave)
multiply_add: Callable[..., Any] = intrinsic(_multiply_add)
plus: Callable[..., Any] = intrinsic(_pairwise("fadd"))
minus: Callable[..., Any] = intrinsic(_pairwise("fsub"))
times: Callable[..., Any] = intrinsic(_pairwise("fmul"))
negative: Callable[..., Any] = intrinsic(_negative)

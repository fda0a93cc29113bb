"""Four numbers side by side, as a processor's vector register holds them, for use inside compiled kernels.

The compiler vectorises a plain loop as it sees fit: with checks for overlapping arrays before it and single numbers
after it, which for rows of twenty numbers cost more than the loop. Kernels written in lanes say what they want.
`multiply_add` rounds once, on every machine, and takes single numbers too.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

LANES = 4

_DOUBLE = ir.DoubleType()
_VECTOR = ir.VectorType(_DOUBLE, LANES)
_INDEX = ir.IntType(32)
_UNDEFINED = ir.Constant(_VECTOR, ir.Undefined)


class LanesType(types.Type):
    """The type kernels give to four numbers side by side."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")  # type: ignore[no-untyped-call]


Lanes = Any
_LANES = cast("Any", LanesType)()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: object, kernel_type: LanesType) -> None:
        super().__init__(manager, kernel_type, _VECTOR)


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:  # noqa: ANN401
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _VECTOR.as_pointer())


def _load(_: object, array: Any, index: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        return builder.load(_pointer(context, builder, signature.args[0], *values), align=8)

    return _LANES(array, types.intp), build


def _repeat(_: object, array: Any, index: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        data = context.make_array(signature.args[0])(context, builder, values[0]).data
        return _spread_value(builder, builder.load(builder.gep(data, [values[1]])))

    return _LANES(array, types.intp), build


def _store(_: object, array: Any, index: object, lanes: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        builder.store(values[2], _pointer(context, builder, signature.args[0], *values[:2]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, _LANES), build


def _spread(_: object, value: object) -> Any:  # noqa: ANN401, ARG001
    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        return _spread_value(builder, values[0])

    return _LANES(types.float64), build


def _spread_value(builder: Any, value: Any) -> Any:  # noqa: ANN401
    first = builder.insert_element(_UNDEFINED, value, _INDEX(0))
    return builder.shuffle_vector(first, _UNDEFINED, ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES))


def _total(_: object, lanes: object) -> Any:  # noqa: ANN401, ARG001
    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        parts = [builder.extract_element(values[0], _INDEX(lane)) for lane in range(LANES)]
        return builder.fadd(builder.fadd(parts[0], parts[1]), builder.fadd(parts[2], parts[3]))

    return types.float64(_LANES), build


def _multiply_add(_: object, a: Any, b: object, c: object) -> Any:  # noqa: ANN401, ARG001
    kind, name, value = (
        (_LANES, f"llvm.fma.v{LANES}f64", _VECTOR) if a == _LANES else (types.float64, "llvm.fma.f64", _DOUBLE)
    )

    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        function = cast("Any", cgutils).get_or_insert_function(
            builder.module, ir.FunctionType(value, [value] * 3), name
        )
        return builder.call(function, values)

    return kind(kind, kind, kind), build


def _pairwise(operation: str) -> Callable[..., Any]:
    def typed(_: object, a: Any, b: object) -> Any:  # noqa: ANN401, ARG001
        kind = _LANES if a == _LANES else types.float64

        def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
            return getattr(builder, operation)(*values)

        return kind(kind, kind), build

    return typed


def _negative(_: object, a: Any) -> Any:  # noqa: ANN401
    kind = _LANES if a == _LANES else types.float64

    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        return builder.fneg(*values)

    return kind(kind), build


load: Callable[..., Lanes] = intrinsic(_load)
store: Callable[..., None] = intrinsic(_store)
repeat: Callable[..., Lanes] = intrinsic(_repeat)
spread: Callable[..., Lanes] = intrinsic(_spread)
total: Callable[..., Any] = intrinsic(_total)
multiply_add: Callable[..., Any] = intrinsic(_multiply_add)
plus: Callable[..., Any] = intrinsic(_pairwise("fadd"))
minus: Callable[..., Any] = intrinsic(_pairwise("fsub"))
times: Callable[..., Any] = intrinsic(_pairwise("fmul"))
negative: Callable[..., Any] = intrinsic(_negative)

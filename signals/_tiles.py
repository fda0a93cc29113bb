"""Tiles of eight by eight numbers in vector registers, for use inside compiled kernels (see `_lanes`).

A tile is eight rows of eight numbers, one after the other in a flat array.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from signals._lanes import WIDE, wide_type

_DOUBLE = ir.DoubleType()
_VECTOR = ir.VectorType(_DOUBLE, WIDE)
_INDEX = ir.IntType(32)


def _wide_tuple(count: int) -> Any:  # noqa: ANN401
    return cast("Any", types.UniTuple)(wide_type, count)


def _shuffled(builder: Any, a: Any, b: Any, lanes: list[int]) -> Any:  # noqa: ANN401
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_INDEX, WIDE), lanes))


def _spread_lane(builder: Any, row: Any, lane: int) -> Any:  # noqa: ANN401
    return _shuffled(builder, row, row, [lane] * WIDE)


def _places(context: Any, builder: Any, kind: Any, array: Any, at: Any, apart: Any, *, count: int) -> list[Any]:  # noqa: ANN401
    data = context.make_array(kind)(context, builder, array).data
    places = []
    for row in range(count):
        index = builder.add(at, builder.mul(apart, ir.Constant(apart.type, row)))
        places.append(builder.bitcast(builder.gep(data, [index]), _VECTOR.as_pointer()))
    return places


def _loaded(context: Any, builder: Any, kind: Any, array: Any, at: Any, apart: Any, *, count: int) -> list[Any]:  # noqa: ANN401
    return [builder.load(place, align=8) for place in _places(context, builder, kind, array, at, apart, count=count)]


def _transposed(_: object, source: Any, at: object, apart: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        rows = _loaded(context, builder, signature.args[0], *values, count=WIDE)
        # Trade off-diagonal squares of 1, 2 and 4 numbers.
        for size in (1, 2, 4):
            _trade(builder, rows, rows_apart=size, numbers=size)
        return context.make_tuple(builder, signature.return_type, rows)

    return _wide_tuple(WIDE)(source, types.intp, types.intp), build


def _pairs_transposed(_: object, source: Any, at: object, apart: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        rows = _loaded(context, builder, signature.args[0], *values, count=WIDE // 2)
        for size in (1, 2):
            _trade(builder, rows, rows_apart=size, numbers=2 * size)
        return context.make_tuple(builder, signature.return_type, rows)

    return _wide_tuple(WIDE // 2)(source, types.intp, types.intp), build


def _trade(builder: Any, rows: list[Any], *, rows_apart: int, numbers: int) -> None:  # noqa: ANN401
    """Swap groups of numbers between rows, as a transposition of 2 x 2 groups does."""
    keep = [lane if not lane & numbers else lane - numbers + WIDE for lane in range(WIDE)]
    gain = [lane + numbers if not lane & numbers else lane + WIDE for lane in range(WIDE)]
    for i in range(len(rows)):
        if not i & rows_apart:
            a, b = rows[i], rows[i + rows_apart]
            rows[i], rows[i + rows_apart] = _shuffled(builder, a, b, keep), _shuffled(builder, a, b, gain)


def _whiten(_: object, tile: Any, at: object, target: Any, place: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        joint, at, white, place = values
        apart = ir.Constant(at.type, WIDE)
        multiply_add = _multiply_adder(builder)
        root_of = cast("Any", cgutils).get_or_insert_function(
            builder.module, ir.FunctionType(_DOUBLE, [_DOUBLE]), "llvm.sqrt.f64"
        )
        rows = _loaded(context, builder, signature.args[0], joint, at, apart, count=WIDE)
        unit = [ir.Constant(_VECTOR, [float(lane == row) for lane in range(WIDE)]) for row in range(WIDE)]
        zeros = ir.Constant(_VECTOR, [0.0] * WIDE)
        roots = zeros
        for i in range(WIDE):
            inverse = builder.fdiv(ir.Constant(_DOUBLE, 1.0), builder.extract_element(rows[i], _INDEX(i)))
            roots = builder.insert_element(roots, builder.call(root_of, [inverse]), _INDEX(i))
            inserted = builder.insert_element(zeros, builder.fneg(inverse), _INDEX(0))
            negated = _spread_lane(builder, inserted, 0)
            for j in range(i + 1, WIDE):
                # The product does not wait for the division.
                product = builder.fmul(_spread_lane(builder, rows[i], j), rows[i])
                rows[j] = builder.call(multiply_add, [product, negated, rows[j]])
            later = _shuffled(builder, rows[i], zeros, [lane if lane > i else WIDE + lane for lane in range(WIDE)])
            later = builder.fmul(later, negated)
            for j in range(i + 1):
                unit[j] = builder.call(multiply_add, [_spread_lane(builder, unit[j], i), later, unit[j]])
        targets = _places(context, builder, signature.args[2], white, place, apart, count=WIDE)
        for row, to in zip(unit, targets, strict=True):
            builder.store(builder.fmul(row, roots), to, align=8)
        return roots

    return wide_type(tile, types.intp, target, types.intp), build


def _tile(_: object, source: Any, at: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        apart = ir.Constant(values[1].type, WIDE)
        rows = _loaded(context, builder, signature.args[0], values[0], values[1], apart, count=WIDE)
        return context.make_tuple(builder, signature.return_type, rows)

    return _wide_tuple(WIDE)(source, types.intp), build


def _put_tile(_: object, target: Any, at: object, tile: Any) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        apart = ir.Constant(values[1].type, WIDE)
        places = _places(context, builder, signature.args[0], values[0], values[1], apart, count=WIDE)
        for row, place in enumerate(places):
            builder.store(builder.extract_value(values[2], row), place, align=8)
        return context.get_dummy_value()

    return types.void(target, types.intp, tile), build


def _multiply_adder(builder: Any) -> Any:  # noqa: ANN401
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
    return cast("Any", cgutils).get_or_insert_function(builder.module, kind, f"llvm.fma.v{WIDE}f64")


def _spread_numbers(context: Any, builder: Any, kind: Any, array: Any, at: Any, apart: Any) -> list[Any]:  # noqa: ANN401
    """Return eight numbers so far apart, each as lanes."""
    data, spread = context.make_array(kind)(context, builder, array).data, []
    for row in range(WIDE):
        index = builder.add(at, builder.mul(apart, ir.Constant(apart.type, row)))
        undefined = ir.Constant(_VECTOR, ir.Undefined)
        alone = builder.insert_element(undefined, builder.load(builder.gep(data, [index])), _INDEX(0))
        spread.append(_spread_lane(builder, alone, 0))
    return spread


def _outer_product(_: object, source: Any, at: object, apart: object, row: Any, tile: Any) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        numbers = _spread_numbers(context, builder, signature.args[0], *values[:3])
        add = _multiply_adder(builder)
        rows = [
            builder.call(add, [number, values[3], builder.extract_value(values[4], k)])
            for k, number in enumerate(numbers)
        ]
        return context.make_tuple(builder, signature.return_type, rows)

    return tile(source, types.intp, types.intp, row, tile), build


def _inner_product(_: object, source: Any, at: object, apart: object, tile: Any, row: Any) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        add, total = _multiply_adder(builder), values[4]
        for k, number in enumerate(_spread_numbers(context, builder, signature.args[0], *values[:3])):
            total = builder.call(add, [number, builder.extract_value(values[3], k), total])
        return total

    return row(source, types.intp, types.intp, tile, row), build


def _upper_product(_: object, source: Any, at: object, tile: Any) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        add, one = _multiply_adder(builder), ir.Constant(values[1].type, 1)
        rows = [ir.Constant(_VECTOR, None)] * WIDE
        for k in range(WIDE):
            at = builder.add(values[1], ir.Constant(values[1].type, WIDE * k))
            numbers = _spread_numbers(context, builder, signature.args[0], values[0], at, one)
            for j in range(k, WIDE):
                rows[j] = builder.call(add, [numbers[j], builder.extract_value(values[2], k), rows[j]])
        return context.make_tuple(builder, signature.return_type, rows)

    return tile(source, types.intp, tile), build


def _totals(_: object, a: Any) -> Any:  # noqa: ANN401
    def build(_: object, builder: Any, __: object, values: Any) -> Any:  # noqa: ANN401
        rows = [builder.extract_value(values[0], k) for k in range(WIDE)]
        for size in (1, 2, 4):
            _trade(builder, rows, rows_apart=size, numbers=size)
            for i in range(0, WIDE, 2 * size):
                rows[i] = builder.fadd(rows[i], rows[i + size])
        return rows[0]

    return wide_type(a), build


def _spread_tile(_: object, source: Any, at: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        apart = ir.Constant(values[1].type, 1)
        numbers = _spread_numbers(context, builder, signature.args[0], values[0], values[1], apart)
        return context.make_tuple(builder, signature.return_type, numbers)

    return _wide_tuple(WIDE)(source, types.intp), build


def _multiply_add_tile(_: object, a: Any, b: Any, tile: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        add, rows = _multiply_adder(builder), []
        for k in range(WIDE):
            own, to = (builder.extract_value(value, k) for value in values[::2])
            other = values[1] if b == a.dtype else builder.extract_value(values[1], k)
            rows.append(builder.call(add, [own, other, to]))
        return context.make_tuple(builder, signature.return_type, rows)

    return a(a, b, a), build


def _times_tile(_: object, a: Any, b: object) -> Any:  # noqa: ANN401, ARG001
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        rows = [builder.fmul(*(builder.extract_value(value, k) for value in values)) for k in range(WIDE)]
        return context.make_tuple(builder, signature.return_type, rows)

    return a(a, a), build


def _negative_tile(_: object, a: Any) -> Any:  # noqa: ANN401
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401
        rows = [builder.fneg(builder.extract_value(values[0], k)) for k in range(WIDE)]
        return context.make_tuple(builder, signature.return_type, rows)

    return a(a), build


# The columns, as lanes, of eight rows that begin at an index and lie so far apart.
transposed: Callable[..., Any] = intrinsic(_transposed)
# The same of four rows of four pairs of numbers, which stay together.
pairs_transposed: Callable[..., Any] = intrinsic(_pairs_transposed)
# From a symmetric positive definite tile S at an index to an upper triangular tile W at another, `W^T S W = 1`. The
# diagonal of W is returned; of S, the upper triangle counts.
whiten: Callable[..., Any] = intrinsic(_whiten)
# A tile at an index, row after row, and back.
load_tile: Callable[..., Any] = intrinsic(_tile)
store_tile: Callable[..., None] = intrinsic(_put_tile)
# A tile plus the products of eight numbers, which begin at an index and lie so far apart, each with the same row.
add_outer: Callable[..., Any] = intrinsic(_outer_product)
# A row plus the products of eight such numbers with the rows of a tile.
add_inner: Callable[..., Any] = intrinsic(_inner_product)
# The product W^T T of an upper triangular tile W at an index and another.
upper_product: Callable[..., Any] = intrinsic(_upper_product)
times_tile: Callable[..., Any] = intrinsic(_times_tile)
negative_tile: Callable[..., Any] = intrinsic(_negative_tile)
# The sum of each row of a tile.
totals: Callable[..., Any] = intrinsic(_totals)
# Eight numbers from an index on, each as lanes.
spread_tile: Callable[..., Any] = intrinsic(_spread_tile)
# A tile plus the products of the rows of another with those of a third, or all with the same row.
multiply_add_tile: Callable[..., Any] = intrinsic(_multiply_add_tile)

"""What cannot be simulated: numbers that mean nothing, and chains that are in each other's way."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
Bools = NDArray[np.bool_]


def finite(**values: ArrayLike) -> None:
    """Refuse arguments, each an array or a number, that are not finite; the error names them."""
    _require(np.isfinite, "must be finite", values)


def positive(**values: ArrayLike) -> None:
    """Refuse arguments that are not finite and over 0."""
    _require(lambda v: np.isfinite(v) & (v > 0.0), "must be finite and over 0", values)


def not_negative(**values: ArrayLike) -> None:
    """Refuse arguments that are not finite, or below 0."""
    _require(lambda v: np.isfinite(v) & (v >= 0.0), "must be finite and not below 0", values)


def limits(**values: ArrayLike) -> None:
    """Refuse limits that are not over 0; they may be infinite."""
    _require(lambda v: v > 0.0, "must be over 0", values)


def whole(**values: int) -> None:
    """Refuse arguments that are not whole numbers from 0 on."""
    for name, value in values.items():
        if not isinstance(value, int | np.integer) or value < 0:
            msg = f"{name} = {value} must be a whole number, 0 or more"
            raise ValueError(msg)


def array_of(name: str, value: ArrayLike) -> FloatArray:
    """Return an argument as an array.

    Raises
    ------
    ValueError
        If it is no array of numbers; names it.
    """
    try:
        return np.asarray(value, np.float64)
    except (TypeError, ValueError):
        msg = f"{name} must be an array of numbers, with as many in each row"
        raise ValueError(msg) from None


def shaped(shape: tuple[int, ...], **values: ArrayLike) -> None:
    """Refuse arguments of another shape."""
    for name, value in values.items():
        if np.shape(value) != shape:
            msg = f"{name} has the shape {np.shape(value)}: {shape} is needed"
            raise ValueError(msg)


def places(count: int, **values: ArrayLike) -> None:
    """Refuse what are not numbers of the ``count`` that there are, from 0 on."""
    for name, value in values.items():
        array = np.asarray(value)
        if array.size and array.dtype.kind not in "iu":
            msg = f"{name} must be whole numbers, from 0 to {count - 1}"
            raise ValueError(msg)
    _require(lambda v: (v >= 0) & (v < count), f"must be 0 to {count - 1}", values)


def _require(holds: Callable[[FloatArray], Any], words: str, values: dict[str, ArrayLike]) -> None:
    for name, value in values.items():
        array = np.asarray(value, np.float64)
        wrong = np.argwhere(~holds(array))
        if len(wrong):
            place = tuple(map(int, wrong[0]))
            at = f"[{', '.join(map(str, place))}]" if place else ""
            msg = f"{name}{at} = {array[place]:g} {words}"
            raise ValueError(msg)


def crosses_itself(points: FloatArray, closed: bool) -> bool:
    """Whether any two segments of a chain (n, 2) that do not follow each other meet."""
    a, b = segments(points, closed)
    one, other = np.triu_indices(len(a), 2)
    if closed:
        apart = (one != 0) | (other != len(a) - 1)
        one, other = one[apart], other[apart]
    return bool(_meet(a[one], b[one], a[other], b[other]).any())


def segments(points: FloatArray, closed: bool) -> tuple[FloatArray, FloatArray]:
    """Return the two ends of every segment of a chain."""
    return (points, np.roll(points, -1, axis=0)) if closed else (points[:-1], points[1:])


def _meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> Bools:
    """Whether segments from a to b and from c to d, arrays (..., 2), have a point in common."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
        return np.asarray(
            (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
            - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])
        )

    return np.asarray(
        (side(a, b, c) * side(a, b, d) <= 0.0)
        & (side(c, d, a) * side(c, d, b) <= 0.0)
        # Of segments on one line, which are on no side of each other.
        & (np.minimum(a, b) <= np.maximum(c, d)).all(axis=-1)
        & (np.minimum(c, d) <= np.maximum(a, b)).all(axis=-1)
    )


def tangled(chains: Sequence[tuple[FloatArray, bool]], cell: tuple[float, float] | None) -> str:
    """Return which two chains nothing can part, or nothing.

    Shells may overlap, which contacts repair; mid-lines that cross, and rings in others, stay so.

    Parameters
    ----------
    chains : sequence of (points (n, 2), closed)
    cell : (float, float), optional
        Width and height of a periodic cell, not sheared yet, whose images count too [m].
    """
    low = np.array([points.min(axis=0) for points, _ in chains])
    high = np.array([points.max(axis=0) for points, _ in chains])
    home = np.zeros_like(low)
    shifts = np.zeros((1, 2))
    if cell is not None:
        home = np.floor(0.5 * (low + high) / cell) * cell
        shifts = np.array([(0, 0), (1, -1), (1, 0), (1, 1), (0, 1)]) * np.array(cell)
    low, high = low - home, high - home
    widest = float((high - low)[:, 0].max())
    order = np.argsort(low[:, 0], kind="stable")
    left = low[order, 0]
    for p, (points, closed) in enumerate(chains):
        for shift in shifts:
            # Of two chains of the cell itself, the one that begins first looks at the other.
            begin = low[p, 0] - (widest + shift[0] if shift.any() else 0.0)
            first, end = np.searchsorted(left, [begin, np.nextafter(high[p, 0] - shift[0], np.inf)])
            near = order[first:end]
            near = near[(near != p) | shift.any()]
            beside = (low[near] + shift <= high[p]) & (high[near] + shift >= low[p])
            for q in map(int, near[beside.all(axis=1)]):
                there = chains[q][0] - home[q] + shift
                how = _in_the_way(points - home[p], closed, there, chains[q][1])
                if how:
                    return how.format(p, q, min(p, q), max(p, q))
    return ""


def _in_the_way(one: FloatArray, closed: bool, other: FloatArray, ring: bool) -> str:
    a, b = _within(*segments(one, closed), other)
    c, d = _within(*segments(other, ring), one)
    if _meet(a[:, None], b[:, None], c, d).any():
        return "the mid-lines of particles {2} and {3} cross"
    if ring and _inside(one[0], other):
        return "particle {0} is inside particle {1}"
    return "particle {1} is inside particle {0}" if closed and _inside(other[0], one) else ""


def _within(a: FloatArray, b: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the segments that are not wholly on one side of the box of ``points``."""
    low, high = points.min(axis=0), points.max(axis=0)
    near = ((np.minimum(a, b) <= high) & (np.maximum(a, b) >= low)).all(axis=1)
    return a[near], b[near]


def _inside(point: FloatArray, ring: FloatArray) -> bool:
    """Whether a ray from ``point`` to the right leaves the ring (n, 2) an odd number of times."""
    a, b = segments(ring, closed=True)
    passed = (a[:, 1] > point[1]) != (b[:, 1] > point[1])
    a, b = a[passed], b[passed]
    x = a[:, 0] + (point[1] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    return bool((x > point[0]).sum() % 2)

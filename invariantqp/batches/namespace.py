"""Arrays of any library that has the Python array API, and the little that the API leaves out.

Numpy, torch, JAX and CuPy arrays stay where they are, on their device and in their precision; anything else becomes a
numpy array. Functions of this room have no branch on values, so that they can be traced.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.extras import require
from invariantqp.geometry import arrays as checks

# An array of one of the libraries; they have no type in common.
Rows = Any
Namespace = Any


def as_arrays(needed: dict[str, Any], optional: dict[str, Any] | None = None) -> tuple[Namespace, list[Rows]]:
    """The namespace of several arguments, and each as a floating array of it, on one device, in one precision.

    The first argument that is an array of a library decides for all; an optional one that is None stays None.

    Raises:
        BadInput: not real numbers, or arrays of two libraries.
        MissingExtra: array-api-compat is not installed.
    """
    for name, value in needed.items():
        if value is None:
            raise BadInput(name, "None", "an array")
    values = needed | (optional or {})
    require("batches", "array_api_compat")
    import array_api_compat as api

    given = {name: v for name, v in values.items() if api.is_array_api_obj(v) and not api.is_numpy_array(v)}
    if given:
        xp, like = _library(given)
    else:  # numpy's: float32 where the first of its arrays is, float64 otherwise
        first = next((v for v in values.values() if isinstance(v, np.ndarray)), np.empty(0))
        xp = api.array_namespace(np.empty(0))
        like = np.empty(0, first.dtype if first.dtype == np.float32 else np.float64)
    made: list[Rows] = []
    for name, v in values.items():
        if v is None:
            made.append(None)
        elif name not in given:
            made.append(constant(xp, like, checks.array(v, name, "real numbers")))
        elif xp.isdtype(v.dtype, ("real floating", "integral")):
            made.append(v if v.dtype == like.dtype else xp.astype(v, like.dtype))
        else:
            raise BadInput(name, f"an array of {v.dtype}", "real numbers")
    return xp, made


def _library(given: dict[str, Rows]) -> tuple[Namespace, Rows]:
    """The namespace of arrays of one library, and an array of the precision and on the device of the first of them."""
    import array_api_compat as api

    first = next(iter(given))
    try:
        xp = api.array_namespace(*given.values())
    except TypeError as error:
        kinds = ", ".join(sorted({type(v).__module__.split(".")[0] for v in given.values()}))
        raise BadInput(first, f"arrays of {kinds}", "arrays of one library") from error
    floating = [v for v in given.values() if xp.isdtype(v.dtype, "real floating")]
    return xp, floating[0] if floating else xp.astype(given[first], xp.asarray(1.0).dtype)


def constant(xp: Namespace, like: Rows, value: Any) -> Rows:
    """A number or a numpy array as an array like another: its library, device and precision."""
    import array_api_compat as api

    return xp.asarray(np.array(value), dtype=like.dtype, device=api.device(like))


def shaped(value: Rows, tail: tuple[int | None, ...], argument: str, expected: str) -> Rows:
    """`value`, if its last axes are `tail`; None is any length of at least one."""
    shape = tuple(value.shape)
    fits = len(shape) >= len(tail) and all(
        (n is None and k >= 1) or n == k for n, k in zip(tail, shape[len(shape) - len(tail) :], strict=True)
    )
    if not fits:
        raise BadInput(argument, f"shape {shape}", expected)
    return value


def leading_axes(rows: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """The leading axes that all arguments broadcast to; the first that does not is refused."""
    lead: tuple[int, ...] = ()
    for name, shape in rows.items():
        try:
            lead = np.broadcast_shapes(lead, shape)
        except ValueError as error:
            raise BadInput(name, f"{shape} rows", f"{lead} rows, as of the arguments before, or one for all") from error
    return lead


def detached(value: Rows) -> Rows:
    """The same numbers without their derivatives."""
    import array_api_compat as api

    if api.is_torch_array(value):
        return value.detach()
    if api.is_jax_array(value):
        import jax

        return jax.lax.stop_gradient(value)
    return value


def carries_derivatives(*values: Rows) -> bool:
    """Whether any of the arrays may be asked for a derivative: in torch where one requires it, in JAX always."""
    import array_api_compat as api

    return any(api.is_jax_array(v) or (api.is_torch_array(v) and v.requires_grad) for v in values if v is not None)


def iterated(step: Callable[[Any, Any], Any], problem: Any, state: Any, times: int) -> Any:
    """The state of all rows after steps of (problem, state) until each is `converged` (N,), `times` at most.

    Problem and state are named tuples of arrays with the rows last. Under JAX it is one traced loop. Elsewhere rows
    that are converged take no part any more once they are half of all; a device is asked each time how many are left.
    """
    import array_api_compat as api

    if api.is_jax_array(state.converged):
        import jax

        def going(carried: Any) -> Any:
            return (carried[0] < times) & ~carried[1].converged.all()

        return jax.lax.while_loop(going, lambda c: (c[0] + 1, step(problem, c[1])), (0, state))[1]
    whole, here = state, slice(None)
    for _ in range(times):
        state = step(problem, state)
        open_rows = api.array_namespace(state.converged).nonzero(~state.converged)[0]
        left, count = open_rows.shape[0], state.converged.shape[0]
        if left == 0:
            break
        if 2 * left <= count:
            whole = _written(whole, here, state)
            here = open_rows if isinstance(here, slice) else here[open_rows]
            problem, state = (type(v)(*(a[..., open_rows] for a in v)) for v in (problem, state))
    return _written(whole, here, state)


def _written(whole: Any, here: Any, part: Any) -> Any:
    """The state of all rows, with that of some replaced."""
    if isinstance(here, slice):
        return part
    for a, b in zip(whole, part, strict=True):
        a[..., here] = b
    return whole


def precision(xp: Namespace, value: Rows) -> float:
    """The rounding of an array's numbers."""
    return float(xp.finfo(value.dtype).eps)


def cross(xp: Namespace, a: Rows, b: Rows) -> Rows:
    """(..., 3) the vector product; rows broadcast."""
    a, b = xp.broadcast_arrays(a, b)
    x, y, z = (a[..., i] for i in range(3))
    u, v, w = (b[..., i] for i in range(3))
    return xp.stack((y * w - z * v, z * u - x * w, x * v - y * u), axis=-1)


def length_of(xp: Namespace, v: Rows) -> Rows:
    """(...) |v| of (..., n), with derivative 0 where it is zero."""
    square = xp.sum(v * v, axis=-1)
    some = square > 0.0
    return xp.where(some, xp.sqrt(xp.where(some, square, xp.ones_like(square))), xp.zeros_like(square))


def over_largest(xp: Namespace, v: Rows) -> tuple[Rows, Rows]:
    """(..., n) divided by its largest entry (..., 1), so that no square overflows; and that entry, or 1."""
    largest = xp.max(xp.abs(v), axis=-1, keepdims=True)
    largest = xp.where(largest > 0.0, largest, xp.ones_like(largest))
    return v / largest, largest

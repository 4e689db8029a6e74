"""How functions are compiled, and where what was compiled is kept.

Compiling takes seconds, once on each machine, so little is asked of the compiler: a kernel neither allocates
nor sorts nor assigns to slices, as each of these brings code of Numba's own along. It loops over arrays that
NumPy made. Numbers that a kernel passes to an inner function are ``np.int64(0)``, not ``0``: the function is
compiled once for each type of its arguments, and a literal is a type of its own.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compiles a function that Python calls, when it is first called; the machine code is kept on the disk."""
    compiled: Function = numba.njit(cache=True, nogil=True)(function)
    return compiled


def inner(function: Function) -> Function:
    """Compiles a function that only compiled code calls, into its callers."""
    compiled: Function = numba.njit(nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
    return compiled


def inlined(function: Function) -> Function:
    """The same for a function of a few lines: it becomes part of its callers before they are compiled."""
    compiled: Function = numba.njit(inline="always")(function)
    return compiled

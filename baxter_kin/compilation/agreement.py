"""Comparison of a compiled library with CasADi's virtual machine, in a process of its own.

A broken compiler may write a library that kills the interpreter that loads it, so a new library is
loaded and tested by another process first: `python agreement.py LIBRARY FUNCTION...`, with the
functions as CasADi saves them. The exit status is 0 when all agree. The program imports CasADi and
NumPy only, so that it starts in half a second.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import casadi as ca
import numpy as np

AGREEMENT = 1e-9
"""Allowed difference between machine code and virtual machine on `_PROBES` random inputs. Over
2,000 searches both gave the same bits."""

_PROBES = 5


def agrees(functions: Sequence[ca.Function], library: str) -> bool:
    """Whether a library contains these functions and computes the same."""
    try:
        externals = [ca.external(function.name(), library) for function in functions]
    except RuntimeError:
        return False
    return all(map(_agree, functions, externals))


def _agree(function: ca.Function, external: ca.Function) -> bool:
    """Whether both have inputs and outputs of the same shapes, and the same values."""
    shapes = _shapes(function)
    if shapes != _shapes(external):
        return False
    rng = np.random.default_rng(0)
    for _ in range(_PROBES):
        inputs = [rng.uniform(-1.0, 1.0, shape) for shape in shapes[0]]
        for expected, found in zip(function.call(inputs), external.call(inputs), strict=True):
            difference = np.abs(np.array(expected) - np.array(found))
            if not (difference <= AGREEMENT).all():
                return False
    return True


def _shapes(function: ca.Function) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Shapes of the inputs and of the outputs."""
    inputs = [function.size_in(i) for i in range(function.n_in())]
    return inputs, [function.size_out(i) for i in range(function.n_out())]


if __name__ == "__main__":
    library, *saved = sys.argv[1:]
    sys.exit(not agrees([ca.Function.load(path) for path in saved], library))

"""Compare a compiled library with CasADi's virtual machine.

As a program it does so in a process of its own, since rubbish can kill the interpreter that loads
it: `python agreement.py LIBRARY FUNCTION...`, with the functions as CasADi saves them. Its exit
status is 0 when all agree. It imports CasADi and NumPy only, so that it starts in half a second.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import casadi as ca
import numpy as np

AGREEMENT = 1e-9
"""How far machine code may be from the virtual machine on `_PROBES` random inputs. Over 2,000
searches both gave the same bits."""

_PROBES = 5


def loaded(functions: Sequence[ca.Function], library: str) -> tuple[ca.Function, ...] | None:
    """The functions of a library; None when it lacks one, or computes something else.

    Args:
        functions: the same for the virtual machine.
        library: a path. Its code is run, so it must not be rubbish.
    """
    try:
        externals = tuple(ca.external(function.name(), library) for function in functions)
    except RuntimeError:
        return None
    return externals if all(map(_agree, functions, externals)) else None


def _agree(function: ca.Function, external: ca.Function) -> bool:
    """Whether both have the same shapes, and the same outputs for random inputs."""
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
    """Shapes of its inputs and of its outputs."""
    inputs = [function.size_in(i) for i in range(function.n_in())]
    return inputs, [function.size_out(i) for i in range(function.n_out())]


if __name__ == "__main__":
    library, *saved = sys.argv[1:]
    sys.exit(loaded([ca.Function.load(path) for path in saved], library) is None)

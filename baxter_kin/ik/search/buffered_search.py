"""Search functions on memory of their own: for one request at a time, or for many side by side."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from baxter_kin.compilation.buffered import BufferedFunction
from baxter_kin.validation import FloatArray, Indices

BATCH_SIZES = (1, 16, 64, 256)
"""How many searches one call does in a row. Calls of the largest run side by side; what remains
goes into the smallest that holds it, filled up with searches that end at once."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What m searches came to.

    Attributes:
        q: last iterates, shape (m, 7), rad.
        is_valid: shape (m,), whether they converged to a valid pose inside the bounds.
        position_error_m: shape (m,).
        orientation_error_rad: shape (m,).
        iterations: shape (m,).
    """

    q: FloatArray
    is_valid: NDArray[np.bool_]
    position_error_m: FloatArray
    orientation_error_rad: FloatArray
    iterations: FloatArray

    def improve(self, at: Indices, other: Found) -> None:
        """Put what others found in the places `at`, shape (k,), where it is valid or nearer.

        What is valid there stays.
        """
        residual = self.position_error_m[at] + self.orientation_error_rad[at]
        is_nearer = other.position_error_m + other.orientation_error_rad < residual
        is_better = (is_nearer | other.is_valid) & ~self.is_valid[at]
        for field_ in fields(self):
            getattr(self, field_.name)[at[is_better]] = getattr(other, field_.name)[is_better]


class BatchedSearch:
    """A search function for many requests at a time."""

    def __init__(self, function: ca.Function, filler: tuple[FloatArray, ...]) -> None:
        """Prepare it.

        Args:
            function: whose last inputs are the same for all requests.
            filler: its first inputs, such that it ends at once.
        """
        shared = list(range(len(filler), function.n_in()))
        self._filler = [_rows(value) for value in filler]
        self._mapped = {
            size: BufferedFunction(
                function.map(f"{function.name()}_{size}", "serial", size, shared, [])
            )
            for size in BATCH_SIZES
        }

    def __call__(self, inputs: tuple[FloatArray, ...], shared: tuple[FloatArray, ...]) -> Found:
        """What it finds for inputs of shape (m, ...) each, and shared ones."""
        count, most = len(inputs[0]), BATCH_SIZES[-1]
        parts = [slice(at, at + most) for at in range(0, max(count, 1), most)]
        with _side_by_side(len(parts)) as each:
            found = each(lambda part: self._run([x[part] for x in inputs], shared), parts)
            q, report = (np.concatenate(column) for column in zip(*found, strict=True))
        return Found(q, report[:, 0] == 1.0, report[:, 1], report[:, 2], report[:, 3])

    def _run(
        self, inputs: list[FloatArray], shared: tuple[FloatArray, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """One call, for at most as many requests as the largest batch holds."""
        count = len(inputs[0])
        size = next(size for size in BATCH_SIZES if size >= count)
        mapped, own = self._mapped[size], len(inputs)
        for memory, filler, given in zip(mapped.inputs, self._filler, inputs, strict=False):
            rows = memory.reshape(size, *filler.shape)
            rows[:count], rows[count:] = _rows(given), filler
        for memory, value in zip(mapped.inputs[own:], shared, strict=True):
            memory[:] = _rows(value)
        mapped.run()
        q, report = mapped.outputs
        return q[:count].copy(), report[:count].copy()


def _rows(values: FloatArray) -> FloatArray:
    """Matrices (..., n, n) by columns, as CasADi stores them; vectors (..., n) as they are."""
    return values.swapaxes(-1, -2) if values.shape[-2:] == (4, 4) else values


@contextmanager
def _side_by_side(count: int) -> Iterator[Callable[..., Iterable[Any]]]:
    """A `map` that runs on all cores when there are several things to do; CasADi lets others run.

    The cores are those the process may use now.
    """
    cores = min(count, len(os.sched_getaffinity(0)))
    if cores < 2:
        yield map
        return
    with ThreadPoolExecutor(cores, "ik-search") as pool:
        yield pool.map


class BufferedSearch(BufferedFunction):
    """A search function for one request at a time, with nothing copied.

    Attributes:
        request: views of its first inputs: vectors, and matrices by rows.
        q: what it finds, shape (7,), rad.
        report: shape (5,).
    """

    def __init__(self, function: ca.Function, given: tuple[FloatArray, ...]) -> None:
        """Prepare it, with the last inputs given once and for all."""
        super().__init__(function)
        own = len(self.inputs) - len(given)
        for memory, value in zip(self.inputs[own:], given, strict=True):
            memory[:] = _rows(value)
        self.request = [rows[0] if len(rows) == 1 else rows.T for rows in self.inputs[:own]]
        self.q, self.report = (rows[0] for rows in self.outputs)

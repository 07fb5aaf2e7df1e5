"""CasADi functions that read and write NumPy arrays directly, without copies."""

from __future__ import annotations

import threading

import casadi as ca
import numpy as np

from baxter_kin.validation import FloatArray


class BufferedFunction(threading.local):
    """A function with memory for one evaluation; each thread has its own.

    Attributes:
        inputs: memory of each input, one row for each of its columns.
        outputs: memory of each output, one row for each of its columns.
        run: evaluates the function.
    """

    def __init__(self, function: ca.Function) -> None:
        self.inputs = [np.zeros(function.size_in(i)[::-1]) for i in range(function.n_in())]
        self.outputs = [np.zeros(function.size_out(i)[::-1]) for i in range(function.n_out())]
        self._buffer, self.run = function.buffer()
        for i, array in enumerate(self.inputs):
            self._buffer.set_arg(i, array.data)  # type: ignore[call-arg]  # wants no size
        for i, array in enumerate(self.outputs):
            self._buffer.set_res(i, array.data)  # type: ignore[call-arg]  # neither here

    def __call__(self, *rows: FloatArray) -> list[FloatArray]:
        """Evaluate the function; rows stand for columns of inputs and outputs.

        An input with fewer rows than it has columns keeps the values of the other columns. The
        outputs are copies.
        """
        for memory, given in zip(self.inputs, rows, strict=True):
            memory[: len(given)] = given
        self.run()
        return [array.copy() for array in self.outputs]

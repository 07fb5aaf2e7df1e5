"""CasADi functions that read and write NumPy arrays directly, without copies."""

from __future__ import annotations

import threading

import casadi as ca
import numpy as np

from baxter_kin.validation import FloatArray


class BufferedFunction(threading.local):
    """A function, and memory for one evaluation; each thread has its own.

    Attributes:
        inputs: memory of each input, a row for each of its columns.
        outputs: memory of each output, a row for each of its columns.
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
        """Evaluate it: columns of inputs and outputs are given as rows, and outputs are copied.

        If an input gets fewer rows than it has columns, the other columns keep their values.
        """
        for memory, given in zip(self.inputs, rows, strict=True):
            memory[: len(given)] = given
        self.run()
        return [array.copy() for array in self.outputs]

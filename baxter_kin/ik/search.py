"""Searcher: runs the search function on one pose or on many, wherever it is evaluated."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.arrays import Vector
from baxter_kin.errors import UnknownNameError
from baxter_kin.ik.compiler import compiled
from baxter_kin.ik.kernel import bounds_of, search_function
from baxter_kin.ik.seeds import RANDOM_STARTS
from baxter_kin.model import Arm

LANES = (1, 16, 256)
"""How many searches one call does in a row: what fills the largest goes there, and so on."""


class Backend(str, Enum):
    """Where searches are evaluated."""

    AUTO = "auto"
    """Machine code where a C compiler is found, else CasADi's virtual machine."""
    COMPILED = "compiled"
    CASADI = "casadi"
    IPOPT = "ipopt"
    """The reference: an interior-point method on the same program, a thousand times slower."""

    @classmethod
    def of(cls, name: str | Backend) -> Backend:
        """The backend of that name.

        Raises:
            UnknownNameError: when there is none.
        """
        try:
            return cls(name)
        except ValueError:
            raise UnknownNameError("backend", name, [backend.value for backend in cls]) from None


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

    q: Vector
    is_valid: NDArray[np.bool_]
    position_error_m: Vector
    orientation_error_rad: Vector
    iterations: Vector


class Search(Protocol):
    """What runs searches.

    Attributes:
        backend: where.
        random_starts: how many random configurations are worth its time.
    """

    backend: Backend
    random_starts: int

    def search(self, q_starts: Vector, Ts: Vector, bounds: Vector | None = None) -> Found:
        """Searches from starts, shape (m, 7), for poses, shape (m, 4, 4), within bounds, (14,)."""


class Searcher:
    """The fast search of one arm, ready to run.

    Attributes:
        backend: where it runs: `COMPILED` or `CASADI`.
        random_starts: how many random configurations are worth its time.
    """

    random_starts = RANDOM_STARTS

    def __init__(self, function: ca.Function, bounds: Vector, backend: Backend) -> None:
        """Wrap a search function, as `baxter_kin.ik.kernel` makes them, under some bounds."""
        self.backend = backend
        self._bounds = bounds
        self._desk = _Desk(function, bounds)
        self._cores = len(os.sched_getaffinity(0))
        self._mapped = {lanes: function.map(lanes) for lanes in LANES}
        self._parallel = self._mapped[LANES[-1]].map(self._cores, "thread")

    @classmethod
    def of(cls, arm: Arm, backend: str | Backend = Backend.AUTO) -> Searcher:
        """The search of an arm; without a working compiler it runs in the virtual machine."""
        wanted = Backend.of(backend)
        function = search_function(arm)
        machine_code = None if wanted is Backend.CASADI else compiled(function)
        if machine_code is None:
            return cls(function, bounds_of(arm), Backend.CASADI)
        return cls(machine_code, bounds_of(arm), Backend.COMPILED)

    def search_one(self, q_start: Vector, T_base_tip: pin.SE3) -> tuple[Vector, Vector]:
        """One search, with nothing checked and nothing copied.

        Args:
            q_start: shape (7,), rad.
            T_base_tip: the pose.

        Returns:
            Last iterate, shape (7,), and report, shape (5,), as the search function has them; both
            are overwritten by the next search of this thread.
        """
        desk = self._desk
        desk.q_start[:] = q_start
        desk.T[:] = T_base_tip.homogeneous
        desk.run()
        return desk.q, desk.report

    def search(self, q_starts: Vector, Ts: Vector, bounds: Vector | None = None) -> Found:
        """Many searches; on all cores when there are enough of them.

        Args:
            q_starts: shape (m, 7), rad.
            Ts: poses as matrices, shape (m, 4, 4).
            bounds: others than the joint limits, shape (14,), rad.
        """
        count, done, parts = len(q_starts), 0, []
        within = self._bounds if bounds is None else bounds
        while done < count:
            function, lanes = self._largest(count - done)
            parts.append(_run(function, q_starts[done:], Ts[done:], within, lanes))
            done += lanes
        q, report = (np.concatenate(column)[:count] for column in zip(*parts, strict=True))
        return Found(q, report[:, 0] == 1.0, report[:, 1], report[:, 2], report[:, 3])

    def _largest(self, remaining: int) -> tuple[ca.Function, int]:
        """The function that does as many searches as there are left, at a time."""
        at_once = self._cores * LANES[-1]
        if remaining >= at_once:
            return self._parallel, at_once
        lanes = max((lanes for lanes in LANES if lanes <= remaining), default=LANES[0])
        return self._mapped[lanes], lanes


def _run(
    function: ca.Function, q_starts: Vector, Ts: Vector, bounds: Vector, lanes: int
) -> tuple[Vector, Vector]:
    poses = Ts[:lanes].transpose(1, 0, 2).reshape(4, 4 * lanes)
    columns = np.repeat(bounds[:, None], lanes, axis=1)
    q, report = function(q_starts[:lanes].T, poses, columns)
    return np.array(q).T, np.array(report).T


class _Desk(threading.local):
    """Memory that CasADi reads and writes directly, one for each thread."""

    def __init__(self, function: ca.Function, bounds: Vector) -> None:
        self.q_start, self.q, self.report = np.zeros(7), np.zeros(7), np.zeros(5)
        pose = np.zeros(16)
        self.T = pose.reshape(4, 4, order="F")
        self._bounds = bounds.copy()
        self._buffer, self.run = function.buffer()
        for index, array in enumerate((self.q_start, pose, self._bounds)):
            self._buffer.set_arg(index, array.data)  # type: ignore[call-arg]  # wants no size
        for index, array in enumerate((self.q, self.report)):
            self._buffer.set_res(index, array.data)  # type: ignore[call-arg]  # neither here

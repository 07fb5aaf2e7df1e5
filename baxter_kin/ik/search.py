"""Searcher: runs the search function on one pose or on many, wherever it is evaluated."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.arrays import Vector
from baxter_kin.errors import UnknownNameError
from baxter_kin.ik.compiler import compiled
from baxter_kin.ik.kernel import bounds_of, search_function
from baxter_kin.ik.seeds import FINE_STARTS
from baxter_kin.model import Arm

LANES = (1, 16, 64, 256)
"""How many searches one call does in a row. Calls of the largest run side by side; what remains
goes into the smallest that holds it, filled up with searches that end at once."""

_BOUNDS = 2  # the input of the search function that all lanes share


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
        fine_starts: how many starts computed with care are worth its time.
    """

    backend: Backend
    fine_starts: int

    def search(self, q_starts: Vector, Ts: Vector, bounds: Vector | None = None) -> Found:
        """Searches from starts, shape (m, 7), for poses, shape (m, 4, 4), within bounds, (14,)."""


class Searcher:
    """The fast search of one arm, ready to run.

    Attributes:
        backend: where it runs: `COMPILED` or `CASADI`.
        fine_starts: how many starts computed with care are worth its time.
    """

    fine_starts = FINE_STARTS

    def __init__(
        self, function: ca.Function, bounds: Vector, backend: Backend, filler: tuple[Vector, Vector]
    ) -> None:
        """Wrap a search function, as `baxter_kin.ik.kernel` makes them.

        Args:
            function: the search.
            bounds: the joint limits, shape (14,), rad.
            backend: what evaluates it.
            filler: a configuration, (7,), and its pose, (4, 4): a search that ends at once.
        """
        self.backend = backend
        self._bounds = bounds
        self._desk = _Desk(function, bounds)
        self._mapped = {
            lanes: function.map(f"{function.name()}_{lanes}", "serial", lanes, [_BOUNDS], [])
            for lanes in LANES
        }
        self._filler = filler

    @classmethod
    def of(cls, arm: Arm, backend: str | Backend = Backend.AUTO) -> Searcher:
        """The search of an arm; without a working compiler it runs in the virtual machine."""
        wanted = Backend.of(backend)
        function = search_function(arm)
        filler = arm.neutral, arm.T_base_tip(arm.neutral).homogeneous
        machine_code = None if wanted is Backend.CASADI else compiled(function)
        if machine_code is None:
            return cls(function, bounds_of(arm), Backend.CASADI, filler)
        return cls(machine_code, bounds_of(arm), Backend.COMPILED, filler)

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
        within = self._bounds if bounds is None else bounds
        most = LANES[-1]
        parts = [slice(at, at + most) for at in range(0, len(q_starts), most)]
        with _side_by_side(len(parts)) as each:
            found = each(lambda part: self._run(q_starts[part], Ts[part], within), parts)
            q, report = (np.concatenate(column) for column in zip(*found, strict=True))
        return Found(q, report[:, 0] == 1.0, report[:, 1], report[:, 2], report[:, 3])

    def _run(self, q_starts: Vector, Ts: Vector, bounds: Vector) -> tuple[Vector, Vector]:
        """One call: iterates and reports of at most as many searches as the largest has lanes."""
        count = len(q_starts)
        lanes = next(lanes for lanes in LANES if lanes >= count)
        q, poses = (np.empty((lanes, *shape)) for shape in ((7,), (4, 4)))
        q[:count], poses[:count] = q_starts, Ts
        q[count:], poses[count:] = self._filler
        matrix = poses.transpose(1, 0, 2).reshape(4, 4 * lanes)
        q_found, report = self._mapped[lanes](q.T, matrix, bounds)
        return np.array(q_found).T[:count], np.array(report).T[:count]


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

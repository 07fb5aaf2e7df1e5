"""Searcher: runs the search function on one pose or on many, wherever it is evaluated."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, fields
from enum import Enum
from functools import cache
from typing import Any, Protocol

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.compilation.buffered import BufferedFunction
from baxter_kin.compilation.machine_code import compiled
from baxter_kin.errors import member_of
from baxter_kin.ik.search.exact_search import (
    ArmNumbers,
    iterations_of,
    search_function,
    step_function,
)
from baxter_kin.ik.search.map_search import PATIENCE, map_search_function
from baxter_kin.ik.search.task_search import task_search_function
from baxter_kin.ik.seeds import MAP_STARTS, NullSpaceMap
from baxter_kin.ik.task import Task
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import LIMBS, Arm
from baxter_kin.kinematics.symbolic import Shape
from baxter_kin.validation import FloatArray, Indices

LANES = (1, 16, 64, 256)
"""How many searches one call does in a row. Calls of the largest run side by side; what remains
goes into the smallest that holds it, filled up with searches that end at once."""

FINE_ROUNDS = (2, 2, 4, 8, 16, 32, 64, 128)
"""Few poses get there, and all but one of 100,000 at joint limits were solved by the first 128."""


SCATTERED_STARTS = 352
"""Where computed starts fail, one of these in thirty leads to a solution between several limits."""


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
        return member_of(cls, "backend", name)


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
        """Put what others found in the places `at`, shape (k,), where it is better."""
        residual = self.position_error_m[at] + self.orientation_error_rad[at]
        is_better = other.position_error_m + other.orientation_error_rad < residual
        for field_ in fields(self):
            getattr(self, field_.name)[at[is_better]] = getattr(other, field_.name)[is_better]


class Search(Protocol):
    """What runs searches.

    Attributes:
        backend: where.
        fine_rounds: how many starts computed with care it is given at once, round by round.
        scattered_starts: how many from all over the joint ranges, for poses that are left then.
    """

    backend: Backend
    fine_rounds: tuple[int, ...]
    scattered_starts: int

    def search(
        self, q_starts: FloatArray, Ts: FloatArray, bounds: FloatArray | None = None
    ) -> Found:
        """Searches from starts, shape (m, 7), for poses, shape (m, 4, 4), within bounds, (14,)."""

    def search_from_map(self, Ts: FloatArray) -> Found:
        """Searches for poses, shape (m, 4, 4), each from its nearest setpoints in turn."""


class Searcher:
    """The fast search of one arm for one task, ready to run.

    Attributes:
        backend: where it runs: `COMPILED` or `CASADI`.
        fine_rounds: how many starts computed with care it is given at once, round by round.
        scattered_starts: how many from all over the joint ranges, for poses that are left then.
    """

    fine_rounds: tuple[int, ...] = FINE_ROUNDS
    scattered_starts: int = SCATTERED_STARTS

    def __init__(
        self, arm: Arm, backend: str | Backend = Backend.AUTO, tolerance: Tolerance = EXACT
    ) -> None:
        """Make it ready; without a working compiler it runs in the virtual machine.

        Raises:
            UnknownNameError: when there is no such backend.
            DescriptionError: when the arm is not built like Baxter's.
        """
        task, self._map = Task.of(arm, tolerance), NullSpaceMap(arm, tolerance)
        self._numbers = ArmNumbers.of(arm.at_gripper)
        functions_of = exact_functions if task.is_exact else task_functions
        functions, self.backend = evaluated(functions_of, self._numbers.shape, Backend.of(backend))
        self._turned = slice(None) if task.is_exact else (slice(None), np.argsort(task.columns))
        self._task = task
        self._given = () if task.is_exact else task.numbers(self._numbers.T_last_tip)
        self._arm = self._numbers.within()
        T = task.turned(arm.T_base_tip(arm.neutral).homogeneous)
        self._desk = Desk(functions[0], (*self._given, self._arm))
        self._many = Lanes(functions[0], (arm.neutral, T))
        self._map_desk, self._many_from_map = None, None
        if task.is_exact:
            from_map = functions[1 + LIMBS.index(arm.side)]
            self._map_desk = Desk(from_map, (self._arm,))
            self._many_from_map = Lanes(from_map, (T,))

    def search_one(self, q_start: FloatArray, T_base_tip: pin.SE3) -> tuple[FloatArray, FloatArray]:
        """One search, with nothing checked and nothing copied.

        Args:
            q_start: shape (7,), rad.
            T_base_tip: the pose.

        Returns:
            Last iterate, shape (7,), and report, shape (5,), as the search function has them; both
            are overwritten by the next search of this thread.
        """
        desk = self._desk
        request = desk.request
        request[0][:] = q_start
        request[1][self._turned] = T_base_tip.homogeneous
        desk.run()
        return desk.q, desk.report

    def search_one_from_map(self, T_base_tip: pin.SE3) -> tuple[FloatArray, FloatArray] | None:
        """The same from the nearest setpoints; the pose must be valid.

        None for a tolerance or a tool: what starts suit them takes longer to find.
        """
        desk = self._map_desk
        if desk is None:
            return None
        desk.request[0][:] = T_base_tip.homogeneous
        desk.run()
        return desk.q, desk.report

    def search(
        self, q_starts: FloatArray, Ts: FloatArray, bounds: FloatArray | None = None
    ) -> Found:
        """Many searches; on all cores when there are enough of them.

        Args:
            q_starts: shape (m, 7), rad.
            Ts: poses as matrices, shape (m, 4, 4).
            bounds: others than the joint limits, shape (14,), rad.
        """
        arm = self._arm if bounds is None else self._numbers.within(bounds)
        return self._many((q_starts, self._task.turned(Ts)), (*self._given, arm))

    def search_from_map(self, Ts: FloatArray) -> Found:
        """Searches for poses, shape (m, 4, 4), each from its nearest setpoints in turn."""
        if self._many_from_map is None:
            return search_from_setpoints(self, self._map, Ts)
        return self._many_from_map((Ts,), (self._arm,))


def search_from_setpoints(search: Search, map_: NullSpaceMap, Ts: FloatArray) -> Found:
    """Searches for poses, shape (m, 4, 4), each from its nearest setpoints until one is valid.

    What `baxter_kin.ik.search.map_search` does for exact poses of the gripper, but that a search
    with little hope goes on to its last iteration.
    """
    nearest, poses = map_.nearest(Ts), np.arange(len(Ts))
    found = search.search(map_.setpoints[nearest[:, 0]], Ts)
    for rank in range(1, MAP_STARTS):
        poses = poses[~found.is_valid[poses]]
        if not poses.size:
            break
        again = search.search(map_.setpoints[nearest[poses, rank]], Ts[poses])
        found.improve(poses, again)
    return found


@cache
def evaluated(
    functions_of: Callable[[Shape], Sequence[ca.Function]], shape: Shape, wanted: Backend
) -> tuple[Sequence[ca.Function], Backend]:
    """The functions for arms of a shape where they are wanted, or else in the virtual machine.

    When they have to be compiled, those for other shapes are too: no robot but the first has to
    wait.
    """
    functions = functions_of(shape)
    if wanted is not Backend.CASADI:
        others = (other for other in Shape if other is not shape)
        machine_code = compiled(functions, lambda: map(functions_of, others))
        if machine_code is not None:
            return machine_code, Backend.COMPILED
    return functions, Backend.CASADI


@cache
def exact_functions(shape: Shape) -> tuple[ca.Function, ...]:
    """For exact poses of grippers: from a start, from the left map, from the right one."""
    step = step_function(shape)
    impatient = iterations_of(step, PATIENCE)
    from_maps = (map_search_function(shape, impatient, side) for side in LIMBS)
    return search_function(shape, iterations_of(step)), *from_maps


@cache
def task_functions(shape: Shape) -> tuple[ca.Function, ...]:
    """For tasks with freedom, and tools: from a start."""
    return (task_search_function(shape),)


class Lanes:
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
            lanes: BufferedFunction(
                function.map(f"{function.name()}_{lanes}", "serial", lanes, shared, [])
            )
            for lanes in LANES
        }

    def __call__(self, inputs: tuple[FloatArray, ...], shared: tuple[FloatArray, ...]) -> Found:
        """What it finds for inputs of shape (m, ...) each, and shared ones."""
        count, most = len(inputs[0]), LANES[-1]
        parts = [slice(at, at + most) for at in range(0, count, most)]
        with _side_by_side(len(parts)) as each:
            found = each(lambda part: self._run([x[part] for x in inputs], shared), parts)
            q, report = (np.concatenate(column) for column in zip(*found, strict=True))
        return Found(q, report[:, 0] == 1.0, report[:, 1], report[:, 2], report[:, 3])

    def _run(
        self, inputs: list[FloatArray], shared: tuple[FloatArray, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """One call, for at most as many requests as the largest has lanes."""
        count = len(inputs[0])
        lanes = next(lanes for lanes in LANES if lanes >= count)
        mapped, own = self._mapped[lanes], len(inputs)
        for memory, filler, given in zip(mapped.inputs, self._filler, inputs, strict=False):
            rows = memory.reshape(lanes, *filler.shape)
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


class Desk(BufferedFunction):
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

"""Searcher: runs the search function for one pose, or for many in parallel."""

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
from baxter_kin.ik.search.map_search import search_functions
from baxter_kin.ik.search.search_function import ArmNumbers
from baxter_kin.ik.seeds import MAP_STARTS, NullSpaceMap
from baxter_kin.ik.tolerance import EXACT, Task, Tolerance
from baxter_kin.kinematics.arm import LIMBS, Arm
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import Shape
from baxter_kin.validation import FloatArray, Indices, member_of

BATCH_SIZES = (1, 16, 64, 256)
"""Numbers of searches in one call. Calls of the largest size run in parallel; the remainder goes
into the smallest size that holds it, filled up with searches that end immediately."""

FINE_ROUNDS = (2, 2, 4, 8, 16, 32, 64, 128)
"""Numbers of finely computed starts in successive rounds. Few poses need them; of 100,000 poses at
joint limits all but one were solved by the first 128."""

SCATTERED_STARTS = 352
"""If computed starts fail, one of thirty of these leads to a solution between several limits."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Results of m searches.

    Attributes:
        q: last iterates, shape (m, 7), rad.
        is_valid: whether they converged to a valid pose inside the bounds, shape (m,).
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
        """Replace invalid results at indices, shape (k,), by others that are valid or nearer."""
        residual = self.position_error_m[at] + self.orientation_error_rad[at]
        is_nearer = other.position_error_m + other.orientation_error_rad < residual
        is_better = (is_nearer | other.is_valid) & ~self.is_valid[at]
        for field_ in fields(self):
            getattr(self, field_.name)[at[is_better]] = getattr(other, field_.name)[is_better]


class BatchedSearch:
    """A search function for many requests at a time."""

    def __init__(self, function: ca.Function, filler: tuple[FloatArray, ...]) -> None:
        """Store the function.

        Args:
            function: the function, whose last inputs are the same for all requests.
            filler: first inputs for which the search ends immediately.
        """
        self._function = function
        self._filler = [_rows(value) for value in filler]
        self._mapped: dict[int, BufferedFunction] = {}

    def __call__(self, inputs: tuple[FloatArray, ...], shared: tuple[FloatArray, ...]) -> Found:
        """Results for inputs of shape (m, ...) each, and for shared ones."""
        count, size = len(inputs[0]), BATCH_SIZES[-1]
        parts = [slice(at, at + size) for at in range(0, max(count, 1), size)]
        with _side_by_side(len(parts)) as each:
            found = each(lambda part: self._run([x[part] for x in inputs], shared), parts)
            q, report = (np.concatenate(column) for column in zip(*found, strict=True))
        return Found(q, report[:, 0] == 1.0, report[:, 1], report[:, 2], report[:, 3])

    def _run(
        self, inputs: list[FloatArray], shared: tuple[FloatArray, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """One call, for at most as many requests as the largest size."""
        count = len(inputs[0])
        size = next(size for size in BATCH_SIZES if size >= count)
        mapped, own = self._of_size(size), len(inputs)
        for memory, filler, given in zip(mapped.inputs, self._filler, inputs, strict=False):
            rows = memory.reshape(size, *filler.shape)
            rows[:count], rows[count:] = _rows(given), filler
        for memory, value in zip(mapped.inputs[own:], shared, strict=True):
            memory[:] = _rows(value)
        mapped.run()
        q, report = mapped.outputs
        return q[:count].copy(), report[:count].copy()

    def _of_size(self, size: int) -> BufferedFunction:
        """The function for a number of requests; made when first needed, which takes some ms."""
        if size not in self._mapped:
            function = self._function
            shared = list(range(len(self._filler), function.n_in()))
            mapped = function.map(f"{function.name()}_{size}", "serial", size, shared, [])
            self._mapped.setdefault(size, BufferedFunction(mapped))  # another thread may be first
        return self._mapped[size]


def _rows(values: FloatArray) -> FloatArray:
    """Matrices (..., 4, 4) by columns, as CasADi stores them; vectors (..., n) unchanged."""
    return values.swapaxes(-1, -2) if values.shape[-2:] == (4, 4) else values


@contextmanager
def _side_by_side(count: int) -> Iterator[Callable[..., Iterable[Any]]]:
    """A `map` on all available cores if there are several calls; CasADi releases the GIL."""
    cores = min(count, len(os.sched_getaffinity(0)))
    if cores < 2:
        yield map
        return
    with ThreadPoolExecutor(cores, "ik-search") as pool:
        yield pool.map


class BufferedSearch(BufferedFunction):
    """A search function for one request at a time, without copies.

    Attributes:
        request: views of its first inputs: vectors, and matrices by rows.
        q: last iterate, shape (7,), rad.
        report: shape (5,).
    """

    def __init__(self, function: ca.Function, given: tuple[FloatArray, ...]) -> None:
        """Store the function and the values of its last inputs."""
        super().__init__(function)
        own = len(self.inputs) - len(given)
        for memory, value in zip(self.inputs[own:], given, strict=True):
            memory[:] = _rows(value)
        self.request = [rows[0] if len(rows) == 1 else rows.T for rows in self.inputs[:own]]
        self.q, self.report = (rows[0] for rows in self.outputs)


class Backend(str, Enum):
    """Where searches are evaluated."""

    AUTO = "auto"
    """Machine code if a C compiler is found, else CasADi's virtual machine."""
    COMPILED = "compiled"
    CASADI = "casadi"
    IPOPT = "ipopt"
    """The reference: an interior-point method on the same program, a thousand times slower."""

    @classmethod
    def of(cls, name: str | Backend) -> Backend:
        """The backend with a name; an `UnknownNameError` if there is none."""
        return member_of(cls, "backend", name)


class Search(Protocol):
    """Runs searches.

    Attributes:
        backend: where they run.
        fine_rounds: numbers of finely computed starts to give it in successive rounds.
        scattered_starts: number of starts from all over the joint ranges, for the remaining poses.
    """

    backend: Backend
    fine_rounds: tuple[int, ...]
    scattered_starts: int

    def search(
        self, q_starts: FloatArray, Ts: FloatArray, bounds: FloatArray | None = None
    ) -> Found:
        """Search from starts, shape (m, 7), for poses, shape (m, 4, 4), within bounds, (14,)."""

    def search_from_map(self, Ts: FloatArray) -> Found:
        """Search for poses, shape (m, 4, 4), each from its nearest setpoints in turn."""


class Searcher:
    """The fast search for one arm and tolerance, ready to run.

    Attributes:
        backend: where it runs: `COMPILED` or `CASADI`.
        fine_rounds: as of `Search`.
        scattered_starts: likewise.
    """

    fine_rounds: tuple[int, ...] = FINE_ROUNDS
    scattered_starts: int = SCATTERED_STARTS

    def __init__(
        self, arm: Arm, backend: str | Backend = Backend.AUTO, tolerance: Tolerance = EXACT
    ) -> None:
        """Prepare the search; without a working compiler it runs in the virtual machine."""
        self._task, self._map = Task.of(arm, tolerance), NullSpaceMap(arm, tolerance)
        self._numbers = ArmNumbers.of(arm)
        functions, self.backend = _evaluated(self._numbers.shape, Backend.of(backend))
        columns = self._task.columns
        is_turned = columns != sorted(columns)
        self._turned = (slice(None), np.argsort(columns)) if is_turned else slice(None)
        self._given = self._task.numbers(DHParameters.of(arm).T_last_tip)
        self._arm = self._numbers.within()
        T = arm.T_base_tip(arm.neutral).homogeneous
        shared = self._given, self._arm
        self._one = BufferedSearch(functions[0], shared)
        self._many = BatchedSearch(functions[0], (arm.neutral, self._task.turned(T)))
        self._one_from_map, self._many_from_map = None, None
        self._T_tip_gripper = None
        if arm.tip_frame != arm.gripper_frame:
            self._T_tip_gripper = arm.T_gripper_tip.inverse().homogeneous
        if tolerance == EXACT:
            from_map = functions[1 + LIMBS.index(arm.side)]
            self._one_from_map = BufferedSearch(from_map, shared)
            self._many_from_map = BatchedSearch(from_map, (T, self._gripper_poses(T)))

    def search_one(self, q_start: FloatArray, T_base_tip: pin.SE3) -> tuple[FloatArray, FloatArray]:
        """Run one search; its input is not checked and its output not copied.

        Args:
            q_start: shape (7,), rad.
            T_base_tip: the pose.

        Returns:
            Last iterate, shape (7,), and report, shape (5,), as of `search_function`; the next
            search of this thread overwrites both.
        """
        one = self._one
        request = one.request
        request[0][:] = q_start
        request[1][self._turned] = T_base_tip.homogeneous
        one.run()
        return one.q, one.report

    def search_one_from_map(self, T_base_tip: pin.SE3) -> tuple[FloatArray, FloatArray] | None:
        """Run one search from the nearest setpoints; the report is that of `map_search_function`.

        None with a tolerance, for which it takes longer to find suitable starts.
        """
        one = self._one_from_map
        if one is None:
            return None
        T = T_base_tip.homogeneous
        one.request[0][:] = T
        one.request[1][:] = self._gripper_poses(T)
        one.run()
        return one.q, one.report

    def search(
        self, q_starts: FloatArray, Ts: FloatArray, bounds: FloatArray | None = None
    ) -> Found:
        """Run many searches, on all cores if there are enough of them.

        Args:
            q_starts: shape (m, 7), rad.
            Ts: poses as matrices, shape (m, 4, 4).
            bounds: instead of the joint limits, shape (14,), rad.
        """
        arm = self._arm if bounds is None else self._numbers.within(bounds)
        return self._many((q_starts, self._task.turned(Ts)), (self._given, arm))

    def search_from_map(self, Ts: FloatArray) -> Found:
        """Search for poses, shape (m, 4, 4), each from its nearest setpoints in turn."""
        if self._many_from_map is None:
            return search_from_setpoints(self, self._map, Ts)
        return self._many_from_map((Ts, self._gripper_poses(Ts)), (self._given, self._arm))

    def _gripper_poses(self, Ts: FloatArray) -> FloatArray:
        """Poses of the gripper for poses of the tip, shape (..., 4, 4) each."""
        return Ts if self._T_tip_gripper is None else Ts @ self._T_tip_gripper


def search_from_setpoints(search: Search, map_: NullSpaceMap, Ts: FloatArray) -> Found:
    """Search for poses, shape (m, 4, 4), each from its nearest setpoints until one is valid.

    `map_search_function` does this for exact poses and also stops searches that progress slowly.
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
def _evaluated(shape: Shape, wanted: Backend) -> tuple[Sequence[ca.Function], Backend]:
    """The search functions for arms of a shape: as machine code, or in the virtual machine.

    Functions for the other shapes are compiled at the same time, so that only the first robot has
    to wait.
    """
    functions = search_functions(shape)
    if wanted is not Backend.CASADI:
        others = (other for other in Shape if other is not shape)
        machine_code = compiled(functions, lambda: map(search_functions, others))
        if machine_code is not None:
            return machine_code, Backend.COMPILED
    return functions, Backend.CASADI

"""Searcher: runs the search function on one pose or on many, wherever it is evaluated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from functools import cache
from typing import Protocol

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin.compilation.machine_code import compiled
from baxter_kin.errors import member_of
from baxter_kin.ik.search.arm_numbers import ArmNumbers
from baxter_kin.ik.search.buffered_search import BatchedSearch, BufferedSearch, Found
from baxter_kin.ik.search.exact_search import iterations_of, search_function, step_function
from baxter_kin.ik.search.map_search import PATIENCE, map_search_function
from baxter_kin.ik.search.task_search import task_search_function
from baxter_kin.ik.seeds import MAP_STARTS, NullSpaceMap
from baxter_kin.ik.task import Task
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import LIMBS, Arm
from baxter_kin.kinematics.symbolic import Shape
from baxter_kin.validation import FloatArray

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
        functions_of = exact_functions if task.is_exact else _task_functions
        functions, self.backend = evaluated(functions_of, self._numbers.shape, Backend.of(backend))
        self._turned = slice(None) if task.is_exact else (slice(None), np.argsort(task.columns))
        self._task = task
        self._given = () if task.is_exact else task.numbers(self._numbers.T_last_tip)
        self._arm = self._numbers.within()
        T = task.turned(arm.T_base_tip(arm.neutral).homogeneous)
        self._one = BufferedSearch(functions[0], (*self._given, self._arm))
        self._many = BatchedSearch(functions[0], (arm.neutral, T))
        self._one_from_map, self._many_from_map = None, None
        if task.is_exact:
            from_map = functions[1 + LIMBS.index(arm.side)]
            self._one_from_map = BufferedSearch(from_map, (self._arm,))
            self._many_from_map = BatchedSearch(from_map, (T,))

    def search_one(self, q_start: FloatArray, T_base_tip: pin.SE3) -> tuple[FloatArray, FloatArray]:
        """One search, with nothing checked and nothing copied.

        Args:
            q_start: shape (7,), rad.
            T_base_tip: the pose.

        Returns:
            Last iterate, shape (7,), and report, shape (5,), as the search function has them; both
            are overwritten by the next search of this thread.
        """
        one = self._one
        request = one.request
        request[0][:] = q_start
        request[1][self._turned] = T_base_tip.homogeneous
        one.run()
        return one.q, one.report

    def search_one_from_map(self, T_base_tip: pin.SE3) -> tuple[FloatArray, FloatArray] | None:
        """The same from the nearest setpoints; the pose must be valid.

        None for a tolerance or a tool: what starts suit them takes longer to find.
        """
        one = self._one_from_map
        if one is None:
            return None
        one.request[0][:] = T_base_tip.homogeneous
        one.run()
        return one.q, one.report

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
def _task_functions(shape: Shape) -> tuple[ca.Function, ...]:
    """For tasks with freedom, and tools: from a start."""
    return (task_search_function(shape),)

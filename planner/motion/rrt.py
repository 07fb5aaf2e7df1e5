"""Corners of a path around obstacles in joint space, by OMPL.

RRT-Connect (Kuffner and LaValle 2000) grows a tree from each end until they meet. OMPL has
pitfalls:

- It checks an edge at steps that are a fraction of the space's extent, by default so long that a
  quarter of the paths cross an obstacle. Here the step is a distance.
- It calls a path that does not reach its goal a solution too, an approximate one.
- Nothing stops it within an edge, and a time limit of 1e300 s expires at once.
- A validity checker must return a `bool`, and no other type of Python or NumPy.
- It logs to stdout, and its random numbers start from one seed per process, which it claims cannot
  be set twice. It can: objects created later draw from the new seed.

It is loaded by the first search, since it does not exist for every supported Python.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from baxter_kin import JointLimits
from baxter_kin.distribution.extras import run_to_install
from baxter_kin.errors import MissingLibraryError
from baxter_kin.validation import FloatArray
from planner.collision.context import IsFree
from planner.errors import MotionError

if TYPE_CHECKING:
    from ompl import base

EDGE_STEP_RAD = 0.02
"""Distance in joint space between two collision checks of an edge, a sixth of OMPL's default; with
a few mm of margin, no path crossed any of 100 walls."""

MAX_EDGE_RAD = 0.75
"""Maximum length of an edge of a tree. OMPL would choose a fifth of the arm's extent, 2.5; between
the boards of a shelf such edges are blocked."""

SHORTCUTS = 120
"""Number of straight lines between random points of a path that are tried in its place (Geraerts
and Overmars, Int. J. Robotics Research 26(8), 2007). Where no program shortens a path, the arm
stops at its corners."""

MIN_FRACTION, MAX_STEP_FRACTION = 1e-9, 0.01
"""Bounds of a step as a fraction of the extent: OMPL's resolution, and a reasonable maximum."""

NEWEST_PYTHON = (3, 13)
"""The newest Python for which OMPL has wheels; those for macOS need version 15."""

_ONE_AT_A_TIME = threading.RLock()
"""OMPL's seed and log level belong to the process."""


def search_corners(
    q_start: FloatArray,
    q_goal: FloatArray,
    limits: JointLimits,
    is_free: IsFree,
    *,
    rng: np.random.Generator,
    timeout_s: float,
    step_rad: float = EDGE_STEP_RAD,
) -> FloatArray | None:
    """Corners from start to goal; samples on the straight lines between them are free.

    Args:
        q_start: shape (n,), rad, inside the limits.
        q_goal: shape (n,), rad, inside the limits.
        limits: of those n joints; their positions bound the search.
        is_free: whether a configuration is free. An exception that it raises ends the search.
        rng: seeds the search; the same numbers find the same corners, unless the time expires.
        timeout_s: maximum duration of the search, above zero.
        step_rad: distance between two samples, Euclidean in joint space, above zero.

    Returns:
        Shape (m, n), rad, including start and goal; None when nothing was found in that time, or
        start or goal is not free.
    """
    ompl, ends = _load(), (q_start, q_goal)
    deadline_s, fraction = time.monotonic() + timeout_s, _fraction(limits, step_rad)
    with _quiet_and_seeded(ompl, int(rng.integers(1, 2**31))):
        space = _space(ompl, limits, _until(deadline_s, is_free), fraction)
        path = _solution(ompl, space, ends, deadline_s)
    if path is None:
        return None
    path[0], path[-1] = ends
    return path


def _load() -> Any:
    """Import OMPL, or raise an error that says what to do."""
    try:
        import ompl  # noqa: PLC0415 - only searches need it
    except ImportError as cause:
        raise MissingLibraryError(_what_to_do(cause)) from cause
    return ompl


def _what_to_do(cause: ImportError) -> str:
    if cause.name != "ompl":
        return f"ways around obstacles need OMPL, which cannot be loaded here: {cause}"
    newest = ".".join(map(str, NEWEST_PYTHON))
    if sys.version_info[:2] > NEWEST_PYTHON:
        what = f"which has no wheel for this Python yet; use Python 3.10 to {newest}"
    else:
        what = f"which is not installed; {run_to_install('ompl')}"
    return f"ways around obstacles need OMPL, {what}"


def _fraction(limits: JointLimits, step_rad: float) -> float:
    with np.errstate(over="ignore"):
        extent = float(np.linalg.norm(limits.q_max - limits.q_min))
    if step_rad < MIN_FRACTION * extent:
        raise MotionError(
            f"the position limits span {extent:.3g} rad; that is too wide to search in steps of "
            f"{step_rad:g} rad: give narrower ones"
        )
    return min(step_rad / extent, MAX_STEP_FRACTION)


def _until(deadline_s: float, is_free: IsFree) -> IsFree:
    """`is_free` until the deadline; afterwards nothing is free, which also ends an edge."""
    return lambda q: time.monotonic() < deadline_s and bool(is_free(q))


@contextmanager
def _quiet_and_seeded(ompl: Any, seed: int) -> Iterator[None]:
    with _ONE_AT_A_TIME:
        level = ompl.util.getLogLevel()
        ompl.util.setLogLevel(ompl.util.LogLevel.LOG_NONE)
        try:
            ompl.util.RNG.setSeed(seed)
            yield
        finally:
            ompl.util.setLogLevel(level)


def _space(
    ompl: Any, limits: JointLimits, is_free: IsFree, fraction: float
) -> base.SpaceInformation:
    joints = len(limits.names)
    bounds = ompl.base.RealVectorBounds(joints)
    for i in range(joints):
        bounds.setLow(i, float(limits.q_min[i]))
        bounds.setHigh(i, float(limits.q_max[i]))
    states = ompl.base.RealVectorStateSpace(joints)
    states.setBounds(bounds)
    space = ompl.base.SpaceInformation(states)
    space.setStateValidityChecker(lambda state: is_free(_vector(state, joints)))
    space.setStateValidityCheckingResolution(fraction)
    space.setup()
    return space


def _solution(
    ompl: Any, space: base.SpaceInformation, ends: tuple[FloatArray, FloatArray], deadline_s: float
) -> FloatArray | None:
    """The corners that RRT-Connect finds, shape (m, n), if they reach the goal."""
    problem = ompl.base.ProblemDefinition(space)
    states = [_state(space, q) for q in ends]
    problem.setStartAndGoalStates(*states)
    search = ompl.geometric.RRTConnect(space)
    search.setRange(MAX_EDGE_RAD)
    search.setProblemDefinition(problem)
    search.setup()
    search.solve(ompl.base.PlannerTerminationCondition(lambda: time.monotonic() >= deadline_s))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath()
    shortener = ompl.geometric.PathSimplifier(space)
    shortener.partialShortcutPath(path, SHORTCUTS, SHORTCUTS, 1.0)
    return np.array([_vector(s, ends[0].size) for s in path.getStates()])


def _state(space: base.SpaceInformation, q: FloatArray) -> base.State:
    state = space.allocState()
    for i, angle in enumerate(q.tolist()):
        state[i] = angle
    return state


def _vector(state: base.State, joints: int) -> FloatArray:
    return np.array([state[i] for i in range(joints)])

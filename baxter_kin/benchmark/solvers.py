"""Solvers that can take part: ours and peers, which are imported only when they are used.

To add a solver, add a line to `OURS` or `PEERS`. Some peers are given the arm's joint placements;
others read the stock robot's URDF and are skipped when another robot is measured.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.description import StockFiles
from baxter_kin.distribution.extras import run_to_install
from baxter_kin.errors import BaxterError
from baxter_kin.ik import IKResult, IKService
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

BatchCall: TypeAlias = Callable[[Sequence[pin.SE3], Sequence[FloatArray]], Sequence[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Contestant:
    """A solver in three steps, of which only the middle one is timed.

    Attributes:
        name: its name in tables.
        version: version of its package.
        settings: its settings, as a phrase.
        prepare: converts pose and seed, shape (7,), rad, to arguments of `call`; not timed.
        call: the solver's public call; timed.
        read: converts an answer to joint values, shape (7,), rad, or None when the solver reports
            a failure; not timed.
        forward: the solver's forward kinematics, a 4 x 4 matrix seen from base, to check that it
            solves the same arm; None if it has none.
        call_batch: solves many poses from many seeds, with one result each; None if it cannot.
        is_ours: whether it is this toolkit.
    """

    name: str
    version: str
    settings: str
    prepare: Callable[[pin.SE3, FloatArray], tuple[Any, ...]]
    call: Callable[..., Any]
    read: Callable[[Any], FloatArray | None]
    forward: Callable[[FloatArray], FloatArray] | None = None
    call_batch: BatchCall | None = None
    is_ours: bool = False


def scientific(number: float) -> str:
    """A number in short scientific notation, such as 1e-5."""
    return np.format_float_scientific(number, trim="-", exp_digits=1)


def version_of(package: str) -> str:
    """The version of an installed package; "unknown" when it runs from its sources."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


# One builder for each solver ---------------------------------------------------------------------


def ours(arm: Arm, **options: Any) -> Contestant:
    """This toolkit's IK service, with options of `IKService`."""
    service = IKService(arm, **options)

    def solve_batch(poses: Sequence[pin.SE3], seeds: Sequence[FloatArray]) -> Sequence[IKResult]:
        return service.solve_batch(poses, seeds=seeds)

    chosen = ", ".join(f"{name} {value}" for name, value in options.items())
    return Contestant(
        name=f"baxter-kin ({chosen})" if chosen else "baxter-kin",
        version=version_of("baxter-kin"),
        settings=f"`IKService.solve`, {chosen or 'all defaults'}",
        prepare=lambda T_base_tip, q_seed: (T_base_tip, q_seed),
        call=service.solve,
        read=lambda result: result.q if result.is_valid else None,
        call_batch=solve_batch,
        is_ours=True,
    )


TOOLBOX_SEARCHES = 1000
"""Maximum number of starts; the default of the package, 100, fails on a few poses."""


def toolbox(arm: Arm, *, tolerance: float) -> Contestant:
    """Roboticstoolbox for Python: Levenberg-Marquardt with random restarts, in C++ (`ETS.ik_LM`).

    Args:
        arm: whose tip to place.
        tolerance: on half the squared length of the pose error (m and rad mixed).
    """
    from roboticstoolbox import ET, ETS  # noqa: PLC0415 - a peer

    *placements, last = placements_about_z(arm)
    limits = zip(arm.limits.q_min, arm.limits.q_max, strict=True)
    parts = [
        part
        for placement, (lower, upper) in zip(placements, limits, strict=True)
        for part in (ET.SE3(placement.homogeneous), ET.Rz(qlim=[lower, upper]))
    ]
    ets = ETS([*parts, ET.SE3(last.homogeneous)])
    return Contestant(
        name=f"roboticstoolbox (tol {scientific(tolerance)})",
        version=version_of("roboticstoolbox-python"),
        settings=f"`ETS.ik_LM`, tol {scientific(tolerance)} on half the squared error, slimit "
        f"{TOOLBOX_SEARCHES}, else its defaults (Chan, 30 iterations a search)",
        prepare=lambda T_base_tip, q_seed: (T_base_tip.homogeneous, q_seed.copy()),
        call=partial(ets.ik_LM, tol=tolerance, slimit=TOOLBOX_SEARCHES),
        read=lambda solution: solution.q if solution.success else None,
        forward=lambda q: np.asarray(ets.eval(q)),
    )


TRAC_IK_TIMEOUT_S = 0.005
"""As published by its authors for Baxter (Beeson and Ames, Humanoids 2015), and its default."""


def trac_ik(arm: Arm, *, epsilon: float) -> Contestant:
    """TRAC-IK through pytracik: KDL's Newton and NLopt's SQP, always in two threads.

    Args:
        arm: whose tip to place.
        epsilon: greatest error along and about each axis, m and rad; 1e-5 is its default.
    """
    from trac_ik import TracIK  # noqa: PLC0415 - a peer

    urdf = str(StockFiles.installed().urdf)
    solver = TracIK("base", arm.tip_frame, urdf, timeout=TRAC_IK_TIMEOUT_S, epsilon=epsilon)
    solver.joint_limits = arm.limits.q_min, arm.limits.q_max  # it reads them in single precision

    def forward(q: FloatArray) -> FloatArray:
        T_base_tip = np.eye(4)
        T_base_tip[:3, 3], T_base_tip[:3, :3] = solver.fk(q)
        return T_base_tip

    return Contestant(
        name=f"TRAC-IK (eps {scientific(epsilon)})",
        version=f"pytracik {version_of('pytracik')}",
        settings=f"`TracIK.ik`, Speed, {1e3 * TRAC_IK_TIMEOUT_S:g} ms, eps {scientific(epsilon)} "
        "per axis; it always runs two threads",
        prepare=lambda pose, q_seed: (pose.translation.copy(), pose.rotation.copy(), q_seed.copy()),
        call=solver.ik,
        read=lambda q: q,
        forward=forward,
    )


OPTIK_TOLERANCE = 1e-12
"""Bound on the squared length of the pose error (m and rad mixed): the loosest that guarantees
1e-6. The default, 1e-6, leaves errors of 1e-3."""

OPTIK_MAX_TIME_S = 0.1
"""The default of the package."""


def optik(arm: Arm) -> Contestant:
    """OptIK: SLSQP on the logarithm of the pose error, with random restarts, in Rust.

    Its forward kinematics of Baxter differs from Pinocchio's by a constant transform before the
    first joint (42.6 mm, no rotation). The transform is determined here, at the middle of the joint
    ranges, and every pose is corrected for it before it is passed to OptIK; the correction is not
    timed. `enter` checks that it is the same everywhere.
    """
    from optik import Robot, SolverConfig  # noqa: PLC0415 - a peer

    robot = Robot.from_urdf_file(str(StockFiles.installed().urdf), "base", arm.tip_frame)
    robot.set_parallelism(1)  # one thread, as the others; with more it is not deterministic
    config = SolverConfig(solution_mode="speed", max_time=OPTIK_MAX_TIME_S, tol_f=OPTIK_TOLERANCE)
    q = 0.5 * (arm.limits.q_min + arm.limits.q_max)
    T_base_root: FloatArray = arm.T_base_tip(q).homogeneous @ np.linalg.inv(np.array(robot.fk(q)))
    T_root_base = np.linalg.inv(T_base_root)
    return Contestant(
        name=f"OptIK (tol {scientific(OPTIK_TOLERANCE)})",
        version=f"optik-py {version_of('optik-py')}",
        settings=f"`Robot.ik`, speed, 1 thread, {1e3 * OPTIK_MAX_TIME_S:g} ms, tol_f "
        f"{scientific(OPTIK_TOLERANCE)}; poses corrected by the constant offset of its base",
        prepare=lambda pose, q_seed: (T_root_base @ pose.homogeneous, q_seed.copy()),
        call=partial(robot.ik, config),
        read=lambda answer: None if answer is None else np.array(answer[0]),
        forward=lambda q: T_base_root @ np.array(robot.fk(q)),
    )


PINK_STEPS, PINK_STEP_S = 200, 1.0
"""Steps are so long that the velocity limits bound a step to 1.5 rad at least."""

PINK_DAMPING = 1e-2
"""Levenberg-Marquardt damping of the frame task: of 0, 1e-3, 1e-2 and 1 the one that solves most
poses, and fastest."""

PINK_LIMIT_GAIN = 1.0
"""Lets a step go all the way to a joint limit; the default of 0.5 only approaches it."""

PINK_ERROR = 5e-7
"""The loop ends when the task's error, m and rad mixed, is no longer than this."""


def pink(arm: Arm) -> Contestant:
    """Pink: differential IK, one quadratic program a step, in the loop its documentation shows."""
    from pink import Configuration, solve_ik  # noqa: PLC0415 - a peer
    from pink.limits import ConfigurationLimit, VelocityLimit  # noqa: PLC0415 - likewise
    from pink.tasks import FrameTask  # noqa: PLC0415 - likewise

    model = arm.model.copy()  # pink writes attributes onto the model
    data = model.createData()
    limits = [
        ConfigurationLimit(model, config_limit_gain=PINK_LIMIT_GAIN),
        VelocityLimit(model),
    ]
    task = FrameTask(
        arm.tip_frame, position_cost=1.0, orientation_cost=1.0, lm_damping=PINK_DAMPING
    )

    def solve(T_base_tip: pin.SE3, q_seed: FloatArray) -> FloatArray | None:
        task.set_target(T_base_tip)
        configuration = Configuration(model, data, q_seed)
        for _ in range(PINK_STEPS):
            if np.linalg.norm(task.compute_error(configuration)) <= PINK_ERROR:
                return np.array(configuration.q)
            velocity = solve_ik(configuration, [task], PINK_STEP_S, solver="daqp", limits=limits)
            configuration.integrate_inplace(velocity, PINK_STEP_S)
        return None

    return Contestant(
        name="pink",
        version=version_of("pin-pink"),
        settings=f"`solve_ik` with daqp, at most {PINK_STEPS} steps of {PINK_STEP_S:g} s until the "
        f"error is <= {scientific(PINK_ERROR)}; one `FrameTask`, costs 1 and 1, lm_damping "
        f"{PINK_DAMPING:g}; position limits with gain {PINK_LIMIT_GAIN:g} and velocity limits; no "
        "restarts",
        prepare=lambda pose, q_seed: (pose, q_seed.copy()),
        call=solve,
        read=lambda q: q,
    )


KDL_ITERATIONS = 100
"""The default of PyKDL."""

KDL_EPSILON = 5e-7
"""Maximum error along and about each axis, m and rad: the loosest that guarantees 1e-6 in all."""


def kdl(arm: Arm) -> Contestant:
    """Orocos KDL through PyKDL: Newton-Raphson with clamped joint limits, no restarts."""
    import PyKDL  # noqa: PLC0415 - a peer

    def frame(T: pin.SE3) -> Any:
        return PyKDL.Frame(PyKDL.Rotation(*T.rotation.ravel()), PyKDL.Vector(*T.translation))

    def joints(q: FloatArray) -> Any:
        array = PyKDL.JntArray(len(q))
        for index, value in enumerate(q):
            array[index] = value
        return array

    first, *others = placements_about_z(arm)
    chain = PyKDL.Chain()  # a segment is a joint and what comes after it, so the first is fixed
    chain.addSegment(PyKDL.Segment(PyKDL.Joint(), frame(first)))
    for placement in others:
        chain.addSegment(PyKDL.Segment(PyKDL.Joint(PyKDL.Joint.RotZ), frame(placement)))
    positions = PyKDL.ChainFkSolverPos_recursive(chain)
    velocities = PyKDL.ChainIkSolverVel_pinv(chain)
    q_limits = joints(arm.limits.q_min), joints(arm.limits.q_max)
    solver = PyKDL.ChainIkSolverPos_NR_JL(
        chain, *q_limits, positions, velocities, KDL_ITERATIONS, KDL_EPSILON
    )

    def solve(q_seed: Any, T_base_tip: Any, _: object = (chain, positions, velocities)) -> Any:
        """Solve; the default argument keeps objects alive that the solver does not own."""
        q = PyKDL.JntArray(q_seed.rows())
        return q if solver.CartToJnt(q_seed, T_base_tip, q) >= 0 else None

    def forward(q: FloatArray) -> FloatArray:
        T = PyKDL.Frame()
        positions.JntToCart(joints(q), T)
        rows = [[T[row, column] for column in range(4)] for row in range(3)]
        return np.array([*rows, [0.0, 0.0, 0.0, 1.0]])

    return Contestant(
        name="KDL",
        version=f"PyKDL {getattr(PyKDL, '__version__', 'unknown')}",
        settings=f"`ChainIkSolverPos_NR_JL` on `ChainIkSolverVel_pinv`, {KDL_ITERATIONS} "
        f"iterations, eps {scientific(KDL_EPSILON)} per axis; no restarts",
        prepare=lambda pose, q_seed: (joints(q_seed), frame(pose)),
        call=solve,
        read=lambda answer: None if answer is None else np.array(list(answer)),
        forward=forward,
    )


def placements_about_z(arm: Arm) -> list[pin.SE3]:
    """Eight fixed poses: before each of seven turns about z, and after the last, up to the tip.

    A calibrated joint turns about another axis than z; the frames on both sides of it are rotated
    so that this axis becomes their z axis.
    """
    model, data = arm.model, arm.model.createData()
    tip = model.frames[model.getFrameId(arm.tip_frame)].placement
    chain, turned_back = [], pin.SE3.Identity()
    for joint in range(1, model.njoints):
        axis = np.asarray(data.joints[joint].S).reshape(-1)[3:]
        turned = pin.SE3(pin.Quaternion.FromTwoVectors(np.eye(3)[2], axis).matrix(), np.zeros(3))
        chain.append(turned_back * model.jointPlacements[joint] * turned)
        turned_back = turned.inverse()
    return [*chain, turned_back * tip]


# Who takes part ----------------------------------------------------------------------------------

MAX_FK_DIFFERENCE = 1e-12
"""Allowed difference of two tip poses per matrix element; rounding alone makes 1e-15."""


@dataclass(frozen=True, slots=True)
class Entrant:
    """A solver that can be asked to take part.

    Attributes:
        key: its name on the command line.
        build: makes the contestant for an arm.
        needs: modules that must be installed.
        install: the command that installs them.
    """

    key: str
    build: Callable[[Arm], Contestant]
    needs: tuple[str, ...] = ()
    install: str = ""

    def missing(self) -> tuple[str, ...]:
        """Required modules that are not installed, found without importing any."""
        return tuple(name for name in self.needs if importlib.util.find_spec(name) is None)


@dataclass(frozen=True, slots=True)
class Absence:
    """Why a solver does not take part, as a sentence."""

    key: str
    reason: str


class KinematicsMismatchError(BaxterError):
    """The forward kinematics of a solver differs from the arm's."""


_TOOLBOX = ("roboticstoolbox",), run_to_install("roboticstoolbox-python")
_TRAC_IK = ("trac_ik",), run_to_install("pytracik")

OURS = (
    Entrant("baxter-kin", ours),
    Entrant("baxter-kin-casadi", partial(ours, backend="casadi")),
)
"""With machine code where a compiler is found, and in CasADi's virtual machine."""

PEERS = (
    Entrant("rtb", partial(toolbox, tolerance=1e-12), *_TOOLBOX),
    Entrant("rtb-tight", partial(toolbox, tolerance=4e-13), *_TOOLBOX),
    Entrant("trac-ik", partial(trac_ik, epsilon=1e-5), *_TRAC_IK),
    Entrant("trac-ik-tight", partial(trac_ik, epsilon=5e-7), *_TRAC_IK),
    Entrant("optik", optik, ("optik",), run_to_install("optik-py")),
    Entrant("pink", pink, ("pink", "qpsolvers", "daqp"), run_to_install("pin-pink", "daqp")),
    Entrant("kdl", kdl, ("PyKDL",), "run: apt-get install python3-pykdl"),
)
"""Roboticstoolbox and TRAC-IK take part twice: with the tolerance they are usually measured with,
and with one that implies the 1e-6 asked for here."""

ENTRANTS = OURS + PEERS


def enter(entrant: Entrant, arm: Arm) -> Contestant | Absence:
    """Set a solver up for an arm and check that it has the same kinematics."""
    missing = entrant.missing()
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        reason = f"{', '.join(missing)} {verb} not installed; {entrant.install}"
        return Absence(entrant.key, reason)
    try:
        contestant = entrant.build(arm)
        _check_chain(contestant, arm)
    except Exception as cause:  # a peer may raise anything; the others are still measured
        return Absence(entrant.key, f"{entrant.key} could not start: {describe(cause)}")
    return contestant


def describe(error: Exception) -> str:
    """Type and first line of an exception."""
    lines = str(error).splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


def _check_chain(contestant: Contestant, arm: Arm) -> None:
    if contestant.forward is None:
        return
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = arm.random_configuration(rng)
        gap = float(np.abs(contestant.forward(q) - arm.T_base_tip(q).homogeneous).max())
        if not gap <= MAX_FK_DIFFERENCE:
            raise KinematicsMismatchError(
                f"its forward kinematics differs from Pinocchio's by {gap:.2g} at q = {q.tolist()};"
                f" at most {MAX_FK_DIFFERENCE:g} is rounding"
            )

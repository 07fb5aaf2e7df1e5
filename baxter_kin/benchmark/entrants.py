"""Who may take part: our solvers and the peers. Nothing of theirs is imported before it is needed.

Another row is another line in `OURS` or `PEERS`; a `Contestant` is a solver as it is measured.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.distribution.extras import run_to_install
from baxter_kin.errors import BaxterError
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray
from baxter_kin.value_objects import FrozenMapping

BatchCall: TypeAlias = Callable[[Sequence[pin.SE3], Sequence[FloatArray]], Sequence[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Contestant:
    """A solver as three steps, of which only the middle one is timed.

    Attributes:
        name: as the table shows it.
        version: of the package it comes from.
        settings: everything that was chosen for it, as a phrase.
        prepare: pose and seed, shape (7,), rad, as the solver takes them; not timed.
        call: the public call, on what `prepare` gave; timed.
        read: joint values of what `call` gave, shape (7,), rad, or None when the solver itself
            says that it found none; not timed.
        forward: the solver's own forward kinematics, a 4 x 4 matrix seen from base, to check that
            it solves the same arm; None when it has none of its own.
        call_batch: many poses and seeds in one call, one result each as of `call`; None when it has
            no such call.
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


def short(number: float) -> str:
    """A tolerance as people write it, such as 1e-5."""
    return np.format_float_scientific(number, trim="-", exp_digits=1)


SAME_CHAIN = 1e-12
"""Entries of two tip poses (m, and of the rotation matrix) may differ by this much; rounding alone
makes 1e-15."""


@dataclass(frozen=True, slots=True)
class Entrant:
    """A solver that can be asked to take part.

    Attributes:
        key: its name on the command line.
        module: where it is set up, inside this package; it has a function `contestant(arm, ...)`.
        options: further arguments of that function.
        needs: modules that must be installed.
        install: what to do about it: a command.
    """

    key: str
    module: str
    options: Mapping[str, Any] = field(default_factory=lambda: FrozenMapping({}))
    needs: tuple[str, ...] = ()
    install: str = ""

    def missing(self) -> tuple[str, ...]:
        """Modules it needs that are not installed; looks without importing them."""
        return tuple(name for name in self.needs if importlib.util.find_spec(name) is None)


@dataclass(frozen=True, slots=True)
class Absence:
    """Why a solver does not take part, as a sentence."""

    key: str
    reason: str


class OtherChainError(BaxterError):
    """A solver's forward kinematics differs from the arm's."""


def _toolbox(key: str, tolerance: float) -> Entrant:
    return Entrant(
        key,
        "solvers.toolbox",
        {"tolerance": tolerance},
        needs=("roboticstoolbox",),
        install=run_to_install("roboticstoolbox-python"),
    )


def _trac_ik(key: str, epsilon: float) -> Entrant:
    return Entrant(
        key,
        "solvers.tracik",
        {"epsilon": epsilon},
        needs=("trac_ik",),
        install=run_to_install("pytracik"),
    )


OURS = (
    Entrant("baxter-kin", "solvers.ours"),
    Entrant("baxter-kin-casadi", "solvers.ours", {"backend": "casadi"}),
)
"""With machine code where a compiler is found, and in CasADi's virtual machine."""

PEERS = (
    _toolbox("rtb", 1e-12),
    _toolbox("rtb-tight", 4e-13),
    _trac_ik("trac-ik", 1e-5),
    _trac_ik("trac-ik-tight", 5e-7),
    Entrant("optik", "solvers.optik", needs=("optik",), install=run_to_install("optik-py")),
    Entrant(
        "pink",
        "solvers.pink_loop",
        needs=("pink", "qpsolvers", "daqp"),
        install=run_to_install("pin-pink", "daqp"),
    ),
    Entrant("kdl", "solvers.kdl", needs=("PyKDL",), install="run: apt-get install python3-pykdl"),
)
"""Roboticstoolbox and TRAC-IK take part twice: with the tolerance they are usually measured with,
and with one that implies the 1e-6 asked for here."""

ENTRANTS = OURS + PEERS


def enter(entrant: Entrant, arm: Arm) -> Contestant | Absence:
    """Set the solver up for the arm and check that it solves the same chain."""
    missing = entrant.missing()
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        reason = f"{', '.join(missing)} {verb} not installed; {entrant.install}"
        return Absence(entrant.key, reason)
    try:
        build = import_module(f"baxter_kin.benchmark.{entrant.module}").contestant
        contestant: Contestant = build(arm, **entrant.options)
        _check_chain(contestant, arm)
    except Exception as cause:  # a guest may raise anything; the others shall still be measured
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
        if not gap <= SAME_CHAIN:
            raise OtherChainError(
                f"its forward kinematics differs from Pinocchio's by {gap:.2g} at q = {q.tolist()};"
                f" at most {SAME_CHAIN:g} is rounding"
            )

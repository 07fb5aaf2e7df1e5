"""Contestant: one IK solver, set up for one arm, in the form in which it is measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector

BatchCall: TypeAlias = Callable[[Sequence[pin.SE3], Sequence[Vector]], Sequence[Any]]


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
    prepare: Callable[[pin.SE3, Vector], tuple[Any, ...]]
    call: Callable[..., Any]
    read: Callable[[Any], Vector | None]
    forward: Callable[[Vector], Vector] | None = None
    call_batch: BatchCall | None = None
    is_ours: bool = False


def short(number: float) -> str:
    """A tolerance as people write it, such as 1e-5."""
    return np.format_float_scientific(number, trim="-", exp_digits=1)

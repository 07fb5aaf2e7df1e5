"""Requests of inverse kinematics as they were given: poses, seeds, and what they allow."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sized
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.errors import ConfigurationError, RequestError
from baxter_kin.ik.search.search_function import SEED_TOLERANCE_RAD
from baxter_kin.ik.seeds import SeedMode, SeedType
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, float_array

SeedLike: TypeAlias = "Mapping[str, float] | ArrayLike"
"""A configuration by joint name or in joint order, rad."""

BLOCK = 4096
"""How many poses of a large batch are worked on together."""

MOST_POSES = 10_000_000
"""Of a batch, whose results are all kept: some gigabytes. A stream may have any number."""


@dataclass(frozen=True, slots=True)
class Requests:
    """Poses with all that goes with them, as they were given."""

    poses: list[Any]
    seeds: list[Any] | None
    current: SeedLike | None
    mode: SeedMode
    first: int = 0  # the number of the first one, for error messages

    def blocks(self) -> Iterator[Requests]:
        """The same, `BLOCK` at a time."""
        for at in range(0, len(self.poses), BLOCK):
            part = slice(at, at + BLOCK)
            seeds = None if self.seeds is None else self.seeds[part]
            yield replace(self, poses=self.poses[part], seeds=seeds, first=self.first + at)

    def seed_table(self, arm: Arm) -> dict[SeedType, FloatArray]:
        """The seeds of each type, shape (n, 7), rad; NaN where there is none.

        Raises:
            ConfigurationError: when a seed has another shape, is not finite, or lies too far
                outside the arm's limits.
            UnknownNameError: when a seed names a joint of another arm.
        """
        table = {}
        if self.seeds is not None:
            table[SeedType.USER] = self._user_seeds(arm, self.seeds)
        if self.current is not None:
            q = _checked_seed(arm, self.current, "current")
            table[SeedType.CURRENT] = np.tile(q, (len(self.poses), 1))
        return table

    def _user_seeds(self, arm: Arm, seeds: list[Any]) -> FloatArray:
        if all(type(seed) is np.ndarray and seed.shape == (7,) for seed in seeds):
            together = float_array(seeds, "seeds", ConfigurationError)
            limits, slack = arm.limits, SEED_TOLERANCE_RAD
            inside = (together >= limits.q_min - slack) & (together <= limits.q_max + slack)
            if inside.all():  # which NaN is not
                return together.clip(limits.q_min, limits.q_max)
        table = np.full((len(seeds), 7), np.nan)
        for i, seed in enumerate(seeds):
            if seed is not None:
                name = "seed" if len(seeds) == 1 else f"seeds[{self.first + i}]"
                table[i] = _checked_seed(arm, seed, name)
        return table


def _checked_seed(arm: Arm, seed: SeedLike, what: str) -> FloatArray:
    return arm.limits.check(arm.configuration(seed, what), what, SEED_TOLERANCE_RAD)


def as_list(values: Iterable[Any], what: str) -> list[Any]:
    """Poses or seeds of known number.

    Raises:
        RequestError: when they are no sequence, or more than `MOST_POSES`.
    """
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise RequestError(f"{what} must be a sequence, got {type(values).__name__}")
    if not isinstance(values, Sized):
        raise RequestError(
            f"{what} must be a sequence, whose length is known, got {type(values).__name__}; "
            "solve_stream takes any iterable, or make a list of it"
        )
    if len(values) > MOST_POSES:
        raise RequestError(
            f"{len(values)} {what} came; a batch takes up to {MOST_POSES}, solve_stream any number"
        )
    return list(values)

"""The line behind a tip in the live view, drawn piece by piece while the tip moves."""

from __future__ import annotations

from collections import deque

import numpy as np

from baxter_kin.arrays import Vector
from sim.view.meshcat_commands import Command, delete
from sim.view.scenegraph import line_command
from sim.view.tip_path import LONGEST_JUMP_M, PATH_RADIUS_M, STRETCH_M, line_rgb

PIECE_POINTS = 32
"""A piece is sent again whenever it grows; a full one is followed by the next."""

PIECES_KEPT = 24
"""The oldest pieces vanish: some 10 m of line stay."""


class Trail:
    """One tip's line."""

    def __init__(self, side: str) -> None:
        """Empty.

        Args:
            side: whose tip; the pieces are nodes under `/path/<side>`.
        """
        self._root = f"/path/{side}"
        self._points: list[Vector] = []
        self._is_holding = False
        self._number = 0
        self._kept: deque[str] = deque()

    def advance(self, point_base: Vector, *, is_holding: bool) -> list[Command]:
        """The tip is there now: what to draw and what to remove; mostly nothing.

        Args:
            point_base: shape (3,), metres.
            is_holding: whether the hand holds something, for the colour.
        """
        if not self._points:
            self._begin([point_base], is_holding)
            return []
        step = float(np.linalg.norm(point_base - self._points[-1]))
        if step > LONGEST_JUMP_M:
            self._begin([point_base], is_holding)
            return []
        if is_holding != self._is_holding or len(self._points) >= PIECE_POINTS:
            self._begin(self._points[-1:], is_holding)
        if step < STRETCH_M:
            return []
        self._points.append(point_base)
        return self._drawn()

    def _begin(self, points: list[Vector], is_holding: bool) -> None:
        self._points = points
        self._is_holding = is_holding
        self._number += 1

    def _drawn(self) -> list[Command]:
        path = f"{self._root}/{self._number}"
        removed = []
        if path not in self._kept:
            self._kept.append(path)
            if len(self._kept) > PIECES_KEPT:
                removed.append(delete(self._kept.popleft()))
        line = line_command(path, np.array(self._points), PATH_RADIUS_M, line_rgb(self._is_holding))
        return [*removed, line]

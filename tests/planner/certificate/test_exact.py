"""A second checker of rows, written from the theorem alone, in whole numbers of 2^-200.

Nothing of its arithmetic is the checker's: kinematics from the text of the URDF, sines by Taylor's
series, polynomials and speeds that they meet, supports point by point, a walk through the letters.
What it takes over are the pairs of movers, and where clusters are in the frames that carry them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from fractions import Fraction
from functools import cache, cached_property
from math import isqrt
from typing import Any, NamedTuple

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Body as SceneBody
from planner import Manipulator, Move, Plan, Scene, complete, plan_joint_move
from planner.certificate.body import Body
from planner.certificate.checking import Witness
from planner.certificate.clusters import Clusters
from planner.certificate.robot import Robot
from planner.certificate.rows import Advice, Judge, Pair, Step, Tasks
from planner.certificate.timeline import Timeline
from planner.plan_file import plan_document
from planner.state import State
from planner.verification import PolynomialMotion, certificate_of, certify

P = 200
ONE = 1 << P

LOOKS = 8
"""Instants of each piece in a cell at which speeds are compared with their bounds."""

EVERY = 4
"""Of so many rows one is compared."""

CLOSE_M = 1e-9
"""How much less than the exact gap at the ends of a cell the checker may take."""

Vector = list[int]
Matrix = list[Vector]


def fixed(x: float) -> int:
    n, d = float(x).as_integer_ratio()
    return n * ONE // d


def mul(a: int, b: int) -> int:
    return a * b >> P


def dot(a: Vector, b: Vector) -> int:
    return sum(x * y for x, y in zip(a, b, strict=True)) >> P


def root(a: int) -> int:
    return isqrt(max(a, 0) << P)


def norm(a: Vector) -> int:
    return root(dot(a, a))


def product(A: Matrix, B: Matrix) -> Matrix:
    columns = list(zip(*B, strict=True))
    return [[dot(row, list(column)) for column in columns] for row in A]


def sine_cosine(angle: int) -> tuple[int, int]:
    sums, term = [0, 0], ONE
    for i in range(200):
        sums[i % 2] += -term if i % 4 >= 2 else term
        term = mul(term, angle) // (i + 1)
    return sums[1], sums[0]


def turn(axis: int, angle: int) -> Matrix:
    s, c = sine_cosine(angle)
    R = [[ONE if i == j == axis else 0 for j in range(3)] for i in range(3)]
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i][i] = R[j][j] = c
    R[j][i], R[i][j] = s, -s
    return R


class Frame(NamedTuple):
    R: Matrix
    p: Vector

    def of(self, other: Frame) -> Frame:
        moved = [dot(row, other.p) + p for row, p in zip(self.R, self.p, strict=True)]
        return Frame(product(self.R, other.R), moved)


STILL = Frame([[ONE if i == j else 0 for j in range(3)] for i in range(3)], [0, 0, 0])


class Arm:
    """Frames of the seven joints from the text of a URDF."""

    def __init__(self, text: str, names: tuple[str, ...]) -> None:
        joints = [j for j in ET.fromstring(text).iter("joint") if j.find("child") is not None]
        by_child = {self._link(j, "child"): j for j in joints}
        moved = [self._link(next(j for j in joints if j.get("name") == n), "child") for n in names]
        self.spans = []
        for child, before in zip(moved, ["base", *moved], strict=False):
            span, link = STILL, child
            while link != before:
                span = self._origin(by_child[link]).of(span)
                link = self._link(by_child[link], "parent")
            self.spans.append(span)

    @staticmethod
    def _link(joint: ET.Element, tag: str) -> str:
        element = joint.find(tag)
        assert element is not None
        return element.attrib["link"]

    @staticmethod
    def _origin(joint: ET.Element) -> Frame:
        origin = joint.find("origin")
        if origin is None:
            return STILL
        xyz, rpy = (
            [fixed(float(x)) for x in origin.get(key, "0 0 0").split()] for key in ("xyz", "rpy")
        )
        R = product(product(turn(2, rpy[2]), turn(1, rpy[1])), turn(0, rpy[0]))
        return Frame(R, xyz)

    def seen(self, m: int, k: int, q: Vector) -> Frame:
        """Joint k seen from joint m."""
        T = STILL
        for i in range(m, k):
            T = T.of(self.spans[i]).of(Frame(turn(2, q[i]), [0, 0, 0]))
        return T


class Motion:
    """The polynomials of a file, by derivatives at the start of each piece."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.t = [fixed(t) for t in data["knots_s"]]
        given = data.get("derivatives") or [
            list(rows) for rows in zip(*(data[key] for key in "qvaj"), strict=False)
        ]
        self.d = [[[fixed(x) for x in row] for row in own] for own in given]

    def at(self, t: int) -> Vector:
        i = max(k for k in range(len(self.d)) if self.t[k] <= t)
        return self._value(i, 0, t - self.t[i])

    def _value(self, i: int, order: int, s: int) -> Vector:
        found = [0] * 7
        for k in range(len(self.d[i]) - 1, order - 1, -1):
            later = [mul(s, x) // (k - order + 1) for x in found]
            found = [x + y for x, y in zip(self.d[i][k], later, strict=True)]
        return found

    @cache  # noqa: B019 - lives as long as one test
    def peaks(self, start: int, end: int) -> tuple[Vector, Vector]:
        """Greatest speed and acceleration of each joint met at instants of a cell."""
        fast, hard = [0] * 7, [0] * 7
        for i in range(len(self.d)):
            low, high = max(start, self.t[i]), min(end, self.t[i + 1])
            if low >= high:
                continue
            looks = [low - self.t[i] + (high - low) * k // LOOKS for k in range(LOOKS + 1)]
            for s in looks:
                fast = [max(x, abs(y)) for x, y in zip(fast, self._value(i, 1, s), strict=True)]
                hard = [max(x, abs(y)) for x, y in zip(hard, self._value(i, 2, s), strict=True)]
        return fast, hard

    @cached_property
    def kinks(self) -> list[tuple[int, Vector]]:
        """When the velocity jumps, and by how much."""
        found = []
        for i in range(1, len(self.d)):
            before = self._value(i - 1, 1, self.t[i] - self.t[i - 1])
            jump = [abs(x - y) for x, y in zip(before, self.d[i][1], strict=True)]
            if max(jump) > fixed(1e-8):
                found.append((self.t[i], jump))
        return found

    def jumps(self, start: int, end: int) -> Vector:
        """What the velocity of each joint jumps by inside of a cell, in all."""
        inside = [jump for t, jump in self.kinks if start < t < end]
        return [sum(column) for column in zip(*inside, strict=True)] or [0] * 7

    def cut(self, start: float, end: float) -> float:
        """Where a cell is cut: at the kink inside that is nearest to its middle, or there."""
        middle = 0.5 * (start + end)
        inside = [float(Fraction(t, ONE)) for t, _ in self.kinks if fixed(start) < t < fixed(end)]
        return min(inside, key=lambda t: (abs(t - middle), t), default=middle)


class Exact:
    """Rows of one step."""

    def __init__(self, arm: Arm, clusters: Clusters, step: Step, motion: Motion) -> None:
        self._arm, self._clusters, self._step, self._motion = arm, clusters, step, motion
        self._places = {each.root: each for each in clusters.placed}

    @cache  # noqa: B019 - the same
    def _frame(self, m: int, k: int, t: int) -> Frame:
        return self._arm.seen(m, k, self._motion.at(t))

    @cache  # noqa: B019 - the same
    def _points(self, node: int) -> tuple[Frame, list[Vector], int, int]:
        """A node in the frame of its tree: where that is, its points, ball and disc."""
        place = self._places[max(r for r in self._places if r <= node)]
        points = place.shape.points_of(node - place.root)
        frame = Frame([[fixed(x) for x in row] for row in place.R], [fixed(x) for x in place.p])
        own = [[fixed(x) for x in point] for point in points]
        return frame, own, fixed(place.shape.ball_m), fixed(place.shape.disc_m)

    def _lowest(self, node: int, n: Vector) -> int:
        frame, points, ball, disc = self._points(node)
        d = [dot(n, list(column)) for column in zip(*frame.R, strict=True)]
        least = min(dot(d, x) for x in points) + dot(n, frame.p)
        return least - mul(ball, norm(n)) - mul(disc, norm([*d[:2], 0]))

    def row(self, pair: Pair, a: int, b: int, cell: tuple[float, float], n: Any) -> tuple[int, int]:
        """The lesser gap at both ends of the cell, and how much it may sag in between."""
        direction, (k, m) = [fixed(x) for x in n], (pair.first.level, pair.second.level)
        start, end = (fixed(t) for t in cell)
        along = [0, ONE, 0]
        ends = []
        for t in (start, end):
            T = self._frame(m, k, t)
            seen = [dot(direction, list(column)) for column in zip(*T.R, strict=True)]
            slide = mul(dot(seen, along), fixed(pair.first.slide_m[0]))
            ends.append(dot(direction, T.p) + self._lowest(a, seen) + slide)
        ends_gap = min(ends) + self._lowest(b, [-x for x in direction])
        return (ends_gap << P) // norm(direction), self._sag(pair, a, m, start, end)

    def _sag(self, pair: Pair, a: int, m: int, start: int, end: int) -> int:
        (fast, hard), jumps = self._motion.peaks(start, end), self._motion.jumps(start, end)
        frame, points, ball, disc = self._points(a)
        placed = [frame.of(Frame(STILL.R, x)).p for x in points]
        reach = max(map(norm, placed)) + ball + disc + abs(fixed(pair.first.slide_m[0]))
        u = w = jump = 0
        for i in range(pair.first.level - 1, m - 1, -1):
            bend = root(mul(mul(fast[i], fast[i]), mul(fast[i], fast[i])) + mul(hard[i], hard[i]))
            w += 2 * mul(fast[i], u) + mul(bend, reach)
            u += mul(fast[i], reach)
            jump += mul(jumps[i], reach)
            reach += norm(self._arm.spans[i].p)
        return mul(w, mul(end - start, end - start)) // 8 + mul(jump, end - start) // 4


@pytest.fixture(scope="module")
def short_plan(manipulator: Manipulator, table: SceneBody, block: SceneBody) -> Plan:
    q = manipulator.arm.neutral
    motion = plan_joint_move(q, q + np.linspace(-0.3, 0.3, 7), manipulator.limits)
    start = State.of(manipulator, Scene.of([table, block]), q=q)
    return complete(Plan(start, (Move("move", motion),)), manipulator=manipulator)


def walk(
    judge: Judge, clusters: Clusters, advice: Advice, motion: Motion
) -> Iterator[tuple[Any, ...]]:
    """Rows in the order of letters: (pair, first, second, start, end, letter, direction)."""
    open_ = [
        (number, pair.first.root, pair.second.root, pair.begin_s, pair.end_s)
        for number, pair in enumerate(judge.step.pairs)
    ]
    while open_:
        letters, n = advice.next(len(open_))
        halves: dict[tuple[int, int], list[tuple[Any, ...]]] = {}
        for task, letter, direction in zip(open_, letters, n, strict=True):
            number, first, second, start, end = task
            if letter <= 2:
                yield (*task, letter, direction)
                continue
            kids = clusters.children(np.array([first if letter == 3 else second]))[0].tolist()
            middle = motion.cut(start, end)
            for side in (0, 1):
                halves.setdefault((side, int(letter)), []).append(
                    {
                        3: (number, kids[side], second, start, end),
                        4: (number, first, kids[side], start, end),
                        5: (number, first, second, *((start, middle), (middle, end))[side]),
                    }[int(letter)]
                )
        open_ = [task for key in sorted(halves) for task in halves[key]]


def test_rows_conclude_no_more_than_it_exactly_may(short_plan: Plan, robot: Baxter) -> None:
    document: Any = {**plan_document(short_plan), "certificate": certificate_of(short_plan)}
    require_exact(document, robot)


def test_rows_of_quintics_with_kinks_between_are_exact_as_well(
    short_plan: Plan, robot: Baxter
) -> None:
    q = short_plan.moves[0].trajectory.q_start + np.outer(
        [0.0, 0.4, 1.0], np.linspace(-0.3, 0.3, 7)
    )
    q[1, 3] += 0.1
    smooth = PolynomialMotion.through([0.0, 1.5, 2.5], q, 0.0 * q, 0.0 * q).derivatives
    straight = PolynomialMotion.through([0.0, 1.5, 2.5], q).derivatives
    rows = np.zeros((3, 6, 7))
    rows[0], rows[1, :2], rows[2, :2] = smooth[0], straight[1], (q[2], -straight[0, 1])
    motion = PolynomialMotion(np.array([0.0, 1.5, 2.5, 3.5]), rows)
    found = certify(motion, "left", short_plan.start)
    assert found.is_certified, found.reason
    require_exact(found.document, robot)


def require_exact(document: Any, robot: Baxter) -> None:
    """Compare rows of a moving step with exact ones."""
    text, plan = robot.description.text, document["plan"]
    witness = Witness.of_file(document["certificate"])
    own = Robot(text, "left")
    timeline = Timeline(plan, document["states"], own, Body(text), witness.steps)
    motion = Motion(plan["steps"][0]["trajectory"])
    advice, rows = Advice(witness.trace), 0
    for step in timeline.steps:
        judge = Judge(own, timeline.clusters, step)
        found = list(walk(judge, timeline.clusters, advice, motion))
        if step.motion is None:
            continue
        exact = Exact(Arm(text, own.names), timeline.clusters, step, motion)
        columns = [np.array(column) for column in list(zip(*found, strict=True))[:5]]
        tasks = Tasks(*columns)
        judge.place(np.unique(np.concatenate([tasks.start_s, tasks.end_s])))
        middles = judge.between_middles(tasks)
        n = np.array([m if row[5] == 2 else row[6] for row, m in zip(found, middles, strict=True)])
        concluded = list(zip(found, n, judge.gaps_m(tasks, n), judge.sag_m(tasks), strict=True))
        for row, direction, gap_m, sag_m in concluded[::EVERY]:
            number, first, second, start, end = row[:5]
            pair = step.pairs[number]
            ends, sag = exact.row(pair, first, second, (start, end), direction)
            assert sag <= fixed(sag_m)
            assert 0 <= ends - fixed(gap_m) - fixed(sag_m) <= fixed(CLOSE_M)
            assert ends - sag > fixed(pair.least_m)
            rows += 1
    assert advice.is_used_up
    assert rows > 25

"""Rows of the kernel against coal's distances, against the checker, and against NumPy's rows."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Plan
from planner.certificate.body import Body
from planner.certificate.checking import check
from planner.certificate.clusters import Clusters, Shape
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Interval, Pose
from planner.certificate.robot import Robot
from planner.certificate.rows import Advice, Mover, Pair, Step, certified_m
from planner.plan_file import plan_document
from planner.prover import kernel
from planner.prover.kernel import Kernel, Trees
from planner.prover.numpy_search import rows_of
from planner.prover.problem import Chain, NotShownError
from planner.verification import certificate_of

SHARE = 0.98

SHAPES: list[dict[str, Any]] = [
    {"type": "Box", "size_m": [0.1, 0.04, 0.06]},
    {"type": "Sphere", "radius_m": 0.05},
    {"type": "Cylinder", "radius_m": 0.03, "length_m": 0.12},
]


@pytest.fixture(scope="module")
def own(robot: Baxter) -> Robot:
    return Robot(robot.description.text, "left")


def coal_shape(data: dict[str, Any]) -> coal.ShapeBase:
    if data["type"] == "Box":
        return coal.Box(*data["size_m"])
    if data["type"] == "Sphere":
        return coal.Sphere(data["radius_m"])
    return coal.Cylinder(data["radius_m"], data["length_m"])


def still(clusters: Clusters, roots: tuple[int, int], least_m: float = 0.0) -> Step:
    first, second = (Mover(name, root, 0) for name, root in zip("ab", roots, strict=True))
    return Step("still", [Pair(first, second, least_m, 0.0, 1.0)], None, np.zeros(7))


def rotation(rng: np.random.Generator) -> np.ndarray[Any, Any]:
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return R if np.linalg.det(R) > 0.0 else -R


@given(
    kinds=st.tuples(st.integers(0, 2), st.integers(0, 2)),
    seed=st.integers(0, 2**31),
    away_m=st.floats(0.0, 0.3),
)
def test_distances_are_coals_and_contacts_are_refused(
    own: Robot, own_kernel: Kernel, kinds: tuple[int, int], seed: int, away_m: float
) -> None:
    rng, clusters = np.random.default_rng(seed), Clusters()
    data = [SHAPES[kind] for kind in kinds]
    R = [rotation(rng), rotation(rng)]
    way = rng.normal(size=3)
    p = [np.zeros(3), away_m * way / np.linalg.norm(way)]
    roots = [
        clusters.add(Shape.of_file(each, "x"), Pose(Interval(turned), Interval(place)))
        for each, turned, place in zip(data, R, p, strict=True)
    ]
    placed = [coal.Transform3s(turned, place) for turned, place in zip(R, p, strict=True)]
    shapes = [coal_shape(each) for each in data]
    distance_m = coal.distance(
        shapes[0], placed[0], shapes[1], placed[1], coal.DistanceRequest(), coal.DistanceResult()
    )
    step = still(clusters, (roots[0], roots[1]))
    trees = Trees.of(own_kernel, clusters)
    if distance_m < 1e-5:
        if distance_m < -1e-5:
            with pytest.raises(NotShownError, match="a and b come as near as"):
                own_kernel.rows(Chain.of(own), trees, step, share=SHARE)
        return
    found = own_kernel.rows(Chain.of(own), trees, step, share=SHARE)
    assert SHARE * distance_m - 1e-5 <= found.proven_m <= distance_m + 1e-6
    assert certified_m(own, clusters, step, Advice(found.trace)) >= found.proven_m


@pytest.mark.slow
def test_without_a_compiler_numpy_finds_rows_that_certify_as_much(
    tracked_plan: Plan, robot: Baxter, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("planner.verification.witness.rows_kernel", lambda: None)
    document = {**plan_document(tracked_plan), "certificate": certificate_of(tracked_plan)}
    text = robot.description.text
    found = check(document, text, body=Body(text))
    for step in tracked_plan:
        if step.proof is not None:
            kept = [clear_m for label, clear_m in found.clearances_m if label == step.label]
            assert min(kept) >= 0.97 * step.proof.nearest.distance_m


def test_both_searches_refuse_the_same(own: Robot, own_kernel: Kernel) -> None:
    clusters = Clusters()
    box = Shape.of_file(SHAPES[0], "box")
    roots = [
        clusters.add(box, Pose(Interval(np.eye(3)), Interval([x, 0.0, 0.0]))) for x in (0.0, 0.11)
    ]
    for least_m, is_shown in ((0.009, True), (0.011, False)):
        step = still(clusters, (roots[0], roots[1]), least_m)
        trees = Trees.of(own_kernel, clusters)
        if is_shown:
            assert own_kernel.rows(Chain.of(own), trees, step, share=0.0).proven_m > least_m
            assert rows_of(own, clusters, step, 0.0).proven_m > least_m
            continue
        with pytest.raises(NotShownError):
            own_kernel.rows(Chain.of(own), trees, step, share=0.0)
        with pytest.raises(NotShownError):
            rows_of(own, clusters, step, 0.0)


def test_large_bodies_near_each_other_are_separated(own: Robot, own_kernel: Kernel) -> None:
    """It was believed that directions of numbers up to 127 do: half a metre takes 2 mm of them."""
    clusters, angle = Clusters(), 0.0031
    R = np.array(
        [
            [np.cos(angle), 0.0, np.sin(angle)],
            [0.0, 1.0, 0.0],
            [-np.sin(angle), 0.0, np.cos(angle)],
        ]
    )
    plate = Shape.of_file({"type": "Box", "size_m": [1.0, 1.0, 0.02]}, "plate")
    roots = [
        clusters.add(plate, Pose(Interval(R), Interval(R @ [0.0, 0.0, z]))) for z in (0.0, 0.0203)
    ]
    step = still(clusters, (roots[1], roots[0]))
    found = own_kernel.rows(Chain.of(own), Trees.of(own_kernel, clusters), step, share=0.9)
    assert found.proven_m > 0.9 * 3e-4 - 1e-6
    assert len(found.trace.fine) == 1


@pytest.mark.slow
def test_threads_find_the_same(
    own: Robot, own_kernel: Kernel, tracked_plan: Plan, robot: Baxter
) -> None:
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda _: certificate_of(tracked_plan), range(2)))
    assert all(each == found[0] for each in found)


def test_a_hollow_of_a_mesh_is_not_filled(own: Robot, own_kernel: Kernel) -> None:
    """It was believed that a leaf may have some triangles: their hull closed a channel."""
    clusters, corners = Clusters(), []
    for y in (-0.1, 0.1):
        a, b, c, d = ([x, y, z] for x, z in ((0.0, 0.0), (0.3, 0.0), (0.3, 0.1), (0.0, 0.1)))
        corners += [[a, b, c], [a, c, d]]
    vertices = np.array(corners).reshape(-1, 3)
    data = {
        "type": "Mesh",
        "vertices": vertices.tolist(),
        "triangles": np.arange(len(vertices)).reshape(-1, 3).tolist(),
    }
    channel = clusters.add(Shape.of_file(data, "channel"), Pose.identity())
    ball = clusters.add(
        Shape.of_file({"type": "Sphere", "radius_m": 0.05}, "ball"),
        Pose(Interval(np.eye(3)), Interval([0.15, 0.0, 0.05])),
    )
    step = still(clusters, (ball, channel))
    found = own_kernel.rows(Chain.of(own), Trees.of(own_kernel, clusters), step, share=SHARE)
    assert found.proven_m == pytest.approx(0.05, rel=0.03)


def test_other_libraries_are_not_loaded(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nothing"):
        Kernel(str(tmp_path / "nothing.so"))
    with pytest.raises(OSError, match="has no rows"):
        Kernel("libm.so.6")


def test_more_rows_than_fit_are_an_error(
    own: Robot, own_kernel: Kernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel, "MAX_LETTERS", 0)
    clusters = Clusters()
    box = Shape.of_file(SHAPES[0], "box")
    roots = [
        clusters.add(box, Pose(Interval(np.eye(3)), Interval([x, 0.0, 0.0]))) for x in (0.0, 0.2)
    ]
    with pytest.raises(NotCertifiedError, match="more rows than are checked"):
        own_kernel.rows(
            Chain.of(own),
            Trees.of(own_kernel, clusters),
            still(clusters, (roots[0], roots[1])),
            share=SHARE,
        )

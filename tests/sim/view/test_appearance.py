from __future__ import annotations

import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from baxter_kin import Baxter
from sim.view.appearance import Appearance

MAX_BYTES = 1_000_000

THINNED_M = 3e-3
"""The build script lets surfaces move by about 2 mm where nobody sees it."""

WITHOUT_MESH = {"pedestal", "collision_head", "accelerometer"}
"""Links not drawn, or drawn by another mesh than the URDF's visual."""


@pytest.fixture(scope="module")
def appearance() -> Appearance:
    return Appearance.load()


@pytest.fixture(scope="module")
def visuals(robot: Baxter) -> list[pin.GeometryObject]:
    """The visuals as Pinocchio reads them from the original meshes."""
    geometry = pin.buildGeomFromUrdf(
        robot.model,
        str(robot.description.stock.urdf),
        pin.GeometryType.VISUAL,
        package_dirs=[str(robot.description.stock.package_dir)],
    )
    return [
        visual
        for visual in geometry.geometryObjects
        if Path(visual.meshPath).suffix and not any(link in visual.name for link in WITHOUT_MESH)
    ]


def bounds(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([points.min(axis=0), points.max(axis=0)])


@pytest.mark.slow
def test_fills_the_same_space_as_the_original_meshes(
    appearance: Appearance, visuals: list[pin.GeometryObject], robot: Baxter
) -> None:
    for visual in visuals:
        stem, joint = Path(visual.meshPath).stem, robot.model.names[visual.parentJoint]
        points = [
            part.T_joint_mesh.act(point)
            for part in appearance.parts
            if part.mesh.name.split(".")[0] == stem
            and part.joint == joint
            and part.T_joint_mesh.isApprox(visual.placement, 1e-9)
            for point in part.mesh.points_m
        ]
        wanted = [visual.placement.act(point) for point in visual.geometry.vertices()]
        difference = np.abs(bounds(np.array(points)) - bounds(np.array(wanted))).max()
        assert difference < THINNED_M, visual.name


def test_stands_on_the_floor(appearance: Appearance) -> None:
    (pedestal,) = (part for part in appearance.parts if "pedestal" in part.mesh.name)
    assert pedestal.mesh.points_m[:, 2].min() == pytest.approx(-0.93, abs=0.01)


def test_every_joint_carries_something_and_both_arms_the_same(
    appearance: Appearance, robot: Baxter
) -> None:
    def meshes(side: str) -> set[str]:
        return {part.mesh.name for part in appearance.parts if part.joint.startswith(f"{side}_")}

    assert {part.joint for part in appearance.parts} == {"universe", *robot.joint_names}
    assert meshes("left") == meshes("right")


def test_the_arms_are_red_and_the_head_has_no_markers(appearance: Appearance) -> None:
    colours = [part.rgb for part in appearance.parts if part.mesh.name == "E0.0"]
    assert all(red > 0.4 and green < 0.1 and blue < 0.1 for red, green, blue in colours)
    assert not any("collision_head" in part.mesh.name for part in appearance.parts)


def test_normals_are_of_unit_length(appearance: Appearance) -> None:
    for mesh in {part.mesh.name: part.mesh for part in appearance.parts}.values():
        lengths = np.linalg.norm(mesh.normals.astype(float), axis=1)
        assert np.abs(lengths - 127.0).max() < 1.0, mesh.name


def test_the_file_is_small_read_only_and_carries_the_licence(appearance: Appearance) -> None:
    assert len((files("sim.view") / "appearance.npz").read_bytes()) <= MAX_BYTES
    assert "Rethink Robotics" in appearance.notice
    with pytest.raises(ValueError, match="read-only"):
        appearance.parts[0].mesh.vertices[0] = 0


def test_needs_neither_the_original_meshes_nor_what_reads_them() -> None:
    script = (
        "import sys, sim.view.appearance; sim.view.appearance.Appearance.load(); "
        "print([name for name in ('trimesh', 'collada', 'meshcat') if name in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=300
    )
    assert run.stdout.strip() == "[]"

"""What every test may use; the model is loaded once a session."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import settings
from numpy.typing import ArrayLike

from baxter_kin import Arm, Baxter, IKService, pose_from_quaternion
from baxter_kin.description import StockFiles
from baxter_kin.files import PathLike
from baxter_kin.kinematics.arm import JOINTS
from planner import Body, Manipulator, Scene, State, load_object, plan_pick_and_place
from planner.collision.robot.robot_body import RobotBody
from tests import cpu_time, shares, skips
from tests.bodies import with_plain_fingers
from tests.calibrated import calibrated_arm
from tests.cpu_time import pytest_configure  # noqa: F401 - pytest finds its hooks here
from tests.shares import pytest_collection_modifyitems  # noqa: F401 - the same
from tests.skips import (  # noqa: F401 - the same
    pytest_sessionfinish,
    pytest_terminal_summary,
)

if TYPE_CHECKING:  # an extra
    from planner.atlas import PositionGrid, ReachMap

OVERHEAD_XYZW = (-0.0249590815779, 0.999649402929, 0.00737916180073, 0.00486450832011)

settings.register_profile("default", deadline=None, max_examples=50)
settings.register_profile("ci", deadline=None, max_examples=50, derandomize=True)
settings.register_profile("quick", deadline=None, max_examples=3, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")


def pytest_addoption(parser: pytest.Parser) -> None:
    skips.pytest_addoption(parser)
    cpu_time.pytest_addoption(parser)
    shares.pytest_addoption(parser)


def overhead(x: float, y: float, z: float) -> pin.SE3:
    """The demo's tool orientation at a position in base."""
    return pose_from_quaternion((x, y, z), OVERHEAD_XYZW)


def at(x: float, y: float, z: float) -> pin.SE3:
    """An unrotated pose in base."""
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def state_at(q: ArrayLike, side: str = "left") -> State:
    """An arm that stands somewhere, and nothing else is known."""
    names = (f"{side}_{joint}" for joint in JOINTS)
    return State(Scene.of(), dict(zip(names, np.array(q).tolist(), strict=True)))


@pytest.fixture(scope="session")
def robot() -> Baxter:
    return Baxter.load()


@pytest.fixture(scope="session")
def drawn() -> Baxter:
    """As the URDF of example-robot-data draws it: with half-round tips on the right hand."""
    return Baxter.load(StockFiles.installed().urdf)


@pytest.fixture(scope="session", params=["left", "right"])
def arm(request: pytest.FixtureRequest, robot: Baxter) -> Arm:
    """Either arm in turn."""
    return robot.arm(request.param)


@pytest.fixture(scope="session")
def left(robot: Baxter) -> Arm:
    return robot.arm("left")


@pytest.fixture(scope="session", params=["stock left", "calibrated left", "calibrated right"])
def any_arm(request: pytest.FixtureRequest, robot: Baxter) -> Arm:
    """An arm as it is drawn, and arms as a factory might calibrate them."""
    kind, side = request.param.split()
    return (
        robot.arm(side)
        if kind == "stock"
        else calibrated_arm(robot, side, np.random.default_rng(3))
    )


@pytest.fixture(scope="session")
def ik(left: Arm) -> IKService:
    """The left arm's IK service."""
    return IKService(left)


@pytest.fixture(scope="session")
def manipulator(robot: Baxter) -> Manipulator:
    """The left arm, as the demo plans for it."""
    return Manipulator.of(robot, "left")


@pytest.fixture(scope="session")
def plain(robot: Baxter) -> RobotBody:
    """The robot with boxes for fingers, so that contacts are known by hand."""
    return with_plain_fingers(robot)


@pytest.fixture(scope="session")
def table() -> Body:
    return load_object("table", at(1.0, 0.0, -0.93))


@pytest.fixture(scope="session")
def block() -> Body:
    """The demo's block at rest on the table."""
    return load_object("block", at(0.6725, 0.1265, -0.155), is_movable=True)


@pytest.fixture(scope="session")
def scene(table: Body, block: Body) -> Scene:
    return Scene.of([table, block])


@pytest.fixture(scope="session")
def specimens(robot: Baxter, ik: IKService, manipulator: Manipulator) -> dict[str, object]:
    """Objects of all public classes (`tests.specimens`)."""
    from tests import specimens as module  # noqa: PLC0415 - imports this one

    scene, start = module.SCENE, manipulator.arm.neutral
    plan = plan_pick_and_place(module.TASK, manipulator, scene, start)
    return module.specimens_of(robot, ik, manipulator, plan)


class SmallDisk(io.FileIO):
    """A file on a disk that has room for so many bytes."""

    def __init__(self, path: PathLike, room: int) -> None:
        super().__init__(os.fspath(path), "wb")
        self._room = room

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > self._room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


@pytest.fixture
def small_disk(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """From the call on, recordings that are written piece by piece have room for so many bytes."""

    def leave(room: int) -> None:
        monkeypatch.setattr(
            "sim.files.open_to_write", lambda path: io.BufferedWriter(SmallDisk(path, room))
        )

    return leave


@pytest.fixture
def full_disk(small_disk: Callable[[int], None]) -> None:
    """Such files can be made, but no byte finds room in them."""
    small_disk(0)


@pytest.fixture(scope="session")
def small_grid() -> PositionGrid:
    """Positions at the edge of the left arm's reach, in two blocks."""
    pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11", exc_type=ImportError)
    from planner.atlas import PositionGrid  # noqa: PLC0415 - an extra

    return PositionGrid.within([0.5, 0.0, 0.0], [0.8, 0.9, 0.2], 0.1)


@pytest.fixture(scope="session")
def small_map(
    robot: Baxter, small_grid: PositionGrid, tmp_path_factory: pytest.TempPathFactory
) -> ReachMap:
    """A reach map of both arms with 72 rotations; not to be changed."""
    from baxter_kin.parallel import Serial  # noqa: PLC0415 - an extra
    from planner.atlas import RotationGrid, build_reach_map  # noqa: PLC0415

    path: Path = tmp_path_factory.mktemp("maps") / "small.zarr"
    return build_reach_map(path, robot, small_grid, RotationGrid.hopf(0), engine=Serial())


@pytest.fixture(scope="session")
def table_map(robot: Baxter, tmp_path_factory: pytest.TempPathFactory) -> ReachMap:
    """Both arms, the tool pointing down with 12 rolls, 10 cm apart; not to be changed."""
    pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11", exc_type=ImportError)
    from baxter_kin.parallel import Serial  # noqa: PLC0415 - an extra
    from planner.atlas import PositionGrid, RotationGrid, build_reach_map  # noqa: PLC0415

    positions = PositionGrid.within((0.2, -0.9, -0.2), (1.3, 0.9, 0.1), 0.1)
    rotations = RotationGrid.about_tool_axis(np.diag([-1.0, 1.0, -1.0]), 12)
    path: Path = tmp_path_factory.mktemp("maps") / "table.zarr"
    return build_reach_map(path, robot, positions, rotations, engine=Serial())

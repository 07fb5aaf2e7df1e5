"""What users import from `sim.ros1`: shown in a line, copied or refused, strict with input."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import sim.ros1
from baxter_kin import Baxter, BaxterError
from baxter_kin.display import MAX_LINE
from baxter_kin.errors import CopyError
from sim import World
from sim.ros1 import (
    BaxterLink,
    ExecutionOptions,
    Follow,
    Following,
    Master,
    Node,
    Pace,
    RosExecutor,
    RosRobot,
    Sample,
    SampleObserver,
    StopCause,
)

ZEROS = np.zeros(7)
DATA = {
    "ExecutionOptions": ExecutionOptions(Pace(0.2, 0.4)),
    "Follow": Follow.LAG,
    "Following": Following(Follow.LAG, 0.4),
    "Pace": Pace(0.2, 0.4),
    "Sample": Sample(0.1, "left", *(ZEROS,) * 4, 0.01, 0.001, True, False, False),
    "StopCause": StopCause.SIGINT,
}
LIVE = ("BaxterLink", "Master", "Node", "RosExecutor", "RosRobot")
BAD: dict[str, Callable[[], object]] = {
    "a link to a number": lambda: BaxterLink(5),  # type: ignore[arg-type]
    "an executor of a number": lambda: RosExecutor(5),  # type: ignore[arg-type]
    "a robot in a number": lambda: RosRobot(5),  # type: ignore[arg-type]
    "a node without a name": lambda: Node(""),
    "a node that is a number": lambda: Node(5),  # type: ignore[arg-type]
    "a master at a word": lambda: Master(port="x"),  # type: ignore[arg-type]
    "a master beyond all ports": lambda: Master(port=70_000),
    "a pace of nothing": lambda: Pace(0.0),
    "a pace that is a word": lambda: Pace("fast"),  # type: ignore[arg-type]
    "a lead of hours": lambda: Pace(0.3, 3600.0),
    "a lag below zero": lambda: Following(Follow.LAG, -0.4),
    "a way that is a word": lambda: Following("lazy"),  # type: ignore[arg-type]
    "options of numbers": lambda: ExecutionOptions(0.3),  # type: ignore[arg-type]
    "a time-out of nothing": lambda: ExecutionOptions(timeout_s=0.0),
    "a response of a number": lambda: ExecutionOptions(response={"left": 0.3}),  # type: ignore[dict-item]
}


@pytest.fixture(scope="module")
def live(robot: Baxter) -> Iterator[dict[str, Any]]:
    """One of everything that runs."""
    with (
        Master(port=0) as master,
        RosRobot(World(robot), master_uri=master.uri) as baxter,
        Node("/front_door", master_uri=master.uri, host="127.0.0.1") as node,
        BaxterLink(node) as link,
    ):
        made = (link, master, node, RosExecutor(link), baxter)
        yield dict(zip(LIVE, made, strict=True))


def test_the_front_door_has_what_it_says() -> None:
    assert sim.ros1.__all__ == sorted(sim.ros1.__all__)
    for name in sim.ros1.__all__:
        assert getattr(sim.ros1, name).__name__ == name
    rest = {SampleObserver.__name__, "NotReadyError"}
    assert set(sim.ros1.__all__) == {*DATA, *LIVE, *rest}
    with pytest.raises(AttributeError, match="Robot"):
        _ = sim.ros1.Robot


def test_each_is_shown_in_one_short_line_and_copied_or_refused(live: dict[str, Any]) -> None:
    for name, each in {**DATA, **live}.items():
        shown = repr(each)
        assert shown.isprintable()
        assert len(shown) <= MAX_LINE
        assert shown.removeprefix("<").startswith((f"{name}(", f"{name}."))
        assert "array(" not in shown
        assert " at 0x" not in shown
    for each in DATA.values():
        for copied in (pickle.loads(pickle.dumps(each)), copy.deepcopy(each)):
            assert type(copied) is type(each)
            assert repr(copied) == repr(each)
    for each in live.values():
        for way in (pickle.dumps, copy.copy, copy.deepcopy):
            with pytest.raises(CopyError):
                way(each)


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_in_one_sentence(name: str) -> None:
    with pytest.raises(BaxterError) as refusal:
        BAD[name]()
    assert "\n" not in str(refusal.value)

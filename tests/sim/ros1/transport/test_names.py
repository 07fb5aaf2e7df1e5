"""ROS names."""

from __future__ import annotations

import pytest

from sim.errors import RosMessageError
from sim.ros1.transport.names import full_name, node_name


@pytest.mark.parametrize(
    ("name", "full"),
    [
        ("/robot/state", "/robot/state"),
        ("robot/state", "/robot/state"),
        ("~rate", "/node/rate"),
        ("ExternalTools/left/PositionKinematicsNode/IKService",
         "/ExternalTools/left/PositionKinematicsNode/IKService"),
    ],
)  # fmt: skip
def test_names_are_made_full(name: str, full: str) -> None:
    assert full_name(name, "/node") == full


@pytest.mark.parametrize(
    "name", ["", "/", "~", "~/a", "a b", "/a//b", "/a/", "ä", "1a", "a~b", "a\n"]
)
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(RosMessageError, match="not a name such as"):
        full_name(name, "/node")


def test_nodes_have_global_names() -> None:
    assert node_name("baxter_kin") == node_name("/baxter_kin") == "/baxter_kin"
    with pytest.raises(RosMessageError, match="not a node's name such as"):
        node_name("~private")

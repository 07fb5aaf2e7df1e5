"""ROS names: /global, relative, and ~private ones (ROS wiki, "Names")."""

from __future__ import annotations

import re

from baxter_kin.display import quoted
from baxter_kin.validation import expect
from sim.errors import RosMessageError

_NODE = re.compile(r"/?[A-Za-z][\w]*(/[A-Za-z][\w]*)*", re.ASCII)
_NAME = re.compile(r"[~/]?[A-Za-z][\w]*(/\w+)*", re.ASCII)


def node_name(name: str) -> str:
    """A node's name in full, such as "/baxter_kin"."""
    if not _NODE.fullmatch(expect(name, str, "node's name", RosMessageError)):
        raise RosMessageError(f"not a node's name such as /baxter_kin: {quoted(name)}")
    return f"/{name.lstrip('/')}"


def full_name(name: str, node: str) -> str:
    """The name of a topic, service or parameter in full.

    Args:
        name: global as "/robot/state", relative to / as "robot/state", or private as "~rate".
        node: the node to which private ones belong, in full.
    """
    if not _NAME.fullmatch(expect(name, str, "name", RosMessageError)):
        raise RosMessageError(f"not a name such as /robot/state: {quoted(name)}")
    if name.startswith("~"):
        return f"{node}/{name[1:]}"
    return f"/{name.lstrip('/')}"

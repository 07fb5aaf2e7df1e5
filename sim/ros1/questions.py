"""What a node may ask the master: parameters, and who is there."""

from __future__ import annotations

from typing import Any

from sim.errors import RosConnectionError, RosError
from sim.ros1.transport.names import full_name
from sim.ros1.transport.xmlrpc.master_client import MasterClient

_MISSING = object()
"""Stands for a default that was not given."""


class Questions:
    """The part of a node that only asks. Every question may raise `RosConnectionError`.

    Attributes:
        name: the node's, to which private names belong.
    """

    name: str
    _master: MasterClient

    def parameter(self, name: str, default: Any = _MISSING) -> Any:
        """A parameter's value: a bool, number, text, list, or a mapping of those below it.

        Args:
            name: its name.
            default: the answer when it is not set.
        """
        try:
            return self._master.call("getParam", full_name(name, self.name))
        except RosConnectionError:
            raise
        except RosError:
            if default is _MISSING:
                raise
            return default

    def set_parameter(self, name: str, value: Any) -> None:
        """Set a parameter for everybody."""
        self._master.call("setParam", full_name(name, self.name), value)

    def delete_parameter(self, name: str) -> None:
        """Remove a parameter, and those below it."""
        self._master.call("deleteParam", full_name(name, self.name))

    def has_parameter(self, name: str) -> bool:
        """Whether a parameter is set."""
        return bool(self._master.call("hasParam", full_name(name, self.name)))

    def parameter_names(self) -> tuple[str, ...]:
        """All parameters that are set."""
        return tuple(map(str, self._master.call("getParamNames")))

    def publishers_of(self, topic: str) -> tuple[str, ...]:
        """The names of the nodes that the master has as publishers of a topic."""
        return self._master.system()[0].get(full_name(topic, self.name), ())

    def subscribers_of(self, topic: str) -> tuple[str, ...]:
        """The names of the nodes that the master has as subscribers of a topic."""
        return self._master.system()[1].get(full_name(topic, self.name), ())

    def providers_of(self, service: str) -> tuple[str, ...]:
        """The name of the node that the master has for a service; empty when there is none."""
        return self._master.system()[2].get(full_name(service, self.name), ())

    def nodes(self) -> tuple[str, ...]:
        """The names of all nodes that the master knows."""
        state = self._master.system()
        return tuple(sorted({name for part in state for names in part.values() for name in names}))

    def topics(self) -> dict[str, str]:
        """The types of all topics that somebody publishes or subscribes to, by topic."""
        return {str(name): str(kind) for name, kind in self._master.call("getTopicTypes")}

"""Worlds that several test modules use."""

from __future__ import annotations

import pytest

from baxter_kin import Baxter
from planner import Body
from sim import World


@pytest.fixture
def world(robot: Baxter, table: Body) -> World:
    """A world with a table."""
    world = World(robot)
    world.spawn(table)
    return world


@pytest.fixture(scope="module")
def shared(robot: Baxter, table: Body) -> World:
    """A world with a table for many examples, each of which removes what it adds."""
    world = World(robot)
    world.spawn(table)
    return world

"""Random and spoilt bytes to every socket: the node lives, and forgets those who sent them."""

from __future__ import annotations

import os
import threading

from tests.sim.ros1.hostile import WAYS, attack, target
from tests.sim.ros1.processes import until
from tests.sim.ros1.wire import listening_addresses, own_sockets

MESSAGES = 200
SEED = 5 if os.environ.get("CI") else None
LOOPBACK = "0100007F"


def test_a_node_and_its_master_survive_hostile_peers() -> None:
    before = own_sockets()
    with target() as aim:
        seed = SEED if SEED is not None else int.from_bytes(os.urandom(4), "little")
        sent = attack(aim, MESSAGES, seed)
        assert set(sent) == set(WAYS), f"seed {seed}"
        assert aim.is_well(), f"seed {seed}"
        assert aim.node.counts.faults == aim.master.counts.faults == 0, f"seed {seed}"
        assert aim.node.counts.malformed > MESSAGES / 10
        assert aim.received > 0
        until(lambda: not aim.node._server.peers)
        assert listening_addresses(own_sockets() - before) == {LOOPBACK}
    until(lambda: not [each for each in threading.enumerate() if "/target" in each.name])

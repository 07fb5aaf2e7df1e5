"""What both ends of a TCPROS connection tell each other before messages flow."""

from __future__ import annotations

import socket
from collections.abc import Mapping

from sim.errors import RosConnectionError
from sim.ros1.transport.network.addresses import Place
from sim.ros1.transport.network.framing import (
    LONGEST_HEADER,
    FrameReader,
    ProtocolError,
    framed_header,
    parse_header,
)

ANY = "*"
"""The md5 sum and type of who takes whatever comes, as `rostopic echo`."""

HANDSHAKE_S = 10.0
"""How long a peer may be silent before it has said who it is."""


class Refusal(ProtocolError):  # noqa: N818 - it is an answer
    """A connection that is refused; the peer is told why."""


def check_sum(fields: Mapping[str, str], *, what: str, kind: str, md5: str) -> None:
    """See that a peer means the same type.

    Args:
        fields: of its header.
        what: the topic or service.
        kind: our type.
        md5: its sum.
    """
    theirs = fields.get("md5sum", "")
    if theirs not in (md5, ANY):
        raise Refusal(
            f"{what} has the type {kind} with md5 sum {md5}, not {fields.get('type', 'one')} with"
            f" {theirs or 'none'}; install the same version of its package on both sides"
        )


def greet_peer(sock: socket.socket, ours: Mapping[str, str], *, place: Place, node: str) -> Answer:
    """Send a header and wait for the peer's.

    Args:
        sock: connected, with a timeout.
        ours: our fields.
        place: where the peer is, for the error.
        node: who it is, for the error.
    """
    try:
        sock.sendall(framed_header(ours))
        answer = _read_header(sock)
    except (OSError, ProtocolError) as cause:
        reason = "no answer" if isinstance(cause, TimeoutError) else str(cause)
        raise RosConnectionError(
            f"{node} at {place} did not shake hands: {reason}", host=str(place), node=node
        ) from cause
    if "error" in answer:
        raise RosConnectionError(
            f"{node} at {place} refused: {answer['error']}", host=str(place), node=node
        )
    return answer


Answer = dict[str, str]
"""The fields of a peer's header."""


def _read_header(sock: socket.socket) -> Answer:
    """Exactly the header: what follows it stays in the socket."""
    reader = FrameReader(LONGEST_HEADER)
    wanted = 4
    seen = b""
    while True:
        data = sock.recv(wanted - len(seen))
        if not data:
            raise ProtocolError("the connection ended")
        seen += data
        if len(seen) == 4:
            wanted = 4 + int.from_bytes(seen, "little")
            if wanted > LONGEST_HEADER:
                raise ProtocolError(f"a header of {wanted - 4} bytes")
        if len(seen) == wanted:
            reader.feed(seen)
            return parse_header(next(reader.frames()))

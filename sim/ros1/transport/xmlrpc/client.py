"""Calls of XML-RPC, as ROS uses it: an answer has a code, a text and a value."""

from __future__ import annotations

import http.client
import xmlrpc.client
from typing import Any
from xml.parsers.expat import ExpatError

from baxter_kin.display import quoted
from sim.errors import RosConnectionError, RosError, RosUnreachableError
from sim.ros1.transport.network.addresses import Place, place_of, resolve

LONGEST_ANSWER = 16 * 2**20
"""Bytes; a robot's description has 0.2 MB."""

SUCCESS = 1

NOT_XMLRPC = (
    ExpatError,
    xmlrpc.client.Error,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    OverflowError,
)
"""What Python's reader of XML-RPC raises when it is given something else."""


def ask(uri: str, method: str, *args: Any, node: str, timeout_s: float) -> Any:
    """The value that a node or the master answers.

    Args:
        uri: its XML-RPC server.
        method: such as "requestTopic".
        *args: what XML-RPC can write.
        node: whose server it is, for the error.
        timeout_s: how long each step may take: connecting, sending, every piece of the answer.
    """
    place = place_of(uri)
    answer = _call(place, method, args, node, timeout_s)
    if not isinstance(answer, (list, tuple)) or len(answer) != 3:
        raise _strange(place, node, f"{method} gave {quoted(answer)}")
    code, text, value = answer
    if code != SUCCESS:
        raise RosError(f"{node} refused {method}: {quoted(text)}")
    return value


def _call(place: Place, method: str, args: tuple[Any, ...], node: str, timeout_s: float) -> Any:
    try:
        body = xmlrpc.client.dumps(args, method, encoding="utf-8", allow_none=False)
    except (TypeError, OverflowError) as cause:
        raise RosError(f"XML-RPC cannot write {quoted(args)}: {cause}") from cause
    content = _post(place, body.encode("utf-8", "xmlcharrefreplace"), node, timeout_s)
    try:
        return xmlrpc.client.loads(content)[0][0]
    except xmlrpc.client.Fault as cause:
        raise RosError(f"{node} refused {method}: {quoted(cause.faultString)}") from cause
    except NOT_XMLRPC as cause:
        raise _strange(place, node, str(cause)) from cause


def _post(place: Place, body: bytes, node: str, timeout_s: float) -> bytes:
    address = resolve(place.host, node=node)
    connection = http.client.HTTPConnection(address, place.port, timeout=timeout_s)
    headers = {"Content-Type": "text/xml", "Host": str(place)}
    try:
        connection.request("POST", "/RPC2", body, headers)
        with connection.getresponse() as answer:
            content = answer.read(LONGEST_ANSWER + 1)
    except (OSError, http.client.HTTPException) as cause:
        reason = "no answer" if isinstance(cause, TimeoutError) else str(cause) or repr(cause)
        raise RosUnreachableError(
            f"cannot reach {node} at {place}: {reason}",
            host=str(place),
            node=node,
            remedy="check that it runs and that no firewall is between",
        ) from cause
    finally:
        connection.close()
    if answer.status != http.client.OK or len(content) > LONGEST_ANSWER:
        raise _strange(place, node, f"status {answer.status}, {len(content)} bytes")
    return content


def _strange(place: Place, node: str, what: str) -> RosConnectionError:
    return RosConnectionError(
        f"{node} at {place} does not answer as ROS 1 does: {quoted(what)}",
        host=str(place),
        node=node,
        remedy="check what runs there",
    )

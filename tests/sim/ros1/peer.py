"""A node of rospy that does what it is told: a line of JSON comes in, one goes out.

It runs under the system's Python. Messages travel as hexadecimal text of their bytes; they are read
and written by the classes that ROS's own generator made.
"""

from __future__ import annotations

import io
import json
import sys
import threading
import time
from typing import Any

import roslib.message
import rospy


def class_of(name: str) -> Any:
    """Of a message, or of a part of a service."""
    for part in ("Request", "Response"):
        if name.endswith(part):
            service = service_class_of(name[: -len(part)])
            return getattr(service, f"_{part.lower()}_class")
    return roslib.message.get_message_class(name)


def service_class_of(name: str) -> Any:
    return roslib.message.get_service_class(name)


def written(message: Any) -> str:
    stream = io.BytesIO()
    message.serialize(stream)
    return stream.getvalue().hex()


def read(kind: Any, data: str) -> Any:
    return kind().deserialize(bytes.fromhex(data))


class Peer:
    """Its methods are what it may be told to do."""

    def __init__(self) -> None:
        self._publishers: dict[str, Any] = {}
        self._services: list[Any] = []
        self._subscribers: dict[str, Any] = {}
        self._received: dict[str, list[Any]] = {}

    def start(self, name: str) -> str:
        rospy.init_node(name, disable_signals=True)
        return str(rospy.get_name())

    def subscribe(self, topic: str, kind: str, wait_s: float = 0.0) -> None:
        """Keep what comes; `wait_s` makes it a slow reader."""
        received = self._received.setdefault(topic, [])

        def keep(message: Any) -> None:
            received.append((time.time(), written(message), message._connection_header["callerid"]))
            time.sleep(wait_s)

        self._subscribers[topic] = rospy.Subscriber(topic, class_of(kind), keep, tcp_nodelay=True)

    def received(self, topic: str) -> list[Any]:
        """Time of arrival, bytes and sender of all that came; it is forgotten then."""
        kept = self._received[topic]
        found = kept[:]
        del kept[: len(found)]
        return found

    def writers(self, topic: str) -> int:
        return int(self._subscribers[topic].get_num_connections())

    def advertise(self, topic: str, kind: str, latch: bool = False) -> None:
        self._publishers[topic] = rospy.Publisher(topic, class_of(kind), latch=latch, queue_size=10)

    def readers(self, topic: str) -> int:
        return int(self._publishers[topic].get_num_connections())

    def publish(self, topic: str, data: str) -> None:
        publisher = self._publishers[topic]
        publisher.publish(read(publisher.data_class, data))

    def keep_publishing(self, topic: str, data: str, rate_hz: float) -> None:
        publisher = self._publishers[topic]
        message = read(publisher.data_class, data)

        def run() -> None:
            while not rospy.is_shutdown():
                publisher.publish(message)
                time.sleep(1.0 / rate_hz)

        threading.Thread(target=run, daemon=True).start()

    def serve(self, service: str, kind: str, response: str) -> None:
        """Answer with what is given; an empty text is an error."""
        service_class = service_class_of(kind)

        def handle(_: Any) -> Any:
            if not response:
                raise rospy.ServiceException("not today")
            return read(service_class._response_class, response)

        self._services.append(rospy.Service(service, service_class, handle))

    def call(self, service: str, kind: str, request: str, times: int = 1) -> list[str]:
        """Call it over one connection so many times."""
        service_class = service_class_of(kind)
        rospy.wait_for_service(service, 5.0)
        proxy = rospy.ServiceProxy(service, service_class, persistent=times > 1)
        asked = read(service_class._request_class, request)
        try:
            return [written(proxy(asked)) for _ in range(times)]
        except rospy.ServiceException as error:
            return [f"error: {error}"]

    def echo(self, kind: str, items: list[str]) -> list[str]:
        """The same messages, read and written again; their sum comes first."""
        message_class = class_of(kind)
        return [message_class._md5sum, *(written(read(message_class, item)) for item in items)]

    def service_sum(self, kind: str) -> str:
        return str(service_class_of(kind)._md5sum)

    def parameter(self, name: str) -> Any:
        return rospy.get_param(name)

    def search(self, name: str) -> Any:
        return rospy.search_param(name)

    def set_parameter(self, name: str, value: Any) -> None:
        rospy.set_param(name, value)

    def topics(self) -> Any:
        return rospy.get_published_topics()

    def close_topic(self, topic: str) -> None:
        self._publishers.pop(topic).unregister()

    def is_ended(self) -> bool:
        return bool(rospy.is_shutdown())


def main() -> None:
    answers, sys.stdout = sys.stdout, sys.stderr  # rospy prints too
    peer = Peer()
    for line in sys.stdin:
        name, *args = json.loads(line)
        try:
            answer = {"value": getattr(peer, name)(*args)}
        except Exception as error:  # whatever it is, the test is told
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
    rospy.signal_shutdown("no more orders")


if __name__ == "__main__":
    main()

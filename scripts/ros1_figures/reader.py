"""A node of rospy, under the system's Python, that notes when messages were sent and came.

`/usr/bin/python3 reader.py TOPIC=TYPE...`

It says "ready" when it is connected to all and reads until its input ends. Then it prints, as JSON,
for each topic the pairs of a header's stamp (0 without one) and the time of arrival, in seconds.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import roslib.message
import rospy


def main() -> None:
    """Read until the input ends."""
    answers, sys.stdout = sys.stdout, sys.stderr
    rospy.init_node("reader", anonymous=True, disable_signals=True)
    wanted = dict(item.split("=") for item in sys.argv[1:])
    received: dict[str, list[tuple[float, float]]] = {topic: [] for topic in wanted}

    def keep(message: Any, topic: str) -> None:
        arrived_s = time.time()
        header = getattr(message, "header", None)
        received[topic].append((header.stamp.to_sec() if header else 0.0, arrived_s))

    subscribers = [
        rospy.Subscriber(
            topic, roslib.message.get_message_class(name), keep, topic, tcp_nodelay=True
        )
        for topic, name in wanted.items()
    ]
    while not all(each.get_num_connections() for each in subscribers):
        time.sleep(0.01)
    answers.write("ready\n")
    answers.flush()
    sys.stdin.read()
    answers.write(json.dumps(received) + "\n")
    answers.flush()
    rospy.signal_shutdown("done")


if __name__ == "__main__":
    main()

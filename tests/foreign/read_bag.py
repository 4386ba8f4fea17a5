"""Reads a recording with a reader of others, `rosbags` or `mcap_ros2`, and prints each topic's messages and what they sum up to."""

import math
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

folder, reader = Path(sys.argv[1]), sys.argv[2]


def messages() -> Iterator[tuple[str, object]]:
    """Topic and content of each message."""
    if reader == "rosbags":
        from rosbags.highlevel import AnyReader

        with AnyReader([folder]) as bag:
            for connection, _, data in bag.messages():
                yield connection.topic, bag.deserialize(data, connection.msgtype)
    else:
        from mcap_ros2.reader import read_ros2_messages

        for file in sorted(folder.glob("*.mcap")):
            for message in read_ros2_messages(str(file)):
                yield message.channel.topic, message.ros_msg


def number(topic: str, message: object) -> float:
    """A number that stands in the message."""
    if topic == "/moment":
        return message.wrench.torque.z
    if topic == "/tf":
        return message.transforms[0].transform.translation.x
    if topic in ("/truth/contact", "/truth/surface"):
        return message.point.x
    if topic == "/joint_states":
        return message.position[0]
    if topic == "/base_twist":
        return message.twist.linear.x
    return float(message.data)


of_topic = defaultdict(list)
for topic, message in messages():
    of_topic[topic].append(number(topic, message))
for topic, numbers in sorted(of_topic.items()):
    print(topic, len(numbers), repr(math.fsum(numbers)))

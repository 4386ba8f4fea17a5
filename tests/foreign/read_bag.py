"""Reads a recording with `rosbags` or `mcap_ros2`, or listens to one that is played to `foxglove`.

Prints the number of messages of each topic and the sum of their values.
"""

import asyncio
import math
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

source, reader = sys.argv[1], sys.argv[2]


def messages() -> Iterator[tuple[str, object]]:
    """Topic and content of each message."""
    if reader == "rosbags":
        from rosbags.highlevel import AnyReader

        with AnyReader([Path(source)]) as bag:
            for connection, _, data in bag.messages():
                yield connection.topic, bag.deserialize(data, connection.msgtype)
    elif reader == "foxglove":
        yield from asyncio.run(received())
    else:
        from mcap_ros2.reader import read_ros2_messages

        for file in sorted(Path(source).glob("*.mcap")):
            for message in read_ros2_messages(str(file)):
                yield message.channel.topic, message.ros_msg


async def received() -> list[tuple[str, object]]:
    """Topic and content of each message of the feed at this address."""
    from foxglove_feed import Feed

    async with Feed(source) as feed:
        await feed.silence(60.0, 5.0)
        return feed.messages()


def number(topic: str, message: object) -> float:
    """A number that the message contains."""
    if topic == "/moment":
        return message.wrench.torque.z
    if topic == "/tf":
        return message.transforms[0].transform.translation.x
    if topic == "/field":
        return message.magnetic_field.x
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

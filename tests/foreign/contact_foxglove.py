"""Listens to `ros2-node contact` by the Foxglove protocol, with robo-ws-bridge, until no contact has arrived for some seconds.

Messages of ROS 2 are decoded by rosbags with the standard definitions, which are not those of the feed, and drawn scenes by the
published schema of Foxglove. The arguments are the address and the file for the contacts. Prints, as JSON, what was received.
"""

import asyncio
import csv
import json
import sys
from pathlib import Path

from foxglove_feed import Feed
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from rosbags.typesys import Stores, get_typestore

FIRST_S, SILENCE_S = 90.0, 6.0

url, out = sys.argv[1], Path(sys.argv[2])
types = get_typestore(Stores.ROS2_HUMBLE)


def scene(payload: bytes) -> list[str]:
    """Names of the entities of a scene."""
    update = SceneUpdate.FromString(payload)
    assert all(entity.frame_id == "world" for entity in update.entities)
    assert all(entity.lines or entity.spheres or entity.triangles for entity in update.entities)
    return [entity.id for entity in update.entities]


async def listened() -> list[tuple[dict, bytes]]:
    """Channel and content of each message."""
    async with Feed(url) as feed:
        await feed.silence_of("/contact", FIRST_S, SILENCE_S)
        return feed.received()


received = asyncio.run(listened())
counts: dict[str, int] = {}
entities: set[str] = set()
with out.open("w", newline="") as file:
    table = csv.writer(file)
    table.writerow(["whisker", "time_ns", "x_m", "y_m", "z_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"])
    for channel, payload in received:
        topic = channel["topic"]
        counts[topic] = counts.get(topic, 0) + 1
        if channel["encoding"] == "protobuf":
            entities.update(scene(payload))
            continue
        message = types.deserialize_cdr(payload, channel["schemaName"])
        assert bytes(types.serialize_cdr(message, channel["schemaName"])) == payload, topic
        if topic.endswith("/contact"):
            time_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            at, covariance = message.pose.pose.position, message.pose.covariance.tolist()
            table.writerow(
                [topic.split("/")[2], time_ns, *map(repr, (at.x, at.y, at.z, covariance[0], covariance[1], covariance[7]))]
            )
print(json.dumps({"counts": counts, "entities": sorted(entities)}))

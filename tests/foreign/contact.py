"""Plays a recording to `ros2-node contact` by DDS, with Cyclone DDS, and listens to it, with rosless.

The recording is read by rosbags. The arguments are the folder of the recording, the names of the whiskers, separated by commas, and
the file for the contacts. Prints, as JSON, the numbers of messages and the latency from the sent moment to the received contact.
"""

import csv
import json
import math
import sys
import threading
import time
from pathlib import Path

import rosless
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from ros_types import TYPES, cyclone
from rosbags.highlevel import AnyReader

WARM_S, TAIL_S, POLL_S = 2.0, 3.0, 0.5
PLAYED = ("/tf", "/tf_static", "/joint_states")
CONTACT, MARKERS = "geometry_msgs/msg/PoseWithCovarianceStamped", "visualization_msgs/msg/MarkerArray"
MAP, DIAGNOSTICS = "nav_msgs/msg/OccupancyGrid", "diagnostic_msgs/msg/DiagnosticArray"

folder, whiskers, out = Path(sys.argv[1]), sys.argv[2].split(","), Path(sys.argv[3])
over = threading.Event()
node = rosless.Node()


def messages() -> list[tuple[int, str, str, object]]:
    """Time, topic, type and content of each message that is played."""
    with AnyReader([folder]) as bag:
        return [
            (
                time_ns,
                connection.topic,
                connection.msgtype,
                cyclone(bag.deserialize(data, connection.msgtype), TYPES[connection.msgtype]),
            )
            for connection, time_ns, data in bag.messages()
            if connection.topic in PLAYED or connection.topic.endswith("/moment")
        ]


class Listener(threading.Thread):
    """Takes the messages of a topic with their times of arrival."""

    def __init__(self, topic: str, type_name: str, durability: str = "volatile") -> None:
        super().__init__(daemon=True)
        quality = {"reliability": "reliable", "history": "keep_all", "durability": durability}
        self.received: list[tuple[float, object]] = []
        self._subscription = node.subscribe(topic, type_name=type_name, wait=30.0, **quality)

    def run(self) -> None:
        """Listens until the end."""
        while not over.is_set():
            message = self._subscription.read(timeout=POLL_S)
            if message is not None:
                self.received.append((time.perf_counter(), message))


def stamp_ns(message: object) -> int:
    """Time of a message."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


recorded = messages()
types = {topic: type_name for _, topic, type_name, _ in recorded}
reliable = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1000))
participant = DomainParticipant(0)
writers = {
    topic: DataWriter(participant, Topic(participant, f"rt{topic}", TYPES[type_name], qos=reliable), qos=reliable)
    for topic, type_name in types.items()
}
contacts = {name: Listener(f"/whiskers/{name}/contact", CONTACT) for name in whiskers}
markers, diagnostics = Listener("/whiskers/markers", MARKERS), Listener("/diagnostics", DIAGNOSTICS)
maps = Listener("/whiskers/map", MAP, durability="transient_local")
listeners = [*contacts.values(), markers, diagnostics, maps]
for listener in listeners:
    listener.start()
deadline = time.monotonic() + 60.0
used = [topic for topic in writers if topic.endswith("moment")]
while not all(writers[topic].get_matched_subscriptions() for topic in used):
    assert time.monotonic() < deadline, "nobody subscribes"
    time.sleep(0.1)
time.sleep(WARM_S)

sent: dict[tuple[str, int], float] = {}
first_ns, begun = recorded[0][0], time.perf_counter()
for time_ns, topic, _, message in recorded:
    left_s = 1e-9 * (time_ns - first_ns) - (time.perf_counter() - begun)
    if left_s > 0:
        time.sleep(left_s)
    if topic.endswith("moment"):
        name = topic.split("/")[1] if topic.count("/") > 1 else whiskers[0]
        sent[name, time_ns] = time.perf_counter()
    writers[topic].write(message)
time.sleep(TAIL_S)
over.set()
for listener in listeners:
    listener.join()

latencies_ms = []
with out.open("w", newline="") as file:
    table = csv.writer(file)
    table.writerow(["whisker", "time_ns", "x_m", "y_m", "z_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"])
    for name, listener in contacts.items():
        for at_s, message in listener.received:
            latencies_ms.append(1e3 * (at_s - sent[name, stamp_ns(message)]))
            at, covariance = message.pose.pose.position, message.pose.covariance
            table.writerow([name, stamp_ns(message), *map(repr, (at.x, at.y, at.z, covariance[0], covariance[1], covariance[7]))])
latencies_ms.sort()
shares = {"median": 0.5, "p99": 0.99, "worst": 1.0}
latency_ms = (
    {name: latencies_ms[math.ceil(share * len(latencies_ms)) - 1] for name, share in shares.items()} if latencies_ms else {}
)
states = [status for _, message in diagnostics.received for status in message.status]
last = {status.name: {value.key: value.value for value in status.values} for status in states}
grids = [message for _, message in maps.received]
summary = {
    "moments": len(sent),
    "contacts": len(latencies_ms),
    "latency_ms": latency_ms,
    "markers": sorted({marker.ns for _, message in markers.received for marker in message.markers}),
    "diagnostics": last,
    "maps": len(grids),
    "occupied": sum(value > 60 for value in grids[-1].data) if grids else 0,
    "frame": grids[-1].header.frame_id if grids else "",
}
print(json.dumps(summary))

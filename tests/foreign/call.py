"""Calls the service as Cyclone DDS does and listens with rosless; prints the positions of the pushes (m).

The arguments are those of the call. A request of `rmw_cyclonedds_cpp` begins with half of the caller's identity and a number, which
its answer repeats.
"""

import sys
import time
from dataclasses import dataclass

import rosless
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, int32, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

NAME = "whisker_interfaces::srv::dds_::IncrementsBeamTest"


@dataclass
class Request(IdlStruct, typename=f"{NAME}_Request_"):
    """Parameters of the routine, in millimetres and seconds."""

    caller: array[uint8, 8]
    high: int32
    low: uint32
    total_x_distance: float32
    total_y_distance: float32
    increments_x: uint32
    increments_y: uint32
    pause_sec: uint32


@dataclass
class Response(IdlStruct, typename=f"{NAME}_Response_"):
    """End of the routine."""

    caller: array[uint8, 8]
    high: int32
    low: uint32
    structure_needs_at_least_one_member: uint8


reliable = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
participant = DomainParticipant(0)
requests = DataWriter(participant, Topic(participant, "rq/increments_beam_testRequest", Request, qos=reliable), qos=reliable)
responses = DataReader(participant, Topic(participant, "rr/increments_beam_testReply", Response, qos=reliable), qos=reliable)
x, y, increments_x, increments_y, pause = sys.argv[1:]
caller = list(b"a caller")
pose = "geometry_msgs/msg/PoseStamped"
with rosless.subscribe("/truth/pushed", type_name=pose, wait=30.0, reliability="reliable", history="keep_all") as pushes:
    deadline = time.monotonic() + 60.0
    while not (requests.get_matched_subscriptions() and responses.get_matched_publications()):
        assert time.monotonic() < deadline, "no service"
        time.sleep(0.1)
    time.sleep(1.0)
    requests.write(Request(caller, 0, 1, float(x), float(y), int(increments_x), int(increments_y), int(pause)))
    answer = next(responses.take_iter(timeout=duration(seconds=240)))
    assert (list(answer.caller), answer.low) == (caller, 1), answer
    while (push := pushes.read(timeout=2.0)) is not None:
        print(f"{push.pose.position.y:.4f}")

"""Writes recordings with rosbags.

The arguments are folder, kind (`stream` or `openwhisker`), and number of readings at 800 Hz, which are numbered along x.
"""

import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ARRAY = "whisker_interfaces/msg/MagneticFieldArray"
BEGIN_NS = 1_705_004_054_969_568_695
PERIOD_NS = 1_250_000

folder, kind, readings = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
types = get_typestore(Stores.ROS2_HUMBLE)
types.register(get_types_from_msg("sensor_msgs/MagneticField[] magnetic_field_array", ARRAY))
of = types.types


def field(i: int) -> object:
    """The reading number `i`."""
    time_ns = BEGIN_NS + i * PERIOD_NS
    stamp = of["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    header = of["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    vector = of["geometry_msgs/msg/Vector3"](x=float(i), y=float(i % 65536), z=65535.0)
    return of["sensor_msgs/msg/MagneticField"](header=header, magnetic_field=vector, magnetic_field_covariance=np.zeros(9))


with Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
    if kind == "stream":
        topic = writer.add_connection("/field", "sensor_msgs/msg/MagneticField", typestore=types)
        for i in range(readings):
            data = types.serialize_cdr(field(i), topic.msgtype)
            writer.write(topic, BEGIN_NS + i * PERIOD_NS, data)
    else:
        topic = writer.add_connection("/magnetometer_reading", ARRAY, typestore=types)
        for i in range(0, readings, 80):
            message = of[ARRAY](magnetic_field_array=[field(k) for k in range(i, min(i + 80, readings))])
            writer.write(topic, BEGIN_NS + i * PERIOD_NS, types.serialize_cdr(message, topic.msgtype))

"""Messages of ROS 2 for Cyclone DDS, made from those of rosbags."""

from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """Point in time."""

    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """Time and frame."""

    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    """Vector."""

    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    """Rotation."""

    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    """Force and moment."""

    force: Vector3
    torque: Vector3


@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    """Force and moment in a frame."""

    header: Header
    wrench: Wrench


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    """Pose of a frame."""

    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    """Pose of a frame in its parent."""

    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    """Poses of frames."""

    transforms: sequence[TransformStamped]


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    """Positions of joints."""

    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


TYPES: dict[str, type] = {
    "geometry_msgs/msg/WrenchStamped": WrenchStamped,
    "tf2_msgs/msg/TFMessage": TFMessage,
    "sensor_msgs/msg/JointState": JointState,
}
"""Type of Cyclone DDS for a type of ROS 2."""

_NESTED = {
    "stamp": Time,
    "header": Header,
    "force": Vector3,
    "torque": Vector3,
    "translation": Vector3,
    "rotation": Quaternion,
    "wrench": Wrench,
    "transform": Transform,
}


def cyclone(message: object, of: type) -> object:
    """A message of rosbags as one of Cyclone DDS."""
    values = {}
    for name in of.__dataclass_fields__:
        value = getattr(message, name)
        if name in _NESTED:
            value = cyclone(value, _NESTED[name])
        elif name == "transforms":
            value = [cyclone(transform, TransformStamped) for transform in value]
        elif hasattr(value, "tolist"):
            value = value.tolist()
        values[name] = value
    return of(**values)

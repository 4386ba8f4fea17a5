//! The messages, as ROS 2 defines them.
//!
//! One table states each message once: from it come the type, the text by which ROS 2 defines it, and [`AnyMessage`].

use std::fmt::Debug;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::{Error, Publisher, cdr};

/// A message that can be recorded and sent.
pub trait Message: Clone + Debug + Serialize + DeserializeOwned + Field + Send + 'static {
    /// Name of the type, for example `geometry_msgs/msg/Vector3`.
    const TYPE: &'static str;

    /// The definition of the type and of all that it is made of, in the form that recordings hold (`ros2msg`).
    fn definition() -> String {
        let mut parts = Vec::new();
        Self::collect(&mut parts);
        let mut text = String::new();
        for (i, (name, fields)) in parts.iter().enumerate() {
            if i > 0 {
                text.push_str(&format!("{}\nMSG: {name}\n", "=".repeat(80)));
            }
            text.push_str(fields);
        }
        text
    }

    /// The bytes of the message: CDR behind its encapsulation.
    fn encode(&self) -> Vec<u8> {
        cdr::encode(self)
    }

    /// The message of some bytes, or what is wrong with them.
    ///
    /// # Errors
    /// What was found that is no such message.
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        cdr::decode(bytes)
    }
}

/// What a field of a message can be.
pub trait Field {
    /// The type's name within a definition, for example `float64` or `geometry_msgs/Vector3`.
    fn name() -> String;

    /// Adds the definitions of the messages that it is made of, each once: name and fields.
    fn collect(_parts: &mut Vec<(String, String)>) {}
}

macro_rules! primitives {
    ($($rust:ty => $ros:literal),* $(,)?) => {
        $(impl Field for $rust {
            fn name() -> String {
                $ros.into()
            }
        })*
    };
}

primitives!(bool => "bool", i32 => "int32", u32 => "uint32", f64 => "float64", String => "string", [f64; 9] => "float64[9]");

impl<T: Field> Field for Vec<T> {
    fn name() -> String {
        format!("{}[]", T::name())
    }

    fn collect(parts: &mut Vec<(String, String)>) {
        T::collect(parts);
    }
}

macro_rules! messages {
    ($($(#[$about:meta])* $name:ident = $type:literal { $($(#[$note:meta])* $field:ident: $of:ty,)* })*) => {
        $(
            $(#[$about])*
            #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
            pub struct $name {
                $($(#[$note])* pub $field: $of,)*
            }

            impl Field for $name {
                fn name() -> String {
                    $type.replace("/msg/", "/")
                }

                fn collect(parts: &mut Vec<(String, String)>) {
                    if parts.iter().any(|(name, _)| *name == Self::name()) {
                        return;
                    }
                    let fields = [$(format!("{} {}\n", <$of>::name(), stringify!($field))),*].concat();
                    parts.push((Self::name(), fields));
                    $(<$of>::collect(parts);)*
                }
            }

            impl Message for $name {
                const TYPE: &'static str = $type;
            }
        )*

        /// A message of any type that is known here.
        #[derive(Clone, Debug, PartialEq)]
        pub enum AnyMessage {
            $($(#[$about])* $name($name),)*
        }

        impl AnyMessage {
            /// Names of the types that are known.
            pub const TYPES: &'static [&'static str] = &[$($type),*];

            /// Hands the message within to a publisher.
            ///
            /// # Errors
            /// What the publisher says.
            pub fn write(&self, publisher: &mut impl Publisher, topic: &str, time_ns: u64) -> Result<(), Error> {
                match self {
                    $(Self::$name(message) => publisher.write(topic, time_ns, message),)*
                }
            }

            /// The message of this type in these bytes; none where the type is not known.
            ///
            /// # Errors
            /// What was found that is no such message.
            pub fn decode(type_name: &str, bytes: &[u8]) -> Result<Option<Self>, String> {
                match type_name {
                    $($type => $name::decode(bytes).map(|message| Some(Self::$name(message))),)*
                    _ => Ok(None),
                }
            }
        }
    };
}

messages! {
    /// A point in time.
    Time = "builtin_interfaces/msg/Time" {
        /// Whole seconds.
        sec: i32,
        /// Nanoseconds beyond them.
        nanosec: u32,
    }

    /// When, and in which frame.
    Header = "std_msgs/msg/Header" {
        /// When.
        stamp: Time,
        /// In which frame.
        frame_id: String,
    }

    /// Yes or no.
    Bool = "std_msgs/msg/Bool" {
        /// Which.
        data: bool,
    }

    /// A number.
    Float64 = "std_msgs/msg/Float64" {
        /// Which.
        data: f64,
    }

    /// A text.
    Text = "std_msgs/msg/String" {
        /// Which.
        data: String,
    }

    /// A vector.
    Vector3 = "geometry_msgs/msg/Vector3" {
        /// Along x.
        x: f64,
        /// Along y.
        y: f64,
        /// Along z.
        z: f64,
    }

    /// A point \[m\].
    Point = "geometry_msgs/msg/Point" {
        /// Along x.
        x: f64,
        /// Along y.
        y: f64,
        /// Along z.
        z: f64,
    }

    /// A rotation. Its default is no rotation at all but all zeros, as in ROS 2's own memory; use [`Quaternion::about_z`].
    Quaternion = "geometry_msgs/msg/Quaternion" {
        /// Times i.
        x: f64,
        /// Times j.
        y: f64,
        /// Times k.
        z: f64,
        /// Real part.
        w: f64,
    }

    /// Where something is and how it is turned.
    Pose = "geometry_msgs/msg/Pose" {
        /// Where.
        position: Point,
        /// How turned.
        orientation: Quaternion,
    }

    /// A pose in a frame.
    PoseStamped = "geometry_msgs/msg/PoseStamped" {
        /// When and in which frame.
        header: Header,
        /// The pose.
        pose: Pose,
    }

    /// A point in a frame.
    PointStamped = "geometry_msgs/msg/PointStamped" {
        /// When and in which frame.
        header: Header,
        /// The point.
        point: Point,
    }

    /// Where a frame lies in another.
    Transform = "geometry_msgs/msg/Transform" {
        /// Of its origin \[m\].
        translation: Vector3,
        /// Of its axes.
        rotation: Quaternion,
    }

    /// Where a frame lies in another, at a time.
    TransformStamped = "geometry_msgs/msg/TransformStamped" {
        /// When, and the other frame.
        header: Header,
        /// The frame.
        child_frame_id: String,
        /// Where it lies.
        transform: Transform,
    }

    /// Where frames lie in others.
    TfMessage = "tf2_msgs/msg/TFMessage" {
        /// Each of them.
        transforms: Vec<TransformStamped>,
    }

    /// Force and moment.
    Wrench = "geometry_msgs/msg/Wrench" {
        /// Force \[N\].
        force: Vector3,
        /// Moment \[N m\].
        torque: Vector3,
    }

    /// Force and moment in a frame.
    WrenchStamped = "geometry_msgs/msg/WrenchStamped" {
        /// When and in which frame.
        header: Header,
        /// Force and moment.
        wrench: Wrench,
    }

    /// Velocity and angular velocity.
    Twist = "geometry_msgs/msg/Twist" {
        /// Velocity \[m/s\].
        linear: Vector3,
        /// Angular velocity \[rad/s\].
        angular: Vector3,
    }

    /// Velocity and angular velocity in a frame.
    TwistStamped = "geometry_msgs/msg/TwistStamped" {
        /// When and in which frame.
        header: Header,
        /// Velocity and angular velocity.
        twist: Twist,
    }

    /// Angles, speeds and moments of joints; a list that is not known is empty.
    JointState = "sensor_msgs/msg/JointState" {
        /// When.
        header: Header,
        /// Names of the joints.
        name: Vec<String>,
        /// Angles \[rad\].
        position: Vec<f64>,
        /// Speeds \[rad/s\].
        velocity: Vec<f64>,
        /// Moments \[N m\].
        effort: Vec<f64>,
    }

    /// A magnetic field: by the standard in tesla. OpenWhisker and the platform here put the sensor's counts into it.
    MagneticField = "sensor_msgs/msg/MagneticField" {
        /// When and in which frame.
        header: Header,
        /// The field.
        magnetic_field: Vector3,
        /// Its covariance, row by row; all zeros where it is not known.
        magnetic_field_covariance: [f64; 9],
    }

    /// The readings since the last message of this kind.
    MagneticFieldArray = "whisker_interfaces/msg/MagneticFieldArray" {
        /// Each of them, in order of time.
        magnetic_field_array: Vec<MagneticField>,
    }
}

const NANOSECONDS: u64 = 1_000_000_000;

impl Time {
    /// The time this many nanoseconds after the epoch; the last that fits, where it does not fit.
    pub fn from_nanoseconds(time_ns: u64) -> Self {
        match i32::try_from(time_ns / NANOSECONDS) {
            Ok(sec) => Self { sec, nanosec: (time_ns % NANOSECONDS) as u32 },
            Err(_) => Self { sec: i32::MAX, nanosec: NANOSECONDS as u32 - 1 },
        }
    }

    /// Nanoseconds since the epoch.
    pub fn nanoseconds(&self) -> i64 {
        i64::from(self.sec) * NANOSECONDS as i64 + i64::from(self.nanosec)
    }
}

impl Quaternion {
    /// The rotation about the z axis by an angle.
    pub fn about_z(angle_rad: f64) -> Self {
        Self { x: 0.0, y: 0.0, z: (0.5 * angle_rad).sin(), w: (0.5 * angle_rad).cos() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_definition_as_ros_writes_it() {
        let line = "=".repeat(80);
        let expected = format!(
            "sensor_msgs/MagneticField[] magnetic_field_array\n\
             {line}\nMSG: sensor_msgs/MagneticField\n\
             std_msgs/Header header\ngeometry_msgs/Vector3 magnetic_field\nfloat64[9] magnetic_field_covariance\n\
             {line}\nMSG: std_msgs/Header\n\
             builtin_interfaces/Time stamp\nstring frame_id\n\
             {line}\nMSG: builtin_interfaces/Time\n\
             int32 sec\nuint32 nanosec\n\
             {line}\nMSG: geometry_msgs/Vector3\n\
             float64 x\nfloat64 y\nfloat64 z\n"
        );
        assert_eq!(MagneticFieldArray::definition(), expected);
    }

    #[test]
    fn verif_times() {
        let time = Time::from_nanoseconds(1_705_004_054_969_568_695);
        assert_eq!(time, Time { sec: 1_705_004_054, nanosec: 969_568_695 });
        assert_eq!(time.nanoseconds(), 1_705_004_054_969_568_695);
        assert_eq!(Time::from_nanoseconds(u64::MAX).sec, i32::MAX);
    }
}

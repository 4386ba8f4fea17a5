//! Messages as defined by ROS 2.
//!
//! One table has each message once; the type, its ROS 2 definition and [`AnyMessage`] are derived from it.

use std::fmt::Debug;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::{Error, Publisher, cdr};

/// Message that can be recorded and sent.
pub trait Message: Clone + Debug + Serialize + DeserializeOwned + Field + Send + 'static {
    /// Name of the type, for example `geometry_msgs/msg/Vector3`.
    const TYPE: &'static str;

    /// Definition of the type and of the types of its fields, in the format of recordings (`ros2msg`).
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

    /// Encodes the message as CDR with its encapsulation header.
    fn encode(&self) -> Vec<u8> {
        cdr::encode(self)
    }

    /// Decodes a message.
    ///
    /// # Errors
    /// Description of the content found.
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        cdr::decode(bytes)
    }
}

/// Type of a field of a message.
pub trait Field {
    /// Name of the type within a definition, for example `float64` or `geometry_msgs/Vector3`.
    fn name() -> String;

    /// Adds name and fields of the messages that it contains, each once.
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

primitives!(
    bool => "bool", i8 => "int8", u8 => "uint8", i32 => "int32", u32 => "uint32", f32 => "float32", f64 => "float64",
    String => "string", [f64; 9] => "float64[9]",
    // Rows of a matrix follow one another, as the elements of a list do.
    [[f64; 6]; 6] => "float64[36]",
);

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
                    let fields = [$(format!("{} {}\n", <$of>::name(), stringify!($field).trim_start_matches("r#"))),*].concat();
                    parts.push((Self::name(), fields));
                    $(<$of>::collect(parts);)*
                }
            }

            impl Message for $name {
                const TYPE: &'static str = $type;
            }
        )*

        /// Message of any known type. It is serialised as its fields.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        #[serde(untagged)]
        pub enum AnyMessage {
            $($(#[$about])* $name($name),)*
        }

        impl AnyMessage {
            /// Names of the known types.
            pub const TYPES: &'static [&'static str] = &[$($type),*];

            /// Writes the message to a publisher.
            ///
            /// # Errors
            /// Errors of the publisher.
            pub fn write(&self, publisher: &mut impl Publisher, topic: &str, time_ns: u64) -> Result<(), Error> {
                match self {
                    $(Self::$name(message) => publisher.write(topic, time_ns, message),)*
                }
            }

            /// Decodes a message of this type. `None` if the type is unknown.
            ///
            /// # Errors
            /// Description of the content found.
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
        /// Additional nanoseconds.
        nanosec: u32,
    }

    /// Time and frame.
    Header = "std_msgs/msg/Header" {
        /// Time.
        stamp: Time,
        /// Name of the frame.
        frame_id: String,
    }

    /// Boolean value.
    Bool = "std_msgs/msg/Bool" {
        /// Value.
        data: bool,
    }

    /// A number.
    Float64 = "std_msgs/msg/Float64" {
        /// Value.
        data: f64,
    }

    /// A text.
    Text = "std_msgs/msg/String" {
        /// Value.
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

    /// Rotation. The default has all components zero, as in ROS 2, and is not a rotation; use [`Quaternion::about_z`].
    Quaternion = "geometry_msgs/msg/Quaternion" {
        /// Coefficient of i.
        x: f64,
        /// Coefficient of j.
        y: f64,
        /// Coefficient of k.
        z: f64,
        /// Real part.
        w: f64,
    }

    /// Position and orientation.
    Pose = "geometry_msgs/msg/Pose" {
        /// Position.
        position: Point,
        /// Orientation.
        orientation: Quaternion,
    }

    /// A pose in a frame.
    PoseStamped = "geometry_msgs/msg/PoseStamped" {
        /// Time and frame.
        header: Header,
        /// The pose.
        pose: Pose,
    }

    /// A point in a frame.
    PointStamped = "geometry_msgs/msg/PointStamped" {
        /// Time and frame.
        header: Header,
        /// The point.
        point: Point,
    }

    /// A vector in a frame.
    Vector3Stamped = "geometry_msgs/msg/Vector3Stamped" {
        /// Time and frame.
        header: Header,
        /// The vector.
        vector: Vector3,
    }

    /// Pose of a frame in its parent frame.
    Transform = "geometry_msgs/msg/Transform" {
        /// Position of its origin \[m\].
        translation: Vector3,
        /// Orientation of its axes.
        rotation: Quaternion,
    }

    /// Pose of a frame in its parent frame at a time.
    TransformStamped = "geometry_msgs/msg/TransformStamped" {
        /// Time and parent frame.
        header: Header,
        /// The frame.
        child_frame_id: String,
        /// Its pose in the parent frame.
        transform: Transform,
    }

    /// Poses of several frames.
    TfMessage = "tf2_msgs/msg/TFMessage" {
        /// One entry for each frame.
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
        /// Time and frame.
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
        /// Time and frame.
        header: Header,
        /// Velocity and angular velocity.
        twist: Twist,
    }

    /// A pose and its covariance.
    PoseWithCovariance = "geometry_msgs/msg/PoseWithCovariance" {
        /// The pose.
        pose: Pose,
        /// Covariance of x, y, z and of the rotations about these axes \[m2, rad2\].
        covariance: [[f64; 6]; 6],
    }

    /// A pose with its covariance in a frame.
    PoseWithCovarianceStamped = "geometry_msgs/msg/PoseWithCovarianceStamped" {
        /// Time and frame.
        header: Header,
        /// The pose.
        pose: PoseWithCovariance,
    }

    /// Angles, speeds and moments of joints; an unknown list is empty.
    JointState = "sensor_msgs/msg/JointState" {
        /// Time.
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

    /// Magnetic field, in tesla by the standard. OpenWhisker and this platform record the sensor's raw counts.
    MagneticField = "sensor_msgs/msg/MagneticField" {
        /// Time and frame.
        header: Header,
        /// The field.
        magnetic_field: Vector3,
        /// Covariance, row by row; all zeros if it is unknown.
        magnetic_field_covariance: [f64; 9],
    }

    /// A duration.
    Duration = "builtin_interfaces/msg/Duration" {
        /// Whole seconds.
        sec: i32,
        /// Additional nanoseconds.
        nanosec: u32,
    }

    /// A colour; components from 0 to 1.
    Color = "std_msgs/msg/ColorRGBA" {
        /// Red.
        r: f32,
        /// Green.
        g: f32,
        /// Blue.
        b: f32,
        /// Opacity.
        a: f32,
    }

    /// A compressed image.
    CompressedImage = "sensor_msgs/msg/CompressedImage" {
        /// Time and frame.
        header: Header,
        /// Name of the encoding.
        format: String,
        /// Encoded image.
        data: Vec<u8>,
    }

    /// Place in a texture.
    UvCoordinate = "visualization_msgs/msg/UVCoordinate" {
        /// Along the image.
        u: f32,
        /// Down the image.
        v: f32,
    }

    /// File with a mesh.
    MeshFile = "visualization_msgs/msg/MeshFile" {
        /// Name.
        filename: String,
        /// Contents.
        data: Vec<u8>,
    }

    /// A drawn object, with the fields of ROS 2 Humble and later. [`marker`] has the values of `type` and `action`.
    Marker = "visualization_msgs/msg/Marker" {
        /// Time and frame.
        header: Header,
        /// Namespace.
        ns: String,
        /// Number within the namespace.
        id: i32,
        /// Kind of the object.
        r#type: i32,
        /// Action.
        action: i32,
        /// Pose in the frame of the header.
        pose: Pose,
        /// Dimensions \[m\].
        scale: Vector3,
        /// Colour.
        color: Color,
        /// Time until it is removed; zero for never.
        lifetime: Duration,
        /// Whether it moves with its frame after its time.
        frame_locked: bool,
        /// Points, for the kinds that have some.
        points: Vec<Point>,
        /// Colours of the points; empty for one colour.
        colors: Vec<Color>,
        /// Name of a texture.
        texture_resource: String,
        /// Texture.
        texture: CompressedImage,
        /// Places of the points in the texture.
        uv_coordinates: Vec<UvCoordinate>,
        /// Text, for the kind that has one.
        text: String,
        /// Name of a mesh.
        mesh_resource: String,
        /// Mesh.
        mesh_file: MeshFile,
        /// Whether the mesh brings its own materials.
        mesh_use_embedded_materials: bool,
    }

    /// Drawn objects.
    MarkerArray = "visualization_msgs/msg/MarkerArray" {
        /// The objects.
        markers: Vec<Marker>,
    }

    /// Place and size of a map.
    MapMetaData = "nav_msgs/msg/MapMetaData" {
        /// Time of the map.
        map_load_time: Time,
        /// Side of a cell \[m\].
        resolution: f32,
        /// Number of cells along x.
        width: u32,
        /// Number of cells along y.
        height: u32,
        /// Pose of the outer corner of the first cell.
        origin: Pose,
    }

    /// Probability of occupation of the cells of a plane.
    OccupancyGrid = "nav_msgs/msg/OccupancyGrid" {
        /// Time and frame.
        header: Header,
        /// Place and size.
        info: MapMetaData,
        /// Probability in per cent, -1 if unknown, row by row along x.
        data: Vec<i8>,
    }

    /// A field of the points of a cloud. [`point_field`] has the values of `datatype`.
    PointField = "sensor_msgs/msg/PointField" {
        /// Name.
        name: String,
        /// Place within the bytes of a point.
        offset: u32,
        /// Type of its numbers.
        datatype: u8,
        /// Number of numbers.
        count: u32,
    }

    /// Points with fields, as bytes.
    PointCloud2 = "sensor_msgs/msg/PointCloud2" {
        /// Time and frame.
        header: Header,
        /// Number of rows; 1 for points without an order.
        height: u32,
        /// Number of points of a row.
        width: u32,
        /// Fields of a point.
        fields: Vec<PointField>,
        /// Whether the first byte of a number is the most significant one.
        is_bigendian: bool,
        /// Number of bytes of a point.
        point_step: u32,
        /// Number of bytes of a row.
        row_step: u32,
        /// The points, row by row.
        data: Vec<u8>,
        /// Whether all numbers are finite.
        is_dense: bool,
    }

    /// A value with its name.
    KeyValue = "diagnostic_msgs/msg/KeyValue" {
        /// Name.
        key: String,
        /// Value.
        value: String,
    }

    /// State of a component.
    DiagnosticStatus = "diagnostic_msgs/msg/DiagnosticStatus" {
        /// Level.
        level: Level,
        /// Name of the component.
        name: String,
        /// Description.
        message: String,
        /// Name of the device.
        hardware_id: String,
        /// Values.
        values: Vec<KeyValue>,
    }

    /// States of components.
    DiagnosticArray = "diagnostic_msgs/msg/DiagnosticArray" {
        /// Time.
        header: Header,
        /// The states.
        status: Vec<DiagnosticStatus>,
    }

    /// Readings since the last message of this topic.
    MagneticFieldArray = "whisker_interfaces/msg/MagneticFieldArray" {
        /// Readings in the order of time.
        magnetic_field_array: Vec<MagneticField>,
    }
}

/// Level of a [`DiagnosticStatus`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Level(pub u8);

impl Level {
    /// Everything is in order.
    pub const OK: Self = Self(0);
    /// Restricted operation.
    pub const WARN: Self = Self(1);
    /// Failure.
    pub const ERROR: Self = Self(2);
    /// No recent data.
    pub const STALE: Self = Self(3);
}

impl Field for Level {
    fn name() -> String {
        "byte".into()
    }
}

/// Constants of [`Marker`].
pub mod marker {
    /// Kind: ellipsoid with the dimensions `scale`.
    pub const SPHERE: i32 = 2;
    /// Kind: line through the points, `scale.x` wide.
    pub const LINE_STRIP: i32 = 4;
    /// Kind: triangles, three points each.
    pub const TRIANGLE_LIST: i32 = 11;
    /// Action: adds or replaces the object.
    pub const ADD: i32 = 0;
}

/// Constants of [`PointField`].
pub mod point_field {
    /// Numbers of single precision.
    pub const FLOAT32: u8 = 7;
}

const NANOSECONDS: u64 = 1_000_000_000;

impl Time {
    /// Time at this many nanoseconds after the epoch, saturated at the largest representable time.
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
    /// Rotation about the z axis by an angle (rad).
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

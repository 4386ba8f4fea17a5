//! ROS 2 messages and rosbag2 recordings, without ROS.
//!
//! [`messages`] holds the standard messages that whiskers need, each with the text that ROS 2 defines it by. [`Writer`] records them into a
//! rosbag2 folder, a `metadata.yaml` beside an MCAP file; [`Reader`] reads such folders, and bare MCAP files, whoever wrote them. [`Publisher`]
//! is what a recording and a node have in common: something that takes messages. [`topics`] names topics and frames; [`cdr`] is how values become bytes.
//!
//! ```
//! use bag::messages::{Header, MagneticField, Time, Vector3};
//! use bag::{Publisher, Reader, Writer};
//!
//! let home = tempfile::tempdir()?;
//! let folder = home.path().join("reading");
//! let time_ns = 1_500_000_000;
//! let field = MagneticField {
//!     header: Header { stamp: Time::from_nanoseconds(time_ns), frame_id: "whisker_base_link".into() },
//!     magnetic_field: Vector3 { x: 1e-3, y: 0.0, z: 0.0 },
//!     magnetic_field_covariance: [0.0; 9],
//! };
//! let mut writer = Writer::create(&folder)?;
//! writer.write("/field", time_ns, &field)?;
//! writer.finish()?;
//!
//! for record in Reader::open(&folder)?.records() {
//!     assert_eq!(record?.decode::<MagneticField>()?, field);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod cdr;
mod error;
pub mod messages;
mod metadata;
mod reader;
mod records;
pub mod topics;
mod writer;

pub use error::Error;
pub use messages::Message;
pub use reader::{Attachment, Reader, Record};
pub use writer::Writer;

/// Something that takes messages: a recording, a node.
pub trait Publisher {
    /// Takes a message of a topic at a time in nanoseconds, since whatever epoch the caller counts from.
    ///
    /// # Errors
    /// [`Error`] says what did not take it.
    fn write<M: Message>(&mut self, topic: &str, time_ns: u64, message: &M) -> Result<(), Error>;
}

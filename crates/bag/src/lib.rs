//! ROS 2 messages and rosbag2 recordings, without ROS.
//!
//! [`messages`] defines the ROS 2 messages in which the data of a whisker are recorded. [`Writer`] records them into a
//! rosbag2 folder: a `metadata.yaml` beside an MCAP file. [`Reader`] reads such folders, and single MCAP files of any
//! writer, with uncompressed, zstd and LZ4 chunks. [`Publisher`] is the common interface of a recording and a live
//! node. [`topics`] defines the names of topics and frames, and [`cdr`] encodes values. The crate depends on no other
//! crate of the project; the command `whisker bag` (`whisker_cli::ros`) converts traces and logs with it.
//!
//! # Example: rate of change of a recorded field
//!
//! A magnetometer's field is recorded twice, 1.5 s apart, and the change of its x component per second is computed from
//! the recording.
//!
//! ```
//! use bag::messages::{Header, MagneticField, Time, Vector3};
//! use bag::{Publisher, Reader, Writer};
//!
//! let home = tempfile::tempdir()?;
//! let folder = home.path().join("reading");
//! let field = |time_ns, x_t| MagneticField {
//!     header: Header { stamp: Time::from_nanoseconds(time_ns), frame_id: "whisker_base_link".into() },
//!     magnetic_field: Vector3 { x: x_t, y: 0.0, z: 0.0 },
//!     magnetic_field_covariance: [0.0; 9],
//! };
//! let mut writer = Writer::create(&folder)?;
//! for (time_ns, x_t) in [(0, 1e-3), (1_500_000_000, 4e-3)] {
//!     writer.write("/field", time_ns, &field(time_ns, x_t))?;
//! }
//! writer.finish()?;
//!
//! let mut readings = Vec::new();
//! for record in Reader::open(&folder)?.records() {
//!     let record = record?;
//!     readings.push((1e-9 * record.time_ns as f64, record.decode::<MagneticField>()?.magnetic_field.x));
//! }
//! let [(t0_s, x0_t), (t1_s, x1_t)] = readings[..] else { panic!("two messages") };
//! let rate_t_per_s = (x1_t - x0_t) / (t1_s - t0_s);
//! assert!((rate_t_per_s - 2e-3).abs() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod cdr;
mod chunk;
mod error;
mod lengths;
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

/// Destination of messages: a recording or a node.
pub trait Publisher {
    /// Records or sends a message of a topic. `time_ns` counts from the caller's epoch (ns).
    ///
    /// # Errors
    /// [`Error`] names the file or topic that failed.
    fn write<M: Message>(&mut self, topic: &str, time_ns: u64, message: &M) -> Result<(), Error>;
}

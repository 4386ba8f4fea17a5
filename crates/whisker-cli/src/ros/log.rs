//! Logs of the platform from recordings of a magnetometer.

use std::path::{Path, PathBuf};

use anyhow::bail;
use bag::messages::MagneticFieldArray;
use bag::{Attachment, Reader, topics};
use files::{sha256, write_atomically, write_json};
use platform::record::LogSidecar;
use platform::streams::SIDECAR;
use testbed::provenance::watermark;

use super::restore::check_replaces_same;

/// Writes the readings of a magnetometer as a log. Without the sidecar of a log, as in foreign recordings, time counts
/// from the first reading, and pushes are unknown.
pub(super) fn import_readings(
    path: &Path,
    reader: &Reader,
    sidecar: Option<&Attachment>,
    salvage: bool,
    folder: &Path,
) -> anyhow::Result<Vec<PathBuf>> {
    let mut table = String::from("t_s,x_counts,y_counts,z_counts\n");
    let mut first_ns = sidecar.map(|_| 0);
    let mut last_ns = i64::MIN;
    for record in reader.records() {
        let record = match record {
            Ok(record) => record,
            Err(error) if salvage => {
                eprintln!("warning: {error}");
                break;
            }
            Err(error) => return Err(error.into()),
        };
        if record.topic != topics::MAGNETOMETER {
            continue;
        }
        for field in record.decode::<MagneticFieldArray>()?.magnetic_field_array {
            let stamp_ns = field.header.stamp.nanoseconds();
            if stamp_ns < last_ns {
                bail!(record.wrong(format!("a stamp of {stamp_ns} ns"), format!("none before the last, {last_ns} ns")));
            }
            last_ns = stamp_ns;
            let t_s = (stamp_ns - *first_ns.get_or_insert(stamp_ns)) as f64 / 1e9;
            let axes = field.magnetic_field;
            let mut counts = [0_u16; 3];
            for (count, value) in counts.iter_mut().zip([axes.x, axes.y, axes.z]) {
                if value.fract() != 0.0 || !(0.0..=f64::from(u16::MAX)).contains(&value) {
                    bail!(record.wrong(value, "the counts of a sensor, whole numbers from 0 to 65535"));
                }
                *count = value as u16;
            }
            let [x, y, z] = counts;
            table.push_str(&format!("{t_s:.6},{x},{y},{z}\n"));
        }
    }
    let Some(_) = first_ns.filter(|_| table.lines().nth(1).is_some()) else {
        bail!(
            "{}: found neither a trace nor readings on {}, expected one of them",
            path.display(),
            topics::MAGNETOMETER
        );
    };
    let files = [folder.join(SIDECAR), folder.join("log.csv")];
    check_replaces_same(&files[1], table.as_bytes())?;
    if let Some(attachment) = sidecar {
        check_replaces_same(&files[0], &attachment.data)?;
    }
    match sidecar {
        Some(attachment) => write_atomically(&files[0], &attachment.data)?,
        // Contacts may have been added to the sidecar of this table.
        None if files.iter().all(|file| file.is_file()) => {}
        None => {
            // Format and rate of OpenWhisker's driver; its recordings do not contain them.
            let format = platform::sensor::format("hex").expect("the platform's own format is registered");
            let mark = watermark([sha256(&table).as_str()]);
            write_json(&files[0], &LogSidecar::new(format.name, format.rate_hz, mark))?;
        }
    }
    // The table is written last: it marks a complete log.
    write_atomically(&files[1], table.as_bytes())?;
    Ok(files.into())
}

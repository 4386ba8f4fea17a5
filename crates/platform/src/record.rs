//! Recording: sinks of a session's data, and the project's own log.

use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use files::{FORMAT, Watermark, write_json};
use serde::{Deserialize, Serialize};

use crate::calibration::Detection;
use crate::printer::Head;
use crate::routine::Contact;
use crate::{Error, Sample};

/// End of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Complete.
    Complete,
    /// Interrupted: the data so far are kept under names that contain `interrupted`.
    Interrupted,
}

/// Sink of the data of sensor and printer, each in the order of time. Data of the two with the same time may arrive
/// some tenths of a second apart.
pub trait Sink: Send {
    /// Takes samples of the sensor.
    ///
    /// # Errors
    /// If they cannot be written.
    fn samples(&mut self, samples: &[Sample]) -> Result<(), Error>;

    /// Takes the detection at a sample, before that sample.
    ///
    /// # Errors
    /// If it cannot be written.
    fn detected(&mut self, detection: &Detection) -> Result<(), Error>;

    /// Takes a position of the head.
    ///
    /// # Errors
    /// If it cannot be written.
    fn head(&mut self, head: Head) -> Result<(), Error>;

    /// Takes a push, at its end.
    ///
    /// # Errors
    /// If it cannot be written.
    fn contact(&mut self, contact: Contact) -> Result<(), Error>;

    /// Ends the recording. Returns the files written.
    ///
    /// # Errors
    /// If the data cannot be written.
    fn finish(self: Box<Self>, ending: Ending) -> Result<Vec<PathBuf>, Error>;
}

/// Names of a log's table: by its ending, and while it is written.
const COMPLETE: &str = "log.csv";
const INTERRUPTED: &str = "log.interrupted.csv";
const PART: &str = "log.csv.part";

/// Sidecar of a log; `datasets/FORMAT.md` specifies it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogSidecar {
    /// Version of the format.
    pub format: u32,
    /// `platform_log`.
    pub kind: String,
    /// Nominal sampling rate (Hz).
    pub rate_hz: f64,
    /// Name in the registry of line formats.
    pub sensor: String,
    /// Pushes, by the printer's positions.
    pub contacts: Vec<Contact>,
    /// Program that wrote it.
    pub watermark: Watermark,
}

/// Kind of a log.
pub const LOG_KIND: &str = "platform_log";

impl LogSidecar {
    /// Sidecar of a log of this line format, a name in the registry, without pushes.
    pub fn new(sensor: &str, rate_hz: f64, watermark: Watermark) -> Self {
        let (kind, sensor) = (LOG_KIND.into(), sensor.into());
        Self { format: FORMAT, kind, rate_hz, sensor, contacts: Vec::new(), watermark }
    }
}

/// File that reserves space on the disk for the end of a log, and its size in bytes: the sidecar and the rows of half a minute.
const RESERVE: (&str, usize) = ("reserve.part", 1 << 20);

/// The project's log: samples (`log.csv`), sidecar (`log.json`) and positions of the head (`head.csv`). A file that is
/// being written ends in `.part`; one of an interrupted session has `interrupted` in its name.
///
/// The space for its end is reserved from the beginning, so that no sample is lost if the disk fills up, which ends the session.
#[derive(Debug)]
pub struct Log {
    folder: PathBuf,
    reserve: PathBuf,
    samples: Table,
    heads: Table,
    sidecar: LogSidecar,
}

impl Log {
    /// Creates a log in a folder, and the folder if it is missing.
    ///
    /// # Errors
    /// If the folder has a log, or a file cannot be created.
    pub fn create(folder: &Path, sidecar: LogSidecar) -> Result<Self, Error> {
        Self::check_is_free(folder)?;
        fs::create_dir_all(folder).map_err(Error::file(folder))?;
        let reserve = folder.join(RESERVE.0);
        fs::write(&reserve, vec![0; RESERVE.1]).map_err(Error::file(&reserve))?;
        Ok(Self {
            folder: folder.into(),
            reserve,
            samples: Table::create(folder.join(PART), "t_s,x_counts,y_counts,z_counts")?,
            heads: Table::create(folder.join("head.csv.part"), "t_s,x_m,y_m,z_m")?,
            sidecar,
        })
    }

    /// Checks that a folder has no log, complete or not: a recording is not overwritten.
    ///
    /// # Errors
    /// [`Error::File`] names the file found.
    pub fn check_is_free(folder: &Path) -> Result<(), Error> {
        let taken = [COMPLETE, INTERRUPTED, PART].map(|file| folder.join(file)).into_iter().find(|path| path.exists());
        taken.map_or(Ok(()), |path| {
            let expected = "none: rename or remove it, or choose another folder";
            Err(files::Error::value(&path, "path", "a log", expected).into())
        })
    }
}

impl Sink for Log {
    fn samples(&mut self, samples: &[Sample]) -> Result<(), Error> {
        // All are taken before the first is written, so that none is lost if the disk is full.
        for Sample { t_s, counts: [x, y, z] } in samples {
            self.samples.take(format_args!("{t_s:.6},{x},{y},{z}"));
        }
        self.samples.write_chunk()
    }

    fn detected(&mut self, _: &Detection) -> Result<(), Error> {
        // Not part of the log: it follows from the samples and the calibration.
        Ok(())
    }

    fn head(&mut self, Head { t_s, x_m, y_m, z_m }: Head) -> Result<(), Error> {
        self.heads.take(format_args!("{t_s:.6},{x_m:.6},{y_m:.6},{z_m:.6}"));
        self.heads.write_chunk()
    }

    fn contact(&mut self, contact: Contact) -> Result<(), Error> {
        self.sidecar.contacts.push(contact);
        Ok(())
    }

    fn finish(self: Box<Self>, ending: Ending) -> Result<Vec<PathBuf>, Error> {
        let stem = match ending {
            Ending::Complete => "",
            Ending::Interrupted => "interrupted.",
        };
        let name = |file: &str, end: &str| self.folder.join(format!("{file}.{stem}{end}"));
        let files = [name("head", "csv"), name("log", "json"), name("log", "csv")];
        let Self { reserve, heads, sidecar, samples, .. } = *self;
        let released = fs::remove_file(&reserve).map_err(Error::file(&reserve));
        // An error of one file does not keep the others from being written. The table is renamed last: if it exists,
        // the log is complete.
        let heads = heads.finish(&files[0]);
        let sidecar = write_json(&files[1], &sidecar).map_err(Error::from);
        let samples = samples.finish(&files[2]);
        released.and(heads).and(sidecar).and(samples)?;
        Ok(files.into())
    }
}

/// Number of bytes of rows that are written at once.
const CHUNK: usize = 1 << 13;

/// A table that is written under a temporary name, in whole rows.
#[derive(Debug)]
struct Table {
    path: PathBuf,
    file: File,
    /// Rows that are not in the file yet.
    rows: Vec<u8>,
    /// Length of the file in bytes: that of its whole rows.
    length: u64,
}

impl Table {
    fn create(path: PathBuf, header: &str) -> Result<Self, Error> {
        let file = File::create(&path).map_err(Error::file(&path))?;
        Ok(Self { path, file, rows: format!("{header}\n").into_bytes(), length: 0 })
    }

    /// Takes a row.
    fn take(&mut self, row: std::fmt::Arguments<'_>) {
        writeln!(self.rows, "{row}").expect("memory can be written to");
    }

    /// Writes the rows taken if they make a chunk.
    fn write_chunk(&mut self) -> Result<(), Error> {
        if self.rows.len() >= CHUNK { self.flush().map_err(Error::file(&self.path)) } else { Ok(()) }
    }

    /// Writes the pending rows. After an error they remain pending, and the file ends with the last row that was written whole.
    fn flush(&mut self) -> io::Result<()> {
        if let Err(error) = self.file.write_all(&self.rows) {
            // The first error is the one to report. A file that cannot be cut ends with an incomplete row, which readers skip.
            let _ = self.file.set_len(self.length).and_then(|()| self.file.seek(SeekFrom::Start(self.length)));
            return Err(error);
        }
        self.length += self.rows.len() as u64;
        self.rows.clear();
        Ok(())
    }

    /// Writes the pending rows as far as possible and gives the table its name.
    fn finish(mut self, path: &Path) -> Result<(), Error> {
        let written = self.flush().and_then(|()| self.file.sync_all());
        let renamed = fs::rename(&self.path, path);
        written.and(renamed).map_err(Error::file(path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(folder: &Path) -> Box<Log> {
        let watermark =
            Watermark { tool: "test".into(), version: "0".into(), git_commit: None, inputs_sha256: String::new() };
        let mut log = Box::new(Log::create(folder, LogSidecar::new("hex", 800.0, watermark)).expect("a log"));
        log.samples(&[Sample { t_s: 0.5, counts: [1, 2, 65535] }]).expect("kept");
        log.head(Head { t_s: 0.25, x_m: 0.127, y_m: 0.09675, z_m: 0.0 }).expect("kept");
        log.contact(Contact { start_s: 0.1, end_s: 0.4, distance_m: 0.145, push_m: 0.006 }).expect("kept");
        log
    }

    #[test]
    fn verif_a_log_appears_complete() {
        let folder = tempfile::tempdir().expect("a folder");
        let log = log(folder.path());
        assert!(!folder.path().join("log.csv").exists());
        let files = log.finish(Ending::Complete).expect("written");
        let names: Vec<_> = files.iter().map(|path| path.file_name().expect("a name").to_owned()).collect();
        assert_eq!(names, ["head.csv", "log.json", "log.csv"]);
        assert_eq!(
            fs::read_to_string(&files[0]).expect("text"),
            "t_s,x_m,y_m,z_m\n0.250000,0.127000,0.096750,0.000000\n"
        );
        let table = "t_s,x_counts,y_counts,z_counts\n0.500000,1,2,65535\n";
        assert_eq!(fs::read_to_string(&files[2]).expect("text"), table);
        let sidecar: LogSidecar = files::read_json(&files[1]).expect("a sidecar");
        assert_eq!((sidecar.kind.as_str(), sidecar.contacts.len()), (LOG_KIND, 1));
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 3);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn robust_rows_that_could_not_be_written_are_written_once_there_is_space() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("table.part");
        std::os::unix::fs::symlink("/dev/full", &path).expect("a link");
        let mut table = Table::create(path.clone(), "k").expect("open");
        let mut failed = 0;
        for k in 0..2 * CHUNK {
            table.take(format_args!("{k}"));
            failed += u32::from(table.write_chunk().is_err());
        }
        assert!(failed > 0);
        fs::remove_file(&path).expect("removed");
        table.file = File::create(&path).expect("a disk with space");
        table.finish(&folder.path().join("table.csv")).expect("written");
        let expected: Vec<String> = (0..2 * CHUNK).map(|k| k.to_string()).collect();
        let text = fs::read_to_string(folder.path().join("table.csv")).expect("text");
        assert_eq!(text, format!("k\n{}\n", expected.join("\n")));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn robust_a_table_that_cannot_be_written_does_not_cost_the_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut log = log(folder.path());
        log.heads.file = File::options().write(true).open("/dev/full").expect("open");
        let error = log.finish(Ending::Interrupted).expect_err("the disk is full").to_string();
        assert!(error.contains("head.interrupted.csv: No space left on device"), "{error}");
        let text = fs::read_to_string(folder.path().join("log.interrupted.csv")).expect("text");
        assert_eq!(text, "t_s,x_counts,y_counts,z_counts\n0.500000,1,2,65535\n");
        let sidecar: LogSidecar = files::read_json(&folder.path().join("log.interrupted.json")).expect("a sidecar");
        assert_eq!(sidecar.contacts.len(), 1);
    }

    #[test]
    fn robust_an_interrupted_log_is_named_so() {
        let folder = tempfile::tempdir().expect("a folder");
        log(folder.path()).finish(Ending::Interrupted).expect("written");
        assert!(
            folder.path().join("log.interrupted.csv").exists() && folder.path().join("log.interrupted.json").exists()
        );
        assert!(!folder.path().join("log.csv").exists());
    }

    #[test]
    fn robust_a_log_is_not_overwritten() {
        let folder = tempfile::tempdir().expect("a folder");
        let sidecar = log(&folder.path().join("another")).sidecar;
        for (ending, name) in
            [(None, PART), (Some(Ending::Interrupted), INTERRUPTED), (Some(Ending::Complete), COMPLETE)]
        {
            let folder = folder.path().join(name);
            let begun = log(&folder);
            if let Some(ending) = ending {
                begun.finish(ending).expect("written");
            }
            let error = Log::create(&folder, sidecar.clone()).expect_err("refused").to_string();
            assert!(error.contains(&format!("{name}: path: found a log, expected none")), "{error}");
        }
    }
}

//! Streaming writer of traces, with memory independent of the length.

use std::io::Write;
use std::path::{Path, PathBuf};

use files::hexadecimal;
use files::{AtomicFile, Error, write_json};
use sha2::{Digest as _, Sha256};

use crate::Sidecar;
use crate::table::{FurtherColumns, Instant, TruthInstant, header, push_row};

/// Trace under construction. The files appear when [`TraceWriter::finish`] is called.
#[derive(Debug)]
pub struct TraceWriter {
    sidecar: Sidecar,
    path: PathBuf,
    file: AtomicFile,
    digest: Sha256,
    line: String,
    further: FurtherColumns,
}

impl TraceWriter {
    /// Starts a trace with this sidecar and these columns beyond [`crate::COLUMNS`]. Row count and hash are computed from the
    /// rows written.
    ///
    /// # Errors
    /// [`Error::Io`] with the path.
    pub fn create(folder: &Path, sidecar: Sidecar, further: FurtherColumns) -> Result<Self, Error> {
        let path = folder.join(format!("{}.csv", sidecar.name));
        let file = AtomicFile::create(&path)?;
        let sidecar = Sidecar { rows: 0, ..sidecar };
        let mut writer = Self { sidecar, path, file, digest: Sha256::new(), line: header(further), further };
        writer.write_line()?;
        Ok(writer)
    }

    /// Appends the next row in order of time.
    ///
    /// # Errors
    /// [`Error::Io`] with the path.
    pub fn push(&mut self, known: &Instant, truth: &TruthInstant) -> Result<(), Error> {
        self.line.clear();
        push_row(&mut self.line, known, truth, self.further);
        self.sidecar.rows += 1;
        self.write_line()
    }

    fn write_line(&mut self) -> Result<(), Error> {
        self.digest.update(&self.line);
        self.file.write_all(self.line.as_bytes()).map_err(Error::io(&self.path))
    }

    /// Completes the CSV and then the sidecar, which marks the trace as complete. Returns the path of the CSV.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn finish(mut self) -> Result<PathBuf, Error> {
        self.file.finish()?;
        self.sidecar.csv_sha256 = hexadecimal(&self.digest.finalize());
        write_json(&self.path.with_extension("json"), &self.sidecar)?;
        Ok(self.path)
    }
}

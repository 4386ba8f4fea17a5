//! Writing a trace row by row: it is never whole in memory, however long it is.

use std::io::Write;
use std::path::{Path, PathBuf};

use files::hexadecimal;
use files::{AtomicFile, Error, write_json};
use sha2::{Digest as _, Sha256};

use crate::Sidecar;
use crate::table::{Instant, TruthInstant, header, push_row};

/// A trace that is being written. It is there when it is finished.
#[derive(Debug)]
pub struct TraceWriter {
    sidecar: Sidecar,
    path: PathBuf,
    file: AtomicFile,
    digest: Sha256,
    line: String,
}

impl TraceWriter {
    /// Begins the trace that this sidecar describes. Number and hash of the rows follow from what is written.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn create(folder: &Path, sidecar: Sidecar) -> Result<Self, Error> {
        let path = folder.join(format!("{}.csv", sidecar.name));
        let file = AtomicFile::create(&path)?;
        let sidecar = Sidecar { rows: 0, ..sidecar };
        let mut writer = Self { sidecar, path, file, digest: Sha256::new(), line: header() };
        writer.write_line()?;
        Ok(writer)
    }

    /// Takes the next row in the order of time.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn push(&mut self, known: &Instant, truth: &TruthInstant) -> Result<(), Error> {
        self.line.clear();
        push_row(&mut self.line, known, truth);
        self.sidecar.rows += 1;
        self.write_line()
    }

    fn write_line(&mut self) -> Result<(), Error> {
        self.digest.update(&self.line);
        self.file.write_all(self.line.as_bytes()).map_err(Error::io(&self.path))
    }

    /// Puts the CSV in its place, and then the sidecar, which makes the trace complete. Returns the path of the CSV.
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

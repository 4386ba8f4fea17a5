//! Reading, hashing and writing whole files.

use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest as _, Sha256};
use tempfile::NamedTempFile;
use whisker::list_for_object;

use crate::keys_once::KeysOnce;
use crate::{Error, shown};

/// Hash over several pieces of data, each kept apart from the next.
#[derive(Clone, Debug, Default)]
pub struct Digest(Sha256);

impl Digest {
    /// Adds a piece.
    pub fn add(&mut self, bytes: impl AsRef<[u8]>) -> &mut Self {
        let bytes = bytes.as_ref();
        self.0.update((bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
        self
    }

    /// The hash of all pieces, in hexadecimal.
    pub fn finish(self) -> String {
        hexadecimal(&self.0.finalize())
    }
}

/// SHA-256 of some bytes, in hexadecimal.
pub fn sha256(bytes: impl AsRef<[u8]>) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

pub(crate) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A file that is written under a temporary name in its folder, which is made where missing, and renamed when it is finished: the file is there
/// whole or not at all.
#[derive(Debug)]
pub struct AtomicFile {
    file: BufWriter<NamedTempFile>,
    path: PathBuf,
}

impl AtomicFile {
    /// Begins the file.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn create(path: &Path) -> Result<Self, Error> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let create = || {
            fs::create_dir_all(folder)?;
            let mut builder = tempfile::Builder::new();
            builder.prefix(TEMPORARY.0).suffix(TEMPORARY.1);
            // Temporary files are private; results are to be read by others, as far as the file mode mask allows.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            builder.tempfile_in(folder)
        };
        let file = create().map_err(Error::io(path))?;
        Ok(Self { file: BufWriter::new(file), path: path.into() })
    }

    /// Puts the whole file in its place, once all of it has reached the disk.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn finish(self) -> Result<(), Error> {
        self.put(true)
    }

    /// Puts the whole file in its place without waiting for the disk: for what can be made again, and is known to be whole by something else.
    ///
    /// # Errors
    /// [`Error::Io`] names the file.
    pub fn finish_fast(self) -> Result<(), Error> {
        self.put(false)
    }

    fn put(self, waits: bool) -> Result<(), Error> {
        let put = || {
            let file = self.file.into_inner()?;
            if waits {
                file.as_file().sync_all()?;
            }
            file.persist(&self.path)?;
            Ok(())
        };
        put().map_err(Error::io(&self.path))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// How temporary names begin and end.
const TEMPORARY: (&str, &str) = (".", ".part");

/// Whether a file bears a temporary name: where nobody is writing, it was left behind by a program that was killed.
pub fn is_temporary(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with(TEMPORARY.0) && name.ends_with(TEMPORARY.1)
}

/// Writes a whole file, see [`AtomicFile`].
///
/// # Errors
/// [`Error::Io`] names the file.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes).map_err(Error::io(path))?;
    file.finish()
}

/// Longest JSON file that is read.
const MOST_JSON_BYTES: u64 = 1 << 26;

/// Longest table that is read whole.
const MOST_TABLE_BYTES: u64 = 1 << 30;

/// The bytes of a table that is read whole.
///
/// # Errors
/// [`Error`] names the file.
pub(crate) fn read_table(path: &Path) -> Result<Vec<u8>, Error> {
    read_at_most(path, MOST_TABLE_BYTES)
}

/// A whole file. What is longer is refused before memory runs out: a link in a strange folder may lead to a device that never ends.
fn read_at_most(path: &Path, most: u64) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let mut read = || File::open(path)?.take(most + 1).read_to_end(&mut bytes);
    let length = read().map_err(Error::io(path))? as u64;
    if length > most {
        return Err(Error::value(path, "size", format!("more than {most} bytes"), "a smaller file"));
    }
    Ok(bytes)
}

/// Reads a JSON file into a typed value.
///
/// # Errors
/// [`Error::Io`] or [`Error::Json`], with the place.
pub fn read_json<T: DeserializeOwned + Serialize>(path: &Path) -> Result<T, Error> {
    let bytes = read_at_most(path, MOST_JSON_BYTES)?;
    parse_json(&bytes).map_err(Error::json(path))
}

/// Parses JSON into a typed value. An object that has a key twice is refused: which of the two was meant? So is a list in the place of an object, whose values serde
/// would take in the order of the fields.
///
/// # Errors
/// What is wrong, with line and column or the key.
pub fn parse_json<T: DeserializeOwned + Serialize>(bytes: &[u8]) -> serde_json::Result<T> {
    let value = serde_json::from_slice(bytes)?;
    let KeysOnce = serde_json::from_slice(bytes)?;
    match list_for_object(&serde_json::from_slice(bytes)?, &serde_json::to_value(&value)?) {
        None => Ok(value),
        Some(place) => Err(serde::de::Error::custom(format!("{}: found a list, expected an object", shown(&place)))),
    }
}

/// Writes a value as JSON with two spaces of indentation and a newline at the end, atomically.
///
/// # Errors
/// [`Error::Io`] names the file.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    let mut bytes = serde_json::to_vec_pretty(value).map_err(Error::json(path))?;
    bytes.push(b'\n');
    write_atomically(path, &bytes)
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize, Serialize, PartialEq)]
    struct Inner {
        x_m: f64,
        y_m: f64,
    }

    #[derive(Debug, Deserialize, Serialize, PartialEq)]
    struct Outer {
        pair: (f64, f64),
        inner: Vec<Inner>,
    }

    #[test]
    fn robust_a_list_is_no_object() {
        let outer = Outer { pair: (1.0, 2.0), inner: vec![Inner { x_m: 3.0, y_m: 4.0 }] };
        let sound = r#"{"pair": [1, 2], "inner": [{"x_m": 3, "y_m": 4}]}"#;
        assert_eq!(parse_json::<Outer>(sound.as_bytes()).unwrap(), outer);
        for (list, place) in [(r#"{"pair": [1, 2], "inner": [[3, 4]]}"#, "inner[0]"), ("[[1, 2], []]", "the whole")] {
            let error = parse_json::<Outer>(list.as_bytes()).unwrap_err().to_string();
            assert_eq!(error, format!("{place}: found a list, expected an object"));
        }
    }
}

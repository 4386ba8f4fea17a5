//! Changed copies of the examples of own recordings.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// Copy of a folder of `examples`.
pub(crate) struct Laboratory {
    pub(crate) folder: tempfile::TempDir,
}

impl Laboratory {
    pub(crate) fn of(example: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(example);
        for entry in fs::read_dir(example).unwrap() {
            let path = entry.unwrap().path();
            fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
        }
        Self { folder }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Changes the mapping.
    pub(crate) fn mapped(self, change: impl FnOnce(&mut Value)) -> Self {
        let path = self.path("import.json");
        let mut mapping = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        change(&mut mapping);
        fs::write(&path, mapping.to_string()).unwrap();
        self
    }
}

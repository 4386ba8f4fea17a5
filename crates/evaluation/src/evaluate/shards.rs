//! Results of finished items, each in a separate file until the run is merged.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use files::{AtomicFile, sha256, write_atomically};
use serde::{Deserialize, Serialize};
use testbed::results::{ContourTrialRow, FailureRow, MapObjectRow, MapRow, QuantityRow, TrialRow};

use super::tables::OverTime;

/// Folder of the shards in the run's folder.
const FOLDER: &str = "shards";
/// File beside the shards that marks them as those of shares that compute all items again.
const RENEWED: &str = "renewed";

/// Results of an item: one entry per trial and seed, in the order of the scene's traces, then of the seeds.
pub(super) type Shard = Vec<TrialResults>;

/// Results of a trial at one noise level under one seed.
#[derive(Default, Serialize, Deserialize)]
pub(super) struct TrialResults {
    /// One per participant if the trial can be scored.
    pub(super) estimators: Vec<EstimatorResult>,
    /// One per participant if the object has an outline.
    pub(super) contours: Vec<ContourTrialRow>,
    /// Those that the participants state beside the contact.
    pub(super) quantities: Vec<QuantityRow>,
    /// Failures of the trial or of participants.
    pub(super) failures: Vec<FailureRow>,
    /// Maps of the scene under that seed, kept with its first trace.
    pub(super) maps: Vec<MapRow>,
    /// Objects of these maps.
    pub(super) map_objects: Vec<MapObjectRow>,
}

/// Results of one estimator on one trial.
#[derive(Serialize, Deserialize)]
pub(super) struct EstimatorResult {
    pub(super) row: TrialRow,
    /// Mean probabilities over the contact of the models that the estimator averages.
    pub(super) models: Vec<(String, f64)>,
    pub(super) over_time: OverTime,
    pub(super) elapsed_ns: u64,
    pub(super) steps: usize,
}

/// Folder of the shards. A shard begins with the hash of its remaining bytes, so that a truncated or damaged one does
/// not count as finished work.
pub(super) struct Shards(PathBuf);

impl Shards {
    /// Shards in the folder of a run.
    pub(super) fn in_run(folder: &Path) -> Self {
        Self(folder.join(FOLDER))
    }

    fn path(&self, item: usize) -> PathBuf {
        self.0.join(item.to_string())
    }

    /// Whether an item is finished.
    pub(super) fn has(&self, item: usize) -> bool {
        fs::read(self.path(item)).is_ok_and(|bytes| body(&bytes).is_some())
    }

    /// Writes the results of an item.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn write(&self, item: usize, shard: &Shard) -> anyhow::Result<()> {
        let path = self.path(item);
        let body = postcard::to_stdvec(shard).with_context(|| path.display().to_string())?;
        let mut file = AtomicFile::create(&path)?;
        let written = file.write_all(sha256(&body).as_bytes()).and_then(|()| file.write_all(&body));
        written.with_context(|| path.display().to_string())?;
        Ok(file.finish_fast()?)
    }

    /// Reads the results of an item.
    ///
    /// # Errors
    /// If the file cannot be read, or is damaged.
    pub(super) fn read(&self, item: usize) -> anyhow::Result<Shard> {
        let path = self.path(item);
        let bytes = fs::read(&path).with_context(|| path.display().to_string())?;
        let Some(body) = body(&bytes) else { bail!("{}: damaged; evaluate again", path.display()) };
        postcard::from_bytes(body).with_context(|| path.display().to_string())
    }

    /// Marks the shards as those of shares that compute all items again.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn mark_renewed(&self) -> anyhow::Result<()> {
        Ok(write_atomically(&self.0.join(RENEWED), b"")?)
    }

    /// Whether shares compute all items again, so that the existing results are new.
    pub(super) fn are_renewed(&self) -> bool {
        self.0.join(RENEWED).is_file()
    }

    /// Removes the results of an item, if there are any.
    ///
    /// # Errors
    /// If the file cannot be removed.
    pub(super) fn remove_item(&self, item: usize) -> anyhow::Result<()> {
        let path = self.path(item);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(error).with_context(|| path.display().to_string()),
            _ => Ok(()),
        }
    }

    /// Removes all shards of a run.
    ///
    /// # Errors
    /// If they cannot be removed.
    pub(super) fn remove(folder: &Path) -> anyhow::Result<()> {
        let folder = folder.join(FOLDER);
        if folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        Ok(())
    }
}

/// Bytes after the hash. `None` if the hash does not match.
fn body(bytes: &[u8]) -> Option<&[u8]> {
    const HASH: usize = 64;
    let (hash, body) = bytes.split_at_checked(HASH)?;
    (sha256(body).as_bytes() == hash).then_some(body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_a_damaged_shard_does_not_count_as_finished() {
        let folder = tempfile::tempdir().unwrap();
        let shards = Shards::in_run(folder.path());
        assert!(!shards.has(3));
        let failure = FailureRow { trace: "pin".into(), estimator: None, noise: 0.01, seed: 7, reason: "torn".into() };
        let done = TrialResults { failures: vec![failure.clone()], ..TrialResults::default() };
        shards.write(3, &vec![done]).unwrap();
        assert!(shards.has(3));
        assert_eq!(shards.read(3).unwrap()[0].failures, [failure]);
        let path = folder.path().join("shards/3");
        let bytes = fs::read(&path).unwrap();
        for length in [0, 10, 64, bytes.len() - 1] {
            fs::write(&path, &bytes[..length]).unwrap();
            assert!(!shards.has(3), "cut to {length} bytes");
        }
        let mut flipped = bytes.clone();
        flipped[70] ^= 1;
        fs::write(&path, flipped).unwrap();
        assert!(!shards.has(3) && shards.read(3).is_err());
    }
}

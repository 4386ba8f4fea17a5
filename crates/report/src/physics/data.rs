//! The tables of the physics study, read and checked.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use testbed::results::{ResultsKind, read_rows};

/// Provenance of the tables.
#[derive(Deserialize, Serialize)]
pub(crate) struct Watermark {
    format: u32,
    kind: String,
    /// The program that simulated.
    pub(crate) generator: Generator,
    /// Version of NumPy.
    pub(crate) numpy: String,
    /// Version of SciPy.
    pub(crate) scipy: String,
}

/// The program that simulated.
#[derive(Deserialize, Serialize)]
pub(crate) struct Generator {
    /// Its name.
    pub(crate) name: String,
    /// Its version.
    pub(crate) version: String,
    /// Version of MuJoCo.
    pub(crate) mujoco: String,
    /// Commit, where it is known.
    pub(crate) git_commit: Option<String>,
    /// Hash of its source.
    pub(crate) source_sha256: String,
}

/// A claim that was measured.
#[derive(Deserialize, Serialize)]
pub(crate) struct Claim {
    /// Its name.
    pub(crate) id: String,
    /// The claim in words.
    pub(crate) claim: String,
    /// Measured value.
    pub(crate) measured: f64,
    /// `<=` or `>=`.
    pub(crate) relation: String,
    /// Bound on the measured value.
    pub(crate) bound: f64,
    /// Unit of both; may be empty.
    pub(crate) unit: String,
    /// Whether the measured value keeps the bound.
    pub(crate) holds: bool,
}

/// Whether a folder holds the tables of the physics study.
pub(crate) fn is_study(folder: &Path) -> bool {
    ResultsKind::Physics.is_in(folder)
}

fn watermark_file(folder: &Path) -> PathBuf {
    folder.join(ResultsKind::Physics.file())
}

/// The tables of the physics study. Those of single figures are read on request.
pub(crate) struct Data {
    folder: PathBuf,
    /// Their provenance.
    pub(crate) watermark: Watermark,
    /// Every claim, in the order of the studies.
    pub(crate) claims: Vec<Claim>,
}

impl Data {
    /// Reads the study in a folder.
    ///
    /// # Errors
    /// When the watermark is not one of a physics study, or a file is missing or damaged; the error names file, line and column.
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let file = watermark_file(folder);
        let watermark: Watermark = files::read_json(&file)?;
        let Watermark { format, kind, .. } = &watermark;
        ensure!(
            (*format, kind.as_str()) == (1, "physics"),
            "{}: found format {format} of kind `{kind}`, expected format 1 of kind `physics`",
            file.display()
        );
        Ok(Self { claims: read_rows(&folder.join("claims.csv"))?, folder: folder.to_owned(), watermark })
    }

    /// The rows of a table. Columns without a field are ignored.
    ///
    /// # Errors
    /// When the file is missing or damaged.
    pub(crate) fn table<T: DeserializeOwned>(&self, name: &str) -> Result<Vec<T>> {
        read_rows(&self.folder.join(format!("{name}.csv")))
    }

    /// The bound of a claim.
    ///
    /// # Errors
    /// When there is no such claim.
    pub(crate) fn bound(&self, id: &str) -> Result<f64> {
        let claim = self.claims.iter().find(|claim| claim.id == id);
        let file = self.folder.join("claims.csv");
        claim
            .map(|claim| claim.bound)
            .with_context(|| format!("{}: expected a claim `{id}`, found none", file.display()))
    }
}

/// The different names in a column, in the order of their first row.
pub(crate) fn names<'a>(column: impl Iterator<Item = &'a str>) -> Vec<String> {
    column.fold(Vec::new(), |mut names, name| {
        if !names.iter().any(|known| known == name) {
            names.push(name.to_owned());
        }
        names
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn verif_names_keep_their_order() {
        assert_eq!(names(["b", "a", "b"].into_iter()), ["b", "a"]);
    }

    #[test]
    fn robust_a_watermark_of_another_kind_gives_one_error() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let text = r#"{"format": 1, "kind": "chemistry", "numpy": "", "scipy": "", "generator":
            {"name": "", "version": "", "mujoco": "", "git_commit": null, "source_sha256": ""}}"#;
        fs::write(folder.path().join("watermark.json"), text).expect("written");
        let message = format!("{:#}", Data::read(folder.path()).err().expect("another kind"));
        assert!(message.contains("watermark.json: found format 1 of kind `chemistry`, expected"), "{message}");
    }
}

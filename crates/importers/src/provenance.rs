//! Provenance of imported traces.

use trace::Generator;

/// Program that made an imported trace: the importer with this name, by the hash of its sources.
pub(crate) fn generator(importer: &str, source_sha256: String) -> Generator {
    Generator {
        name: importer.into(),
        version: env!("CARGO_PKG_VERSION").into(),
        mujoco: None,
        git_commit: None,
        source_sha256,
    }
}

//! Names that must be distinct.

use std::collections::BTreeSet;

use anyhow::bail;

/// Checks that names are distinct. `what` names their kind in the message.
pub(crate) fn check_distinct(what: &str, names: impl Iterator<Item = String>) -> anyhow::Result<()> {
    let mut seen = BTreeSet::new();
    for name in names {
        if seen.contains(&name) {
            bail!("{what} `{name}`: found twice, expected each once");
        }
        seen.insert(name);
    }
    Ok(())
}

//! `whisker import`: foreign recordings to traces.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use files::write_atomically;
use importers::{IMPORTERS, importer};
use trace::{Role, Trace};

use super::{FINISHED_WITH_FAILURES, print, table};

/// Convert recordings of other groups into traces
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Format of the recordings (--list)
    #[arg(required_unless_present = "list")]
    format: Option<String>,
    /// Folder with the recordings
    #[arg(required_unless_present = "list")]
    folder: Option<PathBuf>,
    /// Folder for the traces [default: datasets/<format>]
    #[arg(long)]
    out: Option<PathBuf>,
    /// List the formats
    #[arg(long, exclusive = true)]
    list: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (Some(format), Some(folder)) = (&arguments.format, &arguments.folder) else {
        let rows: String = IMPORTERS.iter().map(|row| format!("{:<28} {}\n", row.name, row.about)).collect();
        print(&rows)?;
        return Ok(ExitCode::SUCCESS);
    };
    let row = importer(format).with_context(|| {
        let known: Vec<_> = IMPORTERS.iter().map(|row| row.name).collect();
        format!("unknown format `{format}`, expected one of: {}", known.join(", "))
    })?;
    let imported = (row.import)(folder)?;
    if imported.traces.is_empty() {
        bail!("{}: found no recordings", folder.display());
    }
    let out = arguments.out.clone().unwrap_or_else(|| PathBuf::from("datasets").join(row.name));
    // Outlines first: the sidecars of the traces name them.
    for (file, outline) in &imported.outlines {
        write_atomically(&out.join(file), outline.to_csv().as_bytes())?;
    }
    for trace in &imported.traces {
        trace.write(&out)?;
    }
    print(&format!("{}{}\n", contents(&imported.traces), out.display()))?;
    for failure in &imported.failures {
        eprintln!("error: {failure}");
    }
    Ok(if imported.failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(FINISHED_WITH_FAILURES) })
}

/// Table of the imported traces, one row per whisker and group.
fn contents(traces: &[Trace]) -> String {
    let mut rows: Vec<Vec<String>> = Vec::new();
    let mut of_group: BTreeMap<(&str, Role, &str), Vec<&Trace>> = BTreeMap::new();
    for trace in traces {
        let sidecar = &trace.sidecar;
        of_group.entry((&sidecar.whisker.name, sidecar.role, &sidecar.group)).or_default().push(trace);
    }
    for ((whisker, role, group), members) in of_group {
        let instants: usize = members.iter().map(|trace| trace.sidecar.rows).sum();
        let known = members.iter().flat_map(|trace| &trace.truth.instants).filter(|truth| truth.contact.is_some());
        rows.push(vec![
            whisker.into(),
            group.into(),
            role.name().into(),
            members.len().to_string(),
            instants.to_string(),
            known.count().to_string(),
        ]);
    }
    table::render(&["whisker", "group", "role", "traces", "rows", "known contacts"], &rows, 3)
}

//! `whisker import`: foreign recordings to traces.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::slice;

use anyhow::{Context, bail};
use evaluation::plausibility::{Finding, Subject, spatial_findings};
use files::{Error, StagedFiles, check_replaces_own, read_json, write_atomically};
use importers::{IMPORTERS, Imported, importer};
use serde_json::Value;
use trace::{Outline, Role, Sidecar, SpatialSidecar, SpatialTrace, Trace, is_trace_table};

use super::output::reserve_folder;
use super::progress::Progress;
use super::{FINISHED_WITH_FAILURES, print, table};

/// Convert recordings of real sensors into traces
///
/// `csv` and `bag` read the recordings of any laboratory by a mapping file, which names columns, units and frames
/// (docs/own-data.md). Other traces in the output folder are kept, with a warning.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Format of the recordings (--list)
    #[arg(required_unless_present = "list")]
    format: Option<String>,
    /// Mapping file, or folder with the recordings of a published format
    #[arg(required_unless_present = "list")]
    path: Option<PathBuf>,
    /// Import traces in space instead of planar traces: poses with six degrees of freedom and two bending channels
    #[arg(long)]
    space: bool,
    /// Folder for the traces [default: datasets/<format>, datasets/<format>-space with --space]
    #[arg(long)]
    out: Option<PathBuf>,
    /// List the formats
    #[arg(long, exclusive = true)]
    list: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (Some(format), Some(path)) = (&arguments.format, &arguments.path) else {
        let rows: String = IMPORTERS.iter().map(|row| format!("{:<28} {}\n", row.name, row.about)).collect();
        print(&rows)?;
        return Ok(ExitCode::SUCCESS);
    };
    let row = importer(format).with_context(|| {
        let known: Vec<_> = IMPORTERS.iter().map(|row| row.name).collect();
        format!("unknown format `{format}`, expected one of: {}", known.join(", "))
    })?;
    let (import, default) = match arguments.space {
        false => (row.import, row.name.to_owned()),
        true => (row.import_in_space, format!("{}-space", row.name)),
    };
    let out = arguments.out.clone().unwrap_or_else(|| PathBuf::from("datasets").join(default));
    let _lock = reserve_folder(&out, slice::from_ref(path))?;
    let progress = Progress::of("importing");
    let imported = import(path, &|done, all| {
        progress.set_length(all);
        progress.set_position(done);
    })?;
    drop(progress);
    if imported.traces.is_empty() && imported.spatial_traces.is_empty() {
        print_failures(&imported.failures);
        bail!("{}: found no recordings that can be imported", path.display());
    }
    for Trace { sidecar, .. } in &imported.traces {
        check_replaces_imported(&out, &sidecar.name, &sidecar.generator.name, sidecar.format)?;
    }
    for SpatialTrace { sidecar, .. } in &imported.spatial_traces {
        check_replaces_imported(&out, &sidecar.name, &sidecar.generator.name, sidecar.format)?;
    }
    for (file, _) in &imported.outlines {
        check_replaces_own(&out.join(file), "an outline", |path| Outline::read(path).is_ok())?;
    }
    let planar = imported.traces.iter().map(|trace| &trace.sidecar.name);
    let spatial = imported.spatial_traces.iter().map(|trace| &trace.sidecar.name);
    let names: BTreeSet<String> = planar.chain(spatial).cloned().collect();
    let others = others(&out, &names)?;
    let staged = StagedFiles::create(&out)?;
    write(&imported, staged.folder()).with_context(|| format!("{}: nothing was changed", out.display()))?;
    staged.finish()?;
    print(&format!("{}{}\n", contents(&imported), out.display()))?;
    if !others.is_empty() {
        let (folder, names) = (out.display(), others.join(", "));
        eprintln!(
            "warning: {folder}: also contains traces that this import does not yield, and that are fitted and evaluated with it: {names}"
        );
    }
    for note in &imported.notes {
        eprintln!("note: {note}");
    }
    for warning in &imported.warnings {
        eprintln!("warning: {warning}");
    }
    let planar = imported.traces.iter().map(|trace| (&trace.sidecar.name, Subject::new(trace, None).findings()));
    let spatial = imported.spatial_traces.iter().map(|trace| (&trace.sidecar.name, spatial_findings(trace)));
    print_findings(planar.chain(spatial));
    print_failures(&imported.failures);
    Ok(if imported.failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(FINISHED_WITH_FAILURES) })
}

/// Writes traces and outlines into a folder.
fn write(imported: &Imported, folder: &Path) -> Result<(), Error> {
    for (file, outline) in &imported.outlines {
        write_atomically(&folder.join(file), outline.to_csv().as_bytes())?;
    }
    for trace in &imported.traces {
        trace.write(folder)?;
    }
    for trace in &imported.spatial_traces {
        trace.write(folder)?;
    }
    Ok(())
}

/// Names of the traces in a folder, except for some. A recording that was renamed, removed or is now refused has left its trace
/// there.
///
/// # Errors
/// If the folder cannot be read.
fn others(out: &Path, names: &BTreeSet<String>) -> anyhow::Result<Vec<String>> {
    if !out.exists() {
        return Ok(Vec::new());
    }
    let entries = fs::read_dir(out).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let paths = entries.with_context(|| out.display().to_string())?.into_iter().map(|entry| entry.path());
    let is_sidecar = |path: &PathBuf| {
        path.extension().is_some_and(|extension| extension == "json")
            && read_json::<Value>(path).is_ok_and(|file| file["kind"] == "trace")
    };
    let found = paths.filter(is_sidecar).filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()));
    let mut others: Vec<String> = found.filter(|name| !names.contains(name)).collect();
    others.sort();
    Ok(others)
}

/// Checks that a trace replaces nothing but a trace of the same importer, `generator`, and of the same format.
///
/// # Errors
/// If one of its two files is there and is no such file.
fn check_replaces_imported(out: &Path, name: &str, generator: &str, format: u32) -> Result<(), Error> {
    let path = out.join(format!("{name}.csv"));
    check_replaces_own(&path, "a trace", |path| is_trace_table(path).unwrap_or(false))?;
    let kind = format!("the sidecar of a trace of format {format} that `whisker import {generator}` wrote");
    check_replaces_own(&path.with_extension("json"), &kind, |path| {
        read_json::<Value>(path).is_ok_and(|file| {
            file["kind"] == "trace" && file["format"] == format && file["generator"]["name"] == generator
        })
    })
}

/// Prints the findings of traces. Those of several traces with the same probable cause are one line.
fn print_findings<'a>(findings: impl Iterator<Item = (&'a String, Vec<Finding>)>) {
    let mut causes: Vec<(Finding, Vec<&String>)> = Vec::new();
    for (name, finding) in findings.flat_map(|(name, found)| found.into_iter().map(move |finding| (name, finding))) {
        let is_same =
            |(other, _): &&mut (Finding, _)| (other.place, &other.looks_like) == (finding.place, &finding.looks_like);
        match causes.iter_mut().find(is_same) {
            Some((_, names)) => names.push(name),
            None => causes.push((finding, vec![name])),
        }
    }
    for (finding, names) in causes {
        let (first, others) = names.split_first().expect("a finding has a trace");
        let names: Vec<&str> = others.iter().map(|name| name.as_str()).collect();
        let others = if names.is_empty() { String::new() } else { format!("; likewise {}", names.join(", ")) };
        eprintln!("warning: {first}: {finding}{others}");
    }
}

fn print_failures(failures: &[Error]) {
    for failure in failures {
        eprintln!("error: {failure}");
    }
}

/// Table of the imported traces, one row per whisker and group.
fn contents(imported: &Imported) -> String {
    let planar = imported.traces.iter().map(|trace| {
        let known = trace.truth.instants.iter().filter(|truth| truth.contact.is_some()).count();
        let Sidecar { whisker, group, role, rows, .. } = &trace.sidecar;
        ((&whisker.name, *role, group), *rows, known)
    });
    let spatial = imported.spatial_traces.iter().map(|trace| {
        let known = trace.truth.instants.iter().filter(|truth| truth.contact_m().is_some()).count();
        let SpatialSidecar { whisker, group, role, rows, .. } = &trace.sidecar;
        ((&whisker.name, *role, group), *rows, known)
    });
    let mut of_group: BTreeMap<(&String, Role, &String), [usize; 3]> = BTreeMap::new();
    for (key, rows, known) in planar.chain(spatial) {
        let counts = of_group.entry(key).or_default();
        for (count, added) in counts.iter_mut().zip([1, rows, known]) {
            *count += added;
        }
    }
    let row = |((whisker, role, group), counts): (&(&String, Role, &String), &[usize; 3])| {
        let words = [whisker.as_str(), group.as_str(), role.name()].map(str::to_owned);
        [&words[..], &counts.map(|count| count.to_string())].concat()
    };
    let rows: Vec<Vec<String>> = of_group.iter().map(row).collect();
    table::render(&["whisker", "group", "role", "traces", "rows", "known contacts"], &rows, 3)
}

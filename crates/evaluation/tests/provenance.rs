//! Identities of the code: the declared sources are closed under imports, and edits elsewhere leave the identities unchanged.

#[path = "../source_identity.rs"]
mod source_identity;

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use source_identity::{CALIBRATION, Code, EVALUATION};

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// A path in a source file, or an import.
#[derive(Clone, Debug, PartialEq)]
struct Import {
    segments: Vec<String>,
    /// Name under which a re-export makes it available. `None` if it is private or an inline path.
    exported: Option<String>,
}

/// A source file without comments, literals and unit tests.
fn code(text: &str) -> String {
    let text = text.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let bytes = text.as_bytes();
    let mut code = String::new();
    let mut at = 0;
    while at < bytes.len() {
        let rest = &text[at..];
        let raw = ["r\"", "br\"", "r#\"", "br#\""].iter().find(|start| rest.starts_with(**start));
        let follows_word = code.ends_with(|last: char| last.is_alphanumeric() || last == '_');
        if rest.starts_with("//") {
            at += rest.find('\n').unwrap_or(rest.len());
        } else if let Some(start) = raw.filter(|_| !follows_word) {
            let end = if start.contains('#') { "\"#" } else { "\"" };
            at += start.len() + rest[start.len()..].find(end).expect("a raw string ends") + end.len();
        } else if rest.starts_with('"') {
            let mut end = 1;
            while bytes[at + end] != b'"' {
                end += if bytes[at + end] == b'\\' { 2 } else { 1 };
            }
            at += end + 1;
        } else if rest.starts_with("'\"'") || rest.starts_with("'\\''") || rest.starts_with("'\\\"'") {
            at += rest[1..].find("'").unwrap() + 2 + usize::from(rest.starts_with("'\\''"));
        } else {
            let next = rest.chars().next().unwrap();
            code.push(next);
            at += next.len_utf8();
        }
    }
    code
}

/// The paths of a use tree, below a prefix.
fn expand(prefix: &[String], tree: &str, is_exported: bool, imports: &mut Vec<Import>) {
    let tree = tree.trim();
    if let Some((head, group)) = tree.split_once('{') {
        let group = group.trim_end().strip_suffix('}').expect("a group of imports ends");
        let mut below = prefix.to_vec();
        below.extend(head.split("::").map(str::trim).filter(|segment| !segment.is_empty()).map(str::to_owned));
        let (mut depth, mut start) = (0, 0);
        for (at, letter) in group.char_indices().chain([(group.len(), ',')]) {
            match letter {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    if !group[start..at].trim().is_empty() {
                        expand(&below, &group[start..at], is_exported, imports);
                    }
                    start = at + 1;
                }
                _ => {}
            }
        }
        return;
    }
    let (path, alias) = tree.split_once(" as ").map_or((tree, None), |(path, alias)| (path, Some(alias.trim())));
    let mut segments = prefix.to_vec();
    segments.extend(path.split("::").map(|segment| segment.trim().to_owned()).filter(|segment| !segment.is_empty()));
    if segments.last().is_some_and(|last| last == "self") {
        segments.pop();
    }
    let name = alias.map(str::to_owned).or_else(|| segments.last().cloned());
    imports.push(Import { exported: name.filter(|_| is_exported), segments });
}

/// The imports and inline paths of a file, and the modules that it declares.
fn imports(text: &str) -> (Vec<Import>, Vec<String>) {
    let code = code(text);
    let (mut imports, mut modules) = (Vec::new(), Vec::new());
    let mut inline = String::new();
    let mut lines = code.as_str();
    while let Some(at) = lines.find("use ") {
        let (before, from) = lines.split_at(at);
        let starts_statement = before.trim_end_matches([' ', '\t']).is_empty()
            || before.ends_with('\n')
            || before.trim_end().ends_with([';', '{', '}'])
            || before.ends_with("pub ")
            || before.ends_with(") ");
        inline.push_str(before);
        if !starts_statement {
            inline.push_str("use ");
            lines = &from[4..];
            continue;
        }
        let end = from.find(';').expect("an import ends");
        let is_exported = before.ends_with("pub ") || (before.ends_with(") ") && before.contains("pub("));
        expand(&[], &from[4..end], is_exported, &mut imports);
        lines = &from[end + 1..];
    }
    inline.push_str(lines);
    for line in inline.lines() {
        let declared = line.trim().trim_start_matches("pub(crate) ").trim_start_matches("pub(super) ");
        let declared = declared.trim_start_matches("pub ").strip_prefix("mod ");
        modules.extend(declared.and_then(|name| name.strip_suffix(';')).map(str::to_owned));
    }
    let is_word = |letter: char| letter.is_alphanumeric() || letter == '_' || letter == ':';
    for word in inline.split(|letter| !is_word(letter)).filter(|word| word.contains("::")) {
        let segments = word.split("::").filter(|segment| !segment.is_empty()).map(str::to_owned).collect();
        imports.push(Import { segments, exported: None });
    }
    (imports, modules)
}

/// Module tree of the crates of a workspace, by their files.
struct Sources {
    root: PathBuf,
    crates: BTreeSet<String>,
    /// Imports and modules of the files that were parsed.
    parsed: RefCell<BTreeMap<String, Rc<Parsed>>>,
}

/// Imports and declared modules of a file.
type Parsed = (Vec<Import>, Vec<String>);

/// A module: its crate, and its path in it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Module {
    package: String,
    path: Vec<String>,
}

impl Sources {
    fn new() -> Self {
        let root = workspace();
        let entries = fs::read_dir(root.join("crates")).unwrap().map(|entry| entry.unwrap().path());
        let crates = entries.map(|path| path.file_name().unwrap().to_string_lossy().into_owned()).collect();
        Self { root, crates, parsed: RefCell::default() }
    }

    fn parsed(&self, file: &str) -> Rc<Parsed> {
        let mut parsed = self.parsed.borrow_mut();
        let parse = || Rc::new(imports(&fs::read_to_string(self.root.join(file)).unwrap()));
        parsed.entry(file.to_owned()).or_insert_with(parse).clone()
    }

    fn module_of(file: &str) -> Module {
        let mut parts: Vec<String> = file.split('/').map(str::to_owned).collect();
        let last = parts.pop().unwrap();
        let stem = last.trim_end_matches(".rs");
        if !matches!(stem, "mod" | "lib") {
            parts.push(stem.into());
        }
        Module { package: parts[1].clone(), path: parts[3..].to_vec() }
    }

    /// File of a module.
    fn file(&self, module: &Module) -> Option<String> {
        let source = format!("crates/{}/src", module.package);
        let below = module.path.join("/");
        let candidates = match module.path.is_empty() {
            true => vec![format!("{source}/lib.rs")],
            false => vec![format!("{source}/{below}.rs"), format!("{source}/{below}/mod.rs")],
        };
        candidates.into_iter().find(|file| self.root.join(file).is_file())
    }

    /// File that defines the item of a path used in a module. `None` if it lies outside the workspace, or in the module itself.
    fn resolve(&self, from: &Module, segments: &[String], depth: usize) -> Option<String> {
        let (first, rest) = segments.split_first()?;
        let child = |module: &Module, name: &String| {
            let path = module.path.iter().chain([name]).cloned().collect();
            Some(Module { package: module.package.clone(), path }).filter(|module| self.file(module).is_some())
        };
        let package = first.replace('_', "-");
        let (mut module, mut rest) = match first.as_str() {
            "crate" => (Module { path: Vec::new(), ..from.clone() }, rest),
            "self" => (from.clone(), rest),
            "super" => {
                let path = from.path[..from.path.len().checked_sub(1)?].to_vec();
                (Module { path, ..from.clone() }, rest)
            }
            _ if child(from, first).is_some() => (from.clone(), segments),
            _ if self.crates.contains(&package) => (Module { package, path: Vec::new() }, rest),
            _ => return None,
        };
        while let Some((next, after)) = rest.split_first() {
            if next == "super" {
                module.path.pop();
            } else if let Some(inner) = child(&module, next) {
                module = inner;
            } else {
                break;
            }
            rest = after;
        }
        let file = self.file(&module)?;
        let Some((item, after)) = rest.split_first() else { return Some(file) };
        for import in self.parsed(&file).0.iter().filter(|_| depth < 8) {
            if import.exported.as_ref() == Some(item) {
                let target: Vec<String> = import.segments.iter().chain(after).cloned().collect();
                if let Some(found) = self.resolve(&module, &target, depth + 1) {
                    return Some(found);
                }
            }
        }
        Some(self.macro_file(&module, item).unwrap_or(file))
    }

    /// File that defines an exported macro, which appears in the root of its crate.
    fn macro_file(&self, module: &Module, name: &str) -> Option<String> {
        let folder = format!("crates/{}/src", module.package);
        let files = fs::read_dir(self.root.join(&folder)).unwrap().map(|entry| entry.unwrap().path());
        let defines = |path: &PathBuf| {
            path.is_file() && fs::read_to_string(path).unwrap().contains(&format!("macro_rules! {name} "))
        };
        let file = files.filter(|_| module.path.is_empty()).find(defines)?;
        Some(format!("{folder}/{}", file.file_name()?.to_str()?))
    }
}

/// Files that listed files lead to and that are not listed, each with the file that leads there.
fn missing(code: &Code) -> BTreeMap<String, String> {
    let sources = Sources::new();
    let files: BTreeSet<String> = code.files(&sources.root).into_iter().collect();
    let mut missing = BTreeMap::new();
    for file in files.iter().filter(|file| file.ends_with(".rs")) {
        let module = Sources::module_of(file);
        let (imports, modules) = sources.parsed(file).as_ref().clone();
        // The modules and re-exports of a crate root count for the files that use them.
        let is_root = file.ends_with("/src/lib.rs");
        let declared = modules.into_iter().filter(|_| !is_root).map(|name| vec!["self".to_owned(), name]);
        let used = imports.into_iter().filter(|import| !is_root || import.exported.is_none());
        let paths = used.map(|import| import.segments).chain(declared);
        for path in paths {
            let found = sources.resolve(&module, &path, 0);
            if let Some(found) = found.filter(|found| !files.contains(found)) {
                missing.insert(found, format!("{file}: {}", path.join("::")));
            }
        }
    }
    missing
}

#[test]
fn verif_the_sources_of_calibrations_are_closed_under_imports() {
    assert_eq!(missing(&CALIBRATION), BTreeMap::new());
}

#[test]
fn verif_the_sources_of_evaluations_are_closed_under_imports() {
    assert_eq!(missing(&EVALUATION), BTreeMap::new());
}

#[test]
fn verif_imports_are_found_in_groups_inline_and_behind_re_exports() {
    let text = "use crate::a::{self, b::{C, D as E}};\npub use super::f;\n// use crate::g;\nfn h() { crate::i::j(\"use crate::k;\") }\nmod l;\n";
    let (found, modules) = imports(text);
    let paths: Vec<String> = found.iter().map(|import| import.segments.join("::")).collect();
    assert_eq!(paths, ["crate::a", "crate::a::b::C", "crate::a::b::D", "super::f", "crate::i::j"]);
    assert_eq!((found[3].exported.as_deref(), modules), (Some("f"), vec!["l".to_owned()]));
}

/// Files of a workspace that the identities may depend on, in a folder of their own.
fn copy(to: &Path) {
    fn all(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let is_source = path.extension().is_some_and(|extension| extension == "rs" || extension == "toml");
            if path.is_dir() {
                all(&path, files);
            } else if is_source {
                files.push(path);
            }
        }
    }
    let root = workspace();
    let mut files = vec![root.join("Cargo.lock"), root.join("README.md")];
    all(&root.join("crates"), &mut files);
    for file in files {
        let target = to.join(file.strip_prefix(&root).unwrap());
        fs::create_dir_all(target.parent().unwrap()).unwrap();
        fs::copy(&file, target).unwrap();
    }
}

#[test]
fn verif_an_identity_changes_with_the_code_that_determines_the_result_and_with_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    copy(root);
    let identities = || (CALIBRATION.sha256(root), EVALUATION.sha256(root));
    let before = identities();
    let changed_by = |file: &str, from: &str, to: &str| {
        let path = root.join(file);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{file}: found no `{from}`");
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let after = identities();
        fs::write(&path, text).unwrap();
        (after.0 != before.0, after.1 != before.1)
    };
    // Caption of a figure, driver of the platform, claim, test, README, unrelated package.
    let unrelated = [
        ("crates/report/src/figures/mod.rs", "caption: \"", "caption: \"Changed. "),
        ("crates/platform/src/lib.rs", "//!", "//! Changed."),
        ("crates/whisker-cli/src/claims/pins.rs", "//!", "//! Changed."),
        ("crates/evaluation/tests/evaluate.rs", "//!", "//! Changed."),
        ("README.md", "#", "# Changed"),
        ("Cargo.lock", "name = \"clap\"\nversion = \"", "name = \"clap\"\nversion = \"9"),
    ];
    for (file, from, to) in unrelated {
        assert_eq!(changed_by(file, from, to), (false, false), "{file}");
    }
    let of_estimates = ["crates/whisker/src/estimators/mod.rs", "crates/filters/src/unscented.rs"];
    for file in of_estimates {
        assert_eq!(changed_by(file, "//!", "//! Changed."), (false, true), "{file}");
    }
    for file in ["crates/whisker/src/elastica/mod.rs", "crates/trace/src/table.rs"] {
        assert_eq!(changed_by(file, "//!", "//! Changed."), (true, true), "{file}");
    }
    let locked = changed_by("Cargo.lock", "name = \"nalgebra\"\nversion = \"", "name = \"nalgebra\"\nversion = \"9");
    assert_eq!(locked, (true, true), "Cargo.lock: nalgebra");
    assert_eq!(identities(), before);
}

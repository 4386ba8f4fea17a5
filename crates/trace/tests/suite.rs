//! Names of a suite's traces agree with those of the generator.

use std::fs;
use std::path::PathBuf;

use trace::Suite;

/// Suite in a temporary folder with a scene called `scene`.
fn suite(entries: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.json"), r#"{"format": 1, "name": "scene", "motion": {}}"#).unwrap();
    let path = folder.path().join("suite.json");
    fs::write(&path, format!(r#"{{"format": 1, "name": "suite", "scenes": [{entries}]}}"#)).unwrap();
    (folder, path)
}

fn names(entries: &str) -> Vec<String> {
    let (_folder, path) = suite(entries);
    Suite::read(&path).unwrap().names(&path).unwrap()
}

#[test]
fn verif_trace_names_contain_the_seeds() {
    assert_eq!(names(r#"{"scene": "scene.json"}"#), ["scene"]);
    assert_eq!(names(r#"{"scene": "scene.json", "seeds": [3]}"#), ["scene_03"]);
    assert_eq!(names(r#"{"scene": "scene.json", "seeds": [0, 112]}"#), ["scene_00", "scene_112"]);
}

#[test]
fn robust_invalid_suites_are_rejected_with_their_place() {
    for (entries, words) in [
        (r#"{"scene": "scene.json", "seeds": []}"#, "at least one seed"),
        (r#"{"scene": "scene.json", "sedes": [1]}"#, "unknown field `sedes`"),
        (r#"{"scene": "scene.json", "seeds": [-1]}"#, "suite.json:1:"),
        (r#"{"scene": "other.json"}"#, "other.json"),
    ] {
        let (_folder, path) = suite(entries);
        let error = Suite::read(&path).and_then(|suite| suite.names(&path)).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

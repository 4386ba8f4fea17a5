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
    Suite::read(&path).unwrap().runs(&path).unwrap().into_iter().map(|run| run.name).collect()
}

#[test]
fn verif_trace_names_contain_the_seeds() {
    assert_eq!(names(r#"{"scene": "scene.json"}"#), ["scene"]);
    assert_eq!(names(r#"{"scene": "scene.json", "seeds": [3]}"#), ["scene_03"]);
    assert_eq!(names(r#"{"scene": "scene.json", "seeds": [0, 112]}"#), ["scene_00", "scene_112"]);
}

#[test]
fn verif_a_random_suite_states_its_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("suite.json");
    let read = |text: &str| {
        fs::write(&path, format!(r#"{{"format": 1, "name": "suite", {text}}}"#)).unwrap();
        Suite::read(&path)
    };
    let suite = read(r#""random": {"seed": 3, "sets": 20}"#).unwrap();
    assert_eq!(suite.random.map(|random| (random.seed, random.sets, random.traces())), Some((3, 20, 5)));
    assert!(suite.scenes.is_empty() && suite.runs(&path).unwrap().is_empty());
    for (text, words) in [
        (r#""random": {"seed": 3, "sets": 0}"#, "random.sets"),
        (r#""random": {"seed": 3, "sets": 2, "traces": 100}"#, "1 to 99"),
        (r#""random": {"seed": 3, "set": 2}"#, "unknown field `set`"),
        (r#""random": {"seed": 3, "sets": 2, "in_space": true, "ideal": false}"#, "random.ideal"),
        (r#""random": {"seed": 3, "sets": 2}, "scenes": [{"scene": "scene.json"}]"#, "one of the two"),
        (r#""scenes": []"#, "at least one, or the key `random`"),
    ] {
        let error = read(text).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
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
        let error = Suite::read(&path).and_then(|suite| suite.runs(&path)).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

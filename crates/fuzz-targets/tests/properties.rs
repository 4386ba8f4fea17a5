//! Property-based tests with generated input.

use std::collections::BTreeMap;
use std::path::{Component, Path};

use fuzz_targets::{TARGETS, is_decimal, one_error};
use proptest::prelude::*;
use serde_json::{Value, json};
use strict_json::{one_line, parse_json};
use testbed::results::{FailureRow, csv_bytes, read_rows};
use trace::{COLUMNS, is_plain_name};

fn run(target: &str, bytes: &[u8]) {
    (TARGETS.iter().find(|row| row.name == target).expect("a target").run)(bytes);
}

/// Text that is a number or nearly one.
fn nearly_a_number() -> impl Strategy<Value = String> {
    prop_oneof![
        "[-+]?[0-9]{0,4}[.]?[0-9]{0,4}([eE][-+]?[0-9]{0,3})?",
        "[-+]?(inf|infinity|nan|NaN|0x[0-9a-f]{1,4}(p[0-9])?|1_000|[٠-٩]{1,3}|[０-９]{1,3}|1,5|1 |\t1|\u{feff}1|1f64|\"1\"|1\"5)",
        any::<f64>().prop_map(|value| value.to_string()),
        "\\PC{0,8}",
    ]
}

/// Nested JSON.
fn value() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        any::<f64>().prop_map(Value::from),
        "\\PC{0,6}".prop_map(Value::from),
    ];
    leaf.prop_recursive(4, 32, 4, |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..4).prop_map(Value::from),
            prop::collection::btree_map("[a-z]{1,3}", inner, 0..4).prop_map(|map| json!(map)),
        ]
    })
}

proptest! {
    /// A cell is parsed as its exact decimal value or rejected with file, line and column.
    #[test]
    fn robust_a_cell_is_a_number_or_refused(cell in nearly_a_number(), column in 0..COLUMNS.len()) {
        let names = COLUMNS.map(|(name, _)| name).join(",");
        let mut cells: Vec<&str> = vec!["0"; 9];
        cells.resize(COLUMNS.len(), "");
        cells[column] = &cell;
        // The target compares every value with the text of its cell.
        run("trace", format!("{names}\n{}\n", cells.join(",")).as_bytes());
        let is_word = cell.bytes().any(|byte| byte.is_ascii_alphabetic() && !matches!(byte, b'e' | b'E'));
        prop_assert_eq!(is_decimal(&cell), cell.parse::<f64>().is_ok() && !is_word);
    }

    /// Tables of a run preserve arbitrary text.
    #[test]
    fn verif_tables_preserve_arbitrary_text(
        words in prop::collection::vec(
            ("(?s).{0,12}|nan|inf|-infinity|1e999|\"|,|\"\"\"|\r\n", prop::option::of("(?s).{1,8}|nan")),
            0..6,
        )
    ) {
        let rows: Vec<FailureRow> = words
            .into_iter()
            .map(|(reason, estimator)| FailureRow { trace: reason.clone(), estimator, noise: 0.01, seed: u64::MAX, reason })
            .collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("failures.csv");
        std::fs::write(&path, csv_bytes(&rows).unwrap()).unwrap();
        prop_assert_eq!(read_rows::<FailureRow>(&path).unwrap(), rows);
    }

    /// JSON is accepted unless an object at any depth has a duplicate key.
    #[test]
    fn robust_json_with_duplicate_keys_is_rejected(inner in value(), depth in 0..5, key in "[a-z]{1,3}") {
        let around = |text: String, level: i32| match level % 2 {
            0 => format!("[1, {text}]"),
            _ => format!("{{\"a\": {text}}}"),
        };
        let sound = (0..depth).fold(inner.to_string(), around);
        prop_assert!(parse_json::<Value>(sound.as_bytes()).is_ok());
        let twice = (0..depth).fold(format!("{{\"{key}\": 1, \"{key}\": {inner}}}"), around);
        let error = parse_json::<Value>(twice.as_bytes()).unwrap_err().to_string();
        prop_assert!(error.contains(&format!("the key `{key}` again")) && error.contains("line 1 column"), "{}", error);
    }

    /// A plain name is a single path component without control characters.
    #[test]
    fn robust_a_plain_name_stays_in_its_folder(name in "(?s).{0,12}|\\.{1,3}|(\\.\\./){1,3}x|/etc/x|a\\\\b|a\u{0}b|a\nb") {
        if is_plain_name(&name) {
            let path = Path::new("folder").join(&name);
            let expected = ["folder", &name].map(|part| Component::Normal(part.as_ref()));
            prop_assert_eq!(path.components().collect::<Vec<_>>(), expected);
            prop_assert_eq!(one_line(&name), name);
        }
    }

    /// A program's answer is an estimate, `null` or an error.
    #[test]
    fn robust_answers_are_parsed_exactly_or_rejected(
        keys in prop::collection::btree_map(
            "contact_x_m|contact_y_m|cov_xx_m2|cov_xy_m2|cov_yy_m2|innovation_n_m|innovation_variance_n2_m2|truth",
            nearly_a_number(),
            0..6,
        )
    ) {
        let keys: BTreeMap<String, String> = keys;
        let text = keys.iter().map(|(key, number)| format!("\"{key}\": {number}")).collect::<Vec<_>>().join(", ");
        run("answer", format!("{{{text}}}\n").as_bytes());
    }

    /// Arbitrary bytes.
    #[test]
    fn robust_any_bytes_are_parsed_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200), target in 0..TARGETS.len()) {
        (TARGETS[target].run)(&bytes);
    }

    /// Arbitrary text becomes one line.
    #[test]
    fn verif_one_line_is_one(text in "(?s).{0,40}") {
        prop_assert!(!one_line(&text).contains(char::is_control));
        one_error(Err::<(), _>(files::Error::value(Path::new("file.json"), &text, &text, "something else")), "file.json");
    }
}

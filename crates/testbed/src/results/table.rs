//! Tables of rows as CSV: writing and reading with the columns of the row type.

use std::fs;
use std::io::Write;
use std::marker::PhantomData;
use std::path::Path;

use anyhow::{Context, anyhow, bail, ensure};
use csv::{DeserializeErrorKind, ErrorKind, IntoInnerError, ReaderBuilder, StringRecord, Writer, WriterBuilder};
use files::AtomicFile;
use serde::de::{DeserializeOwned, Error as _, Visitor, value};
use serde::{Deserializer, Serialize, forward_to_deserialize_any};
use strict_json::shown;

/// Rows as the bytes of a CSV. The header is written even without rows.
///
/// # Errors
/// If a row does not serialise.
pub fn csv_bytes<Row: Serialize + DeserializeOwned>(rows: &[Row]) -> anyhow::Result<Vec<u8>> {
    table_bytes(columns::<Row>(), rows.iter())
}

/// Writes a table row by row, so that its size does not matter. The file appears when it is complete.
///
/// # Errors
/// If it cannot be written.
pub fn write_rows<Row: Serialize + DeserializeOwned>(
    path: &Path,
    rows: impl IntoIterator<Item = Row>,
) -> anyhow::Result<()> {
    let mut table = TableFile::<Row>::new(AtomicFile::create(path)?)?;
    rows.into_iter().try_for_each(|row| table.push(&row)).with_context(|| path.display().to_string())?;
    Ok(table.finish()?.finish()?)
}

pub(super) fn table_bytes(columns: &[&str], rows: impl Iterator<Item: Serialize>) -> anyhow::Result<Vec<u8>> {
    let mut writer = WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    writer.write_record(columns)?;
    for row in rows {
        writer.serialize(row)?;
    }
    Ok(writer.into_inner()?)
}

/// Writer of a table row by row, with the bytes of [`csv_bytes`] or [`super::score_bytes`].
pub struct Table<Row, To: Write> {
    pub(super) writer: Writer<To>,
    rows: PhantomData<Row>,
}

/// Writer of a table into a file, which appears when it is finished.
pub type TableFile<Row> = Table<Row, AtomicFile>;

impl<Row: Serialize + DeserializeOwned, To: Write> Table<Row, To> {
    /// Starts a table with the columns of `Row`.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn new(to: To) -> anyhow::Result<Self> {
        Self::with_columns(to, columns::<Row>())
    }

    /// Appends a row.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn push(&mut self, row: &Row) -> anyhow::Result<()> {
        self.writer.serialize(row).map_err(refusal)
    }
}

impl<Row, To: Write> Table<Row, To> {
    pub(super) fn with_columns(to: To, columns: &[&str]) -> anyhow::Result<Self> {
        let mut writer = WriterBuilder::new().has_headers(false).from_writer(to);
        writer.write_record(columns).map_err(refusal)?;
        Ok(Self { writer, rows: PhantomData })
    }

    /// Finishes the table and returns its destination.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> anyhow::Result<To> {
        Ok(self.writer.into_inner().map_err(IntoInnerError::into_error)?)
    }
}

/// Reason for a failed write: the error of the operating system if there is one.
pub(super) fn refusal(error: csv::Error) -> anyhow::Error {
    match error.into_kind() {
        ErrorKind::Io(error) => error.into(),
        other => anyhow::anyhow!("{other:?}"),
    }
}

/// Reads a table whose columns are the fields of `T`.
///
/// # Errors
/// If the file cannot be read or is damaged. The error names file, line and column, and both the value found and the one expected.
pub fn read_rows<T: DeserializeOwned>(path: &Path) -> anyhow::Result<Vec<T>> {
    let rows = read_table(path, parse_row)?;
    // Without rows, no row has compared the columns.
    if rows.is_empty() {
        check_columns::<T>(path)?;
    }
    Ok(rows)
}

/// Checks that the columns of a table are the fields of `T`.
fn check_columns<T: DeserializeOwned>(path: &Path) -> anyhow::Result<()> {
    let (found, expected) = (ReaderBuilder::new().from_path(path)?.headers()?.clone(), columns::<T>());
    let named = |names: Vec<&str>| {
        if names.is_empty() { "no columns".into() } else { format!("`{}`", shown(&names.join(","))) }
    };
    ensure!(
        found.iter().eq(expected.iter().copied()),
        "{}:1: found {}, expected {}",
        path.display(),
        named(found.iter().collect()),
        named(expected.to_vec())
    );
    Ok(())
}

pub(super) fn read_table<T>(
    path: &Path,
    parse: impl Fn(&StringRecord, &StringRecord) -> Result<T, String>,
) -> anyhow::Result<Vec<T>> {
    let at = path.display();
    let bytes = fs::read(path).with_context(|| format!("{at}: cannot be read"))?;
    if let Some(line) = stray_quote(&bytes) {
        bail!("{at}:{line}: found more after the quote that ends a field, expected a comma or the end of the line");
    }
    let mut reader = ReaderBuilder::new().from_reader(bytes.as_slice());
    let header = reader.headers().map_err(|error| anyhow!("{at}:{}", damage(&error)))?.clone();
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| anyhow!("{at}:{}", damage(&error)))?;
        let line = record.position().map_or(0, csv::Position::line);
        for (place, (column, field)) in header.iter().zip(&record).enumerate() {
            if field.parse::<f64>().is_ok_and(|value| !value.is_finite())
                && !accepts_text(place, &record, &header, &parse)
            {
                bail!("{at}:{line}: column `{}`: found {field}, expected a finite number", shown(column));
            }
        }
        rows.push(parse(&record, &header).map_err(|problem| anyhow!("{at}:{line}: {}", shown(&problem)))?);
    }
    Ok(rows)
}

/// Line of a record that the CSV parser rejects, what was found there and what was expected.
fn damage(error: &csv::Error) -> String {
    let line = error.position().map_or(1, csv::Position::line);
    match error.kind() {
        ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{line}: found {len} fields, expected {expected_len}, as in the header")
        }
        ErrorKind::Utf8 { err, .. } => {
            format!("{line}: column {}: found bytes that are not UTF-8, expected UTF-8 text", err.field() + 1)
        }
        _ => format!("{line}: {error}"),
    }
}

/// Line of the first quoted field with characters after its closing quote. The CSV parser would append them to the
/// field and read `"1"5` as 15.
fn stray_quote(bytes: &[u8]) -> Option<u64> {
    let mut line = 1;
    let mut is_quoted = false;
    let mut last = b'\n';
    for (i, &byte) in bytes.iter().enumerate() {
        let next = bytes.get(i + 1).copied().unwrap_or(b'\n');
        match byte {
            // A pair of quotes within a quoted field encodes one quote: it closes and reopens the field.
            b'"' if is_quoted => {
                is_quoted = false;
                if !matches!(next, b'"' | b',' | b'\r' | b'\n') {
                    return Some(line);
                }
            }
            b'"' => is_quoted = matches!(last, b'"' | b',' | b'\r' | b'\n'),
            b'\n' => line += 1,
            _ => {}
        }
        last = byte;
    }
    None
}

/// Whether a column holds text, which may be `nan` or `inf`: the row then parses with any other text in that column.
fn accepts_text<T>(
    place: usize,
    record: &StringRecord,
    header: &StringRecord,
    parse: impl Fn(&StringRecord, &StringRecord) -> Result<T, String>,
) -> bool {
    let other: StringRecord =
        record.iter().enumerate().map(|(i, field)| if i == place { "text" } else { field }).collect();
    parse(&other, header).is_ok()
}

/// Parses a row. The error names the column and the value found.
pub(super) fn parse_row<T: DeserializeOwned>(record: &StringRecord, header: &StringRecord) -> Result<T, String> {
    record.deserialize(Some(header)).map_err(|error| {
        let ErrorKind::Deserialize { err, .. } = error.kind() else {
            return error.to_string();
        };
        let expected = match err.kind() {
            DeserializeErrorKind::ParseBool(_) => "true or false".into(),
            DeserializeErrorKind::ParseInt(_) => "a whole number".into(),
            DeserializeErrorKind::ParseFloat(_) => "a number".into(),
            other => format!("another value: {other}"),
        };
        match err.field().and_then(|field| usize::try_from(field).ok()) {
            Some(field) => format!(
                "column `{}`: found `{}`, expected {expected}",
                header.get(field).unwrap_or_default(),
                record.get(field).unwrap_or_default(),
            ),
            None => format!("{}, expected the columns {}", err.kind(), columns::<T>().join(", ")),
        }
    })
}

/// Names of the fields of a struct in their order, as it requests them from a deserializer.
pub(super) fn columns<T: DeserializeOwned>() -> &'static [&'static str] {
    let mut names: &'static [&'static str] = &[];
    // The deserializer provides no values, so this always ends with an error.
    _ = T::deserialize(FieldNames(&mut names));
    names
}

/// Deserializer without values that records the field names requested from it.
struct FieldNames<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for FieldNames<'_> {
    type Error = value::Error;

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        names: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, value::Error> {
        *self.0 = names;
        self.deserialize_any(visitor)
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, value::Error> {
        Err(value::Error::custom("no values"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Row {
        name: String,
        count: u64,
        share: Option<f64>,
        is_good: bool,
    }

    #[test]
    fn robust_a_damaged_table_is_reported_with_line_column_found_and_expected() {
        const HEADER: &[u8] = b"name,count,share,is_good\n";
        let file = tempfile::NamedTempFile::new().unwrap();
        let cases: [(&[u8], &str); 7] = [
            (b"a,1,0.5,true\nb,2,0.5\n", ":3: found 3 fields, expected 4, as in the header"),
            (b"a,1,0.5,true,\n", ":2: found 5 fields, expected 4, as in the header"),
            (b"a,1,0.5,true\n\xff,2,0.5,true\n", ":3: column 1: found bytes that are not UTF-8, expected UTF-8 text"),
            (b"a,1.5,0.5,true\n", ":2: column `count`: found `1.5`, expected a whole number"),
            (b"a,1,half,true\n", ":2: column `share`: found `half`, expected a number"),
            (b"a,1,,yes\n", ":2: column `is_good`: found `yes`, expected true or false"),
            (b"a,1,nan,true\n", ":2: column `share`: found nan, expected a finite number"),
        ];
        for (rows, expected) in cases {
            fs::write(file.path(), [HEADER, rows].concat()).unwrap();
            let message = format!("{:#}", read_rows::<Row>(file.path()).expect_err(expected));
            assert!(message.ends_with(expected), "{message}");
        }
        fs::write(file.path(), "name,count\na,1\n").unwrap();
        let message = format!("{:#}", read_rows::<Row>(file.path()).unwrap_err());
        assert!(message.ends_with(":2: missing field `is_good`, expected the columns name, count, share, is_good"));
    }
}

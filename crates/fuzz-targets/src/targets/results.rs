//! Tables of a run: every row type is tried, and the header selects those that fit.

use std::fmt::Debug;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use testbed::results::{
    BoundRow, ConsistencyRow, ContourScoreRow, ContourTrialRow, ErrorBandRow, EstimateRow, EventRow, FailureRow,
    GridRow, MapObjectRow, MapPointRow, MapRow, MapVertexRow, QuantityRow, ResidualRow, SummaryHead, SurfaceRow,
    TransferRow, TrialHead, TurnRow, VertexRow, csv_bytes, read_rows, read_scores, score_bytes,
};

use crate::properties::one_error;
use crate::scratch;

const FILE: &str = "untrusted_table.csv";

/// Copy written from the parsed rows.
const AGAIN: &str = "table_again.csv";

pub(super) fn run(bytes: &[u8]) {
    let path = scratch::file(FILE, bytes);
    rows::<BoundRow>(&path);
    rows::<ConsistencyRow>(&path);
    rows::<ContourScoreRow>(&path);
    rows::<ContourTrialRow>(&path);
    rows::<ErrorBandRow>(&path);
    rows::<EstimateRow>(&path);
    rows::<EventRow>(&path);
    rows::<FailureRow>(&path);
    rows::<GridRow>(&path);
    rows::<MapObjectRow>(&path);
    rows::<MapPointRow>(&path);
    rows::<MapRow>(&path);
    rows::<MapVertexRow>(&path);
    rows::<QuantityRow>(&path);
    rows::<ResidualRow>(&path);
    rows::<SurfaceRow>(&path);
    rows::<TransferRow>(&path);
    rows::<TurnRow>(&path);
    rows::<VertexRow>(&path);
    scores::<SummaryHead>(&path);
    scores::<TrialHead>(&path);
}

fn rows<T: Serialize + DeserializeOwned + PartialEq + Debug>(path: &Path) {
    let Some(rows) = one_error(read_rows::<T>(path), FILE) else { return };
    let again = scratch::file(AGAIN, csv_bytes(&rows).expect("it serialises"));
    assert_eq!(read_rows::<T>(&again).expect("written data can be read"), rows);
}

fn scores<Head: Serialize + DeserializeOwned + PartialEq + Debug>(path: &Path) {
    let Some(rows) = one_error(read_scores::<Head>(path), FILE) else { return };
    let again = scratch::file(AGAIN, score_bytes(&rows).expect("it serialises"));
    assert_eq!(read_scores::<Head>(&again).expect("written data can be read"), rows);
}

//! The tables of a run: whichever the header fits.

use std::fmt::Debug;

use serde::Serialize;
use serde::de::DeserializeOwned;
use testbed::results::{
    BoundRow, ConsistencyRow, ContourScoreRow, ContourTrialRow, ErrorBandRow, EstimateRow, EventRow, FailureRow,
    GridRow, MapObjectRow, MapPointRow, MapRow, MapVertexRow, ResidualRow, SummaryHead, SurfaceRow, TransferRow,
    TrialHead, TurnRow, VertexRow, csv_bytes, read_rows, read_scores, score_bytes,
};

use crate::claims::one_error;
use crate::scratch;

const FILE: &str = "strange_table.csv";

pub(super) fn run(bytes: &[u8]) {
    rows::<BoundRow>(bytes);
    rows::<ConsistencyRow>(bytes);
    rows::<ContourScoreRow>(bytes);
    rows::<ContourTrialRow>(bytes);
    rows::<ErrorBandRow>(bytes);
    rows::<EstimateRow>(bytes);
    rows::<EventRow>(bytes);
    rows::<FailureRow>(bytes);
    rows::<GridRow>(bytes);
    rows::<MapObjectRow>(bytes);
    rows::<MapPointRow>(bytes);
    rows::<MapRow>(bytes);
    rows::<MapVertexRow>(bytes);
    rows::<ResidualRow>(bytes);
    rows::<SurfaceRow>(bytes);
    rows::<TransferRow>(bytes);
    rows::<TurnRow>(bytes);
    rows::<VertexRow>(bytes);
    scores::<SummaryHead>(bytes);
    scores::<TrialHead>(bytes);
}

fn rows<T: Serialize + DeserializeOwned + PartialEq + Debug>(bytes: &[u8]) {
    let read = |bytes: &[u8]| one_error(read_rows::<T>(&scratch::file(FILE, bytes)), FILE);
    let Some(rows) = read(bytes) else { return };
    let text = csv_bytes(&rows).expect("it serialises");
    assert_eq!(read(&text).expect("what is written can be read"), rows);
}

fn scores<Head: Serialize + DeserializeOwned + PartialEq + Debug>(bytes: &[u8]) {
    let read = |bytes: &[u8]| one_error(read_scores::<Head>(&scratch::file(FILE, bytes)), FILE);
    let Some(rows) = read(bytes) else { return };
    let text = score_bytes(&rows).expect("it serialises");
    assert_eq!(read(&text).expect("what is written can be read"), rows);
}

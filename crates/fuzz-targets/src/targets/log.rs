//! Recorded log: table, sidecar and a manifest that names both.

use platform::calibration::logs::{LogReader, Source, gather};
use platform::calibration::{Settings, regression::REGRESSIONS};

use crate::properties::{is_decimal, one_error};
use crate::scratch;

const TABLE: &str = "untrusted_log.csv";
const MANIFEST: &str = "untrusted_manifest.json";

/// Header of the project's own logs.
const HEADER: &str = "t_s,x_counts,y_counts,z_counts";

pub(super) fn run(bytes: &[u8]) {
    let [table, sidecar, manifest] = scratch::parts(bytes);
    let path = scratch::file(TABLE, table);
    scratch::file("untrusted_log.json", sidecar);
    one_error(Source::of_manifest(&scratch::file(MANIFEST, manifest)), MANIFEST);
    let mut reader = LogReader::open(&path).expect("it was written");
    let samples: Option<Vec<_>> = reader.by_ref().map(|sample| one_error(sample, TABLE)).collect();
    if let (Some(samples), Ok(text)) = (samples, std::str::from_utf8(table))
        && text.lines().next() == Some(HEADER)
    {
        let rows = text.lines().skip(1).take(samples.len());
        for (sample, row) in samples.iter().zip(rows) {
            let numbers: Vec<f64> = row
                .split(',')
                .map(|cell| {
                    assert!(is_decimal(cell), "read {sample:?} from `{row}`");
                    cell.parse().expect("a number")
                })
                .collect();
            let [x, y, z] = sample.counts.map(f64::from);
            assert_eq!(numbers, [sample.t_s, x, y, z], "`{row}`");
        }
        let lines = text.matches('\n').count();
        assert_eq!(samples.len() + 1, lines.max(1), "samples of {lines} lines");
    }
    for distance_m in [None, Some(0.1)] {
        let sources = [Source { path: path.clone(), distance_m }];
        let Some(gathered) = one_error(gather(&sources, &Settings::default(), &REGRESSIONS[0], 800.0), "") else {
            continue;
        };
        assert!(gathered.presses.iter().all(|press| press.distance_m > 0.0 && press.features.slope_counts_per_s > 0.0));
    }
}

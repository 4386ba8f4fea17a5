//! Labels of the presses in a log.

use std::path::Path;

use files::{Error, FORMAT, read_json};
use serde::{Deserialize, Serialize};

use super::expected_distance;
use crate::record::LOG_KIND;

/// Distance of all presses with their onset in a time span.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct Span {
    /// Beginning of the span, in the log's time (s).
    pub start_s: f64,
    /// End of the span (s).
    pub end_s: f64,
    /// True radial distance from the whisker's root (m).
    pub distance_m: f64,
}

/// Labels of a log, from its sidecar or from the user.
#[derive(Clone, Debug, PartialEq)]
pub struct Labels {
    /// Spans in the order of time.
    spans: Vec<Span>,
}

/// Keys of a sidecar that are read here; the others are the recorder's.
#[derive(Deserialize, Serialize)]
struct Sidecar {
    format: u32,
    kind: String,
    contacts: Vec<Span>,
}

impl Labels {
    /// One distance for the whole log.
    pub fn whole(distance_m: f64) -> Self {
        Self { spans: vec![Span { start_s: f64::NEG_INFINITY, end_s: f64::INFINITY, distance_m }] }
    }

    /// Reads a sidecar.
    ///
    /// # Errors
    /// If it is invalid or its spans are not in order; the error names the key.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let Sidecar { format, kind, contacts: spans } = read_json(path)?;
        if format != FORMAT {
            return Err(Error::value(path, "format", format, FORMAT));
        }
        if kind != LOG_KIND {
            return Err(Error::value(path, "kind", &kind, LOG_KIND));
        }
        let mut last_s = f64::NEG_INFINITY;
        for (i, span) in spans.iter().enumerate() {
            if span.start_s < last_s {
                return Err(Error::value(
                    path,
                    format!("contacts.{i}.start_s"),
                    span.start_s,
                    format!("at least {last_s}"),
                ));
            }
            if span.end_s <= span.start_s {
                let expected = format!("more than {}", span.start_s);
                return Err(Error::value(path, format!("contacts.{i}.end_s"), span.end_s, expected));
            }
            if let Some(expected) = expected_distance(span.distance_m) {
                let key = format!("contacts.{i}.distance_m");
                return Err(Error::value(path, key, span.distance_m, expected));
            }
            last_s = span.end_s;
        }
        Ok(Self { spans })
    }

    /// Labels of a sidecar. `None` if there is no file, or a file of another kind.
    ///
    /// # Errors
    /// As [`Labels::read`].
    pub(super) fn of_sidecar(path: &Path) -> Result<Option<Self>, Error> {
        #[derive(Deserialize, Serialize)]
        struct Kind {
            kind: Option<String>,
        }
        if !path.exists() || read_json::<Kind>(path)?.kind.as_deref() != Some(LOG_KIND) {
            return Ok(None);
        }
        Self::read(path).map(Some)
    }

    /// Smallest and largest distance (m). `None` if there are no labels.
    pub(super) fn range_m(&self) -> Option<[f64; 2]> {
        let distances_m = || self.spans.iter().map(|span| span.distance_m);
        Some([distances_m().min_by(f64::total_cmp)?, distances_m().max_by(f64::total_cmp)?])
    }

    /// Distance of a press with this onset (m). `None` if it is unknown.
    pub fn distance_m(&self, onset_s: f64) -> Option<f64> {
        let span = self.spans.iter().find(|span| (span.start_s..span.end_s).contains(&onset_s));
        span.map(|span| span.distance_m)
    }
}

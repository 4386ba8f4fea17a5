//! Lines of stdin with their arrival.

use std::io::{self, BufRead, BufReader, Read};
use std::sync::mpsc::SyncSender;
use std::time::Instant;

/// Longest line in bytes: the first line of an evaluation contains tables of the sensor model.
const LONGEST_LINE: u64 = 1 << 23;

/// A line and its arrival.
pub(super) struct Arrival {
    /// Bytes without the line end. An error if it is too long.
    pub(super) line: Result<Vec<u8>, io::Error>,
    pub(super) at: Instant,
}

/// Reads stdin and sends its lines until its end.
pub(super) fn read(lines: &SyncSender<Arrival>) {
    let mut stdin = BufReader::new(io::stdin().lock());
    loop {
        let mut line = Vec::new();
        let read = stdin.by_ref().take(LONGEST_LINE + 1).read_until(b'\n', &mut line);
        let at = Instant::now();
        let is_last = read.as_ref().map_or(true, |count| *count == 0);
        let line = match read {
            Ok(0) => return,
            Ok(_) if line.len() as u64 > LONGEST_LINE && line.last() != Some(&b'\n') => {
                let skipped = stdin.skip_until(b'\n').map(drop);
                let long = format!("found more than {LONGEST_LINE} bytes, expected a line of at most that length");
                Err(skipped.err().unwrap_or_else(|| io::Error::new(io::ErrorKind::InvalidData, long)))
            }
            Ok(_) => Ok(line),
            Err(error) => Err(error),
        };
        // The session has ended if nobody receives.
        if lines.send(Arrival { line, at }).is_err() || is_last {
            return;
        }
    }
}

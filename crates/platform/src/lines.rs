//! Bytes of a serial port, cut into lines.

/// Longest line that is kept; what is longer is none of the formats here and must not fill the memory.
const LONGEST: usize = 256;

/// Cuts bytes into lines, whatever pieces they arrive in.
#[derive(Debug, Default)]
pub(crate) struct Lines {
    rest: Vec<u8>,
    overlong: bool,
}

impl Lines {
    /// Takes bytes and hands on each line that they end, without its end (`\n`, `\r\n`). Of an overlong line only the beginning is handed on.
    pub(crate) fn push(&mut self, bytes: &[u8], mut take: impl FnMut(Line)) {
        for piece in bytes.split_inclusive(|byte| *byte == b'\n') {
            let (body, ended) = match piece.split_last() {
                Some((b'\n', body)) => (body, true),
                _ => (piece, false),
            };
            let room = LONGEST - self.rest.len();
            self.overlong |= body.len() > room;
            self.rest.extend_from_slice(&body[..body.len().min(room)]);
            if ended {
                let bytes = self.rest.strip_suffix(b"\r").unwrap_or(&self.rest);
                take(Line { bytes, overlong: self.overlong });
                self.rest.clear();
                self.overlong = false;
            }
        }
    }

    /// What has arrived of a line that has not ended.
    pub(crate) fn rest(&self) -> &[u8] {
        &self.rest
    }
}

/// A line without its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line<'a> {
    /// Its bytes, or its beginning where it is overlong.
    pub(crate) bytes: &'a [u8],
    /// Whether it was longer than what is kept.
    pub(crate) overlong: bool,
}

/// Bytes as text for a message: what cannot be printed is escaped, and what is long is cut.
pub(crate) fn shown(bytes: &[u8]) -> String {
    const MOST: usize = 60;
    let text = bytes.iter().take(MOST).map(|byte| byte.escape_ascii().to_string()).collect::<String>();
    if bytes.len() > MOST { format!("`{text}...`") } else { format!("`{text}`") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(pieces: &[&[u8]]) -> Vec<(Vec<u8>, bool)> {
        let (mut lines, mut all) = (Lines::default(), Vec::new());
        for piece in pieces {
            lines.push(piece, |line| all.push((line.bytes.to_vec(), line.overlong)));
        }
        all
    }

    #[test]
    fn verif_pieces_do_not_matter() {
        let whole = lines(&[b"one\r\ntwo\n\nthree"]);
        assert_eq!(whole, [(b"one".to_vec(), false), (b"two".to_vec(), false), (Vec::new(), false)]);
        assert_eq!(lines(&[b"o", b"ne\r", b"\ntw", b"o\n\nth", b"ree"]), whole);
    }

    #[test]
    fn robust_an_overlong_line_is_one_line() {
        let long = vec![b'x'; 10 * LONGEST];
        let found = lines(&[&long, &long, b"\nok\n"]);
        assert_eq!(found, [(vec![b'x'; LONGEST], true), (b"ok".to_vec(), false)]);
    }
}

//! Splitting of a serial port's bytes into lines.

/// Longest line in bytes: longer ones are of none of the formats, and must not fill the memory.
const LONGEST: usize = 256;

/// Splitter of bytes, which arrive in any pieces, into lines.
#[derive(Debug, Default)]
pub(crate) struct Lines {
    rest: Vec<u8>,
    overlong: bool,
}

impl Lines {
    /// Appends bytes and passes on each completed line without its end (`\n`, `\r\n`); of an overlong line, its beginning.
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

    /// The incomplete last line.
    pub(crate) fn rest(&self) -> &[u8] {
        &self.rest
    }
}

/// A line without its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line<'a> {
    /// Its bytes; the beginning of an overlong line.
    pub(crate) bytes: &'a [u8],
    /// Whether it was overlong.
    pub(crate) overlong: bool,
}

/// Bytes as text for a message: unprintable ones escaped, long text truncated.
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
    fn verif_lines_do_not_depend_on_the_pieces() {
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

//! Quotation of untrusted text in messages.

/// Maximum number of characters quoted from a file in an error message.
const LONGEST: usize = 500;

/// Text in one line. Control characters are escaped as in `\n`, so that they can neither end the line nor control the
/// terminal.
pub fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() { line.extend(c.escape_default()) } else { line.push(c) }
    }
    line
}

/// Excerpt of at most 500 characters in one line, see [`one_line`].
pub fn shown(text: &str) -> String {
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => one_line(&text[..end]) + "...",
        None => one_line(text),
    }
}

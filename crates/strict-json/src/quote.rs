//! Text from outside, quoted in messages.

/// Longest piece of a file that an error repeats, in characters.
const LONGEST: usize = 500;

/// A text as one line that is safe to show: what would end the line or speak to the terminal is written out, as `\n` is.
pub fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() { line.extend(c.escape_default()) } else { line.push(c) }
    }
    line
}

/// What an error repeats of a file: [`one_line`], and not without end.
pub fn shown(text: &str) -> String {
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => one_line(&text[..end]) + "...",
        None => one_line(text),
    }
}

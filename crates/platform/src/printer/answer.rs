//! Parser of the lines from a printer.

/// Meaning of a line from a printer.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// The last command was accepted; some printers append a position.
    Ok(Option<Position>),
    /// Request to send the line of this number again.
    Resend(u32),
    /// The printer is busy.
    Busy,
    /// An error.
    Error(String),
    /// The printer was halted.
    Halted(String),
    /// Position of the head.
    Position(Position),
    /// The printer has just started.
    Started,
    /// Any other line, such as a temperature.
    Remark,
}

/// Position reported by a printer (mm).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Target of the head: x, y, z.
    pub goal: [f64; 3],
    /// Position by the motors: x, y, in millimetres or in steps.
    pub count: Option<[f64; 2]>,
}

impl Answer {
    /// Meaning of a line without its end.
    pub fn parse(line: &str) -> Self {
        let line = line.trim();
        let lower = line.to_ascii_lowercase();
        if let Some(rest) = lower.strip_prefix("ok")
            && rest.chars().next().is_none_or(|next| !next.is_alphanumeric())
        {
            return Self::Ok(position(line));
        }
        if let Some(number) = lower.strip_prefix("resend:").or_else(|| lower.strip_prefix("rs ")) {
            let number = number.trim().trim_start_matches(['n', ':']).trim();
            return number.parse().map_or(Self::Remark, Self::Resend);
        }
        if lower.starts_with("error:") || lower.starts_with("!!") {
            let halted = ["halted", "kill", "!!"].iter().any(|word| lower.contains(word));
            return if halted { Self::Halted(line.into()) } else { Self::Error(line.into()) };
        }
        if lower.starts_with("echo:unknown command") {
            return Self::Error(line.into());
        }
        if lower.starts_with("echo:busy") || lower.starts_with("busy:") {
            return Self::Busy;
        }
        if lower == "start" {
            return Self::Started;
        }
        position(line).map_or(Self::Remark, Self::Position)
    }
}

/// The position in a line like `X:1.00 Y:2.00 Z:3.00 E:0.00 Count X:1.00 Y: 2.00 Z:3.00`.
fn position(line: &str) -> Option<Position> {
    let (goal, count) = line.split_once(" Count").unwrap_or((line, ""));
    let goal = [coordinate(goal, "X:")?, coordinate(goal, "Y:")?, coordinate(goal, "Z:")?];
    let count = coordinate(count, "X:").zip(coordinate(count, "Y:")).map(|(x, y)| [x, y]);
    Some(Position { goal, count })
}

fn coordinate(text: &str, label: &str) -> Option<f64> {
    let (_, rest) = text.split_once(label)?;
    rest.split_ascii_whitespace().next()?.parse().ok().filter(|value: &f64| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_lines_of_printers_are_parsed() {
        let at = |x, y, z, count| Position { goal: [x, y, z], count };
        let counted = at(127.0, 96.75, 0.2, Some([126.5, 96.0]));
        let known = [
            ("ok", Answer::Ok(None)),
            ("ok P15 B3", Answer::Ok(None)),
            ("ok X:1.00 Y:2.00 Z:3.00 E:0.00", Answer::Ok(Some(at(1.0, 2.0, 3.0, None)))),
            ("Resend: 7", Answer::Resend(7)),
            ("rs N7", Answer::Resend(7)),
            ("Resend:N7", Answer::Resend(7)),
            ("echo:busy: processing", Answer::Busy),
            ("start", Answer::Started),
            ("X:127.00 Y:96.75 Z:0.20 E:0.00 Count X: 126.50 Y:96.00 Z:0.20", Answer::Position(counted)),
            ("X:1.00 Y:2.00 Z:3.00 E:0.00 Count: A:1 B:2 C:3", Answer::Position(at(1.0, 2.0, 3.0, None))),
            ("T:21.0 /0.0 B:21.0 /0.0 @:0 B@:0", Answer::Remark),
            ("okay", Answer::Remark),
            ("", Answer::Remark),
            ("X:nan Y:1 Z:1", Answer::Remark),
            // The text in between was lost.
            ("X:127.00 Y:96.75 Z:0Count X: 126.50 Y:96.00", Answer::Remark),
        ];
        for (line, answer) in known {
            assert_eq!(Answer::parse(line), answer, "{line}");
        }
        assert!(matches!(Answer::parse("Error:checksum mismatch, Last Line: 6"), Answer::Error(_)));
        assert!(matches!(Answer::parse("Error:Printer halted. kill() called!"), Answer::Halted(_)));
        assert!(matches!(Answer::parse("echo:Unknown command: \"M999\""), Answer::Error(_)));
    }
}

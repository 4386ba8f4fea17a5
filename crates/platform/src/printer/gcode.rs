//! Formatter of the lines to a printer.

/// Line with its number, checksum and end. The checksum is the exclusive or of the bytes before the asterisk.
pub(crate) fn numbered(number: u32, command: &str) -> String {
    let body = format!("N{number} {command}");
    let checksum = checksum(body.as_bytes());
    format!("{body}*{checksum}\n")
}

/// Checksum of the bytes of a line before the asterisk.
pub(crate) fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}

/// Length in millimetres for a command, to the micrometre.
pub(super) fn millimetres(length_m: f64) -> String {
    format!("{:.3}", 1e3 * length_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_checksum_of_the_known_line() {
        // Example of the protocol's descriptions.
        assert_eq!(numbered(3, "T0"), "N3 T0*57\n");
        assert_eq!(numbered(0, "M110 N0"), "N0 M110 N0*125\n");
    }
}

//! Token without which the printer is not moved.

use anyhow::Context;

/// Length in bytes; as text it has two digits a byte.
const LENGTH: usize = 16;

/// A random token, valid as long as the program runs.
pub(crate) struct Token(String);

impl Token {
    /// A new token from the system's source of random numbers.
    pub(crate) fn random() -> anyhow::Result<Self> {
        let mut bytes = [0; LENGTH];
        getrandom::fill(&mut bytes).context("random numbers of the system")?;
        Ok(Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// Its text, to be shown to the user.
    pub(crate) fn text(&self) -> &str {
        &self.0
    }

    /// Whether a text is the token. The duration of the comparison does not depend on the position of a difference.
    pub(crate) fn is(&self, text: &str) -> bool {
        let (own, found) = (self.0.as_bytes(), text.trim().as_bytes());
        own.len() == found.len() && own.iter().zip(found).fold(0, |differences, (a, b)| differences | (a ^ b)) == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_token_is_itself_alone() {
        let (token, other) = (Token::random().expect("random"), Token::random().expect("random"));
        assert_eq!(token.text().len(), 2 * LENGTH);
        assert!(token.is(token.text()) && token.is(&format!(" {}\n", token.text())));
        let cut = &token.text()[1..];
        assert!(!token.is(other.text()) && !token.is("") && !token.is(cut) && !token.is(&format!("{cut}0")));
    }
}

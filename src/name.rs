//! Names that people give to things of the service: tenants, labels, archives.

/// Longest name. They stand in addresses, logs and columns; with more, lines of those would not be read.
pub const MAX_NAME: usize = 64;

/// Whether a text is a name: letters, digits, dots, hyphens and underscores, all of ASCII.
#[must_use]
pub fn is_name(text: &str) -> bool {
    let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'.' | b'-' | b'_');
    (1..=MAX_NAME).contains(&text.len()) && text.bytes().all(is_allowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_short_and_plain() {
        for good in ["a", "liver-07", "a.b_C", &"a".repeat(MAX_NAME)] {
            assert!(is_name(good), "{good}");
        }
        for bad in ["", "a b", "a=b", "a/b", "ä", "a\n", &"a".repeat(MAX_NAME + 1)] {
            assert!(!is_name(bad), "{bad}");
        }
    }
}

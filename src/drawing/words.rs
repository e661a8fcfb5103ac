//! How words are set, and in how many lines.

use super::colors::Rgb;
use super::svg::Words;

/// Colour of words and of scale bars.
pub(super) const INK: Rgb = [34, 34, 38];
/// Letters of captions and legends.
pub(super) const WORDS: Words = Words { size_px: 13.0, is_bold: false, color: INK };
/// Letters of headings.
pub(super) const BOLD: Words = Words { is_bold: true, ..WORDS };
/// From one line of words to the next, pixels.
pub(super) const LINE_PX: f64 = 18.0;
/// Width of a letter, of its height: the mean of common faces without serifs, and a little more.
const LETTER: f64 = 0.55;

/// About how wide words are, pixels.
pub(super) fn text_px(text: &str) -> f64 {
    text.chars().count() as f64 * LETTER * WORDS.size_px
}

/// Words in lines of a width; a word that is longer has a line of its own.
pub(super) fn in_lines(text: &str, width_px: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_px(line) + text_px(word) + LETTER * WORDS.size_px <= width_px => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_broken_between_words() {
        assert_eq!(in_lines("one two three", 7.0 * LETTER * WORDS.size_px), ["one two", "three"]);
        assert_eq!(in_lines("  ", 50.0), Vec::<String>::new());
    }
}

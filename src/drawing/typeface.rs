//! The typeface of pictures and reports, which is in the program: they look alike on every machine.
//!
//! Noto Sans (SIL Open Font License 1.1, `fonts/OFL.txt`), cut down to Latin, Greek, Cyrillic and signs. What it lacks is
//! drawn as its replacement character.

use std::sync::LazyLock;

use ttf_parser::{GlyphId, OutlineBuilder};

/// A face of the typeface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Typeface {
    /// For text.
    Regular,
    /// For headings.
    Bold,
}

/// What a document needs to know of a face, in thousandths of the height of its letters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaceMeasures {
    /// Highest above the base line.
    pub ascent: f64,
    /// Lowest below it, negative.
    pub descent: f64,
    /// Height of capitals.
    pub capitals: f64,
    /// The box that holds every glyph: left, bottom, right, top.
    pub bounds: [f64; 4],
}

/// Pieces that a curve of a letter is drawn in. Fewer show as corners in a heading; more are not seen.
const PIECES: u32 = 6;
/// Drawn for a letter that the face lacks.
const LACKING: char = '\u{fffd}';

type Parsed = ttf_parser::Face<'static>;

static REGULAR: LazyLock<Parsed> = LazyLock::new(|| parsed(Typeface::Regular));
static BOLD: LazyLock<Parsed> = LazyLock::new(|| parsed(Typeface::Bold));

fn parsed(face: Typeface) -> Parsed {
    Parsed::parse(face.bytes(), 0).expect("the file is the program's own")
}

impl Typeface {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Regular, Self::Bold];

    /// The TrueType file.
    #[must_use]
    pub fn bytes(self) -> &'static [u8] {
        match self {
            Self::Regular => include_bytes!("fonts/NotoSans-Regular.ttf"),
            Self::Bold => include_bytes!("fonts/NotoSans-Bold.ttf"),
        }
    }

    /// Its name as documents write it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Regular => "NotoSans-Regular",
            Self::Bold => "NotoSans-Bold",
        }
    }

    fn parsed(self) -> &'static Parsed {
        match self {
            Self::Regular => &REGULAR,
            Self::Bold => &BOLD,
        }
    }

    /// The number of the glyph of a character, and of none that it lacks.
    #[must_use]
    pub fn glyph(self, character: char) -> u16 {
        let face = self.parsed();
        let glyph = face.glyph_index(character).or_else(|| face.glyph_index(LACKING));
        glyph.map_or(0, |glyph| glyph.0)
    }

    /// The character that is seen: itself, or what stands for one that it lacks.
    #[must_use]
    pub fn shown(self, character: char) -> char {
        if self.parsed().glyph_index(character).is_some() { character } else { LACKING }
    }

    /// How many glyphs it has.
    #[must_use]
    pub fn glyphs(self) -> u16 {
        self.parsed().number_of_glyphs()
    }

    /// How far the next letter is, in heights of letters.
    #[must_use]
    pub fn advance(self, glyph: u16) -> f64 {
        let face = self.parsed();
        f64::from(face.glyph_hor_advance(GlyphId(glyph)).unwrap_or(0)) / f64::from(face.units_per_em())
    }

    /// Width of words in letters of a height.
    #[must_use]
    pub fn width(self, text: &str, size: f64) -> f64 {
        size * text.chars().map(|character| self.advance(self.glyph(character))).sum::<f64>()
    }

    /// Words in lines of a width; a word that is wider is cut.
    #[must_use]
    pub fn lines(self, text: &str, size: f64, width: f64) -> Vec<String> {
        let mut lines = vec![String::new()];
        for word in text.split_whitespace() {
            for piece in self.pieces(word, size, width) {
                let line = lines.last().map_or("", String::as_str);
                let joined = if line.is_empty() { piece.clone() } else { format!("{line} {piece}") };
                if line.is_empty() || self.width(&joined, size) <= width {
                    lines.pop();
                    lines.push(joined);
                } else {
                    lines.push(piece);
                }
            }
        }
        lines.retain(|line| !line.is_empty());
        lines
    }

    /// A word in pieces of a width, of one character at the least.
    fn pieces(self, word: &str, size: f64, width: f64) -> Vec<String> {
        let mut pieces = vec![String::new()];
        for character in word.chars() {
            let piece = pieces.last().map_or("", String::as_str);
            let longer = format!("{piece}{character}");
            if piece.is_empty() || self.width(&longer, size) <= width {
                pieces.pop();
                pieces.push(longer);
            } else {
                pieces.push(character.to_string());
            }
        }
        pieces
    }

    /// Words that are no wider, with an ellipsis where they were cut.
    #[must_use]
    pub fn fitted(self, text: &str, size: f64, width: f64) -> String {
        if self.width(text, size) <= width {
            return text.to_owned();
        }
        let mut kept: String = text.to_owned();
        while kept.pop().is_some() {
            let told = format!("{}…", kept.trim_end());
            if self.width(&told, size) <= width {
                return told;
            }
        }
        String::new()
    }

    /// The closed lines of a glyph, in heights of letters, upwards from the base line.
    #[must_use]
    pub fn outline(self, glyph: u16) -> Vec<Vec<[f64; 2]>> {
        let face = self.parsed();
        let mut outline = Outline { lines: Vec::new(), at: [0.0; 2], unit: 1.0 / f64::from(face.units_per_em()) };
        // A space has none.
        let _ = face.outline_glyph(GlyphId(glyph), &mut outline);
        outline.lines
    }

    /// What a document needs to know of it.
    #[must_use]
    pub fn measures(self) -> FaceMeasures {
        let face = self.parsed();
        let told = |units: i16| f64::from(units) * 1000.0 / f64::from(face.units_per_em());
        let bounds = face.global_bounding_box();
        FaceMeasures {
            ascent: told(face.ascender()),
            descent: told(face.descender()),
            capitals: told(face.capital_height().unwrap_or(face.ascender())),
            bounds: [bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max].map(told),
        }
    }
}

/// Takes the curves of a glyph and keeps straight pieces of them.
struct Outline {
    lines: Vec<Vec<[f64; 2]>>,
    at: [f64; 2],
    unit: f64,
}

impl Outline {
    fn go(&mut self, to: [f64; 2]) {
        self.at = to;
        self.lines.last_mut().into_iter().for_each(|line| line.push(to));
    }

    fn scaled(&self, x: f32, y: f32) -> [f64; 2] {
        [f64::from(x) * self.unit, f64::from(y) * self.unit]
    }

    /// A Bézier curve from where it is over inner points to the last one.
    fn curve(&mut self, points: &[[f64; 2]]) {
        let from = self.at;
        for piece in 1..=PIECES {
            let share = f64::from(piece) / f64::from(PIECES);
            // De Casteljau: mixed again and again until one point is left.
            let mut mixed = vec![from];
            mixed.extend(points);
            while mixed.len() > 1 {
                mixed = mixed.windows(2).map(|pair| between(pair[0], pair[1], share)).collect();
            }
            mixed.into_iter().for_each(|point| self.go(point));
        }
    }
}

fn between(a: [f64; 2], b: [f64; 2], share: f64) -> [f64; 2] {
    [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share]
}

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        self.lines.push(Vec::new());
        let to = self.scaled(x, y);
        self.go(to);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let to = self.scaled(x, y);
        self.go(to);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let points = [self.scaled(x1, y1), self.scaled(x, y)];
        self.curve(&points);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let points = [self.scaled(x1, y1), self.scaled(x2, y2), self.scaled(x, y)];
        self.curve(&points);
    }

    fn close(&mut self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_have_outlines_and_what_is_lacking_has_one_too() {
        let (o, space, lacking) = (Typeface::Bold.glyph('o'), Typeface::Bold.glyph(' '), Typeface::Bold.glyph('脳'));
        assert_eq!(Typeface::Bold.outline(o).len(), 2, "an o is a ring");
        assert!(Typeface::Bold.outline(space).is_empty());
        assert!(lacking != 0 && !Typeface::Bold.outline(lacking).is_empty());
    }

    #[test]
    fn words_are_broken_where_a_line_is_full_and_no_line_is_wider() {
        let face = Typeface::Regular;
        for text in ["one two three", "a_very_long_name_without_a_space", "", "  "] {
            let lines = face.lines(text, 10.0, 40.0);
            assert!(lines.iter().all(|line| face.width(line, 10.0) <= 40.0), "{lines:?}");
            assert_eq!(lines.concat().replace(' ', ""), text.replace(' ', ""));
        }
        assert_eq!(face.fitted("short", 10.0, 40.0), "short");
        assert!(face.fitted("not so short", 10.0, 40.0).ends_with('…'));
    }
}

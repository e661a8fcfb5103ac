//! A page: words, bars and pictures at their places, before it is pixels or a page of a document.

use super::colors::Rgb;
use super::pixels::Pixels;
use super::typeface::Typeface;

/// A thing on a page. Places are from the upper left corner, in units of the page.
#[derive(Clone, Debug)]
pub enum Element {
    /// Words from the left end of their base line.
    Words {
        /// The text, one line.
        text: String,
        /// Where.
        at: [f64; 2],
        /// Face and height of the letters.
        letters: (Typeface, f64),
        /// Colour.
        color: Rgb,
    },
    /// A rectangle from its upper left corner.
    Rectangle {
        /// Where.
        at: [f64; 2],
        /// Width and height.
        size: [f64; 2],
        /// Colour.
        color: Rgb,
    },
    /// A disc.
    Disc {
        /// Its middle.
        at: [f64; 2],
        /// Its radius.
        radius: f64,
        /// Colour.
        color: Rgb,
    },
    /// A picture of [`Page::dots`] pixels for each unit.
    Picture {
        /// Where its upper left corner is.
        at: [f64; 2],
        /// The picture.
        pixels: Pixels,
    },
}

/// Things on white paper; later ones lie over earlier ones.
#[derive(Clone, Debug)]
pub struct Page {
    /// Width and height.
    pub size: [f64; 2],
    /// Pixels for each unit in pictures of surfaces.
    pub dots: u32,
    /// The things.
    pub elements: Vec<Element>,
}

/// Colour of words.
pub const INK: Rgb = [28, 30, 36];
/// Colour of words that say what others are.
pub const QUIET: Rgb = [95, 99, 110];
/// Colour of hairlines.
pub const HAIR: Rgb = [214, 217, 224];
const WHITE: Rgb = [255; 3];

impl Page {
    /// An empty page of a width.
    #[must_use]
    pub fn new(width: f64, dots: u32) -> Self {
        Self { size: [width, 0.0], dots: dots.max(1), elements: Vec::new() }
    }

    /// Puts words; where they end.
    pub fn words(&mut self, text: &str, at: [f64; 2], letters: (Typeface, f64), color: Rgb) -> f64 {
        let (face, size) = letters;
        self.elements.push(Element::Words { text: text.to_owned(), at, letters, color });
        at[0] + face.width(text, size)
    }

    /// Puts words that end there.
    pub fn words_to(&mut self, text: &str, [right, y]: [f64; 2], (face, size): (Typeface, f64), color: Rgb) {
        self.words(text, [right - face.width(text, size), y], (face, size), color);
    }

    /// Puts words around there.
    pub fn words_around(&mut self, text: &str, [x, y]: [f64; 2], (face, size): (Typeface, f64), color: Rgb) {
        self.words(text, [x - face.width(text, size) / 2.0, y], (face, size), color);
    }

    /// Puts words in as many lines as they need, the first base line a line below `top`; where they end.
    pub fn paragraph(
        &mut self,
        text: &str,
        ([left, top], width): ([f64; 2], f64),
        (face, size): (Typeface, f64),
        color: Rgb,
    ) -> f64 {
        let mut base = top;
        for line in face.lines(text, size, width) {
            base += line_height(size);
            self.words(&line, [left, base - 0.3 * size], (face, size), color);
        }
        base
    }

    /// Puts a rectangle.
    pub fn rectangle(&mut self, at: [f64; 2], size: [f64; 2], color: Rgb) {
        self.elements.push(Element::Rectangle { at, size, color });
    }

    /// Puts a line from left to right that is hardly seen.
    pub fn hairline(&mut self, [left, y]: [f64; 2], width: f64) {
        self.rectangle([left, y], [width, 1.0], HAIR);
    }

    /// Puts a picture, whose size is told in units.
    pub fn picture(&mut self, pixels: Pixels, at: [f64; 2]) {
        self.elements.push(Element::Picture { at, pixels });
    }

    /// The page as pixels, [`dots`](Self::dots) for each unit.
    #[must_use]
    pub fn painted(&self) -> Pixels {
        let dots = f64::from(self.dots);
        let [width, height] = self.size.map(|length| whole(length * dots));
        let mut pixels = Pixels::new(width, height, WHITE);
        for element in &self.elements {
            match element {
                Element::Words { text, at, letters: (face, size), color } => {
                    pixels.words(text, at.map(|x| x * dots), (*face, size * dots), *color);
                }
                Element::Rectangle { at, size, color } => {
                    pixels.rectangle(at.map(|x| x * dots), size.map(|x| x * dots), *color);
                }
                Element::Disc { at, radius, color } => pixels.disc(at.map(|x| x * dots), radius * dots, *color),
                Element::Picture { at, pixels: picture } => pixels.lay(picture, at.map(|x| whole(x * dots))),
            }
        }
        pixels
    }
}

/// From one line of words to the next.
#[must_use]
pub fn line_height(size: f64) -> f64 {
    (1.4 * size).ceil()
}

/// The nearest whole number of pixels; 0 of what is none.
fn whole(length: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast keeps to the ends")]
    let whole = length.round() as usize;
    whole
}

//! What is on a page, as operators of PDF. The page is laid upside down by [`super::add_page`]: downwards is positive.

use std::collections::BTreeMap;

use super::fonts;
use crate::drawing::colors::Rgb;
use crate::drawing::{Element, Page, Pixels, Typeface};

/// Glyphs that are used on pages with the character that each stands for, by face.
#[derive(Default)]
pub(super) struct Used(BTreeMap<Typeface, BTreeMap<u16, char>>);

impl Used {
    /// Those of a face.
    pub fn of(&self, face: Typeface) -> BTreeMap<u16, char> {
        self.0.get(&face).cloned().unwrap_or_default()
    }
}

/// A page as operators.
#[derive(Default)]
pub(super) struct Content<'a> {
    pub operators: String,
    pub pictures: Vec<&'a Pixels>,
}

impl<'a> Content<'a> {
    /// Of a page; what glyphs it uses is noted.
    pub fn of(page: &'a Page, used: &mut Used) -> Self {
        let mut content = Self::default();
        for element in &page.elements {
            match element {
                Element::Words { text, at, letters, color } => content.add_words(text, *at, (*letters, *color), used),
                Element::Rectangle { at: [x, y], size: [width, height], color } => {
                    content.say(&format!("{} {x:.2} {y:.2} {width:.2} {height:.2} re f", fill(*color)));
                }
                Element::Disc { at, radius, color } => content.add_disc(*at, *radius, *color),
                Element::Picture { at, pixels } => content.add_picture(*at, pixels, f64::from(page.dots)),
            }
        }
        content
    }

    fn say(&mut self, operators: &str) {
        self.operators.push_str(operators);
        self.operators.push('\n');
    }

    fn add_words(
        &mut self,
        text: &str,
        [x, y]: [f64; 2],
        ((face, size), color): ((Typeface, f64), Rgb),
        used: &mut Used,
    ) {
        let mut digits = String::new();
        for character in text.chars() {
            let glyph = face.glyph(character);
            used.0.entry(face).or_default().entry(glyph).or_insert(face.shown(character));
            digits.push_str(&format!("{glyph:04X}"));
        }
        let font = fonts::resource(face);
        self.say(&format!("BT {} /{font} {size:.2} Tf 1 0 0 -1 {x:.2} {y:.2} Tm <{digits}> Tj ET", fill(color)));
    }

    /// Four curves.
    fn add_disc(&mut self, [x, y]: [f64; 2], radius: f64, color: Rgb) {
        /// How far the inner points of the curve of a quarter lie from its ends, of the radius.
        const KAPPA: f64 = 0.552_284_75;
        let mut path = format!("{} {:.2} {y:.2} m", fill(color), x + radius);
        let mut from = [1.0, 0.0];
        for to in [[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]] {
            let inner = [
                [from[0] + KAPPA * to[0], from[1] + KAPPA * to[1]],
                [to[0] + KAPPA * from[0], to[1] + KAPPA * from[1]],
            ];
            for [dx, dy] in [inner[0], inner[1], to] {
                path.push_str(&format!(" {:.2} {:.2}", x + radius * dx, y + radius * dy));
            }
            path.push_str(" c");
            from = to;
        }
        self.say(&format!("{path} f"));
    }

    fn add_picture(&mut self, [x, y]: [f64; 2], pixels: &'a Pixels, dots: f64) {
        let [width, height] = [pixels.width(), pixels.height()].map(|count| count as f64 / dots);
        // A picture fills the unit square upwards.
        let number = self.pictures.len();
        self.say(&format!("q {width:.2} 0 0 {:.2} {x:.2} {:.2} cm /I{number} Do Q", -height, y + height));
        self.pictures.push(pixels);
    }
}

fn fill(color: Rgb) -> String {
    let [red, green, blue] = color.map(|part| f64::from(part) / 255.0);
    format!("{red:.3} {green:.3} {blue:.3} rg")
}

//! Elements of SVG as text.

use super::colors::{Rgb, hex};
use super::flat::{Drawn, Form};

/// Text that is put together element by element.
#[derive(Default)]
pub(super) struct Svg(String);

/// How words are set.
#[derive(Clone, Copy)]
pub(super) struct Words {
    /// Height of the letters, pixels.
    pub size_px: f64,
    /// Whether they are bold.
    pub is_bold: bool,
    /// Colour.
    pub color: Rgb,
}

impl Svg {
    /// The begin of a document of that size, on white paper.
    pub fn begin([width, height]: [f64; 2], title: &str, description: &str) -> Self {
        let mut svg = Self::default();
        let [w, h] = [number(width), number(height)];
        svg.line_of(&format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" width="{w}" height="{h}" viewBox="0 0 {w} {h}" role="img" font-family="system-ui, sans-serif" stroke-linejoin="round" stroke-linecap="round">"#
        ));
        svg.line_of(&format!("<title>{}</title>", escaped(title)));
        svg.line_of(&format!("<desc>{}</desc>", escaped(description)));
        svg.rectangle([0.0, 0.0], [width, height], "#ffffff");
        svg
    }

    /// The whole document.
    pub fn end(mut self) -> String {
        self.line_of("</svg>");
        self.0
    }

    /// Things of a scene at the places that `place` gives their points, in their order.
    pub fn things(&mut self, all: &[Drawn], place: impl Fn([f64; 2]) -> [f64; 2]) {
        let told = |point: [f64; 2]| {
            let [x, y] = place(point).map(number);
            format!("{x},{y}")
        };
        let mut rest = all;
        while let Some(first) = rest.first() {
            // Lines and dots that follow each other and look alike are one element: a cloud has thousands.
            let run = rest.iter().take_while(|drawn| is_alike(first, drawn)).count().max(1);
            let (these, others) = rest.split_at(run);
            let color = hex(first.color);
            match &first.form {
                Form::Face { corners, edge } => {
                    let points: Vec<String> = corners.iter().map(|corner| told(*corner)).collect();
                    let (stroke, width) = edge.map_or((color.clone(), "0.6"), |edge| (hex(edge), "0.5"));
                    let opacity = opacity("fill", first);
                    self.line_of(&format!(
                        r#"<polygon points="{}" fill="{color}"{opacity} stroke="{stroke}" stroke-width="{width}"/>"#,
                        points.join(" ")
                    ));
                }
                Form::Line { width_px, .. } => self.strokes(first, these, *width_px, told),
                Form::Dot { radius_px, .. } => self.strokes(first, these, 2.0 * radius_px, told),
            }
            rest = others;
        }
    }

    /// Lines, or dots, which are lines of no length with round ends.
    fn strokes(&mut self, like: &Drawn, these: &[Drawn], width_px: f64, told: impl Fn([f64; 2]) -> String) {
        let mut path = String::new();
        for drawn in these {
            match drawn.form.points() {
                [at] => path.push_str(&format!("M{}h0", told(*at))),
                [from, to] => path.push_str(&format!("M{}L{}", told(*from), told(*to))),
                _ => {}
            }
        }
        let (color, width, opacity) = (hex(like.color), number(width_px), opacity("stroke", like));
        self.line_of(&format!(r#"<path d="{path}" stroke="{color}" stroke-width="{width}"{opacity}/>"#));
    }

    /// A straight line.
    pub fn line(&mut self, [[x1, y1], [x2, y2]]: [[f64; 2]; 2], width_px: f64, color: &str) {
        let [x1, y1, x2, y2, width] = [x1, y1, x2, y2, width_px].map(number);
        self.line_of(&format!(
            r#"<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="{color}" stroke-width="{width}"/>"#
        ));
    }

    /// A rectangle from its upper left corner; `fill` is a colour or the name of a gradient.
    pub fn rectangle(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], fill: &str) {
        let [x, y, width, height] = [x, y, width, height].map(number);
        self.line_of(&format!(r#"<rect x="{x}" y="{y}" width="{width}" height="{height}" fill="{fill}"/>"#));
    }

    /// Words from the left end of their base line.
    pub fn words(&mut self, text: &str, [x, y]: [f64; 2], words: Words) {
        let [x, y, size] = [x, y, words.size_px].map(number);
        let weight = if words.is_bold { r#" font-weight="600""# } else { "" };
        let (color, text) = (hex(words.color), escaped(text));
        self.line_of(&format!(r#"<text x="{x}" y="{y}" font-size="{size}"{weight} fill="{color}">{text}</text>"#));
    }

    /// Colours that go over into each other from left to right, at even steps, under a name.
    pub fn gradient(&mut self, name: &str, colors: &[Rgb]) {
        self.line_of(&format!(r#"<linearGradient id="{}">"#, escaped(name)));
        for (place, color) in colors.iter().enumerate() {
            let offset = place as f64 / (colors.len().max(2) - 1) as f64;
            self.line_of(&format!(r#"<stop offset="{offset:.2}" stop-color="{}"/>"#, hex(*color)));
        }
        self.line_of("</linearGradient>");
    }

    fn line_of(&mut self, element: &str) {
        self.0.push_str(element);
        self.0.push('\n');
    }
}

/// Whether two lines, or two dots, look alike.
fn is_alike(a: &Drawn, b: &Drawn) -> bool {
    let is_stroke = match (&a.form, &b.form) {
        (Form::Line { width_px: a, .. }, Form::Line { width_px: b, .. }) => a == b,
        (Form::Dot { radius_px: a, .. }, Form::Dot { radius_px: b, .. }) => a == b,
        _ => false,
    };
    is_stroke && a.color == b.color && a.opacity == b.opacity
}

/// The attribute for the opacity of a thing's fill or stroke; none where it hides what is behind.
fn opacity(of: &str, drawn: &Drawn) -> String {
    if drawn.opacity < 1.0 { format!(r#" {of}-opacity="{:.2}""#, drawn.opacity) } else { String::new() }
}

/// With one decimal: a tenth of a pixel is not seen, and more would be other bytes with every machine's sine.
fn number(value: f64) -> String {
    let told = format!("{value:.1}");
    let told = told.strip_suffix(".0").unwrap_or(&told);
    if told == "-0" { "0".to_owned() } else { told.to_owned() }
}

/// Text as XML has it. Characters that no XML may have are replaced.
fn escaped(text: &str) -> String {
    let mut clean = String::new();
    for c in text.chars() {
        let is_forbidden = (c.is_control() && !matches!(c, '\t' | '\n')) || matches!(c, '\u{fffe}' | '\u{ffff}');
        clean.push(if is_forbidden { char::REPLACEMENT_CHARACTER } else { c });
    }
    quick_xml::escape::escape(clean.as_str()).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_a_decimal_at_the_most() {
        assert_eq!([0.0, -0.04, 12.0, 3.12, -2.55].map(number), ["0", "0", "12", "3.1", "-2.5"]);
    }

    #[test]
    fn text_of_others_is_escaped() {
        assert_eq!(escaped("a<b> & \"c\"\u{1}"), "a&lt;b&gt; &amp; &quot;c&quot;\u{fffd}");
    }
}

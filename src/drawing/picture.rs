//! Panels in rows, all of one scale, with captions, a scale bar and a legend.

use super::colors::hex;
use super::entries::{Entry, entries};
use super::flat::{Drawn, bounds, drawn};
use super::legend::{Legend, round_step, told};
use super::scene::Scene;
use super::svg::Svg;
use super::view::View;
use super::words::{BOLD, INK, LINE_PX, WORDS, in_lines};

/// Space at the edges of a picture and between panels, pixels.
const GAP_PX: f64 = 20.0;
/// Height of a panel at the most, in its widths.
const MOST_HEIGHT: f64 = 0.95;
/// A picture of nothing has this scale, pixels per mm.
const SCALE_OF_NOTHING: f64 = 1.0;

/// A scene as it is seen from somewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// What is seen.
    pub scene: Scene,
    /// From where.
    pub view: View,
    /// A few words above it.
    pub heading: String,
    /// A sentence below it; may be empty.
    pub caption: String,
}

/// Panels in rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// What it is, for those who do not see it.
    pub title: String,
    /// What is to be seen, for the same.
    pub description: String,
    /// Width of every panel, pixels.
    pub panel_px: f64,
    /// The panels, row by row.
    pub rows: Vec<Vec<Panel>>,
    /// What the colours mean.
    pub legend: Vec<Legend>,
}

/// A panel laid flat, with its words in lines.
struct Laid {
    drawn: Vec<Drawn>,
    /// Smallest and largest coordinates, mm.
    bounds: [[f64; 2]; 2],
    heading: Vec<String>,
    caption: Vec<String>,
}

impl Picture {
    /// The picture as an SVG document. Equal pictures give equal bytes.
    #[must_use]
    pub fn to_svg(&self) -> String {
        let rows: Vec<Vec<Laid>> = self.rows.iter().map(|row| self.laid(row)).collect();
        let scale = self.scale(&rows);
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0).max(1) as f64;
        let width = GAP_PX + columns * (self.panel_px + GAP_PX);
        let heights: Vec<f64> = rows.iter().map(|row| row_height(row, scale)).collect();
        let legend_lines = self.legend_lines(width);
        let foot = (legend_lines.len() as f64 + 1.0) * (LINE_PX + 6.0);
        let height = GAP_PX + heights.iter().map(|height| height + GAP_PX).sum::<f64>() + foot;
        let mut svg = Svg::begin([width, height], &self.title, &self.description);
        let mut top = GAP_PX;
        for (row, height) in rows.iter().zip(&heights) {
            for (column, laid) in row.iter().enumerate() {
                let left = GAP_PX + column as f64 * (self.panel_px + GAP_PX);
                self.draw(&mut svg, laid, [left, top], (*height, scale));
            }
            top += height + GAP_PX;
        }
        self.draw_scale_bar(&mut svg, top, scale);
        for line in legend_lines {
            top += LINE_PX + 6.0;
            let mut left = GAP_PX;
            for entry in line {
                left += entry.draw(&mut svg, [left, top]) + GAP_PX;
            }
        }
        svg.end()
    }

    fn laid(&self, row: &[Panel]) -> Vec<Laid> {
        let mut all = Vec::new();
        for panel in row {
            let drawn = drawn(&panel.scene, &panel.view);
            let bounds = bounds(&drawn).unwrap_or_default();
            let [heading, caption] = [&panel.heading, &panel.caption].map(|text| in_lines(text, self.panel_px));
            all.push(Laid { drawn, bounds, heading, caption });
        }
        all
    }

    /// Pixels per mm at which every panel has room.
    fn scale(&self, rows: &[Vec<Laid>]) -> f64 {
        let mut scale = f64::INFINITY;
        for laid in rows.iter().flatten() {
            let [width, height] = laid.size_mm();
            scale = scale.min(self.panel_px / width.max(1e-9)).min(MOST_HEIGHT * self.panel_px / height.max(1e-9));
        }
        // A point and nothing have no size to be seen by.
        if scale.is_finite() && scale < 1e8 { scale } else { SCALE_OF_NOTHING }
    }

    /// A panel with its words: heading at the top, caption at the foot, the scene in the middle of what is between.
    fn draw(&self, svg: &mut Svg, laid: &Laid, [left, top]: [f64; 2], (height, scale): (f64, f64)) {
        let mut base = top;
        for line in &laid.heading {
            base += LINE_PX;
            svg.words(line, [left, base - 5.0], BOLD);
        }
        let foot = top + height - laid.caption.len() as f64 * LINE_PX;
        let [low, high] = laid.bounds;
        let middle = [left + self.panel_px / 2.0, f64::midpoint(base, foot)];
        let center: [f64; 2] = std::array::from_fn(|axis| f64::midpoint(low[axis], high[axis]));
        let place = |[x, y]: [f64; 2]| [middle[0] + scale * (x - center[0]), middle[1] - scale * (y - center[1])];
        svg.things(&laid.drawn, place);
        for (number, line) in laid.caption.iter().enumerate() {
            svg.words(line, [left, foot + (number as f64 + 1.0) * LINE_PX - 5.0], WORDS);
        }
    }

    /// A bar of a round length, about a quarter of a panel.
    fn draw_scale_bar(&self, svg: &mut Svg, top: f64, scale: f64) {
        let length_mm = round_step(0.3 * self.panel_px / scale);
        let (length, ink) = (length_mm * scale, hex(INK));
        let [y, right] = [top + LINE_PX / 2.0, GAP_PX + length];
        svg.line([[GAP_PX, y], [right, y]], 2.0, &ink);
        for x in [GAP_PX, right] {
            svg.line([[x, y - 4.0], [x, y + 4.0]], 2.0, &ink);
        }
        svg.words(&format!("{} mm", told(length_mm)), [right + 8.0, y + 4.5], WORDS);
    }

    /// The entries of the legend in as many lines as they need.
    fn legend_lines(&self, width: f64) -> Vec<Vec<Entry<'_>>> {
        let mut lines: Vec<Vec<Entry<'_>>> = Vec::new();
        let mut left = width;
        for entry in self.legend.iter().flat_map(entries) {
            let wide = entry.width() + GAP_PX;
            if left + wide > width - GAP_PX {
                lines.push(Vec::new());
                left = 0.0;
            }
            left += wide;
            lines.last_mut().into_iter().for_each(|line| line.push(entry));
        }
        lines
    }
}

impl Laid {
    fn size_mm(&self) -> [f64; 2] {
        let [low, high] = self.bounds;
        [high[0] - low[0], high[1] - low[1]]
    }
}

/// Height of a row, pixels: that of its highest scene, headings and captions, which lie at one height.
fn row_height(row: &[Laid], scale: f64) -> f64 {
    /// Air above and below a scene.
    const AIR_PX: f64 = 12.0;
    let mut height = 0.0_f64;
    for laid in row {
        let words = (laid.heading.len() + laid.caption.len()) as f64 * LINE_PX;
        height = height.max(words + scale * laid.size_mm()[1] + AIR_PX);
    }
    height
}

#[cfg(test)]
mod tests {
    use quick_xml::Reader;
    use quick_xml::events::Event;

    use super::*;
    use crate::drawing::{Key, Mark, Range};
    use crate::space::{WorldPoint, WorldVector};

    fn panel(scene: Scene) -> Panel {
        let view = View::new(WorldVector::z(), WorldVector::y()).expect("two directions");
        Panel { scene, view, heading: "From <above>".to_owned(), caption: "A sheet & its vectors".to_owned() }
    }

    fn picture(rows: Vec<Vec<Panel>>) -> Picture {
        let range = Range { low_mm: 2.0, high_mm: 4.5, is_exceeded: [false, true] };
        let key = Key { color: [1, 2, 3], what: "vectors".to_owned(), is_line: true };
        Picture {
            title: "A \"test\"".to_owned(),
            description: "Lines\u{7}".to_owned(),
            panel_px: 200.0,
            rows,
            legend: vec![Legend::Map { range, what: "thickness".to_owned() }, Legend::Keys(vec![key])],
        }
    }

    /// A line from the origin, to the right and upwards, mm.
    fn line(x: f64, y: f64) -> Scene {
        let mut scene = Scene::default();
        scene.add_line([WorldPoint::origin(), WorldPoint::new(x, y, 0.0)], 1, [9, 9, 9], 1.0);
        scene.add(Mark::Dot { at: WorldPoint::new(f64::NAN, 0.0, 0.0), radius_px: 1.0 }, [0; 3], 1.0);
        scene
    }

    /// Names of the elements, and all text; panics where it is not well-formed.
    fn read(svg: &str) -> (Vec<String>, String) {
        let mut reader = Reader::from_str(svg);
        reader.config_mut().check_end_names = true;
        let (mut names, mut text) = (Vec::new(), String::new());
        loop {
            match reader.read_event().expect("well-formed") {
                Event::Start(start) | Event::Empty(start) => {
                    start.attributes().for_each(|attribute| assert!(attribute.is_ok(), "{attribute:?}"));
                    names.push(start.name().as_ref().to_owned());
                }
                Event::Text(words) => text.push_str(&words),
                Event::Eof => return (names, text),
                _ => {}
            }
        }
    }

    #[test]
    fn a_picture_is_well_formed_and_says_what_it_is() {
        let picture = picture(vec![vec![panel(line(40.0, 10.0)), panel(line(10.0, 10.0))]]);
        let svg = picture.to_svg();
        let (names, text) = read(&svg);
        assert_eq!(names[..3], ["svg", "title", "desc"]);
        assert_eq!(names.iter().filter(|name| *name == "path").count(), 2, "a line in each panel");
        for words in ["10 mm", "thickness", "≥ 4.5 mm", "vectors", "A sheet"] {
            assert!(text.contains(words), "{words} in {text}");
        }
        assert!(svg.contains("From &lt;above&gt;") && svg.contains("A &quot;test&quot;"));
        assert!(!svg.contains("NaN") && !svg.contains('\u{7}'));
        assert_eq!(svg, picture.to_svg());
    }

    #[test]
    fn all_panels_have_one_scale_and_lie_inside() {
        let svg = picture(vec![vec![panel(line(40.0, 0.0)), panel(line(20.0, 0.0))]]).to_svg();
        let paths: Vec<&str> = svg.lines().filter(|line| line.starts_with("<path")).collect();
        // 200 pixels are 40 mm: the second line, in the middle of its panel, has half of them.
        assert!(paths[0].contains(" d=\"M20,") && paths[0].contains("L220,"), "{}", paths[0]);
        assert!(paths[1].contains(" d=\"M290,") && paths[1].contains("L390,"), "{}", paths[1]);
        assert!(svg.contains(r#"width="460""#));
    }

    #[test]
    fn nothing_and_a_point_are_pictures_too() {
        let mut point = Scene::default();
        point.add(Mark::Dot { at: WorldPoint::origin(), radius_px: 2.0 }, [0; 3], 1.0);
        for rows in [vec![], vec![vec![]], vec![vec![panel(Scene::default())]], vec![vec![panel(point)]]] {
            let svg = picture(rows).to_svg();
            read(&svg);
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }
}

//! Three views of structures, all of one scale, with the sides of the patient, a scale bar and the meaning of the colours.

use super::{EDGE, HEADING, INNER, SMALL, STRONG};
use crate::drawing::colors::{Rgb, viridis};
use crate::drawing::page::{INK, QUIET};
use crate::drawing::{BARE, Element, Frame, NO_THICKNESS, Page, Pixels, Range, Solid, View, round_step, told};
use crate::model::{Figure, Structure};
use crate::space::WorldPoint;

/// Space between views.
const GAP: f64 = 18.0;
/// Space for the letters round a view.
const RIM: f64 = 22.0;
/// Height of a view at the most.
const MOST_HEIGHT: f64 = 400.0;
/// Colour of the mark at the place that the verdict names.
const MARK: Rgb = [200, 30, 60];
/// More numbers than these hide what they name.
const MOST_BADGES: usize = 40;

/// What is to be seen.
#[derive(Clone, Copy)]
pub(super) struct Shown<'a> {
    pub structures: &'a [Structure],
    /// What the colours mean.
    pub range: Range,
    /// Whether the file says where the sides of the patient are.
    pub is_oriented: bool,
    /// A place to be marked.
    pub place: Option<WorldPoint>,
}

const VIEWS: [&str; 3] = ["From the front", "From the left", "From the feet"];
/// The same where the sides of the patient are not known.
const AXES: [&str; 3] = ["Against the second axis", "Along the first axis", "Along the third axis"];

/// Adds the views below `top`; where they end.
pub(super) fn add_views(page: &mut Page, top: f64, shown: Shown<'_>) -> f64 {
    let solid = Solid::of(shown.structures);
    let views = [View::from_front(), View::from_left(), View::from_feet()];
    let bounds = views.map(|view| solid.bounds(&view).unwrap_or_default());
    let width = ((INNER - 2.0 * GAP) / 3.0).floor();
    let scale = scale(&bounds, [width - 2.0 * RIM, MOST_HEIGHT - 2.0 * RIM]);
    let tallest = bounds.iter().map(|[low, high]| high[1] - low[1]).fold(0.0, f64::max);
    let height = (scale * tallest + 2.0 * RIM).clamp(120.0, MOST_HEIGHT).ceil();
    for (n, view) in views.into_iter().enumerate() {
        let left = EDGE + n as f64 * (width + GAP);
        let heading = if shown.is_oriented { VIEWS[n] } else { AXES[n] };
        page.words(heading, [left, top + 14.0], HEADING, INK);
        let [low, high] = bounds[n];
        let center = [f64::midpoint(low[0], high[0]), f64::midpoint(low[1], high[1])];
        let panel = Panel { view, at: [left, top + 20.0], size: [width, height], center, scale };
        panel.add(page, &solid, shown);
    }
    let below = top + 20.0 + height;
    add_scale_bar(page, [EDGE, below + 18.0], scale);
    add_legend(page, [EDGE + 230.0, below + 18.0], shown);
    below + 62.0
}

/// Units for a millimetre at which every view has room; 1 of nothing.
fn scale(bounds: &[[[f64; 2]; 2]; 3], room: [f64; 2]) -> f64 {
    let mut scale = f64::INFINITY;
    for [low, high] in bounds {
        for axis in 0..2 {
            scale = scale.min(room[axis] / (high[axis] - low[axis]).max(1e-9));
        }
    }
    if scale.is_finite() && scale < 1e8 { scale } else { 1.0 }
}

/// A view at its place.
struct Panel {
    view: View,
    at: [f64; 2],
    size: [f64; 2],
    /// In its middle, mm.
    center: [f64; 2],
    /// Units for a millimetre.
    scale: f64,
}

impl Panel {
    fn add(&self, page: &mut Page, solid: &Solid, shown: Shown<'_>) {
        page.picture(
            picture(solid, &self.view, (self.size, page.dots), (self.center, self.scale), shown.range),
            self.at,
        );
        if shown.is_oriented {
            self.add_letters(page);
        }
        if shown.structures.len() > 1 && shown.structures.len() <= MOST_BADGES {
            for (n, structure) in shown.structures.iter().enumerate() {
                if let Some(middle) = middle(structure) {
                    add_badge(page, self.place(middle), &(n + 1).to_string(), INK);
                }
            }
        }
        if let Some(place) = shown.place {
            add_badge(page, self.place(place), "!", MARK);
        }
    }

    fn place(&self, point: WorldPoint) -> [f64; 2] {
        let [x, y, _] = self.view.project(point);
        let [left, top] = self.at;
        [
            left + self.size[0] / 2.0 + self.scale * (x - self.center[0]),
            top + self.size[1] / 2.0 - self.scale * (y - self.center[1]),
        ]
    }

    fn add_letters(&self, page: &mut Page) {
        let ([left, top], [width, height]) = (self.at, self.size);
        let [to_left, to_right, to_top, to_bottom] = self.view.letters().map(String::from);
        let middle = [left + width / 2.0, top + height / 2.0];
        page.words(&to_left, [left + 2.0, middle[1] + 5.0], STRONG, QUIET);
        page.words_to(&to_right, [left + width - 2.0, middle[1] + 5.0], STRONG, QUIET);
        page.words_around(&to_top, [middle[0], top + 14.0], STRONG, QUIET);
        page.words_around(&to_bottom, [middle[0], top + height - 4.0], STRONG, QUIET);
    }
}

/// A picture of a solid of a size in units.
pub(super) fn picture(
    solid: &Solid,
    view: &View,
    (size, dots): ([f64; 2], u32),
    (center_mm, scale): ([f64; 2], f64),
    range: Range,
) -> Pixels {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the cast keeps to the ends")]
    let size_px = size.map(|length| (length * f64::from(dots)).round() as usize);
    solid.picture(view, Frame { size_px, center_mm, scale: scale * f64::from(dots) }, range)
}

/// A number or sign on a disc.
pub(super) fn add_badge(page: &mut Page, [x, y]: [f64; 2], text: &str, color: Rgb) {
    const WHITE: Rgb = [255; 3];
    const LETTERS: (crate::drawing::Typeface, f64) = (crate::drawing::Typeface::Bold, 12.0);
    let radius = if text.len() > 2 { 12.0 } else { 10.0 };
    page.elements.push(Element::Disc { at: [x, y], radius: radius + 1.5, color: WHITE });
    page.elements.push(Element::Disc { at: [x, y], radius, color });
    page.words_around(text, [x, y + 4.4], LETTERS, WHITE);
}

/// The mean of the nodes of a structure, else of the corners of its mask; `None` without any.
fn middle(structure: &Structure) -> Option<WorldPoint> {
    let mut nodes: Vec<WorldPoint> = Vec::new();
    for figure in &structure.figures {
        match figure {
            Figure::Sheet(sheet) => nodes.extend(&sheet.medial),
            Figure::Tube(tube) => nodes.extend(&tube.centreline),
        }
    }
    if nodes.is_empty() {
        nodes.extend(&structure.object.positions);
    }
    nodes.retain(|node| node.iter().all(|x| x.is_finite()));
    let sum = nodes.iter().fold(WorldPoint::origin().coords, |sum, node| sum + node.coords);
    (!nodes.is_empty()).then(|| WorldPoint::from(sum / nodes.len() as f64))
}

/// A bar of a round length.
fn add_scale_bar(page: &mut Page, [left, top]: [f64; 2], scale: f64) {
    let length_mm = round_step(150.0 / scale);
    let length = length_mm * scale;
    page.rectangle([left, top + 5.0], [length, 2.0], INK);
    for x in [left, left + length - 2.0] {
        page.rectangle([x, top], [2.0, 12.0], INK);
    }
    page.words(&format!("{} mm", told(length_mm)), [left, top + 30.0], SMALL, INK);
}

/// The colour map with its lengths, and what the greys mean.
fn add_legend(page: &mut Page, [left, top]: [f64; 2], shown: Shown<'_>) {
    const BAR: [f64; 2] = [320.0, 12.0];
    const TICKS: usize = 4;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a size of ours")]
    let [width, height] = BAR.map(|length| length as usize * page.dots as usize);
    let mut bar = Pixels::new(width, height, [0; 3]);
    for x in 0..width {
        let color = viridis(x as f64 / (width - 1) as f64);
        (0..height).for_each(|y| bar.set(x, y, color));
    }
    page.picture(bar, [left, top]);
    let range = shown.range;
    for tick in 0..=TICKS {
        let share = tick as f64 / TICKS as f64;
        let x = left + share * BAR[0];
        page.rectangle([x - 0.5, top + BAR[1]], [1.0, 4.0], INK);
        let sign = match (tick, range.is_exceeded) {
            (0, [true, _]) => "< ",
            (TICKS, [_, true]) => "> ",
            _ => "",
        };
        let words = format!("{sign}{}", told(range.low_mm + share * (range.high_mm - range.low_mm)));
        page.words_around(&words, [x, top + 30.0], SMALL, INK);
    }
    let mut right = left + BAR[0] + 34.0;
    right = page.words("thickness, mm", [right, top + 11.0], STRONG, INK) + 22.0;
    for (color, what) in [(NO_THICKNESS, "repaired: not measured"), (BARE, "mask without a figure")] {
        let y = top + if color == BARE { 20.0 } else { 0.0 };
        page.rectangle([right, y], [14.0, 12.0], color);
        page.words(what, [right + 20.0, y + 11.0], SMALL, INK);
    }
    if shown.place.is_some() {
        add_badge(page, [left + BAR[0] + 44.0, top + 27.0], "!", MARK);
        page.words("see verdict", [left + BAR[0] + 60.0, top + 31.0], SMALL, INK);
    }
}

//! The pictures of a mask: with the paper's parameters on the left or above, with the defaults beside it.

use medialrep::drawing::{
    Key, Legend, Paint, Panel, Picture, Range, Scene, VECTOR_COLORS, View, WALL_COLOR, colors::category,
};
use medialrep::model::{Figure as Part, LatticeSize, Side, Structure};
use medialrep::space::WorldVector;

use super::{Figure, Pair, Shows};

/// How far the eye is lowered from straight above the sheet, so that vectors are seen from the side.
const TILT_DEG: f64 = 55.0;
/// How far the sheet is turned, so that no row lies along the line of sight.
const SPIN_DEG: f64 = 16.0;

/// The picture of a figure; `name` is what the mask is called.
pub fn picture(figure: &Figure, name: &str, pair: &Pair) -> Picture {
    let found: Vec<&Structure> = pair.both().into_iter().flatten().collect();
    let range = Range::of_thickness(found.iter().copied());
    let view = view(&found, figure.shows);
    let rows = match figure.shows {
        Shows::Sheet => vec![both(pair, |result, which| sheet_panel(result, which, (view, range)))],
        Shows::Surfaces => both(pair, |result, which| surface_panels(result, which, (view, range))),
        Shows::Points => vec![
            both(pair, |result, which| points_panel(result, which, view)),
            both(pair, |result, _| lattices_panel(result, (view, range))),
        ],
    };
    let columns = rows.iter().map(Vec::len).max().unwrap_or(1);
    Picture {
        title: format!("Figure {}, {name}", figure.number),
        description: described(figure, name),
        panel_px: if columns > 2 { 300.0 } else { 450.0 },
        rows,
        legend: legend(figure, &found, range),
    }
}

fn described(figure: &Figure, name: &str) -> String {
    let what = match figure.shows {
        Shows::Sheet => "The medial sheet, coloured by thickness, with the thickness vectors to both sides",
        Shows::Surfaces => {
            "The medial sheet with its thickness vectors, the upper surface and the lower surface, coloured by thickness"
        }
        Shows::Points => {
            "The points of the medial surface, each sheet in its colour, and the lattices of the sheets, coloured by thickness"
        }
    };
    format!("{what}: {name}, with the paper's parameters ({}) and with the defaults.", figure.joined_told())
}

/// Something for the paper's parameters and the same for the defaults, each with what they are called.
fn both<T>(pair: &Pair, of: impl Fn(&Result<Structure, String>, &str) -> T) -> Vec<T> {
    vec![of(&pair.paper, "The paper's parameters"), of(&pair.defaults, "Defaults")]
}

/// Of single sheets onto the upper side from the front; of several from a corner.
fn view(found: &[&Structure], shows: Shows) -> View {
    if shows == Shows::Points {
        return View::new(WorldVector::new(0.42, -0.75, 0.5), WorldVector::z()).unwrap_or_else(|| View::face_on(&[]));
    }
    found.last().map_or_else(|| View::face_on(&[]), |structure| View::of_structure(structure))
}

fn tilted(view: View) -> View {
    view.spun(SPIN_DEG).tilted(TILT_DEG)
}

fn sheet_panel(result: &Result<Structure, String>, heading: &str, (view, range): (View, Range)) -> Panel {
    let mut scene = Scene::default();
    let mut caption = String::new();
    match result {
        Ok(structure) => {
            scene.add_structure(structure, range);
            caption = told(structure);
        }
        Err(refusal) => caption.push_str(refusal),
    }
    Panel { scene, view: tilted(view), heading: heading.to_owned(), caption }
}

fn points_panel(result: &Result<Structure, String>, heading: &str, view: View) -> Panel {
    let mut scene = Scene::default();
    if let Ok(structure) = result {
        scene.add_sheet_points(structure, 1.9);
    }
    Panel { scene, view, heading: heading.to_owned(), caption: String::new() }
}

/// The sheets alone: vectors of several run through each other in a picture.
fn lattices_panel(result: &Result<Structure, String>, (view, range): (View, Range)) -> Panel {
    let mut scene = Scene::default();
    let mut caption = String::new();
    match result {
        Ok(structure) => {
            for sheet in structure.sheets() {
                scene.add_sheet(sheet, Paint::Thickness(range), 1.0);
            }
            let sizes: Vec<String> = structure.figures.iter().map(|part| size_of(part.grid())).collect();
            caption = format!("Sheets 1 to {}: {}.", sizes.len(), sizes.join(", "));
        }
        Err(refusal) => caption.push_str(refusal),
    }
    Panel { scene, view, heading: "Their lattices".to_owned(), caption }
}

/// The sheet with its vectors, and each side as it is seen from outside.
fn surface_panels(result: &Result<Structure, String>, which: &str, (view, range): (View, Range)) -> Vec<Panel> {
    let mut panels = vec![sheet_panel(result, which, (view, range))];
    let Ok(structure) = result else { return panels };
    for side in Side::BOTH {
        let mut scene = Scene::default();
        for part in &structure.figures {
            match part {
                Part::Sheet(sheet) => scene.add_side(sheet, side, Paint::Thickness(range), 1.0),
                Part::Tube(tube) => scene.add_wall(tube, Paint::Thickness(range), 1.0),
            }
        }
        let (view, heading) = match side {
            Side::Upper => (view, "Upper surface, from above"),
            Side::Lower => (view.turned_over(), "Lower surface, from below"),
        };
        panels.push(Panel { scene, view: view.tilted(25.0), heading: heading.to_owned(), caption: String::new() });
    }
    panels
}

/// The lattices of a structure, how many of their nodes are on the sheet, and of how many the vectors are drawn.
fn told(structure: &Structure) -> String {
    let mut words: Vec<String> = Vec::new();
    for part in &structure.figures {
        let mut told = size_of(part.grid());
        if let Part::Sheet(sheet) = part {
            let valid = sheet.valid.iter().filter(|valid| **valid).count();
            if valid < sheet.valid.len() {
                told += &format!(", {valid} nodes on the sheet");
            }
        }
        let step = Scene::vector_step(part.grid());
        if step > 1 {
            told += &format!(", vectors of every {} row and column", ordinal(step));
        }
        words.push(told);
    }
    format!("Lattice {}.", words.join("; "))
}

fn size_of(grid: LatticeSize) -> String {
    format!("{} × {}", grid.rows, grid.cols)
}

fn ordinal(number: usize) -> String {
    match number {
        2 => "second".to_owned(),
        3 => "third".to_owned(),
        other => format!("{other}th"),
    }
}

fn legend(figure: &Figure, found: &[&Structure], range: Range) -> Vec<Legend> {
    let has_tubes = found.iter().any(|structure| structure.tubes().next().is_some());
    let what = if has_tubes { "thickness (upper + lower; across a tube)" } else { "thickness (upper + lower)" };
    let mut keys = Vec::new();
    if figure.shows == Shows::Points {
        let most = found.iter().map(|structure| structure.sheets().count()).max().unwrap_or(0);
        for number in 0..most {
            keys.push(Key { color: category(number), what: format!("sheet {}", number + 1), is_line: false });
        }
    } else {
        for (color, what) in VECTOR_COLORS.into_iter().zip(["vectors to the upper side", "to the lower side"]) {
            keys.push(Key { color, what: what.to_owned(), is_line: true });
        }
        if has_tubes {
            keys.push(Key { color: WALL_COLOR, what: "centreline".to_owned(), is_line: true });
        }
    }
    vec![Legend::Map { range, what: what.to_owned() }, Legend::Keys(keys)]
}

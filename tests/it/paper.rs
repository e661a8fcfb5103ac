//! `docs/paper.md` and its pictures, held: what the program draws and says today against what was written then.

use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::Event;

use crate::measure::figures::document;
use crate::measure::figures::pictures::picture;
use crate::measure::figures::rows::to_markdown;
use crate::measure::figures::{FIGURES, Pair};

/// How far a number of the tables may move, as a share of what is written.
const SHARE: f64 = 0.05;

/// Whether two words are the same, or numbers that are near; a number may always move by one in its last digit.
fn is_near(was: &str, is: &str) -> bool {
    let bare = |word: &str| word.trim_matches(|c: char| !c.is_ascii_digit() && c != '-').to_owned();
    let (Ok(a), Ok(b)) = (bare(was).parse::<f64>(), bare(is).parse::<f64>()) else { return was == is };
    let decimals = bare(was).split_once('.').map_or(0, |(_, decimals)| decimals.len());
    let digit = 10f64.powi(-i32::try_from(decimals).unwrap());
    (a - b).abs() <= (SHARE * a.abs()).max(if decimals == 0 { 0.0 } else { 1.001 * digit })
}

fn check_table(was: &str, is: &str) {
    let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    let (old, new) = (words(was), words(is));
    let is_near = old.len() == new.len() && old.iter().zip(&new).all(|(was, is)| is_near(was, is));
    assert!(is_near, "was:\n{was}\nis:\n{is}\nif that is meant, write it with `make paper` in the same commit");
}

/// Texts of the elements of a name.
fn texts(svg: &str, name: &str) -> Vec<String> {
    let mut reader = Reader::from_str(svg);
    let (mut found, mut inside) = (Vec::new(), false);
    loop {
        match reader.read_event().expect("well-formed") {
            Event::Start(start) => inside = start.name().as_ref() == name,
            Event::Text(text) if inside => found.push(text.to_string()),
            Event::End(_) => inside = false,
            Event::Eof => return found,
            _ => {}
        }
    }
}

#[track_caller]
fn check_figure(slug: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let figure = FIGURES.iter().find(|figure| figure.slug() == slug).expect("a figure of that name");
    let pair = Pair::of_stand_in(figure);
    let text = document::read(root).expect("the document");
    let part = document::part(&text, slug).expect("its marks");
    assert_eq!(document::with_part(&text, slug, part).as_deref(), Some(text.as_str()));
    check_table(part, &to_markdown(&pair));

    let name = format!("{}, stand-in", figure.subject);
    let svg = picture(figure, &name, &pair).to_svg();
    assert_eq!(svg, picture(figure, &name, &pair).to_svg(), "equal bytes");
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "numbers");
    let written =
        std::fs::read_to_string(root.join(document::PICTURES).join(format!("{slug}.svg"))).expect("a picture");
    for name in ["title", "desc", "text"] {
        let (is, was) = (texts(&svg, name), texts(&written, name));
        assert!(!is.is_empty() && is == was, "{name}: was {was:?}, is {is:?}");
    }
    assert!(text.contains(&format!("({}/{slug}.svg)", document::PICTURES.trim_start_matches("docs/"))), "it is shown");
}

#[test]
fn figure_5_of_a_thalamus_is_as_written() {
    check_figure("5-thalamus");
}

#[test]
fn figure_5_of_a_caudate_is_as_written() {
    check_figure("5-caudate");
}

#[test]
fn figure_6_of_a_caudate_is_as_written() {
    check_figure("6-caudate");
}

#[test]
fn figure_6_of_a_supraspinatus_is_as_written() {
    check_figure("6-supraspinatus");
}

#[test]
fn figure_7_is_as_written() {
    check_figure("7-artificial-object");
}

#[test]
fn every_figure_is_held() {
    for figure in &FIGURES {
        assert!(
            include_str!("paper.rs").contains(&format!("check_figure(\"{}\");", figure.slug())),
            "{}",
            figure.slug()
        );
    }
}

#[test]
fn numbers_that_move_by_little_are_near() {
    for (was, is) in [("9.70", "9.71"), ("0.0002", "0.0003"), ("157", "160"), ("6", "6"), ("warn", "warn")] {
        assert!(is_near(was, is), "{was} {is}");
    }
    for (was, is) in [("9.70", "10.30"), ("0.0002", "0.0004"), ("6", "7"), ("warn", "pass"), ("9.70", "–")] {
        assert!(!is_near(was, is), "{was} {is}");
    }
}

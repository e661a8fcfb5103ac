//! Where parameters are told once more for those who don't run the program: held to the table of parameters.
//! `MEDIALREP_DOCS=write` brings the files up to date.

use std::path::Path;

use medialrep::params::{Given, PARAMS, Param, Shape, phrase};

/// Holds a file of this project to what it should say.
fn check_file(name: &str, wanted: impl FnOnce(&str) -> String) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
    let found = std::fs::read_to_string(&path).unwrap();
    let wanted = wanted(&found);
    if std::env::var_os("MEDIALREP_DOCS").is_some_and(|value| value == "write") {
        std::fs::write(&path, &wanted).unwrap();
    } else {
        assert!(found == wanted, "{name} is out of date (MEDIALREP_DOCS=write writes it); it should be:\n{wanted}");
    }
}

/// `text` with what stands between two lines replaced.
fn with_between(text: &str, begin: &str, end: &str, block: &str) -> String {
    let from = text.find(begin).expect("the first mark is there");
    let from = from + text[from..].find('\n').expect("a line ends") + 1;
    let to = text.find(end).expect("the second mark is there");
    format!("{}{block}{}", &text[..from], &text[to..])
}

fn row(param: &Param) -> String {
    let default = match param.default_value() {
        Given::Nothing => "–".to_owned(),
        default => format!("`{default}`"),
    };
    format!("| `{}` | {default} | {} | {} |\n", param.name, phrase(param.shapes), param.about)
}

#[test]
fn the_table_of_parameters_in_the_documents_is_that_of_the_program() {
    let mut table = "| name | default | takes | what it does |\n|---|---|---|---|\n".to_owned();
    for param in PARAMS {
        table.push_str(&row(param));
    }
    check_file("docs/parameters.md", |found| with_between(found, "<!-- parameters:", "<!-- end of", &table));
}

/// Names and words of a shape, as JSON writes them.
fn tokens(shape: &Shape, found: &mut Vec<String>) {
    match shape {
        Shape::Words(words) => found.extend(words.iter().map(|word| format!("\"{word}\""))),
        Shape::Fields(fields) => {
            for (name, part) in *fields {
                found.push(format!("\"{name}\":"));
                tokens(part, found);
            }
        }
        Shape::List { of, .. } => tokens(of, found),
        Shape::Texts { .. } => found.push("\"11\":".to_owned()),
        Shape::Count(_) | Shape::Number(_) | Shape::Label => {}
    }
}

#[test]
fn the_dictionary_of_the_fuzzer_has_every_name_and_word() {
    /// What JSON and numbers can go wrong by.
    const OTHERS: [&str; 11] = [
        "null",
        "true",
        "\\u0000",
        "\\ud800",
        "9223372036854775807",
        "-9223372036854775808",
        "18446744073709551615",
        "1e308",
        "4.9e-324",
        "0.1",
        "-0.0",
    ];
    let mut words = Vec::new();
    for param in PARAMS {
        words.push(format!("\"{}\":", param.name));
        for shape in param.shapes {
            tokens(shape, &mut words);
        }
    }
    words.extend(OTHERS.map(str::to_owned));
    let mut lines: Vec<String> = Vec::new();
    for word in words {
        let line = format!("\"{}\"\n", word.replace('\\', "\\\\").replace('"', "\\\""));
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    check_file("fuzz/dictionaries/params.dict", |_| lines.concat());
}

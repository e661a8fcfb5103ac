//! What the modules never do. A rule without a test is a wish.

use std::path::{Path, PathBuf};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const MAX_LINES: usize = 800;

/// Files of this project below a folder, and what they say.
pub fn sources(under: &str) -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    walk(&Path::new(ROOT).join(under), &mut files);
    files
}

fn walk(folder: &Path, files: &mut Vec<(PathBuf, String)>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() {
            walk(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            files.push((path, text));
        }
    }
}

/// Code without comments: those may name anything.
fn code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(at, line)| (at + 1, line.split("//").next().unwrap_or_default()))
}

fn check_never(under: &[&str], names: &[&str]) {
    let named = |line: &str| names.iter().any(|name| line.contains(name));
    let found: Vec<_> = under
        .iter()
        .flat_map(|under| sources(under))
        .flat_map(|(path, text)| {
            let lines: Vec<_> = code(&text)
                .filter(|(_, line)| named(line))
                .map(|(at, line)| format!("{}:{at}: {line}", path.display()))
                .collect();
            lines
        })
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn geometry_knows_no_files_no_network_and_no_clock_of_the_service() {
    let names = [
        "tokio",
        "axum",
        "serde",
        "tracing::",
        "std::fs",
        "std::env",
        "std::net",
        "crate::formats",
        "crate::jobs",
        "crate::http",
    ];
    check_never(&["src/pipeline", "src/numerics", "src/space"], &names);
}

/// Names that belong to one folder or file.
fn check_only_in(allowed: &[&str], names: &[&str]) {
    let mut found = Vec::new();
    for (path, text) in sources("src") {
        let place = path.strip_prefix(ROOT).unwrap();
        if allowed.iter().any(|allowed| place.starts_with(allowed)) {
            continue;
        }
        for (at, line) in code(&text).filter(|(_, line)| names.iter().any(|name| line.contains(name))) {
            found.push(format!("{}:{at}: {line}", place.display()));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_database_is_named_where_it_is_used_and_opened_only() {
    check_only_in(&["src/jobs/store/sqlite"], &["sqlx"]);
    check_only_in(&["src/jobs/store/sqlite", "src/jobs/store/mod.rs", "src/jobs/place.rs"], &["sqlite", "Sqlite"]);
}

/// What moves a job writes its history and its end too.
#[test]
fn no_statement_moves_a_job_past_the_table_of_moves() {
    check_never(&["src/jobs/store/sqlite"], &["SET state", ", state =", "history =", "ended_at_ms ="]);
}

#[test]
fn lower_layers_do_not_name_higher_ones() {
    check_never(&["src/params"], &["crate::", "serde"]);
    check_never(&["src/space"], &["crate::numerics", "crate::pipeline"]);
    check_never(&["src/numerics"], &["crate::pipeline"]);
    check_never(&["src/drawing"], &["crate::pipeline", "crate::formats", "serde", "std::fs", "std::env"]);
    check_never(&["src/formats"], &["crate::jobs", "crate::http", "crate::cli", "tokio", "axum"]);
    let above = ["axum", "crate::jobs", "crate::http", "crate::cli", "crate::config"];
    check_never(&["src/webhook", "src/dicomweb", "src/outbound.rs"], &above);
    check_never(&["src/webhook", "src/outbound.rs"], &["crate::formats"]);
    check_never(&["src/jobs"], &["axum", "crate::http", "crate::cli", "crate::config"]);
    check_never(&["src/http"], &["crate::cli"]);
}

#[test]
fn no_file_is_too_long() {
    for (path, text) in sources("src").into_iter().chain(sources("tests")) {
        assert!(text.lines().count() <= MAX_LINES, "{}", path.display());
    }
}

#[test]
fn tests_are_never_ignored() {
    for (path, text) in sources("src").into_iter().chain(sources("tests")) {
        assert!(!text.contains(concat!("#[", "ignore")), "{}", path.display());
    }
}

//! openapi.yaml: written by the program, true to the routes.

use axum::http::Method;
use medialrep::formats::params_json;
use medialrep::http::openapi_yaml;
use medialrep::params::PARAMS;
use serde_json::{Value, json};

use crate::help::support::{Server, mask};
use crate::tidy::sources;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/openapi.yaml");

#[test]
fn the_file_is_what_the_program_writes() {
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(FILE, openapi_yaml()).unwrap();
    }
    let file = std::fs::read_to_string(FILE).unwrap();
    assert!(file == openapi_yaml(), "openapi.yaml is out of date: UPDATE=1 cargo test the_file_is");
}

/// Methods and paths of the document: its keys at these depths.
fn operations() -> Vec<(Method, String)> {
    let yaml = openapi_yaml();
    let paths = yaml.split("\npaths:\n").nth(1).unwrap();
    let (mut path, mut found) = (String::new(), Vec::new());
    for line in paths.lines().take_while(|line| line.starts_with(' ')) {
        if let Some(key) = line.strip_prefix("  ").filter(|rest| rest.starts_with('/')) {
            path = key.trim_end_matches(':').to_owned();
        } else if let Some(key) = line.strip_prefix("    ").filter(|rest| rest.starts_with(char::is_alphabetic)) {
            found.push((key.trim_end_matches(':').to_uppercase().parse().unwrap(), path.clone()));
        }
    }
    found
}

#[tokio::test]
async fn every_route_in_the_document_is_served() {
    let server = Server::without_workers().await;
    let operations = operations();
    assert_eq!(operations.len(), 33, "{operations:?}");
    for (method, path) in operations {
        let answer = server.call(method.clone(), &path.replace("{id}", "1").replace("{name}", "x")).await;
        let media_type = answer.headers.get("content-type").map_or("", |value| value.to_str().unwrap());
        let is_problem = media_type.starts_with("application/problem");
        let code = if is_problem { answer.json()["code"].to_string() } else { String::new() };
        assert!(!code.contains("no_such_route") && !code.contains("method_not_allowed"), "{method} {path}: {code}");
    }
}

#[test]
fn every_operation_has_a_name_of_its_own() {
    let yaml = openapi_yaml();
    let mut names: Vec<_> = yaml.lines().filter(|line| line.trim_start().starts_with("operationId:")).collect();
    assert_eq!(names.len(), operations().len());
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), operations().len(), "{names:?}");
}

#[test]
fn every_answer_in_the_document_is_described() {
    let yaml = openapi_yaml();
    let blocks = yaml.split("\n        '").skip(1);
    let lacking: Vec<_> = blocks.filter(|block| !block.contains("\n          description: ")).collect();
    assert!(lacking.is_empty(), "{lacking:#?}");
}

/// The block of the schema Params in a document.
fn params_of(yaml: &str) -> Vec<&str> {
    let rest = yaml.lines().skip_while(|line| *line != "    Params:").skip(1);
    rest.take_while(|line| line.starts_with("      ")).collect()
}

#[tokio::test]
async fn the_limits_have_the_parameters_of_the_document() {
    let server = Server::without_workers().await;
    let told = server.get("/v1/limits").await.json()["params"].clone();
    let document = json!({
        "openapi": "3.1.0", "info": {"title": "", "version": ""}, "paths": {}, "components": {"schemas": {"Params": told}}
    });
    let yaml = serde_json::from_value::<utoipa::openapi::OpenApi>(document).unwrap().to_yaml().unwrap();
    let file = openapi_yaml();
    assert!(params_of(&yaml).len() > 50);
    assert_eq!(params_of(&yaml), params_of(&file));
    // In the order in which they are described, not in that of the alphabet.
    let names: Vec<&str> = told["properties"].as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(names, PARAMS.iter().map(|param| param.name).collect::<Vec<_>>());
}

#[tokio::test]
async fn the_defaults_that_the_limits_tell_are_accepted_and_change_nothing() {
    let server = Server::without_workers().await;
    let told = server.get("/v1/limits").await.json()["params"].clone();
    let properties = told["properties"].as_object().unwrap();
    let defaults: serde_json::Map<_, _> =
        properties.iter().filter_map(|(name, schema)| Some((name.clone(), schema.get("default")?.clone()))).collect();
    assert!(defaults.len() >= 7, "{defaults:?}");
    let query: String = form_urlencoded::byte_serialize(Value::from(defaults.clone()).to_string().as_bytes()).collect();
    let answer = server.post(&format!("/v1/jobs?params={query}"), mask()).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    let read = |params: &Value| params_json::parse(params.to_string().as_bytes()).unwrap();
    assert_eq!(read(&defaults.into()), read(&json!({})));
}

#[tokio::test]
async fn the_document_is_served() {
    let server = Server::without_workers().await;
    let answer = server.get("/openapi.yaml").await;
    assert_eq!((answer.header("content-type"), answer.text()), ("application/yaml", openapi_yaml()));
}

#[tokio::test]
async fn every_path_that_the_front_page_names_is_in_the_document() {
    let server = Server::without_workers().await;
    let index = server.get("/").await.text();
    for (_, path) in operations().iter().filter(|(_, path)| path != "/") {
        assert!(index.contains(path.as_str()), "{path}");
    }
}

/// Codes as they stand in the sources: where problems are made, and where errors have theirs.
fn codes() -> Vec<String> {
    let mut codes = Vec::new();
    for file in ["src/formats/read/error.rs", "src/model/refusal.rs"] {
        let text = std::fs::read_to_string(format!("{}/{file}", env!("CARGO_MANIFEST_DIR"))).unwrap();
        let body = text.split("fn code(&self)").nth(1).unwrap().split("\n    }\n").next().unwrap().to_owned();
        codes.extend(body.split('"').skip(1).step_by(2).map(str::to_owned));
    }
    for (path, text) in sources("src") {
        if path.components().any(|part| part.as_os_str() == "cli") {
            continue;
        }
        for call in ["Problem::new(", "busy(", "unauthorized("] {
            let made = text.split(call).skip(1).filter_map(|rest| rest.split(')').next()?.split('"').nth(1));
            codes.extend(made.map(str::to_owned));
        }
    }
    codes
}

#[test]
fn every_code_that_a_client_can_meet_is_in_the_document() {
    let yaml = openapi_yaml();
    let mut codes = codes();
    assert!(codes.len() > 50, "{codes:?}");
    // The command line's own, that of tests, and what becomes the state canceled.
    codes.retain(|code| !code.starts_with("cannot_") && code != "cancelled" && code.len() > 1);
    let lacking: Vec<_> = codes.iter().filter(|code| !yaml.contains(&format!("`{code}`"))).collect();
    assert!(lacking.is_empty(), "{lacking:?}");
}

//! The page that the program serves, and who gets the plain text instead.

use std::borrow::Cow;
use std::io::Read;

use axum::http::Method;
use flate2::read::GzDecoder;
use medialrep::http::web::{Page, PageFile};
use medialrep::jobs::token::{Scope, Token};
use sha2::{Digest, Sha256};

use crate::help::left_out::left_out;
use crate::help::support::{Answer, Server};

const BROWSER: (&str, &str) = ("accept", "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8");
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src \
                      'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
const SCRIPT: &str = "export const answer = 42;\n";
const PICTURE: &[u8] = b"\x89PNG";

/// A page of a few lines.
fn planted(name: &str) -> Option<PageFile> {
    let bytes: &'static [u8] = match name {
        "index.html" => b"<!doctype html><script type=module src=page.js></script>",
        "page.js" | "viewer.js" => SCRIPT.as_bytes(),
        "page.css" => b"body { margin: 0 }",
        "mark.svg" => b"<svg/>",
        "mark.png" => PICTURE,
        _ => return None,
    };
    Some(PageFile { bytes: Cow::Borrowed(bytes), sha256: Sha256::digest(bytes).into() })
}

async fn get(server: &Server, path: &str, headers: &[(&str, &str)]) -> Answer {
    server.with(Method::GET, path, headers, Vec::new()).await
}

fn unzipped(bytes: &[u8]) -> String {
    let mut text = String::new();
    GzDecoder::new(bytes).read_to_string(&mut text).unwrap();
    text
}

fn vary(answer: &Answer) -> String {
    let all: Vec<_> = answer.headers.get_all("vary").iter().map(|value| value.to_str().unwrap()).collect();
    all.join(", ").to_lowercase()
}

#[tokio::test]
async fn a_browser_gets_the_page_and_a_program_the_text() {
    let server = Server::with_page(planted).await;
    let page = get(&server, "/", &[BROWSER]).await;
    assert_eq!((page.status.as_u16(), page.header("content-type")), (200, "text/html; charset=utf-8"));
    assert!(page.text().contains("page.js"));
    assert!(vary(&page).contains("accept, accept-encoding"), "{}", vary(&page));
    for headers in [&[][..], &[("accept", "*/*")], &[("accept", "text/plain")]] {
        let text = get(&server, "/", headers).await;
        assert_eq!((text.status.as_u16(), text.header("content-type")), (200, "text/plain; charset=utf-8"));
        assert!(text.text().starts_with("medialrep: "));
        assert!(vary(&text).contains("accept"), "{}", vary(&text));
    }
    let head = server.with(Method::HEAD, "/", &[BROWSER], Vec::new()).await;
    assert_eq!((head.status.as_u16(), head.header("content-type")), (200, "text/html; charset=utf-8"));
    assert!(head.body.is_empty());
}

#[tokio::test]
async fn a_browser_is_told_when_the_page_is_not_built() {
    let server = Server::with_page(|_| None).await;
    let page = get(&server, "/", &[BROWSER]).await;
    assert_eq!((page.status.as_u16(), page.header("content-type")), (200, "text/html; charset=utf-8"));
    for what in ["make web", "npm ci", "npm run build", "href=\"/docs\"", "href=\"/openapi.yaml\""] {
        assert!(page.text().contains(what), "{what}");
    }
    assert!(!page.text().contains("<script"));
    assert_eq!(page.header("content-security-policy"), "default-src 'none'; frame-ancestors 'none'");
    // Nothing of it is kept: the next program may have the page.
    assert_eq!(page.header("cache-control"), "no-store");
    assert!(get(&server, "/", &[]).await.text().starts_with("medialrep: "));
    server.get("/page.js").await.is_problem(404, "no_such_route");
    assert_eq!(server.get("/v1/limits").await.status, 200);
}

#[tokio::test]
async fn files_have_their_types_and_leave_the_server_under_one_policy() {
    let server = Server::with_page(planted).await;
    for (path, media_type) in [
        ("/page.js", "text/javascript; charset=utf-8"),
        ("/viewer.js", "text/javascript; charset=utf-8"),
        ("/page.css", "text/css; charset=utf-8"),
        ("/mark.svg", "image/svg+xml; charset=utf-8"),
        ("/mark.png", "image/png"),
    ] {
        let file = server.get(path).await;
        assert_eq!((file.status.as_u16(), file.header("content-type")), (200, media_type), "{path}");
        assert_eq!(file.body, &*planted(&path[1..]).unwrap().bytes, "{path}");
        assert_eq!(file.header("content-security-policy"), POLICY);
        assert_eq!((file.header("cache-control"), file.header("x-content-type-options")), ("no-cache", "nosniff"));
        assert_eq!((file.header("x-frame-options"), file.header("referrer-policy")), ("DENY", "no-referrer"));
        let head = server.call(Method::HEAD, path).await;
        assert_eq!((head.status.as_u16(), head.header("content-type")), (200, media_type), "{path}");
        assert!(head.body.is_empty());
    }
    assert_eq!(get(&server, "/", &[BROWSER]).await.header("content-security-policy"), POLICY);
}

#[tokio::test]
async fn what_the_browser_has_is_not_sent_again() {
    let server = Server::with_page(planted).await;
    for path in ["/", "/page.js"] {
        let first = get(&server, path, &[BROWSER]).await;
        let etag = first.header("etag").to_owned();
        assert!(etag.starts_with("W/\""), "{etag}");
        let again = get(&server, path, &[BROWSER, ("if-none-match", &etag)]).await;
        assert_eq!((again.status.as_u16(), again.body.len()), (304, 0), "{path}");
        assert_eq!((again.header("etag"), again.header("cache-control")), (&*etag, "no-cache"));
        assert!(vary(&again).contains("accept-encoding"), "{}", vary(&again));
        assert_eq!(get(&server, path, &[BROWSER, ("if-none-match", "W/\"other\"")]).await.status, 200);
    }
    // The text is no copy of the page.
    let etag = get(&server, "/", &[BROWSER]).await.header("etag").to_owned();
    assert_eq!(get(&server, "/", &[("if-none-match", &etag)]).await.status, 200);
}

#[tokio::test]
async fn only_texts_of_the_page_are_compressed() {
    let server = Server::with_page(planted).await;
    let plain = server.get("/viewer.js").await;
    for _ in 0..2 {
        let zipped = get(&server, "/viewer.js", &[("accept-encoding", "br;q=1.0, gzip;q=0.8")]).await;
        assert_eq!((zipped.header("content-encoding"), &*unzipped(&zipped.body)), ("gzip", SCRIPT));
        assert_eq!(zipped.header("content-length"), zipped.body.len().to_string());
        assert_eq!(zipped.header("etag"), plain.header("etag"));
        assert!(vary(&zipped).contains("accept-encoding"));
    }
    let page = get(&server, "/", &[BROWSER, ("accept-encoding", "gzip")]).await;
    assert!(unzipped(&page.body).contains("page.js"));
    for (path, accepted) in [
        ("/viewer.js", "gzip;q=0"),
        ("/viewer.js", "br"),
        ("/mark.png", "gzip"),
        ("/v1/limits", "gzip"),
        ("/openapi.yaml", "gzip"),
        ("/nothing", "gzip"),
        ("/nothing", "identity;q=0"),
    ] {
        let answer = get(&server, path, &[("accept-encoding", accepted)]).await;
        assert!(!answer.headers.contains_key("content-encoding"), "{path}, {accepted}");
        assert_eq!(answer.status.as_u16(), if path == "/nothing" { 404 } else { 200 });
    }
}

#[tokio::test]
async fn pages_of_allowed_origins_may_load_the_viewer() {
    let server = Server::with_page(planted).await;
    let allowed = get(&server, "/viewer.js", &[("origin", "https://viewer.example.org")]).await;
    assert_eq!(allowed.status, 200);
    assert_eq!(allowed.header("access-control-allow-origin"), "https://viewer.example.org");
    assert!(vary(&allowed).contains("origin") && vary(&allowed).contains("accept-encoding"), "{}", vary(&allowed));
    let other = get(&server, "/viewer.js", &[("origin", "https://evil.example")]).await;
    assert!(!other.headers.contains_key("access-control-allow-origin"));
    assert_eq!(other.header("cross-origin-resource-policy"), "same-origin");
}

#[tokio::test]
async fn the_page_asks_for_no_token() {
    let server = Server::with_page(planted).await;
    let token = Token::new().unwrap().stored("t".to_owned(), vec![Scope::Read], None);
    server.jobs.store().insert_token(&token).await.unwrap();
    server.get("/v1/jobs").await.is_problem(401, "token_missing");
    assert_eq!(get(&server, "/", &[BROWSER]).await.status, 200);
    for path in ["/page.js", "/viewer.js"] {
        assert_eq!(server.get(path).await.status, 200, "{path}");
    }
}

#[tokio::test]
async fn what_is_no_file_of_the_page_is_a_problem() {
    let server = Server::with_page(planted).await;
    for path in
        ["/nothing.js", "/index.html", "/v1/nothing", "/.gitignore", "//page.js", "/page.js/", "/%2e%2e/page.js"]
    {
        get(&server, path, &[BROWSER]).await.is_problem(404, "no_such_route");
    }
    for path in ["/page.js", "/nothing.js"] {
        server.post(path, Vec::new()).await.is_problem(404, "no_such_route");
        server.call(Method::DELETE, path).await.is_problem(404, "no_such_route");
    }
    server.post("/", Vec::new()).await.is_problem(405, "method_not_allowed");
}

#[tokio::test]
async fn the_program_serves_the_page_that_was_built() {
    let server = Server::without_workers().await;
    server.get("/.gitignore").await.is_problem(404, "no_such_route");
    let page = get(&server, "/", &[BROWSER]).await;
    assert_eq!((page.status.as_u16(), page.header("content-type")), (200, "text/html; charset=utf-8"));
    if Page::built().file("index.html").is_none() {
        assert!(page.text().contains("make web"));
        return left_out("the page is not built (make web), so its files were not looked at");
    }
    assert_eq!(page.header("content-security-policy"), POLICY);
    for path in ["/page.js", "/page.css", "/viewer.js"] {
        assert_eq!(server.get(path).await.status, 200, "{path}");
    }
    assert!(page.text().contains("page.js"));
    assert!(!page.text().contains("=\"http"), "all of it comes from this server");
}

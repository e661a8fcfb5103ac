//! `GET /v1/jobs/{id}/results/{name}`.

use axum::body::Body;
use axum::http::Request;

use crate::support::{Answer, Server, content, writes};

async fn done() -> (Server, String) {
    let server = Server::start(writes()).await;
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
    (server, format!("{job}/results/thickness.json"))
}

async fn get_with(server: &Server, path: &str, headers: &[(&str, &str)]) -> Answer {
    let request = headers.iter().fold(Request::get(path), |request, (name, value)| request.header(*name, *value));
    server.send(request.body(Body::empty()).unwrap()).await
}

#[tokio::test]
async fn a_result_is_served_whole() {
    let (server, path) = done().await;
    let answer = server.get(&path).await;
    assert_eq!((answer.status.as_u16(), &answer.body), (200, &content("thickness.json")));
    assert_eq!(answer.header("content-type"), "application/json");
    assert_eq!(answer.header("content-length"), answer.body.len().to_string());
    assert_eq!(answer.header("content-disposition"), "attachment; filename=\"thickness.json\"");
    assert_eq!(answer.header("cache-control"), "private, max-age=31536000, immutable");
    let job = server.get(path.split("/results").next().unwrap()).await.json();
    assert_eq!(answer.header("etag"), format!("\"{}\"", job["results"][1]["sha256"].as_str().unwrap()));
}

#[tokio::test]
async fn a_client_that_has_it_gets_nothing() {
    let (server, path) = done().await;
    let etag = server.get(&path).await.header("etag").to_owned();
    for tag in [etag.as_str(), "*", &format!("\"other\", W/{etag}")] {
        let answer = get_with(&server, &path, &[("if-none-match", tag)]).await;
        assert_eq!((answer.status.as_u16(), answer.body.len()), (304, 0), "{tag}");
        assert_eq!(answer.header("etag"), etag);
    }
    assert_eq!(get_with(&server, &path, &[("if-none-match", "\"other\"")]).await.status, 200);
}

#[tokio::test]
async fn a_range_is_served() {
    let (server, path) = done().await;
    let all = content("thickness.json");
    let answer = get_with(&server, &path, &[("range", "bytes=3-6")]).await;
    assert_eq!((answer.status.as_u16(), &answer.body[..]), (206, &all[3..=6]));
    assert_eq!(answer.header("content-range"), format!("bytes 3-6/{}", all.len()));
    assert_eq!(answer.header("content-length"), "4");
    let tail = get_with(&server, &path, &[("range", "bytes=-5")]).await;
    assert_eq!(&tail.body[..], &all[all.len() - 5..]);
    get_with(&server, &path, &[("range", "bytes=999-")]).await.is_problem(416, "range_not_satisfiable");
    let changed = get_with(&server, &path, &[("range", "bytes=3-6"), ("if-range", "\"other\"")]).await;
    assert_eq!((changed.status.as_u16(), changed.body), (200, all));
}

#[tokio::test]
async fn only_published_names_are_served() {
    let (server, path) = done().await;
    let results = path.strip_suffix("thickness.json").unwrap();
    for name in ["points.csv", "nothing", "..", "..%2f..%2f..%2fjobs.sqlite", "%2fetc%2fpasswd"] {
        server.get(&format!("{results}{name}")).await.is_problem(404, "no_such_result");
    }
}

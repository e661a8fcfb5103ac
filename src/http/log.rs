//! One line per request. Routes, never paths or queries: those hold what clients wrote.

use std::time::Instant;

use axum::extract::{MatchedPath, Request};
use axum::middleware::Next;
use axum::response::Response;

/// Logs method, route, status and time.
pub async fn requests(request: Request, next: Next) -> Response {
    let begun = Instant::now();
    let method = request.method().clone();
    let route = request.extensions().get::<MatchedPath>().map_or("none", MatchedPath::as_str).to_owned();
    let response = next.run(request).await;
    let (status, ms) = (response.status().as_u16(), (begun.elapsed().as_secs_f64() * 1e6).round() / 1e3);
    tracing::info!(%method, route, status, ms, "request");
    response
}

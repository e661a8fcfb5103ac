//! The service over HTTP. Handlers extract, make one call, and wrap what comes back; what they
//! call knows no HTTP.

use std::sync::Arc;

use axum::Router;
use axum::http::HeaderValue;
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use axum::middleware::from_fn;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::set_header::SetResponseHeaderLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::jobs::queue::Jobs;

pub mod server;

mod ops;

mod jobs;

mod submit;

mod results;

mod view;

mod params_schema;

mod extract;

mod error;

mod log;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "medialrep",
        description = "Medial shape representation of anatomy: a label mask (NIfTI) in, the medial sheet, surfaces \
                       and thickness vectors out. Every error is a problem object (RFC 9457) with a stable `code`.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0")
    ),
    tags(
        (name = "jobs", description = "Send a mask, watch its job, take its results."),
        (name = "operation", description = "Whether the service works, and what it can do.")
    ),
    components(schemas(params_schema::ParamsSchema))
)]
struct Document;

/// The service's routes.
pub fn router(jobs: Arc<Jobs>) -> Router {
    let (routes, _) = routes().split_for_parts();
    let header = SetResponseHeaderLayer::if_not_present;
    routes
        .fallback(error::no_such_route)
        .method_not_allowed_fallback(error::wrong_method)
        .with_state(jobs)
        .layer(CatchPanicLayer::custom(error::handler_panicked))
        .layer(header(CACHE_CONTROL, HeaderValue::from_static("no-store")))
        .layer(header(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")))
        .layer(header(X_FRAME_OPTIONS, HeaderValue::from_static("DENY")))
        .layer(header(REFERRER_POLICY, HeaderValue::from_static("no-referrer")))
        .layer(header(CONTENT_SECURITY_POLICY, HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'")))
        .layer(from_fn(log::requests))
}

/// The description of the routes, OpenAPI 3.1 in YAML.
///
/// # Panics
/// Never: the document is plain data.
#[must_use]
pub fn openapi_yaml() -> String {
    let (_, document) = routes().split_for_parts();
    document.to_yaml().expect("plain data is YAML")
}

fn routes() -> OpenApiRouter<Arc<Jobs>> {
    OpenApiRouter::with_openapi(Document::openapi())
        .routes(routes!(jobs::submit, jobs::list))
        .routes(routes!(jobs::status, jobs::delete))
        .routes(routes!(jobs::cancel))
        .routes(routes!(results::result))
        .routes(routes!(ops::index))
        .routes(routes!(ops::livez))
        .routes(routes!(ops::readyz))
        .routes(routes!(ops::openapi))
}

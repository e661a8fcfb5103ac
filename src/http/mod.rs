//! The service over HTTP. Handlers extract, make one call, and wrap what comes back; what they
//! call knows no HTTP.

use std::sync::Arc;
use std::time::Duration;

use axum::http::header::{
    ACCEPT, AUTHORIZATION, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_RANGE, CONTENT_SECURITY_POLICY, CONTENT_TYPE,
    ETAG, IF_NONE_MATCH, LINK, LOCATION, RANGE, REFERRER_POLICY, RETRY_AFTER, WARNING, X_CONTENT_TYPE_OPTIONS,
    X_FRAME_OPTIONS,
};
use axum::http::{HeaderName, HeaderValue, Method};
use axum::middleware::from_fn_with_state;
use axum::routing::get;
use axum::{Extension, Router};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::cors::CorsLayer;
use tower_http::set_header::SetResponseHeaderLayer;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::{Modify, OpenApi};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use self::auth::Access;
use self::ops::Description;
use self::web::Page;
use crate::jobs::service::Jobs;

mod connections;

pub mod server;

pub mod auth;

mod ops;

mod limits;

mod samples;

mod docs;

pub mod web;

mod jobs;

mod submit;

mod source;

mod stow;

mod dicom_path;

mod accept;

mod qido;

mod related;

mod wado;

mod metadata;

mod results;

mod events;

mod view;

mod params_schema;

mod extract;

mod error;

mod trace;

/// How long a browser may remember what another origin is allowed.
const CORS_MAX_AGE: Duration = Duration::from_secs(600);

#[derive(OpenApi)]
#[openapi(
    info(
        title = "medialrep",
        description = "Medial shape representation of anatomy: a label mask in, the medial sheet, surfaces \
                       and thickness vectors out. Every error is a problem object (RFC 9457) with a stable `code`. \
                       Any path may answer 404 `no_such_route`, 405 `method_not_allowed`, 500 `internal` and 503 \
                       `store_unavailable`.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0")
    ),
    tags(
        (name = "jobs", description = "Send a mask, watch its job, take its results."),
        (name = "dicomweb", description = "Segmentations stored by an archive (STOW-RS); results that it finds and fetches (QIDO-RS, WADO-RS)."),
        (name = "samples", description = "Masks to try the service on."),
        (name = "operation", description = "Whether the service works, and what it can do.")
    ),
    components(schemas(params_schema::ParamsSchema, events::StateEvent)),
    modifiers(&Token),
    security((), ("token" = []))
)]
struct Document;

/// The token, asked for once the operator has made one.
struct Token;

impl Modify for Token {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let about = "Made with `medialrep token create`. Scopes are read, write and metrics. Not asked for as long as \
                     the service has no tokens.";
        let scheme = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(about)).build();
        let components = document.components.get_or_insert_default();
        components.security_schemes.insert("token".to_owned(), SecurityScheme::Http(scheme).into());
    }
}

/// The service's routes, and the page that this program was built with.
pub fn router(jobs: Arc<Jobs>, access: Access) -> Router {
    router_with_page(jobs, access, Page::built())
}

/// The service's routes, and that page.
pub fn router_with_page(jobs: Arc<Jobs>, access: Access, page: Page) -> Router {
    let (routes, document) = routes().split_for_parts();
    let header = SetResponseHeaderLayer::if_not_present;
    let (cors, own_origin) = (cors(&access.cors_origins), HeaderName::from_static("cross-origin-resource-policy"));
    routes
        .fallback(web::file)
        .method_not_allowed_fallback(error::wrong_method)
        .with_state(Arc::clone(&jobs))
        .layer(Extension(Arc::new(access)))
        .layer(Extension(page))
        .layer(Extension(Description::of(document)))
        .layer(cors)
        .layer(CatchPanicLayer::custom(error::handler_panicked))
        .layer(header(CACHE_CONTROL, HeaderValue::from_static("no-store")))
        .layer(header(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")))
        .layer(header(X_FRAME_OPTIONS, HeaderValue::from_static("DENY")))
        .layer(header(REFERRER_POLICY, HeaderValue::from_static("no-referrer")))
        .layer(header(own_origin, HeaderValue::from_static("same-origin")))
        .layer(header(CONTENT_SECURITY_POLICY, HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'")))
        .layer(from_fn_with_state(jobs, trace::requests))
}

/// What pages of the listed origins may do; without any, browsers let no page read an answer.
fn cors(origins: &[String]) -> CorsLayer {
    let origins: Vec<HeaderValue> = origins.iter().filter_map(|origin| origin.parse().ok()).collect();
    let sent = ["idempotency-key", "prefer", "last-event-id", "traceparent"].map(HeaderName::from_static);
    let seen = ["preference-applied", "idempotent-replayed"].map(HeaderName::from_static);
    CorsLayer::new()
        .allow_origin(origins)
        .allow_methods([Method::GET, Method::POST, Method::DELETE])
        .allow_headers(
            [ACCEPT, AUTHORIZATION, CACHE_CONTROL, CONTENT_TYPE, IF_NONE_MATCH, RANGE]
                .into_iter()
                .chain(sent)
                .collect::<Vec<_>>(),
        )
        .expose_headers(
            [CONTENT_DISPOSITION, CONTENT_RANGE, ETAG, LINK, LOCATION, RETRY_AFTER, WARNING]
                .into_iter()
                .chain(seen)
                .collect::<Vec<_>>(),
        )
        .max_age(CORS_MAX_AGE)
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
        .routes(routes!(events::events))
        .routes(routes!(jobs::cancel))
        .routes(routes!(jobs::retry))
        .routes(routes!(results::pick))
        .routes(routes!(results::result))
        .routes(routes!(stow::store, qido::studies))
        .routes(routes!(qido::series))
        .routes(routes!(qido::instances))
        .routes(routes!(stow::store_in_study, wado::retrieve_study))
        .routes(routes!(metadata::study_metadata))
        .routes(routes!(qido::series_of_study))
        .routes(routes!(qido::instances_of_study))
        .routes(routes!(wado::retrieve_series))
        .routes(routes!(metadata::series_metadata))
        .routes(routes!(qido::instances_of_series))
        .routes(routes!(wado::retrieve_instance))
        .routes(routes!(metadata::instance_metadata))
        .routes(routes!(metadata::bulk_data))
        .routes(routes!(limits::limits))
        .routes(routes!(samples::samples))
        .routes(routes!(samples::sample))
        .routes(routes!(web::front))
        .routes(routes!(ops::livez))
        .routes(routes!(ops::readyz))
        .routes(routes!(ops::metrics))
        .routes(routes!(ops::openapi))
        .routes(routes!(docs::page))
        .route("/docs/{file}", get(docs::file))
}

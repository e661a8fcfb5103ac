//! `/docs`: the description of the API as a page to read and try, all of it in this program.

use std::sync::{Arc, LazyLock};

use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::response::{IntoResponse, Redirect, Response};
use utoipa_swagger_ui::{Config, serve};

use super::error::ApiError;
use crate::problem::Problem;

/// The page writes styles into itself; everything else comes from this server.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
                      connect-src 'self'; frame-ancestors 'none'";

/// This description as a page.
#[utoipa::path(get, path = "/docs", tag = "operation", security(()), responses((status = 303, description = "To /docs/index.html")))]
pub async fn page() -> Redirect {
    Redirect::to("/docs/index.html")
}

/// A file of the page.
pub async fn file(name: Result<Path<String>, PathRejection>) -> Result<Response, ApiError> {
    // Nothing is checked by a server elsewhere.
    static CONFIG: LazyLock<Arc<Config<'static>>> =
        LazyLock::new(|| Arc::new(Config::from("/openapi.yaml").validator_url("none")));
    let Ok(Path(name)) = name else { return Err(no_such_route_here()) };
    let found = serve(&name, Arc::clone(&CONFIG)).map_err(|_| Problem::internal())?;
    let found = found.ok_or_else(no_such_route_here)?;
    let headers =
        [(CONTENT_TYPE, found.content_type.as_str()), (CONTENT_SECURITY_POLICY, POLICY), (CACHE_CONTROL, "no-cache")];
    Ok((headers, found.bytes.into_owned()).into_response())
}

fn no_such_route_here() -> ApiError {
    Problem::new(404, "no_such_route", "there is no such page").hint("GET /docs is the documentation").into()
}

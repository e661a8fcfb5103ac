//! Extractors whose refusals are problem objects.

use axum::extract::{FromRequestParts, Path, Query};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName};
use serde::de::DeserializeOwned;

use super::error::{ApiError, no_such_job};
use crate::jobs::job::JobId;
use crate::problem::Problem;

/// A header as text; what is no text is none that anybody expects.
pub fn header(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name).map(|value| value.to_str().unwrap_or("unreadable"))
}

/// The job of a path `…/{id}`.
pub struct JobPath(pub JobId);

impl<S: Send + Sync> FromRequestParts<S> for JobPath {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let path = Path::<String>::from_request_parts(parts, state).await;
        path.ok().and_then(|Path(id)| JobId::parse(&id)).map(Self).ok_or_else(no_such_job)
    }
}

/// The job and the file name of a path `…/{id}/…/{name}`.
pub struct ResultPath(pub JobId, pub String);

impl<S: Send + Sync> FromRequestParts<S> for ResultPath {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let path = Path::<(String, String)>::from_request_parts(parts, state).await;
        let Ok(Path((id, name))) = path else { return Err(no_such_job()) };
        JobId::parse(&id).map(|id| Self(id, name)).ok_or_else(no_such_job)
    }
}

/// The query. Unknown names are refused where `T` refuses them: a misspelt one would be ignored
/// in silence.
pub struct StrictQuery<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequestParts<S> for StrictQuery<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        match Query::<T>::from_request_parts(parts, state).await {
            Ok(Query(query)) => Ok(Self(query)),
            Err(rejection) => Err(Problem::new(400, "invalid_query", rejection.body_text()).at("query").into()),
        }
    }
}

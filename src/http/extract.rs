//! Extractors whose refusals are problem objects, and what else is read out of headers.

use axum::extract::{FromRequestParts, Path, Query};
use axum::http::header::IF_NONE_MATCH;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName};
use serde::de::DeserializeOwned;
use utoipa::IntoParams;

use super::error::{ApiError, no_such_job};
use crate::jobs::job::JobId;
use crate::problem::Problem;

/// A header as text; what is no text is none that anybody expects.
pub fn header(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name).map(|value| value.to_str().unwrap_or("unreadable"))
}

/// A header that is a list, which may be sent on several lines (RFC 9110, section 5.3), in one; nothing where it is not sent.
pub fn list_header(headers: &HeaderMap, name: HeaderName) -> String {
    let lines: Vec<&str> = headers.get_all(name).iter().map(|value| value.to_str().unwrap_or("unreadable")).collect();
    lines.join(", ")
}

/// Whether a list without quoted commas has this token, in any case.
pub fn has_token(list: &str, token: &str) -> bool {
    list.split(',').any(|one| one.trim().eq_ignore_ascii_case(token))
}

/// Whether the client says that it has what this ETag stands for.
pub fn has_it(headers: &HeaderMap, etag: &str) -> bool {
    is_listed(&list_header(headers, IF_NONE_MATCH), etag)
}

fn is_listed(list: &str, etag: &str) -> bool {
    list.split(',').map(|tag| tag.trim().trim_start_matches("W/")).any(|tag| tag == "*" || tag == etag)
}

/// `type/subtype;q=0.5`, the range in lower case.
pub fn media_range(text: &str) -> (String, f32) {
    let mut parts = text.split(';').map(str::trim);
    let range = parts.next().unwrap_or_default().to_ascii_lowercase();
    let weight = parts.find_map(|part| part.strip_prefix("q=").or_else(|| part.strip_prefix("Q=")));
    (range, weight.and_then(|q| q.parse().ok()).unwrap_or(1.0))
}

/// The `{id}` of a path, described.
#[derive(IntoParams)]
#[into_params(parameter_in = Path)]
#[expect(dead_code, reason = "describes what JobPath and ResultPath take")]
pub struct IdParam {
    /// The job's id
    #[param(format = "uuid")]
    id: String,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_on_two_lines_is_one() {
        let mut headers = HeaderMap::new();
        headers.append(IF_NONE_MATCH, "\"x\"".parse().unwrap());
        headers.append(IF_NONE_MATCH, "\"y\"".parse().unwrap());
        assert!(has_it(&headers, "\"y\"") && !has_it(&headers, "\"z\""));
        assert!(has_token("no-store, No-Cache", "no-cache") && !has_token("", "no-cache"));
    }

    #[test]
    fn a_list_of_etags_is_searched() {
        assert!(is_listed("\"a\", W/\"b\"", "\"b\""));
        assert!(is_listed("*", "\"b\""));
        assert!(!is_listed("\"a\"", "\"b\""));
    }
}

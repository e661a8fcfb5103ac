//! Who asks. A handler that touches jobs takes [`Allowed`], and so cannot forget to ask.
//!
//! As long as no token was ever made, everybody who reaches the port is let in. A browser reaches
//! the loopback too, on behalf of any page it shows: so what comes from a page of another origin,
//! or under a name that is not this machine's, is turned away.

use std::marker::PhantomData;
use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use axum::extract::FromRequestParts;
use axum::http::header::{AUTHORIZATION, HOST, ORIGIN};
use axum::http::request::Parts;
use jiff::Timestamp;

use super::error::ApiError;
use super::extract::header;
use super::trace::TraceId;
use crate::audit::Action;
use crate::jobs::caller::{Caller, OpenRequest};
use crate::jobs::error::JobsError;
use crate::jobs::service::Jobs;
use crate::jobs::token::{Scope, Token};
use crate::problem::Problem;

/// What of the service's settings decides who is let in.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Access {
    /// Origins whose pages may use the service.
    pub cors_origins: Vec<String>,
    /// Whether only this machine reaches the port.
    pub is_local: bool,
}

/// What every route may answer that asks who is there; only described, never made.
#[derive(utoipa::IntoResponses)]
pub enum TokenProblems {
    /// `token_missing`, `token_invalid`
    #[response(status = 401, content_type = "application/problem+json")]
    Unknown(Problem),
    /// `scope_missing`, `foreign_host`, `foreign_origin`
    #[response(status = 403, content_type = "application/problem+json")]
    Forbidden(Problem),
}

/// `too_many_requests`
#[derive(utoipa::IntoResponses)]
#[response(status = 429, content_type = "application/problem+json")]
#[expect(dead_code, reason = "describes an answer, is none")]
pub struct TooManyRequests(Problem);

/// A scope as a type.
pub trait Needs: Send {
    /// It.
    const SCOPE: Scope;
}

/// See jobs.
pub struct Read;

/// Change jobs.
pub struct Write;

/// Read metrics.
pub struct Watch;

impl Needs for Read {
    const SCOPE: Scope = Scope::Read;
}

impl Needs for Write {
    const SCOPE: Scope = Scope::Write;
}

impl Needs for Watch {
    const SCOPE: Scope = Scope::Metrics;
}

/// A caller who may do what `S` says, counted among the open requests of the tenant.
pub struct Allowed<S> {
    /// Who it is.
    pub caller: Caller,
    _open: OpenRequest,
    _scope: PhantomData<S>,
}

impl<S: Needs> FromRequestParts<Arc<Jobs>> for Allowed<S> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, jobs: &Arc<Jobs>) -> Result<Self, ApiError> {
        let trace_id = parts.extensions.get::<TraceId>().map(|id| id.0.clone()).unwrap_or_default();
        let caller = authenticate(jobs, parts, S::SCOPE, trace_id).await?;
        let open = jobs.open_request(&caller.tenant).ok_or_else(too_many_requests)?;
        Ok(Self { caller, _open: open, _scope: PhantomData })
    }
}

async fn authenticate(jobs: &Jobs, parts: &Parts, scope: Scope, trace_id: String) -> Result<Caller, ApiError> {
    let Some(text) = header(&parts.headers, AUTHORIZATION) else {
        if jobs.store().has_tokens().await.map_err(JobsError::Store)? {
            return Err(unauthorized("token_missing", "this service asks for a token"));
        }
        refuse_foreign(parts)?;
        return Ok(Caller { trace_id, ..Caller::default() });
    };
    let stranger = || Caller { trace_id: trace_id.clone(), ..Caller::default() };
    let credentials = text.split_once(' ').filter(|(scheme, _)| scheme.eq_ignore_ascii_case("Bearer"));
    let token = credentials.and_then(|(_, token)| Token::parse(token.trim()));
    let stored = match &token {
        Some(token) => jobs.store().get_token(&token.id).await.map_err(JobsError::Store)?,
        None => None,
    };
    let known = stored.zip(token).filter(|(stored, token)| stored.is_secret(token.secret()));
    let Some((stored, _)) = known.filter(|(stored, _)| stored.is_valid_at(Timestamp::now())) else {
        denied(jobs, &stranger(), "token_invalid").await;
        return Err(unauthorized("token_invalid", "the token is not known, has expired or was revoked"));
    };
    let caller = Caller { tenant: stored.tenant, token: Some(stored.id), trace_id, deliver_to: stored.deliver_to };
    if !stored.scopes.contains(&scope) {
        denied(jobs, &caller, "scope_missing").await;
        let detail = format!("the token has no scope {}", scope.name());
        return Err(Problem::new(403, "scope_missing", detail).hint("ask for a token with this scope").into());
    }
    Ok(caller)
}

/// One line a second at most: who knocks in vain must not fill the disk.
async fn denied(jobs: &Jobs, caller: &Caller, code: &str) {
    static LAST: AtomicI64 = AtomicI64::new(0);
    let now = Timestamp::now().as_second();
    if LAST.swap(now, Ordering::Relaxed) != now {
        jobs.record(caller, Action::Denied, None, code).await;
    }
}

fn refuse_foreign(parts: &Parts) -> Result<(), ApiError> {
    let Some(access) = parts.extensions.get::<Arc<Access>>() else { return Ok(()) };
    let host = header(&parts.headers, HOST);
    if access.is_local && host.is_some_and(|host| !is_this_machine(host)) {
        let detail = "the service is open to this machine only, and the request names another";
        return Err(Problem::new(403, "foreign_host", detail)
            .at("header Host")
            .hint("use 127.0.0.1 or localhost")
            .into());
    }
    let Some(origin) = header(&parts.headers, ORIGIN) else { return Ok(()) };
    let is_own = origin.split_once("://").is_some_and(|(_, authority)| Some(authority) == host);
    if is_own || access.cors_origins.iter().any(|allowed| allowed == origin) {
        return Ok(());
    }
    let problem = Problem::new(403, "foreign_origin", "the request comes from a page of another origin");
    Err(problem.at("header Origin").hint("allow the origin with --cors-origins").into())
}

fn is_this_machine(host: &str) -> bool {
    let name = host.rsplit_once(':').filter(|(_, port)| port.bytes().all(|b| b.is_ascii_digit()));
    let name = name.map_or(host, |(name, _)| name).trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

fn unauthorized(code: &str, detail: &str) -> ApiError {
    Problem::new(401, code, detail).at("header Authorization").hint("send Authorization: Bearer and the token").into()
}

fn too_many_requests() -> ApiError {
    Problem::new(429, "too_many_requests", "too many requests of this tenant are open at the same time")
        .hint("wait for some of them, or close event streams")
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_has_few_names() {
        for host in ["localhost", "LOCALHOST:80", "127.0.0.1", "127.0.0.1:8080", "127.9.9.9", "[::1]", "[::1]:8080"] {
            assert!(is_this_machine(host), "{host}");
        }
        for host in ["", "evil.example", "localhost.evil.example:80", "10.0.0.1:80", "[2001:db8::1]:80", "unreadable"] {
            assert!(!is_this_machine(host), "{host}");
        }
    }
}

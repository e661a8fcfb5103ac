//! What all requests have in common that this program sends: webhooks, and questions to a PACS.

use std::error::Error;
use std::io;
use std::iter::successors;

use reqwest::Certificate;

/// What this program calls itself.
pub const USER_AGENT: &str = concat!("medialrep/", env!("CARGO_PKG_VERSION"));

/// Why there was no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// None in time.
    TimedOut,
    /// The certificate does not fit, or the server speaks no TLS.
    TlsFailed,
    /// Nobody listens there.
    ConnectFailed,
    /// The connection ended without an answer, or with something that is none.
    Interrupted,
}

impl Fault {
    /// Stable, snake case.
    #[must_use]
    pub fn code(self) -> &'static str {
        match self {
            Self::TimedOut => "timed_out",
            Self::TlsFailed => "tls_failed",
            Self::ConnectFailed => "connect_failed",
            Self::Interrupted => "interrupted",
        }
    }

    /// Which one an error of the HTTP client is.
    pub fn of(error: &reqwest::Error) -> Self {
        if error.is_timeout() {
            Self::TimedOut
        } else if causes(error).any(<dyn Error>::is::<rustls::Error>) {
            Self::TlsFailed
        } else if error.is_connect() {
            Self::ConnectFailed
        } else {
            Self::Interrupted
        }
    }
}

/// Why certificates cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the extra root certificates are not certificates in PEM")]
pub struct RootsError;

/// Certificates in PEM; nothing where `pem` is empty.
///
/// # Errors
/// When there are none where some were meant.
pub fn parse_roots(pem: &[u8]) -> Result<Vec<Certificate>, RootsError> {
    let roots = Certificate::from_pem_bundle(pem).map_err(|_| RootsError)?;
    if roots.is_empty() && !pem.is_empty() { Err(RootsError) } else { Ok(roots) }
}

/// The error and what caused it.
pub fn causes<'a>(error: &'a (dyn Error + 'static)) -> impl Iterator<Item = &'a (dyn Error + 'static)> {
    successors(Some(error), |error| cause(*error))
}

/// An I/O error leaves the one that it wraps out of `source`.
fn cause<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a (dyn Error + 'static)> {
    match error.downcast_ref::<io::Error>().and_then(io::Error::get_ref) {
        Some(wrapped) => Some(wrapped),
        None => error.source(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extra_roots_are_certificates_or_nothing() {
        assert!(parse_roots(b"").is_ok_and(|roots| roots.is_empty()));
        assert!(parse_roots(b"no certificate").is_err());
    }
}

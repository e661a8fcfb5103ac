//! Archives that instances are fetched from, as the operator names them.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use reqwest::Url;
use reqwest::header::HeaderValue;

use crate::name::{MAX_NAME, is_name};

/// An archive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PacsServer {
    /// What clients call it.
    pub name: String,
    /// Where its DICOMweb begins: `studies` lies below.
    pub(super) url: Url,
    /// What it is shown with each request.
    pub credentials: Option<Credentials>,
}

/// All archives, and how they are asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PacsConfig {
    /// The archives; no name twice.
    pub servers: Vec<PacsServer>,
    /// Certificates in PEM that are trusted besides the public ones; may be empty.
    pub extra_roots: Vec<u8>,
    /// Longest time to resolve, connect and agree on TLS.
    pub connect: Duration,
    /// Longest silence: before an answer, and within it.
    pub idle: Duration,
}

/// Why an archive is not what can be asked. Holds nothing of its address, which may hold a secret by mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ServerError {
    /// No name before an equals sign.
    #[error("a PACS is given as NAME=URL, such as main=https://pacs.example.org/dicom-web")]
    Form,
    /// Not a name.
    #[error("the name of a PACS has 1 to {MAX_NAME} letters, digits, dots, hyphens and underscores")]
    Name,
    /// Not an absolute URL of http or https.
    #[error("the URL of a PACS begins with http:// or https:// and a host, and has no query and no fragment")]
    Url,
    /// A name or a password, which would show in lists of processes.
    #[error("the URL of a PACS holds a user name or a password: use --pacs-credentials")]
    UserInfo,
}

impl FromStr for PacsServer {
    type Err = ServerError;

    /// Reads `name=url`.
    fn from_str(text: &str) -> Result<Self, ServerError> {
        let (name, url) = text.split_once('=').ok_or(ServerError::Form)?;
        if !is_name(name) {
            return Err(ServerError::Name);
        }
        let url = Url::parse(url.trim()).map_err(|_| ServerError::Url)?;
        if !url.username().is_empty() || url.password().is_some() {
            return Err(ServerError::UserInfo);
        }
        let is_web = matches!(url.scheme(), "http" | "https") && url.has_host();
        if !is_web || url.query().is_some() || url.fragment().is_some() {
            return Err(ServerError::Url);
        }
        Ok(Self { name: name.to_owned(), url, credentials: None })
    }
}

/// Variables of the environment that hold credentials begin so. Processes that need none are started without them.
pub const CREDENTIALS_ENV: &str = "MEDIALREP_PACS_CREDENTIALS";

/// What an archive asks for. Never shown.
#[derive(Clone, PartialEq, Eq)]
pub struct Credentials(HeaderValue);

/// Why a text is no credentials. Holds nothing of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("credentials are one line, USER:PASSWORD or Bearer TOKEN, in printable characters")]
pub struct CredentialsError;

impl FromStr for Credentials {
    type Err = CredentialsError;

    fn from_str(text: &str) -> Result<Self, CredentialsError> {
        if text.chars().any(char::is_control) {
            return Err(CredentialsError);
        }
        let header = match text.split_once(' ') {
            Some((scheme, token)) if scheme.eq_ignore_ascii_case("Bearer") && !token.trim().is_empty() => {
                format!("Bearer {}", token.trim())
            }
            // RFC 7617: the user has no colon, the password may have some.
            _ if text.split_once(':').is_some_and(|(user, _)| !user.is_empty()) => {
                format!("Basic {}", STANDARD.encode(text))
            }
            _ => return Err(CredentialsError),
        };
        let mut header = HeaderValue::from_str(&header).map_err(|_| CredentialsError)?;
        header.set_sensitive(true);
        Ok(Self(header))
    }
}

impl Credentials {
    /// The value of `Authorization`.
    pub(super) fn header(&self) -> HeaderValue {
        self.0.clone()
    }
}

impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Credentials(hidden)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_is_a_name_and_a_url_without_secrets() {
        for (text, error) in [
            ("https://pacs.example.org", ServerError::Form),
            ("a b=https://pacs.example.org", ServerError::Name),
            ("=https://pacs.example.org", ServerError::Name),
            ("main=pacs.example.org", ServerError::Url),
            ("main=ftp://pacs.example.org", ServerError::Url),
            ("main=https://pacs.example.org/?a=b", ServerError::Url),
            ("main=https://user:secret@pacs.example.org", ServerError::UserInfo),
        ] {
            assert_eq!(text.parse::<PacsServer>(), Err(error), "{text}");
        }
        let server: PacsServer = "main=https://pacs.example.org/dicom-web".parse().expect("a server");
        assert_eq!((server.name.as_str(), server.url.path()), ("main", "/dicom-web"));
    }

    #[test]
    fn credentials_are_of_two_kinds_and_never_shown() {
        let basic: Credentials = "peer:pass:word".parse().expect("user and password");
        assert_eq!(basic.header().to_str().ok(), Some("Basic cGVlcjpwYXNzOndvcmQ="));
        let bearer: Credentials = "bearer abc".parse().expect("a token");
        assert_eq!(bearer.header().to_str().ok(), Some("Bearer abc"));
        assert!(!format!("{basic:?}{:?}", basic.header()).contains("cGVlcj"));
        for bad in ["", "secret", ":secret", "Bearer ", "a:b\nc:d"] {
            assert!(bad.parse::<Credentials>().is_err(), "{bad:?}");
        }
    }
}

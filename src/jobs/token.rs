//! Access tokens: who may do what. A token is `mrt_{id}_{secret}`; the store keeps the id and a
//! hash of the secret. The secret is 32 random bytes, so that a plain hash is enough.

use std::fmt;
use std::str::FromStr;

use jiff::Timestamp;
use serde::Serialize;
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

use crate::formats::hex;
use crate::name::{MAX_NAME, is_name};

const PREFIX: &str = "mrt_";
const ID_BYTES: usize = 8;
const SECRET_BYTES: usize = 32;

/// Something that a token allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Scope {
    /// See the tenant's jobs and take their results.
    Read,
    /// Send, cancel, retry and delete jobs.
    Write,
    /// Read the metrics of the whole service.
    Metrics,
}

impl Scope {
    /// All scopes.
    pub const ALL: [Self; 3] = [Self::Read, Self::Write, Self::Metrics];

    /// The name on the command line and in the store.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::Metrics => "metrics",
        }
    }
}

impl FromStr for Scope {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|scope| scope.name() == name);
        found.ok_or_else(|| "scopes are read, write and metrics".to_owned())
    }
}

/// Names a tenant: 1 to 64 letters, digits, dots, hyphens and underscores.
///
/// # Errors
/// When the text is none.
pub fn check_tenant(name: &str) -> Result<String, String> {
    if is_name(name) {
        return Ok(name.to_owned());
    }
    Err(format!("a tenant is 1 to {MAX_NAME} letters, digits, dots, hyphens and underscores"))
}

/// What the store keeps of a token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredToken {
    /// Its public half.
    pub id: String,
    /// SHA-256 of its secret half, lower-case hex.
    pub secret_sha256: String,
    /// Owner of the jobs sent with it.
    pub tenant: String,
    /// What it allows.
    pub scopes: Vec<Scope>,
    /// When it was made.
    pub created_at: Timestamp,
    /// When it ends by itself.
    pub expires_at: Option<Timestamp>,
    /// When it was revoked.
    pub revoked_at: Option<Timestamp>,
    /// Archive that results of what is stored with it (STOW-RS) go to.
    pub deliver_to: Option<String>,
}

impl StoredToken {
    /// Whether it lets anybody in at this time.
    #[must_use]
    pub fn is_valid_at(&self, now: Timestamp) -> bool {
        self.revoked_at.is_none() && self.expires_at.is_none_or(|end| now < end)
    }

    /// Whether `secret` is its secret half; takes the same time for every wrong one.
    #[must_use]
    pub fn is_secret(&self, secret: &str) -> bool {
        hashed(secret).as_bytes().ct_eq(self.secret_sha256.as_bytes()).into()
    }
}

/// A token as its holder has it. Not printed by accident.
pub struct Token {
    /// Its public half.
    pub id: String,
    secret: String,
}

impl Token {
    /// A new one.
    ///
    /// # Errors
    /// When the system has no random numbers.
    pub fn new() -> Result<Self, getrandom::Error> {
        let (mut id, mut secret) = ([0; ID_BYTES], [0; SECRET_BYTES]);
        getrandom::fill(&mut id)?;
        getrandom::fill(&mut secret)?;
        Ok(Self { id: hex(&id), secret: hex(&secret) })
    }

    /// Reads `mrt_{id}_{secret}`.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let (id, secret) = text.strip_prefix(PREFIX)?.split_once('_')?;
        let is_hex = |half: &str, bytes| half.len() == 2 * bytes && half.bytes().all(|b| b.is_ascii_hexdigit());
        (is_hex(id, ID_BYTES) && is_hex(secret, SECRET_BYTES))
            .then(|| Self { id: id.to_owned(), secret: secret.to_owned() })
    }

    /// The secret half.
    #[must_use]
    pub fn secret(&self) -> &str {
        &self.secret
    }

    /// The whole, to be handed to its holder once.
    #[must_use]
    pub fn reveal(&self) -> String {
        format!("{PREFIX}{}_{}", self.id, self.secret)
    }

    /// What the store keeps of it.
    #[must_use]
    pub fn stored(&self, tenant: String, scopes: Vec<Scope>, expires_at: Option<Timestamp>) -> StoredToken {
        StoredToken {
            id: self.id.clone(),
            secret_sha256: hashed(&self.secret),
            tenant,
            scopes,
            created_at: Timestamp::now(),
            expires_at,
            revoked_at: None,
            deliver_to: None,
        }
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Token").field("id", &self.id).finish_non_exhaustive()
    }
}

fn hashed(secret: &str) -> String {
    hex(&Sha256::digest(secret))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_known_by_its_secret_and_shows_it_to_nobody() {
        let token = Token::new().expect("random numbers");
        let stored = token.stored("radiology".to_owned(), vec![Scope::Read], None);
        let read = Token::parse(&token.reveal()).expect("well formed");
        assert!(stored.id == read.id && stored.is_secret(read.secret()));
        assert!(!stored.is_secret(Token::new().expect("random numbers").secret()));
        assert!(!format!("{token:?} {stored:?}").contains(token.secret()));
    }

    #[test]
    fn what_is_not_of_the_form_is_no_token() {
        let good = Token::new().expect("random numbers").reveal();
        for bad in
            ["", "mrt_", "mrt__", &good[1..], &good[..good.len() - 1], &format!("{good}0"), &good.replace('_', "-")]
        {
            assert!(Token::parse(bad).is_none(), "{bad}");
        }
    }

    #[test]
    fn a_token_ends_when_it_expires_or_is_revoked() {
        let now = Timestamp::now();
        let token = Token::new().expect("random numbers").stored("t".to_owned(), vec![], Some(now));
        assert!(!token.is_valid_at(now));
        assert!(token.is_valid_at(now - jiff::SignedDuration::from_secs(1)));
        assert!(!StoredToken { expires_at: None, revoked_at: Some(now), ..token }.is_valid_at(now));
    }
}

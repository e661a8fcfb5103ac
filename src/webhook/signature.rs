//! Signatures after Standard Webhooks: HMAC-SHA256 over id, time and body, so that a receiver can
//! tell who sent a message, when, and that it is whole.

use std::fmt;
use std::str::FromStr;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;

const PREFIX: &str = "whsec_";
const MIN_BYTES: usize = 24;
const MAX_BYTES: usize = 64;

/// Takes secrets with and without padding: both are found in the wild.
const LENIENT: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// What sender and receiver share. Never shown.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(Vec<u8>);

/// Why a text is no secret. Holds nothing of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SecretError {
    /// Another kind of text.
    #[error("a webhook secret starts with {PREFIX}")]
    Prefix,
    /// Not base64.
    #[error("a webhook secret is base64 after {PREFIX}")]
    Encoding,
    /// Too short to be safe, or too long to be meant.
    #[error("a webhook secret has {MIN_BYTES} to {MAX_BYTES} bytes, not {bytes}")]
    Length {
        /// Bytes it has.
        bytes: usize,
    },
}

impl Secret {
    /// The value of `webhook-signature`; `timestamp` in seconds since 1970.
    #[must_use]
    pub fn sign(&self, id: &str, timestamp: i64, body: &[u8]) -> String {
        let mut mac = Hmac::<Sha256>::new_from_slice(&self.0).expect("HMAC takes a key of any length");
        mac.update(format!("{id}.{timestamp}.").as_bytes());
        mac.update(body);
        format!("v1,{}", STANDARD.encode(mac.finalize().into_bytes()))
    }
}

impl FromStr for Secret {
    type Err = SecretError;

    fn from_str(text: &str) -> Result<Self, SecretError> {
        let encoded = text.strip_prefix(PREFIX).ok_or(SecretError::Prefix)?;
        let key = LENIENT.decode(encoded).map_err(|_| SecretError::Encoding)?;
        if !(MIN_BYTES..=MAX_BYTES).contains(&key.len()) {
            return Err(SecretError::Length { bytes: key.len() });
        }
        Ok(Self(key))
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(hidden)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUBLISHED: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

    #[test]
    fn the_published_example_is_signed_alike() {
        let secret: Secret = PUBLISHED.parse().unwrap();
        let signature = secret.sign("msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, br#"{"test": 2432232314}"#);
        assert_eq!(signature, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    }

    #[test]
    fn only_long_keys_in_base64_are_secrets() {
        let of = |bytes: usize| format!("{PREFIX}{}", STANDARD.encode(vec![7; bytes])).parse::<Secret>();
        assert_eq!(of(23), Err(SecretError::Length { bytes: 23 }));
        assert_eq!(of(65), Err(SecretError::Length { bytes: 65 }));
        assert_eq!(of(64), Ok(Secret(vec![7; 64])));
        assert_eq!(
            of(25).unwrap(),
            format!("{PREFIX}{}", STANDARD.encode([7; 25]).trim_end_matches('=')).parse().unwrap()
        );
        assert_eq!(PUBLISHED.trim_start_matches(PREFIX).parse::<Secret>(), Err(SecretError::Prefix));
        assert_eq!("whsec_MfKQ9r8GKYqrTwjU*".parse::<Secret>(), Err(SecretError::Encoding));
    }

    #[test]
    fn a_secret_is_not_shown() {
        let secret: Secret = PUBLISHED.parse().unwrap();
        assert_eq!(format!("{secret:?}"), "Secret(hidden)");
    }
}

//! DICOMweb (PS3.18): instances fetched from an archive ([`client`], WADO-RS), and the bodies in which they come from
//! there or are stored here (STOW-RS, [`multipart`]). And what others ask of this service: searches ([`query`]: of
//! which attributes there are, [`entries`], and how each is matched, [`matching`]), and attributes as JSON ([`json`])
//! whatever letters they are written in ([`charset`]).
//!
//! Which archives there are is the operator's to say ([`server`]): a client names one, and never gives an address. So
//! the addresses may lie in any network, and still no client makes this server ask a machine of its choice.

pub mod multipart;

pub mod server;

pub mod client;

pub mod charset;

pub mod json;

pub mod entries;

pub mod matching;

pub mod query;

pub use client::{FetchError, Pacs, PacsError, Wanted};
pub use server::{CREDENTIALS_ENV, Credentials, PacsConfig, PacsServer, ServerError};

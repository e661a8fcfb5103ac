//! Where webhooks may go: URL prefixes that the operator lists, and networks besides the public
//! internet.

use std::fmt;
use std::net::IpAddr;

use ipnet::IpNet;
use reqwest::Url;

use super::addresses::{behind_nat64, is_public};

/// Longest URL.
pub const MAX_URL_BYTES: usize = 2048;

/// Escapes that some servers resolve before they choose a handler: dot, slash, backslash, and the
/// percent sign that would hide these three.
const ESCAPES: [&str; 4] = ["%2e", "%2f", "%5c", "%25"];

/// The prefixes and networks. The default allows nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Targets {
    prefixes: Vec<Url>,
    networks: Vec<IpNet>,
}

/// Why a list of targets cannot be used. Names entries by position: they may hold what is secret.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TargetsError {
    /// Not a prefix of URLs.
    #[error("webhook target {position}: {reason}")]
    Target {
        /// Counted from 1.
        position: usize,
        /// What is wrong with it.
        reason: TargetError,
    },
    /// Not a range of addresses.
    #[error("webhook network {position} is not of the form 10.1.0.0/16 or fd00:1::/32")]
    Network {
        /// Counted from 1.
        position: usize,
    },
}

/// Why a URL is refused. Holds nothing of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TargetError {
    /// Longer than [`MAX_URL_BYTES`].
    #[error("the URL is longer than {MAX_URL_BYTES} bytes")]
    TooLong,
    /// Not an absolute URL with a host, or with white space.
    #[error("the URL is malformed")]
    Malformed,
    /// Another scheme.
    #[error("the scheme of the URL is not http or https")]
    Scheme,
    /// A name or a password.
    #[error("the URL holds a user name or a password")]
    UserInfo,
    /// A fragment, which is never sent.
    #[error("the URL has a fragment")]
    Fragment,
    /// A query in a prefix, where it would match nothing.
    #[error("a listed URL has no query")]
    Query,
    /// A path that servers read in different ways.
    #[error("the path of the URL has escaped dots, slashes or percent signs")]
    AmbiguousPath,
    /// Under no listed prefix.
    #[error("the URL is not under a listed target")]
    NotListed,
}

/// A URL under a listed prefix, in normal form. Its path and query may hold a token: `Debug`
/// leaves them out.
#[derive(Clone, PartialEq, Eq)]
pub struct CallbackUrl(Url);

impl Targets {
    /// Reads URL prefixes, such as `https://pacs.example.org/hooks/`, and networks, such as
    /// `10.1.0.0/16`, that webhooks may reach although they are not public.
    ///
    /// A prefix ends at a slash of the path: `…/hooks` covers `…/hooks` and `…/hooks/a`, not
    /// `…/hooks2`; `…/hooks/` covers only what lies below.
    ///
    /// # Errors
    /// At the first entry that is neither.
    pub fn parse(prefixes: &[impl AsRef<str>], networks: &[impl AsRef<str>]) -> Result<Self, TargetsError> {
        let prefixes = prefixes.iter().enumerate().map(|(at, text)| {
            parse_prefix(text.as_ref()).map_err(|reason| TargetsError::Target { position: at + 1, reason })
        });
        let networks = networks
            .iter()
            .enumerate()
            .map(|(at, text)| text.as_ref().parse().map_err(|_| TargetsError::Network { position: at + 1 }));
        Ok(Self { prefixes: prefixes.collect::<Result<_, _>>()?, networks: networks.collect::<Result<_, _>>()? })
    }

    /// Whether no URL is allowed at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.prefixes.is_empty()
    }

    /// The URL in normal form if it lies under a listed prefix.
    ///
    /// # Errors
    /// When it does not, or could be read in more than one way.
    pub fn check(&self, url: &str) -> Result<CallbackUrl, TargetError> {
        let url = parse_url(url)?;
        if self.prefixes.iter().any(|prefix| covers(prefix, &url)) {
            Ok(CallbackUrl(url))
        } else {
            Err(TargetError::NotListed)
        }
    }

    /// Whether a connection may go there: public, or in a listed network. An IPv6 address that
    /// stands for an IPv4 address is judged as that.
    #[must_use]
    pub fn allows_address(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        self.networks.iter().any(|network| network.contains(&address))
            || match behind_nat64(address) {
                Some(behind) => self.allows_address(behind.into()),
                None => is_public(address),
            }
    }
}

impl CallbackUrl {
    /// All of it, to be stored.
    #[must_use]
    pub fn as_str(&self) -> &str {
        self.0.as_str()
    }

    /// The address, if that is its host. The host of any other URL goes through a resolver.
    pub(super) fn address(&self) -> Option<IpAddr> {
        self.0.host_str()?.trim_matches(['[', ']']).parse().ok()
    }

    pub(super) fn into_url(self) -> Url {
        self.0
    }
}

impl fmt::Debug for CallbackUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CallbackUrl({}/…)", self.0.origin().ascii_serialization())
    }
}

fn parse_prefix(text: &str) -> Result<Url, TargetError> {
    let url = parse_url(text)?;
    if url.query().is_some() { Err(TargetError::Query) } else { Ok(url) }
}

/// The parser resolves dot segments, plain and escaped, lowers the host and drops default ports.
fn parse_url(text: &str) -> Result<Url, TargetError> {
    if text.len() > MAX_URL_BYTES {
        return Err(TargetError::TooLong);
    }
    // The parser would drop some of these in silence.
    if text.contains(|c: char| c.is_whitespace() || c.is_control()) {
        return Err(TargetError::Malformed);
    }
    let url = Url::parse(text).map_err(|_| TargetError::Malformed)?;
    if !matches!(url.scheme(), "http" | "https") {
        return Err(TargetError::Scheme);
    }
    if !url.username().is_empty() || url.password().is_some() {
        return Err(TargetError::UserInfo);
    }
    if url.fragment().is_some() {
        return Err(TargetError::Fragment);
    }
    if url.path().split('/').any(is_ambiguous) {
        return Err(TargetError::AmbiguousPath);
    }
    Ok(url)
}

fn is_ambiguous(segment: &str) -> bool {
    let segment = segment.to_ascii_lowercase();
    // Some servers cut off what follows a semicolon and resolve dots then.
    let name = segment.split(';').next().unwrap_or_default();
    matches!(name, "." | "..") || ESCAPES.iter().any(|escape| segment.contains(escape))
}

fn covers(prefix: &Url, url: &Url) -> bool {
    let is_same_server = prefix.scheme() == url.scheme()
        && prefix.host_str() == url.host_str()
        && prefix.port_or_known_default() == url.port_or_known_default();
    is_same_server
        && url
            .path()
            .strip_prefix(prefix.path())
            .is_some_and(|rest| rest.is_empty() || rest.starts_with('/') || prefix.path().ends_with('/'))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn targets(prefixes: &[&str]) -> Targets {
        Targets::parse(prefixes, &[""; 0]).unwrap()
    }

    #[test]
    fn urls_under_a_prefix_are_allowed() {
        for (prefix, url, normal) in [
            ("https://a.org/hooks/", "https://a.org/hooks/1", "https://a.org/hooks/1"),
            ("https://a.org/hooks/", "https://a.org/hooks/", "https://a.org/hooks/"),
            ("https://a.org/hooks", "https://a.org/hooks", "https://a.org/hooks"),
            ("https://a.org/hooks", "https://a.org/hooks/1?t=%2e%2F", "https://a.org/hooks/1?t=%2e%2F"),
            ("https://a.org", "https://a.org/any", "https://a.org/any"),
            ("HTTPS://A.org:443/hooks/", "https://a.ORG/hooks/1", "https://a.org/hooks/1"),
            ("https://a.org/hooks/", "https://a.org:443/hooks/x/../1", "https://a.org/hooks/1"),
            ("http://a.org:8080/", "http://a.org:8080/1", "http://a.org:8080/1"),
            ("https://bücher.org/", "https://xn--bcher-kva.org/1", "https://xn--bcher-kva.org/1"),
            ("http://[::1]:80/", "http://[0:0::1]/", "http://[::1]/"),
            ("http://127.0.0.1/", "http://0x7f.1/", "http://127.0.0.1/"),
        ] {
            let checked = targets(&[prefix]).check(url);
            assert_eq!(checked.map(|url| url.as_str().to_owned()), Ok(normal.to_owned()), "{url}");
        }
    }

    #[test]
    fn urls_elsewhere_are_refused() {
        let allowed = targets(&["https://a.org/hooks/", "https://a.org/in"]);
        for url in [
            "http://a.org/hooks/1",
            "https://a.org:8443/hooks/1",
            "https://b.org/hooks/1",
            "https://a.org.b.org/hooks/1",
            "https://a.org./hooks/1",
            "https://a.org/",
            "https://a.org/hooks",
            "https://a.org/Hooks/1",
            "https://a.org/hooks2/1",
            "https://a.org/in2",
            "https://a.org/hooks/../admin",
            "https://a.org/hooks/%2e%2E/admin",
            "https://a.org/hooks/.%2e/admin",
            r"https://a.org/hooks\..\admin",
            "https://a.org/?/hooks/",
        ] {
            assert_eq!(allowed.check(url), Err(TargetError::NotListed), "{url}");
        }
        assert_eq!(Targets::default().check("https://a.org/"), Err(TargetError::NotListed));
    }

    #[test]
    fn urls_of_two_readings_are_refused() {
        let allowed = targets(&["https://a.org/hooks/"]);
        for (url, error) in [
            ("https://a.org/hooks/..%2fadmin", TargetError::AmbiguousPath),
            ("https://a.org/hooks/..%2Fadmin", TargetError::AmbiguousPath),
            ("https://a.org/hooks/..%5cadmin", TargetError::AmbiguousPath),
            ("https://a.org/hooks/%252e%252e/admin", TargetError::AmbiguousPath),
            ("https://a.org/hooks/..;/admin", TargetError::AmbiguousPath),
            ("https://a.org/hooks/..;a=b/admin", TargetError::AmbiguousPath),
            ("https://u@a.org/hooks/1", TargetError::UserInfo),
            ("https://:p@a.org/hooks/1", TargetError::UserInfo),
            ("https://a.org/hooks/1#", TargetError::Fragment),
            ("ftp://a.org/hooks/1", TargetError::Scheme),
            ("file:///hooks/1", TargetError::Scheme),
            ("/hooks/1", TargetError::Malformed),
            ("", TargetError::Malformed),
            ("https://", TargetError::Malformed),
            ("https://a.org:99999/hooks/1", TargetError::Malformed),
            ("https://a.org/hooks/\t1", TargetError::Malformed),
            (" https://a.org/hooks/1", TargetError::Malformed),
            ("https://a.org/hooks/1\r\nx: y", TargetError::Malformed),
        ] {
            assert_eq!(allowed.check(url), Err(error), "{url}");
        }
        let url = format!("https://a.org/hooks/{}", "a".repeat(MAX_URL_BYTES - 20));
        assert!(allowed.check(&url).is_ok());
        assert_eq!(allowed.check(&format!("{url}a")), Err(TargetError::TooLong));
    }

    #[test]
    fn entries_that_cannot_work_are_refused() {
        let parse = |prefix: &str, network: &str| Targets::parse(&["https://a.org/", prefix], &[network]);
        for (prefix, reason) in [
            ("a.org", TargetError::Malformed),
            ("https://a.org/?x", TargetError::Query),
            ("https://a.org/#x", TargetError::Fragment),
            ("https://u:p@a.org/", TargetError::UserInfo),
        ] {
            assert_eq!(parse(prefix, "10.0.0.0/8"), Err(TargetsError::Target { position: 2, reason }), "{prefix}");
        }
        for network in ["10.0.0.1", "10.0.0.0/33", "a.org", ""] {
            assert_eq!(parse("http://b.org", network), Err(TargetsError::Network { position: 1 }), "{network}");
        }
    }

    #[test]
    fn addresses_are_allowed_when_public_or_listed() {
        let listed = Targets::parse(&[""; 0], &["10.1.0.0/16", "fd00:1::/32", "::/0"]).unwrap();
        let unlisted = Targets::default();
        for (address, is_listed, is_unlisted) in [
            ("1.1.1.1", true, true),
            ("10.1.2.3", true, false),
            ("10.2.2.3", false, false),
            ("fd00:1::5", true, false),
            ("::ffff:1.1.1.1", true, true),
            ("::ffff:10.1.2.3", true, false),
            ("::ffff:127.0.0.1", false, false),
            ("64:ff9b::1.1.1.1", true, true),
            ("64:ff9b::10.1.2.3", true, false),
        ] {
            let address: IpAddr = address.parse().unwrap();
            assert_eq!(listed.allows_address(address), is_listed, "{address}");
            assert_eq!(unlisted.allows_address(address), is_unlisted, "{address}");
        }
    }

    #[test]
    fn addresses_as_hosts_are_found() {
        let allowed = targets(&["http://[::1]/", "http://10.0.0.1/", "http://a.org/"]);
        let address = |url: &str| allowed.check(url).unwrap().address().map(|address| address.to_string());
        assert_eq!(address("http://[0::1]/").as_deref(), Some("::1"));
        assert_eq!(address("http://0xa000001/").as_deref(), Some("10.0.0.1"));
        assert_eq!(address("http://a.org/"), None);
    }

    #[test]
    fn paths_and_queries_are_not_shown() {
        let url = targets(&["https://a.org/"]).check("https://a.org/token?secret").unwrap();
        assert_eq!(format!("{url:?}"), "CallbackUrl(https://a.org/…)");
    }
}

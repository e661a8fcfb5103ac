//! The page that people see who open the service in a browser. npm builds it into `web/dist`, and
//! it becomes part of this program; a program built without it says so. It holds no data: everybody
//! gets it who reaches the port.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::Extension;
use axum::body::{Body, Bytes};
use axum::http::header::{
    ACCEPT, ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, VARY,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Response, StatusCode, Uri};
use axum::response::IntoResponse;
use flate2::Compression;
use flate2::write::GzEncoder;
use rust_embed::RustEmbed;
use tokio::task::spawn_blocking;

use super::error;
use super::extract::{has_it, list_header, media_range};
use super::ops::INDEX;
use crate::formats::hex;

/// The file behind `/`; it has no other path.
const FRONT: &str = "index.html";

/// All of the page comes from this server, and it speaks to no other.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src \
                      'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What browsers see of a program without the page.
const NOT_BUILT: &str = "\
<!doctype html>
<html lang=\"en\">
<head>
<meta charset=\"utf-8\">
<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">
<meta name=\"color-scheme\" content=\"light dark\">
<title>medialrep</title>
</head>
<body>
<h1>medialrep</h1>
<p>The page is not built into this program. To have it, run <code>make web</code>, or
<code>cd web &amp;&amp; npm ci &amp;&amp; npm run build</code>, and build the program again.</p>
<p>The service works all the same: <a href=\"/docs\">its documentation, to be tried out</a>, and
<a href=\"/openapi.yaml\">its description</a>.</p>
</body>
</html>
";

/// Release builds hold the files, and their hashes; others, those of who works on the program, read them where
/// they were built.
#[derive(RustEmbed)]
#[folder = "web/dist"]
struct Dist;

/// A file of the page.
#[derive(Clone, Debug)]
pub struct PageFile {
    /// Its content.
    pub bytes: Cow<'static, [u8]>,
    /// SHA-256 of it.
    pub sha256: [u8; 32],
}

/// The files of the page.
#[derive(Clone)]
pub struct Page {
    by_name: fn(&str) -> Option<PageFile>,
    /// By hash: each file is compressed once.
    gzipped: Arc<Mutex<BTreeMap<[u8; 32], Bytes>>>,
}

impl Page {
    /// Those that this program was built with; none, if the page was not built.
    #[must_use]
    pub fn built() -> Self {
        Self::of(|name| Dist::get(name).map(|file| PageFile { sha256: file.metadata.sha256_hash(), bytes: file.data }))
    }

    /// Those that `by_name` finds.
    #[must_use]
    pub fn of(by_name: fn(&str) -> Option<PageFile>) -> Self {
        Self { by_name, gzipped: Arc::default() }
    }

    /// The file of that name. Hidden ones are no part of the page, and no name leads out of its folder.
    #[must_use]
    pub fn file(&self, name: &str) -> Option<PageFile> {
        let is_plain = name.split('/').all(|part| !part.is_empty() && !part.starts_with('.'));
        is_plain.then(|| (self.by_name)(name)).flatten()
    }

    /// A file as an answer to a request with these headers; `vary` are those that it depends on.
    async fn answer(&self, name: &str, file: PageFile, asked: &HeaderMap, vary: &'static str) -> Response<Body> {
        // Weak, because it is the same whether compressed or not.
        let tag = format!("\"{}\"", hex(&file.sha256));
        let mut answer = Response::default();
        let headers = answer.headers_mut();
        let etag = HeaderValue::from_str(&format!("W/{tag}")).expect("hexadecimal digits");
        headers.insert(ETAG, etag);
        headers.insert(VARY, HeaderValue::from_static(vary));
        headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        headers.insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
        if has_it(asked, &tag) {
            *answer.status_mut() = StatusCode::NOT_MODIFIED;
            return answer;
        }
        let media_type = mime_guess::from_path(name).first_or_octet_stream();
        let is_text = media_type.type_() == mime_guess::mime::TEXT || media_type.suffix().is_some();
        let media_type = if is_text { format!("{media_type}; charset=utf-8") } else { media_type.to_string() };
        headers.insert(CONTENT_TYPE, HeaderValue::from_str(&media_type).expect("media types are ASCII"));
        let compressed = if is_text && takes_gzip(asked) { self.gzipped(&file).await } else { None };
        *answer.body_mut() = match compressed {
            Some(bytes) => {
                answer.headers_mut().insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
                Body::from(bytes)
            }
            None => Body::from(file.bytes),
        };
        answer
    }

    /// The file compressed, by whoever asks for it first; `None` when that was not possible.
    async fn gzipped(&self, file: &PageFile) -> Option<Bytes> {
        if let Some(known) = self.compressed().get(&file.sha256) {
            return Some(known.clone());
        }
        let (bytes, sha256) = (file.bytes.clone(), file.sha256);
        let made = spawn_blocking(move || gzip(&bytes)).await.ok()?.ok()?;
        Some(self.compressed().entry(sha256).or_insert(made).clone())
    }

    fn compressed(&self) -> MutexGuard<'_, BTreeMap<[u8; 32], Bytes>> {
        // Nothing panics while it is held.
        self.gzipped.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn gzip(bytes: &[u8]) -> io::Result<Bytes> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(bytes)?;
    Ok(gzip.finish()?.into())
}

/// The page, to who asks for text/html; to others a short text that says what is where.
#[utoipa::path(
    get, path = "/", tag = "operation", security(()),
    params(("Accept" = Option<String>, Header, description = "Media types wanted")),
    responses(
        (status = 200, description = "The page, or a short text", content((String = "text/html"), (String = "text/plain"))),
        (status = 304, description = "The client has the page")
    )
)]
pub async fn front(Extension(page): Extension<Page>, headers: HeaderMap) -> Response<Body> {
    if !wants_html(&headers) {
        return ([(VARY, "Accept")], INDEX).into_response();
    }
    match page.file(FRONT) {
        Some(file) => page.answer(FRONT, file, &headers, "Accept, Accept-Encoding").await,
        None => ([(VARY, "Accept"), (CONTENT_TYPE, "text/html; charset=utf-8")], NOT_BUILT).into_response(),
    }
}

/// What is no route: a file of the page, or a problem.
pub async fn file(
    Extension(page): Extension<Page>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response<Body>, error::ApiError> {
    let is_read = method == Method::GET || method == Method::HEAD;
    let name = uri.path().strip_prefix('/').filter(|name| is_read && *name != FRONT);
    match name.and_then(|name| Some((name, page.file(name)?))) {
        Some((name, file)) => Ok(page.answer(name, file, &headers, "Accept-Encoding").await),
        None => Err(error::no_such_route(&uri)),
    }
}

/// Whether text/html is named: programs that take anything get the text.
fn wants_html(headers: &HeaderMap) -> bool {
    names(headers, ACCEPT, "text/html")
}

fn takes_gzip(headers: &HeaderMap) -> bool {
    names(headers, ACCEPT_ENCODING, "gzip")
}

/// Whether a header lists this, with a weight above 0.
fn names(headers: &HeaderMap, name: HeaderName, wanted: &str) -> bool {
    let listed = list_header(headers, name);
    listed.split(',').map(media_range).any(|(name, weight)| name == wanted && weight > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_who_names_html_wants_html() {
        let wants = |accept: &str| wants_html(&[(ACCEPT, accept.parse().unwrap())].into_iter().collect());
        for accept in ["text/html", "text/html,application/xhtml+xml,*/*;q=0.8", "image/png, TEXT/HTML;q=0.5"] {
            assert!(wants(accept), "{accept}");
        }
        for accept in ["", "*/*", "text/*", "text/plain", "application/json", "text/html;q=0, */*"] {
            assert!(!wants(accept), "{accept}");
        }
        assert!(!wants_html(&HeaderMap::new()));
    }

    #[test]
    fn no_name_leads_out_of_the_folder_or_to_hidden_files() {
        let page = Page::of(|_| Some(PageFile { bytes: Cow::Borrowed(b"x"), sha256: [0; 32] }));
        for name in ["page.js", "a/b.svg"] {
            assert!(page.file(name).is_some(), "{name}");
        }
        for name in ["", ".gitignore", "../Cargo.toml", "a/../b", "a/.b", "/etc/passwd", "a//b", "a/"] {
            assert!(page.file(name).is_none(), "{name}");
        }
    }
}

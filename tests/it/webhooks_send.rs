//! Messages on their way: signed, only to where the list allows, and never further.

use std::collections::VecDeque;
use std::future::pending;
use std::io;
use std::net::IpAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use async_trait::async_trait;
use bytes::Bytes;
use medialrep::webhook::{
    Message, Resolver, Secret, SendError, Sender, SenderError, TargetError, Targets, WebhookConfig,
};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use uuid::Uuid;

const SECRET: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";
const BODY: &str = r#"{"type":"job.succeeded"}"#;
/// An authority of these tests alone, and what it certified for `hook.test`; good until 2120.
const AUTHORITY: &[u8] = include_bytes!("webhooks_tls/authority.pem");
const HOOK: &[u8] = include_bytes!("webhooks_tls/hook.pem");
const HOOK_KEY: &[u8] = include_bytes!("webhooks_tls/hook.key");

/// Gives every connection the same answer and keeps what was asked.
struct Receiver {
    port: u16,
    requests: Arc<Mutex<Vec<String>>>,
}

impl Receiver {
    async fn start(answer: impl Into<String>) -> Self {
        Self::serve(answer.into(), None).await
    }

    async fn start_tls(answer: &str) -> Self {
        let certificate = CertificateDer::from_pem_slice(HOOK).unwrap();
        let key = PrivateKeyDer::from_pem_slice(HOOK_KEY).unwrap();
        let config = ServerConfig::builder().with_no_client_auth().with_single_cert(vec![certificate], key).unwrap();
        Self::serve(answer.to_owned(), Some(TlsAcceptor::from(Arc::new(config)))).await
    }

    async fn serve(answer: String, tls: Option<TlsAcceptor>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let requests = Arc::new(Mutex::new(Vec::new()));
        let kept = Arc::clone(&requests);
        tokio::spawn(async move {
            loop {
                let (stream, _) = listener.accept().await.unwrap();
                match &tls {
                    None => converse(stream, &answer, &kept).await,
                    // A client that trusts nobody ends the handshake.
                    Some(tls) => match tls.accept(stream).await {
                        Ok(stream) => converse(stream, &answer, &kept).await,
                        Err(_) => continue,
                    },
                }
            }
        });
        Self { port, requests }
    }

    fn url(&self, host: &str) -> String {
        format!("http://{host}:{}/hooks/1?token=CANARY", self.port)
    }

    fn requests(&self) -> Vec<String> {
        self.requests.lock().unwrap().clone()
    }
}

/// Holds the connection open until the other side ends it.
async fn converse(mut stream: impl AsyncRead + AsyncWrite + Unpin, answer: &str, kept: &Mutex<Vec<String>>) {
    let mut request = Vec::new();
    while !request.ends_with(BODY.as_bytes()) {
        if stream.read_buf(&mut request).await.unwrap_or(0) == 0 {
            return;
        }
    }
    kept.lock().unwrap().push(String::from_utf8(request).unwrap());
    stream.write_all(answer.as_bytes()).await.unwrap();
    let _ = stream.read_buf(&mut Vec::new()).await;
}

/// Answers one after the other; the last for ever. Counts questions.
#[derive(Default)]
struct Names {
    answers: Mutex<VecDeque<Vec<IpAddr>>>,
    asked: Mutex<usize>,
}

impl Names {
    fn new(answers: &[&[&str]]) -> Arc<Self> {
        let addresses = |texts: &&[&str]| texts.iter().map(|text| text.parse().unwrap()).collect();
        Arc::new(Self { answers: Mutex::new(answers.iter().map(addresses).collect()), asked: Mutex::default() })
    }
}

#[async_trait]
impl Resolver for Names {
    async fn lookup(&self, _: &str) -> io::Result<Vec<IpAddr>> {
        *self.asked.lock().unwrap() += 1;
        let mut answers = self.answers.lock().unwrap();
        let next = if answers.len() > 1 { answers.pop_front() } else { answers.front().cloned() };
        next.ok_or_else(|| io::Error::other("no such name"))
    }
}

/// Never answers.
struct Silence;

#[async_trait]
impl Resolver for Silence {
    async fn lookup(&self, _: &str) -> io::Result<Vec<IpAddr>> {
        pending().await
    }
}

fn config(url: &str, networks: &[&str]) -> WebhookConfig {
    let prefix = url.split("/hooks").next().unwrap();
    let targets = Targets::parse(&[format!("{prefix}/hooks/")], networks).unwrap();
    WebhookConfig::new(targets, SECRET.parse().unwrap())
}

fn message() -> Message {
    Message { id: Uuid::from_u128(7), body: Bytes::from_static(BODY.as_bytes()) }
}

async fn send(url: &str, networks: &[&str], names: Arc<dyn Resolver>) -> Result<u16, SendError> {
    Sender::with_resolver(config(url, networks), names).unwrap().send(url, &message()).await
}

async fn send_locally(url: &str) -> Result<u16, SendError> {
    send(url, &["127.0.0.0/8"], Names::new(&[&["127.0.0.1"]])).await
}

fn header<'a>(request: &'a str, name: &str) -> &'a str {
    let prefix = format!("{name}: ");
    request.lines().find_map(|line| line.strip_prefix(&prefix)).unwrap_or_else(|| panic!("no {name} in {request}"))
}

#[tokio::test]
async fn a_message_arrives_signed() {
    let receiver = Receiver::start("HTTP/1.1 204 No Content\r\n\r\n").await;
    assert_eq!(send_locally(&receiver.url("hook.test")).await, Ok(204));
    let requests = receiver.requests();
    let [request] = requests.as_slice() else { panic!("{requests:?}") };
    assert!(request.starts_with("POST /hooks/1?token=CANARY HTTP/1.1\r\n"), "{request}");
    assert_eq!(header(request, "host"), format!("hook.test:{}", receiver.port));
    assert_eq!(header(request, "content-type"), "application/json");
    assert_eq!(header(request, "user-agent"), concat!("medialrep/", env!("CARGO_PKG_VERSION")));
    assert_eq!(header(request, "webhook-id"), message().id.to_string());
    let timestamp: i64 = header(request, "webhook-timestamp").parse().unwrap();
    assert!(jiff::Timestamp::now().as_second().abs_diff(timestamp) < 5);
    let secret: Secret = SECRET.parse().unwrap();
    let signature = secret.sign(&message().id.to_string(), timestamp, BODY.as_bytes());
    assert_eq!(header(request, "webhook-signature"), signature);
}

#[tokio::test]
async fn the_body_of_the_answer_is_not_waited_for() {
    let receiver = Receiver::start("HTTP/1.1 200 OK\r\ncontent-length: 1000000000\r\n\r\n").await;
    let url = receiver.url("hook.test");
    let sender = Sender::with_resolver(config(&url, &["127.0.0.1/32"]), Names::new(&[&["127.0.0.1"]])).unwrap();
    for _ in 0..2 {
        assert_eq!(sender.send(&url, &message()).await, Ok(200));
    }
}

#[tokio::test]
async fn a_redirect_is_not_followed() {
    let elsewhere = Receiver::start("HTTP/1.1 200 OK\r\n\r\n").await;
    let answer = format!("HTTP/1.1 307 Temporary Redirect\r\nlocation: {}\r\n\r\n", elsewhere.url("hook.test"));
    let receiver = Receiver::start(answer).await;
    assert_eq!(send_locally(&receiver.url("hook.test")).await, Err(SendError::Redirected(307)));
    assert_eq!(receiver.requests().len(), 1);
    assert_eq!(elsewhere.requests().len(), 0);
}

#[tokio::test]
async fn refusals_are_told_apart() {
    for (answer, error) in [
        ("HTTP/1.1 410 Gone\r\n\r\n", SendError::Gone),
        ("HTTP/1.1 500 Internal Server Error\r\n\r\n", SendError::RefusedStatus(500)),
        ("SSH-2.0-OpenSSH\r\n", SendError::Interrupted),
    ] {
        let receiver = Receiver::start(answer).await;
        assert_eq!(send_locally(&receiver.url("hook.test")).await, Err(error));
    }
}

#[tokio::test]
async fn a_private_address_is_refused_unless_listed() {
    let receiver = Receiver::start("HTTP/1.1 200 OK\r\n\r\n").await;
    for host in ["hook.test", "127.0.0.1", "[::ffff:127.0.0.1]", "0x7f000001", "localhost"] {
        let url = receiver.url(host);
        let names = Names::new(&[&["127.0.0.1"]]);
        assert_eq!(send(&url, &["10.0.0.0/8"], names.clone()).await, Err(SendError::AddressNotAllowed), "{host}");
        assert_eq!(receiver.requests().len(), 0, "{host}");
        assert_eq!(send(&url, &["127.0.0.0/8"], names).await, Ok(200), "{host}");
        receiver.requests.lock().unwrap().clear();
    }
}

#[tokio::test]
async fn one_private_address_among_public_ones_is_refused() {
    let receiver = Receiver::start("HTTP/1.1 200 OK\r\n\r\n").await;
    let names = Names::new(&[&["1.1.1.1", "127.0.0.1"]]);
    assert_eq!(send(&receiver.url("hook.test"), &[], names).await, Err(SendError::AddressNotAllowed));
    assert_eq!(receiver.requests().len(), 0);
}

#[tokio::test]
async fn a_name_is_asked_for_once_and_the_connection_goes_there() {
    let receiver = Receiver::start("HTTP/1.1 200 OK\r\n\r\n").await;
    let url = receiver.url("hook.test");
    let names = Names::new(&[&["127.0.0.1"], &["127.0.0.2"]]);
    let sender = Sender::with_resolver(config(&url, &["127.0.0.1/32"]), names.clone()).unwrap();
    assert_eq!(sender.send(&url, &message()).await, Ok(200));
    assert_eq!(*names.asked.lock().unwrap(), 1);
    // Nothing of the first attempt is left that the second could go by.
    assert_eq!(sender.send(&url, &message()).await, Err(SendError::AddressNotAllowed));
    assert_eq!(*names.asked.lock().unwrap(), 2);
    assert_eq!(receiver.requests().len(), 1);
}

#[tokio::test]
async fn names_without_addresses_are_told() {
    let url = "http://hook.test/hooks/1";
    assert_eq!(send(url, &[], Names::new(&[])).await, Err(SendError::NameNotResolved));
    assert_eq!(send(url, &[], Names::new(&[&[]])).await, Err(SendError::NameNotResolved));
}

#[tokio::test]
async fn what_the_list_no_longer_allows_is_not_sent() {
    let receiver = Receiver::start("HTTP/1.1 200 OK\r\n\r\n").await;
    let sender = Sender::new(config("http://other.test/hooks/", &["127.0.0.0/8"])).unwrap();
    let error = sender.send(&receiver.url("127.0.0.1"), &message()).await.unwrap_err();
    assert_eq!(error, SendError::TargetNotAllowed(TargetError::NotListed));
    assert_eq!(error.code(), "target_not_allowed");
    assert!(!error.to_string().contains("CANARY"));
}

#[tokio::test]
async fn slow_servers_and_slow_names_time_out() {
    let receiver = Receiver::start("HTTP/1.1 200").await;
    let url = receiver.url("hook.test");
    let mut config = config(&url, &["127.0.0.1/32"]);
    config.connect = Duration::from_millis(100);
    config.total = Duration::from_millis(300);
    let names: [Arc<dyn Resolver>; 2] = [Names::new(&[&["127.0.0.1"]]), Arc::new(Silence)];
    for names in names {
        let sender = Sender::with_resolver(config.clone(), names).unwrap();
        let started = Instant::now();
        assert_eq!(sender.send(&url, &message()).await, Err(SendError::TimedOut));
        assert!(started.elapsed() < Duration::from_secs(5));
    }
}

#[tokio::test]
async fn a_closed_port_is_told() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://hook.test:{}/hooks/1", listener.local_addr().unwrap().port());
    drop(listener);
    assert_eq!(send_locally(&url).await, Err(SendError::ConnectFailed));
}

#[tokio::test]
async fn a_certificate_is_for_the_host_of_the_url() {
    let receiver = Receiver::start_tls("HTTP/1.1 200 OK\r\n\r\n").await;
    for (host, roots, wanted) in [
        ("hook.test", AUTHORITY, Ok(200)),
        ("hook.test", &[], Err(SendError::TlsFailed)),
        ("other.test", AUTHORITY, Err(SendError::TlsFailed)),
    ] {
        let url = receiver.url(host).replace("http:", "https:");
        let mut config = config(&url, &["127.0.0.1/32"]);
        config.extra_roots = roots.to_vec();
        let sender = Sender::with_resolver(config, Names::new(&[&["127.0.0.1"]])).unwrap();
        assert_eq!(sender.send(&url, &message()).await, wanted, "{host}");
    }
    assert_eq!(receiver.requests().len(), 1);
}

#[tokio::test]
async fn a_server_without_tls_is_told() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("https://hook.test:{}/hooks/1", listener.local_addr().unwrap().port());
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        stream.write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n").await.unwrap();
        let _ = stream.read_to_end(&mut Vec::new()).await;
    });
    assert_eq!(send_locally(&url).await, Err(SendError::TlsFailed));
}

#[test]
fn roots_that_are_none_are_told() {
    for roots in [b"nothing".as_slice(), b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"] {
        let mut config = config("http://hook.test/hooks/", &[]);
        config.extra_roots = roots.to_vec();
        assert!(matches!(Sender::new(config), Err(SenderError::Roots | SenderError::Client(_))));
    }
}

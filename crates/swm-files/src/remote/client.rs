//! Requests over HTTP: ranges of bytes, with retries that continue where the last answer ended.

use std::io::{self, Read as _, Write};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use ureq::http::response::Parts;
use ureq::http::{HeaderMap, Response, StatusCode};
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::{Agent, Body};

use super::address::is_loopback;
use super::error::{RemoteError, RemoteErrorKind as Kind};
use super::s3;
use super::settings::Settings;

/// How often a request is tried again without progress.
const RETRIES: u32 = 4;
/// Bytes that count as progress.
const PROGRESS: u64 = 64 << 10;
/// The longest pause that a server may ask for.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// What is read of a refusal.
const MAX_REFUSAL: u64 = 4096;
/// A list or a description is never longer.
const MAX_TEXT: u64 = 64 << 20;

/// Who a request is signed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Auth {
    None,
    S3,
    Hub,
}

/// What is asked for.
#[derive(Clone, Debug)]
pub(super) struct Link {
    /// For messages.
    pub(super) name: String,
    pub(super) url: String,
    pub(super) auth: Auth,
}

/// Which bytes these are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Version {
    pub(super) length: u64,
    /// The `ETag`, or a date; `None`: the server gives none, or a commit is in the address.
    pub(super) tag: Option<String>,
}

/// What an answer says about its object.
#[derive(Clone, Debug)]
pub(super) struct Head {
    pub(super) version: Version,
    /// Whether parts of it can be asked for.
    pub(super) is_ranged: bool,
}

/// Why a try failed, and whether another one may succeed.
enum Failed {
    Now(RemoteError),
    Later(String, Option<Duration>),
}

/// A client of all servers.
#[derive(Debug)]
pub(super) struct Client {
    agent: Agent,
    pub(super) settings: Settings,
}

impl Client {
    pub(super) fn new(settings: Settings) -> Result<Self, RemoteError> {
        let mut config = Agent::config_builder()
            .http_status_as_error(false)
            .user_agent(concat!("swm/", env!("CARGO_PKG_VERSION")))
            .max_idle_connections_per_host(16)
            .timeout_connect(Some(settings.timeout))
            .timeout_recv_response(Some(settings.timeout))
            .timeout_per_read(Some(settings.timeout));
        if let Some(path) = &settings.certificates {
            let roots = RootCerts::Specific(Arc::new(certificates(path)?));
            config = config.tls_config(TlsConfig::builder().root_certs(roots).build());
        }
        Ok(Self { agent: config.build().new_agent(), settings })
    }

    /// Writes a range of an object to `out`: less if the object ends before. With a `version`, another one is an error.
    pub(super) fn read(
        &self,
        link: &Link,
        range: Range<u64>,
        version: Option<&Version>,
        out: &mut dyn Write,
    ) -> Result<Head, RemoteError> {
        let (mut done, mut tries, mut progress) = (0, 0, 0);
        let mut known = version.cloned();
        loop {
            let reason = match self.try_to_read(link, (range.clone(), &mut done), &mut known, out) {
                Ok(head) => return Ok(head),
                Err(Failed::Now(error)) => return Err(error),
                Err(Failed::Later(reason, pause)) => (reason, pause),
            };
            if done >= progress + PROGRESS {
                (progress, tries) = (done, 0);
            }
            self.pause(link, &mut tries, reason)?;
        }
    }

    /// A text, whole, and the headers that came with it.
    pub(super) fn text(&self, link: &Link) -> Result<(Vec<u8>, HeaderMap), RemoteError> {
        let mut tries = 0;
        loop {
            let reason = match self.try_text(link) {
                Ok(found) => return Ok(found),
                Err(Failed::Now(error)) => return Err(error),
                Err(Failed::Later(reason, pause)) => (reason, pause),
            };
            self.pause(link, &mut tries, reason)?;
        }
    }

    /// Waits before the next try, if there is one.
    fn pause(
        &self,
        link: &Link,
        tries: &mut u32,
        (reason, pause): (String, Option<Duration>),
    ) -> Result<(), RemoteError> {
        if *tries == RETRIES {
            let reason = format!("{reason}, {} times", RETRIES + 1);
            let fix = "check the connection and the server, and run it again: what was fetched is kept";
            return Err(RemoteError::new(Kind::Network, &link.name, reason, fix));
        }
        thread::sleep(pause.unwrap_or_else(|| self.settings.pause * (1 << *tries)).min(LONGEST_PAUSE));
        *tries += 1;
        Ok(())
    }

    fn try_to_read(
        &self,
        link: &Link,
        (range, done): (Range<u64>, &mut u64),
        known: &mut Option<Version>,
        out: &mut dyn Write,
    ) -> Result<Head, Failed> {
        let from = range.start + *done;
        let mut headers = vec![("range", format!("bytes={from}-{}", range.end.saturating_sub(1)))];
        // A weak tag, or a date, is none that a server can be asked to match.
        let tag = known.as_ref().and_then(|known| known.tag.clone());
        headers.extend(tag.filter(|tag| tag.starts_with('"')).map(|tag| ("if-match", tag)));
        let (answer, body) = self.send(link, &headers)?.into_parts();
        let (status, total) = (answer.status, total(&answer));
        let found = Version { length: total.unwrap_or_default(), tag: tag_of(&answer.headers) };
        if status == StatusCode::PRECONDITION_FAILED {
            return Err(Failed::Now(changed(link)));
        }
        if status == StatusCode::RANGE_NOT_SATISFIABLE {
            return match (known.as_ref(), total) {
                (None, Some(0)) if from == 0 => Ok(Head { version: found, is_ranged: true }),
                (Some(known), Some(total)) if known.length != total => Err(Failed::Now(changed(link))),
                _ => Err(Failed::Now(bad_answer(link, &format!("refuses the bytes from {from} on (416)")))),
            };
        }
        let is_ranged = status == StatusCode::PARTIAL_CONTENT;
        if !is_ranged && status != StatusCode::OK {
            let mut text = Vec::new();
            // What cannot be read of a refusal only leaves out its code.
            let _ = body.into_reader().take(MAX_REFUSAL).read_to_end(&mut text);
            return Err(self.refused(link, &answer, &text));
        }
        if !is_ranged && from > 0 {
            return Err(Failed::Now(bad_answer(link, "gives no parts of it")));
        }
        let Some(total) = total else {
            return Err(Failed::Now(bad_answer(link, "does not give its length")));
        };
        if is_ranged && first_byte(&answer.headers) != Some(from) {
            return Err(Failed::Now(bad_answer(
                link,
                &format!("gives other bytes than those from {from} on"),
            )));
        }
        let is_other =
            |known: &Version| known.length != total || known.tag.is_some() && known.tag != found.tag;
        if known.as_ref().is_some_and(is_other) {
            return Err(Failed::Now(changed(link)));
        }
        let version = known.get_or_insert(found).clone();
        let wanted = range.end.min(total).saturating_sub(from);
        self.body(link, body, wanted, done, out)?;
        Ok(Head { version, is_ranged })
    }

    /// So many bytes of an answer; what follows is not read.
    fn body(
        &self,
        link: &Link,
        body: Body,
        wanted: u64,
        done: &mut u64,
        out: &mut dyn Write,
    ) -> Result<(), Failed> {
        let mut body = body.into_reader().take(wanted);
        let (mut piece, mut left) = (vec![0; 64 << 10], wanted);
        while left > 0 {
            let count = match body.read(&mut piece) {
                Ok(0) => return Err(Failed::Later(format!("its answer ends {left} bytes early"), None)),
                Ok(count) => count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(Failed::Later(self.reason(&error), None)),
            };
            let written = out.write_all(&piece[..count]);
            written.map_err(|error| {
                let reason = format!("what was read cannot be written: {error}");
                Failed::Now(RemoteError::new(Kind::Cache, &link.name, reason, "free some space"))
            })?;
            *done += count as u64;
            left -= count as u64;
        }
        Ok(())
    }

    fn try_text(&self, link: &Link) -> Result<(Vec<u8>, HeaderMap), Failed> {
        let (answer, body) = self.send(link, &[])?.into_parts();
        let mut text = Vec::new();
        let read = body.into_reader().take(MAX_TEXT + 1).read_to_end(&mut text);
        if answer.status != StatusCode::OK {
            return Err(self.refused(link, &answer, &text));
        }
        read.map_err(|error| Failed::Later(self.reason(&error), None))?;
        match text.len() as u64 > MAX_TEXT {
            true => Err(Failed::Now(bad_answer(link, "gives a list that is too long"))),
            false => Ok((text, answer.headers)),
        }
    }

    fn send(&self, link: &Link, headers: &[(&'static str, String)]) -> Result<Response<Body>, Failed> {
        let mut request = self.agent.get(&link.url);
        for (name, value) in headers.iter().cloned().chain(self.signature(link)) {
            request = request.header(name, value);
        }
        let host = link.url.split('/').nth(2).unwrap_or_default();
        // What began with TLS goes on with it, and no proxy knows the way back to this machine.
        let mut config = request.config().https_only(link.url.starts_with("https:"));
        if is_loopback(host) {
            config = config.proxy(None);
        }
        config.build().call().map_err(|error| match error {
            ureq::Error::Io(error) => Failed::Later(self.reason(&error), None),
            ureq::Error::Timeout(_) => Failed::Later(self.timed_out(), None),
            ureq::Error::ConnectionFailed | ureq::Error::HostNotFound | ureq::Error::Protocol(_) => {
                Failed::Later(format!("no connection ({error})"), None)
            }
            // Others could show the address with its query, or a header.
            ureq::Error::TooManyRedirects => Failed::Now(bad_answer(link, "redirects without end")),
            ureq::Error::Tls(_) | ureq::Error::Rustls(_) => Failed::Now(RemoteError::new(
                Kind::Network,
                &link.name,
                "its certificate is not trusted, or TLS fails",
                "set SSL_CERT_FILE to the certificates (PEM) of your network, if it has its own",
            )),
            _ => Failed::Now(bad_answer(link, "cannot be asked")),
        })
    }

    fn signature(&self, link: &Link) -> Vec<(&'static str, String)> {
        match (link.auth, &self.settings.s3.credentials, &self.settings.hub.token) {
            (Auth::S3, Some(credentials), _) => s3::signed(&link.url, &self.settings.s3.region, credentials),
            (Auth::Hub, _, Some(token)) => vec![("authorization", format!("Bearer {token}"))],
            _ => Vec::new(),
        }
    }

    fn timed_out(&self) -> String {
        format!("no answer in {} s", self.settings.timeout.as_secs_f32())
    }

    fn reason(&self, error: &io::Error) -> String {
        // Of a body, the client's own error is within.
        let within = error.get_ref().and_then(|within| within.downcast_ref::<ureq::Error>());
        match (error.kind(), within) {
            (io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock, _) | (_, Some(ureq::Error::Timeout(_))) => {
                self.timed_out()
            }
            _ => format!("the connection failed ({error})"),
        }
    }

    /// Why an answer is none. `body` is what came with it.
    fn refused(&self, link: &Link, answer: &Parts, body: &[u8]) -> Failed {
        let (headers, code) = (&answer.headers, answer.status.as_u16());
        let is_later = code == 408 || code == 425 || code == 429 || code >= 500;
        if is_later {
            let pause = headers.get("retry-after").and_then(|value| value.to_str().ok()?.trim().parse().ok());
            return Failed::Later(format!("the server answers {code}"), pause.map(Duration::from_secs));
        }
        let error =
            |kind, reason: String, fix: &str| Failed::Now(RemoteError::new(kind, &link.name, reason, fix));
        let detail = s3::code(body).map(|code| format!(", {code}")).unwrap_or_default();
        match (code, link.auth) {
            (404 | 410, Auth::Hub) => error(
                Kind::Missing,
                format!("nothing is there ({code}), or it is not shown to everybody"),
                "check repository, revision and path; for a private repository set HF_TOKEN",
            ),
            (404 | 410, _) => {
                error(Kind::Missing, format!("nothing is there ({code}{detail})"), "check the address")
            }
            (401 | 403, auth) => {
                error(Kind::Denied, format!("access is denied ({code}{detail})"), self.how_to_sign(auth))
            }
            (301 | 307 | 400, Auth::S3) if let Some(region) = headers.get("x-amz-bucket-region") => {
                let region = region.to_str().unwrap_or("?");
                error(
                    Kind::Answer,
                    format!("its bucket is in the region {region}, not in {}", self.settings.s3.region),
                    &format!("set AWS_REGION={region}"),
                )
            }
            _ => error(Kind::Answer, format!("the server answers {code}{detail}"), "check the address"),
        }
    }

    fn how_to_sign(&self, auth: Auth) -> &'static str {
        match auth {
            Auth::S3 if self.settings.s3.credentials.is_none() => {
                "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, and AWS_ENDPOINT_URL for another store than Amazon's"
            }
            Auth::S3 => "check that the key of AWS_ACCESS_KEY_ID may read and list it, and AWS_REGION",
            Auth::Hub if self.settings.hub.token.is_none() => {
                "set HF_TOKEN; a gated dataset also asks to accept its terms on its page"
            }
            Auth::Hub => {
                "check that the token of HF_TOKEN may read it, and that the terms of a gated dataset are accepted"
            }
            Auth::None => "its server wants a login; fetch it with a program that has one, and open the file",
        }
    }
}

fn changed(link: &Link) -> RemoteError {
    let reason = "it was changed after it was opened";
    RemoteError::new(Kind::Changed, &link.name, reason, "open it again, once nobody writes to it")
}

fn bad_answer(link: &Link, what: &str) -> RemoteError {
    let fix = "use another server, or fetch it with another program";
    RemoteError::new(Kind::Answer, &link.name, format!("the server {what}"), fix)
}

/// What versions differ in.
fn tag_of(headers: &HeaderMap) -> Option<String> {
    let value = headers.get("etag").or_else(|| headers.get("last-modified"))?;
    value.to_str().ok().map(str::to_owned)
}

/// Bytes of the whole object.
fn total(answer: &Parts) -> Option<u64> {
    let headers = &answer.headers;
    match headers.get("content-range") {
        Some(range) => range.to_str().ok()?.rsplit('/').next()?.parse().ok(),
        None if answer.status == StatusCode::OK => headers.get("content-length")?.to_str().ok()?.parse().ok(),
        None => None,
    }
}

/// Of `bytes 5-9/10`, 5.
fn first_byte(headers: &HeaderMap) -> Option<u64> {
    let range = headers.get("content-range")?.to_str().ok()?;
    range.trim().strip_prefix("bytes")?.trim_start().split('-').next()?.parse().ok()
}

/// Certificates to trust.
fn certificates(path: &Path) -> Result<Vec<ureq::tls::Certificate<'static>>, RemoteError> {
    let name = path.display().to_string();
    let refuse = |reason: String| {
        RemoteError::new(Kind::Address, &name, reason, "set SSL_CERT_FILE to a file of certificates in PEM")
    };
    let text = std::fs::read(path).map_err(|error| refuse(error.to_string()))?;
    let of = |item| match item {
        Ok(PemItem::Certificate(found)) => Some(found),
        _ => None,
    };
    let found: Vec<_> = parse_pem(&text).filter_map(of).collect();
    match found.is_empty() {
        true => Err(refuse("it holds no certificate".to_owned())),
        false => Ok(found),
    }
}

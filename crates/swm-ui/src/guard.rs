//! Who may talk to the server: a one-time token, a session cookie, `Host` and `Origin`; and what a page of it may do.
//!
//! Other programs of the same user, other users of the machine and every web page that is open in the same browser can
//! reach a port on the loopback interface. None of them has the token. A page that makes its name resolve to 127.0.0.1
//! (DNS rebinding) sends its own name as `Host`; one that opens a WebSocket to us sends its own `Origin`.

use std::sync::atomic::{AtomicBool, Ordering};

use axum::http::{HeaderMap, HeaderValue, Method, Uri, header};

use crate::error::{Refusal, UiError};

/// A page may load what this server serves, and nothing else, and cannot send forms away. Who may frame it follows.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors ";

/// The secrets of a server, and the names by which it may be addressed.
pub(crate) struct Guard {
    /// Opens the first page, once.
    token: String,
    used: AtomicBool,
    /// What the browser that had the token shows from then on.
    session: String,
    cookie: String,
    /// Values of `Host`.
    hosts: Vec<String>,
    policy: HeaderValue,
}

/// A request that may go on.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Pass {
    /// It has the session's cookie.
    Known,
    /// It had the token: the answer sets this cookie.
    New(String),
}

impl Guard {
    /// New secrets for a server at `port`, which `names` (addresses or host names) stand for. A page of the origin `frame`
    /// may show it in a frame; without one, none may.
    pub(crate) fn new(names: &[String], port: u16, frame: Option<&str>) -> Result<Self, UiError> {
        let ancestors = frame.map_or(Ok("'none'"), |origin| check_origin(origin).map(|()| origin))?;
        let policy = HeaderValue::try_from(format!("{CONTENT_SECURITY_POLICY}{ancestors}"));
        let policy = policy.map_err(|_| UiError::Frame { origin: ancestors.to_owned() })?;
        let hosts = names.iter().flat_map(|name| {
            let bracketed = if name.contains(':') { format!("[{name}]") } else { name.to_lowercase() };
            // Browsers leave the port out where it is the scheme's own.
            let bare = (port == 80).then(|| bracketed.clone());
            [format!("{bracketed}:{port}")].into_iter().chain(bare)
        });
        Ok(Self {
            token: secret()?,
            used: AtomicBool::new(false),
            session: secret()?,
            // Browsers share cookies between ports of a host.
            cookie: format!("swm_ui_{port}"),
            hosts: hosts.collect(),
            policy,
        })
    }

    pub(crate) fn token(&self) -> &str {
        &self.token
    }

    /// Whether a request may go on.
    pub(crate) fn check(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Result<Pass, Refusal> {
        let text = |name| one(headers, &name);
        let host = text(header::HOST)?.ok_or_else(|| Refusal::forbidden("the request names no host"))?;
        if !self.hosts.contains(&host.to_lowercase()) {
            let known = self.hosts.join(", ");
            return Err(Refusal::forbidden(format!("this server is not `{host}`; it answers to {known}")));
        }
        let origin = text(header::ORIGIN)?;
        let is_upgrade = headers.contains_key(header::UPGRADE);
        let changes = *method != Method::GET && *method != Method::HEAD;
        match origin {
            Some(origin) if origin != format!("http://{}", host.to_lowercase()) => {
                return Err(Refusal::forbidden(format!("a page of `{origin}` may not talk to this server")));
            }
            None if is_upgrade || changes => {
                return Err(Refusal::forbidden("the request does not say which page it comes from"));
            }
            _ => {}
        }
        let site = headers.get("sec-fetch-site").map(HeaderValue::as_bytes);
        let is_navigation = headers.get("sec-fetch-mode").is_some_and(|mode| mode == "navigate");
        if !is_navigation && site.is_some_and(|site| site != b"same-origin" && site != b"none") {
            return Err(Refusal::forbidden("another page may not load parts of this server"));
        }
        if self.has_session(headers) {
            return Ok(Pass::Known);
        }
        let query = uri.query().unwrap_or_default();
        let token = query.split('&').find_map(|part| part.strip_prefix("token="));
        let fits = token.is_some_and(|token| equal(token, &self.token));
        if fits && uri.path() == "/" && *method == Method::GET && !self.used.swap(true, Ordering::SeqCst) {
            let Self { cookie, session, .. } = self;
            return Ok(Pass::New(format!("{cookie}={session}; Path=/; HttpOnly; SameSite=Strict")));
        }
        let fix = "open the address that `swm ui` printed; it works once, in one browser, so start `swm ui` again for another";
        Err(Refusal::new(axum::http::StatusCode::UNAUTHORIZED, format!("this page needs a token: {fix}")))
    }

    /// What every answer says.
    pub(crate) fn add_headers(&self, headers: &mut HeaderMap) {
        headers.insert(header::CONTENT_SECURITY_POLICY, self.policy.clone());
        let mut add = |name: &'static str, value: &'static str| {
            headers.insert(name, HeaderValue::from_static(value));
        };
        add("x-content-type-options", "nosniff");
        add("referrer-policy", "no-referrer");
        add("cross-origin-opener-policy", "same-origin");
        add("cross-origin-resource-policy", "same-origin");
        add("cache-control", "no-store");
    }

    fn has_session(&self, headers: &HeaderMap) -> bool {
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs =
            cookies.flat_map(|line| line.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.any(|(name, value)| name == self.cookie && equal(value, &self.session))
    }
}

/// The only value of a header, if there is one.
fn one<'a>(headers: &'a HeaderMap, name: &header::HeaderName) -> Result<Option<&'a str>, Refusal> {
    let wrong = || Refusal::forbidden(format!("the header `{name}` is given twice, or is no text"));
    let mut values = headers.get_all(name).iter();
    let first = values.next();
    if values.next().is_some() {
        return Err(wrong());
    }
    first.map(|value| value.to_str().map_err(|_| wrong())).transpose()
}

/// 256 random bits in hexadecimal.
fn secret() -> Result<String, UiError> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).map_err(|error| UiError::Token(error.to_string()))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Compares in a time that does not tell how much agrees.
fn equal(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
}

/// Refuses what is no single origin: `http://localhost:8888`.
fn check_origin(origin: &str) -> Result<(), UiError> {
    let host = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    let fits = |c: char| c.is_ascii_alphanumeric() || ".-:[]".contains(c);
    match host {
        Some(host) if !host.is_empty() && host.chars().all(fits) => Ok(()),
        _ => Err(UiError::Frame { origin: origin.to_owned() }),
    }
}

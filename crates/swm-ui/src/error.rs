//! What can go wrong before the page is served, and what a request is answered when it cannot be met.

use std::path::PathBuf;

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use swm_core::error::BoxError;

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UiError {
    /// A path that was to be shown.
    #[error("cannot show {path}: {source}", path = path.display())]
    Path {
        /// The path.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The folder for recordings.
    #[error("cannot record into {path}: {source}; give a folder that you may write to as `save`", path = path.display())]
    Save {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The host name.
    #[error("the host `{host}` {reason}")]
    Host {
        /// The name as it was given.
        host: String,
        /// Why it cannot be served on, and the fix.
        reason: String,
    },
    /// The page that may frame this one.
    #[error("`{origin}` is no origin of a page; write it as http://localhost:8888")]
    Frame {
        /// As it was given.
        origin: String,
    },
    /// The port.
    #[error("cannot listen on {address}: {source}; choose another `port`, or 0 for a free one")]
    Listen {
        /// Address and port.
        address: String,
        /// Why.
        source: std::io::Error,
    },
    /// The operating system gives no random bytes for the token.
    #[error("cannot make a token: {0}")]
    Token(String),
    /// The server's threads cannot be started, or the connection of the server broke.
    #[error("the server stopped: {0}")]
    Server(std::io::Error),
}

/// A request that is not met: a status and a sentence.
#[derive(Debug)]
pub(crate) struct Refusal {
    pub status: StatusCode,
    pub reason: String,
}

impl Refusal {
    pub(crate) fn new(status: StatusCode, reason: impl Into<String>) -> Self {
        Self { status, reason: reason.into() }
    }

    pub(crate) fn forbidden(reason: impl Into<String>) -> Self {
        Self::new(StatusCode::FORBIDDEN, reason)
    }

    pub(crate) fn bad(reason: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, reason)
    }
}

impl<E: Into<BoxError>> From<E> for Refusal {
    fn from(error: E) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, sentence(error.into().as_ref()))
    }
}

/// An error with those of its causes that say more.
pub(crate) fn sentence(error: &(dyn std::error::Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = error.source();
    }
    text
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let body = serde_json::json!({ "error": self.reason }).to_string();
        (self.status, [(header::CONTENT_TYPE, "application/json")], body).into_response()
    }
}

/// What a request for data is answered.
pub(crate) type Answer = Result<Response, Refusal>;

/// A JSON answer.
pub(crate) fn json(value: &impl Serialize) -> Answer {
    let body = serde_json::to_vec(value)?;
    Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response())
}

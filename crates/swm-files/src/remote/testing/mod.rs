//! A server on this machine for tests, and a reader of what it has.

mod server;

use std::path::Path;
use std::sync::Arc;

pub use self::server::{Fault, Server, State};
use super::found::Remote;
use super::settings::{Credentials, Hub, Settings};

/// A server, and a reader that keeps what it fetches in a folder of its own.
#[derive(Debug)]
pub struct Hosted {
    /// The server.
    pub server: Server,
    /// The reader.
    pub remote: Arc<Remote>,
}

impl Hosted {
    /// A plain server of these files, by path.
    #[must_use]
    pub fn http(files: &[(&str, Vec<u8>)], cache: &Path) -> Self {
        Self::new(files, cache, |_, _| {})
    }

    /// An empty store of S3. Requests are signed with a key, a secret and a session, where these are given.
    #[must_use]
    pub fn s3(cache: &Path, credentials: Option<[&str; 3]>) -> Self {
        Self::new(&[], cache, |settings, url| {
            settings.s3.endpoint = Some(url.to_owned());
            settings.s3.credentials = credentials.map(|given| {
                let [key, secret, session] = given.map(str::to_owned);
                Credentials { key, secret, session: Some(session) }
            });
        })
    }

    /// The Hub, with these files in its only repository, `user/repo`. Requests have the token, where one is given.
    #[must_use]
    pub fn hub(files: &[(&str, Vec<u8>)], cache: &Path, token: Option<&str>) -> Self {
        Self::new(files, cache, |settings, url| {
            settings.hub = Hub { endpoint: url.to_owned(), token: token.map(str::to_owned) };
        })
    }

    /// As [`Hosted::http`], with room for so many bytes of copies.
    #[must_use]
    pub fn limited(files: &[(&str, Vec<u8>)], cache: &Path, bytes: u64) -> Self {
        Self::new(files, cache, |settings, _| settings.cache_bytes = bytes)
    }

    pub(super) fn new(
        files: &[(&str, Vec<u8>)],
        cache: &Path,
        change: impl FnOnce(&mut Settings, &str),
    ) -> Self {
        let server = Server::start(files);
        let mut settings = Settings::of_test(cache);
        change(&mut settings, &server.url);
        Self { server, remote: Remote::new(settings).expect("its settings are sound") }
    }
}

/// The files of a folder, each with its path below `below`, and its bytes.
#[expect(clippy::unwrap_used, clippy::missing_panics_doc, reason = "helpers of tests panic as tests do")]
#[must_use]
pub fn files_of(folder: &Path, below: &str) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = format!("{below}/{}", entry.file_name().to_str().unwrap());
        match entry.path().is_dir() {
            true => found.extend(files_of(&entry.path(), &path)),
            false => found.push((path, std::fs::read(entry.path()).unwrap())),
        }
    }
    found
}

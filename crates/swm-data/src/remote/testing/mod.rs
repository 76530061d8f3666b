//! A server on this machine for tests, and a reader of what it has: for those of readers that read by position.

mod server;

use std::path::Path;
use std::sync::Arc;

use swm_core::{Column, Registry};

pub use self::server::{Fault, Server, State};
use super::found::Remote;
use super::open::open_from;
use super::settings::{Credentials, Hub, Settings};
use crate::dataset::{Dataset, Steps};
use crate::error::DataError;
use crate::format::Opened;
use crate::open_options::OpenOptions;

/// A server, and a reader that keeps what it fetches in a folder of its own.
#[derive(Debug)]
pub struct Hosted {
    /// The server.
    pub server: Server,
    remote: Arc<Remote>,
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

    fn new(files: &[(&str, Vec<u8>)], cache: &Path, change: impl FnOnce(&mut Settings, &str)) -> Self {
        let server = Server::start(files);
        let mut settings = Settings::of_test(cache);
        change(&mut settings, &server.url);
        Self { server, remote: Remote::new(settings).expect("its settings are sound") }
    }

    /// Opens an address, as [`open_with`](crate::open_with) does.
    ///
    /// # Errors
    ///
    /// As of [`open_with`](crate::open_with).
    pub fn open(&self, registry: &Registry, path: &Path, options: &OpenOptions) -> Opened<dyn Dataset> {
        open_from(&self.remote, registry, path, options)
    }
}

/// All rows of all columns, one after the other.
///
/// # Errors
///
/// As of [`Dataset::rows`].
pub fn rows(dataset: &mut dyn Dataset) -> Result<Vec<Column>, DataError> {
    let mut all = Vec::new();
    for column in 0..dataset.schema().fields().len() {
        for episode in 0..dataset.num_episodes() {
            let (field, count) = (dataset.schema().fields()[column].clone(), dataset.episode_len(episode));
            let mut out = Column::zeros(field.dtype, count * field.dim());
            dataset.rows(column, episode, Steps { first: 0, count, stride: 1 }, out.as_slice_mut())?;
            all.push(out);
        }
    }
    Ok(all)
}

/// Whether rows are equal; NaN equals NaN.
#[must_use]
pub fn same(a: &[Column], b: &[Column]) -> bool {
    format!("{a:?}") == format!("{b:?}")
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

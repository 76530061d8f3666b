//! Addresses of objects.

use std::path::Path;

use super::error::{RemoteError, RemoteErrorKind};
use super::s3::encoded;

/// Where an object or a folder of them is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Address {
    /// The whole address, and the part of it without a query.
    Http {
        url: String,
        plain: String,
    },
    S3 {
        bucket: String,
        key: String,
    },
    Hub {
        repo: String,
        /// A branch, a tag or a commit.
        revision: Option<String>,
        path: String,
    },
}

/// Words in the names of a query's values that are credentials.
const SECRETS: [&str; 10] =
    ["sig", "token", "key", "secret", "password", "passwd", "credential", "x-amz-", "x-goog-", "policy"];

impl Address {
    /// The address that a path is. One with credentials is refused, as paths are recorded in runs and shown.
    pub(super) fn of(path: &Path) -> Result<Self, RemoteError> {
        let found = Self::of_any(path)?;
        match &found {
            Self::Http { url, plain } if has_secret(url) => Err(RemoteError::new(
                RemoteErrorKind::Address,
                plain,
                "its query holds credentials, and runs record the paths of their datasets",
                "fetch it first (`swm fetch`), and use the file",
            )),
            _ => Ok(found),
        }
    }

    /// As [`Address::of`], of a path that is not recorded.
    pub(super) fn of_any(path: &Path) -> Result<Self, RemoteError> {
        let Some(text) = path.to_str() else {
            return Err(wrong("", "it is no text", "write it in Unicode"));
        };
        // A path keeps one slash of two.
        let (scheme, rest) = text.split_once(":/").unwrap_or_default();
        let rest = rest.strip_prefix('/').unwrap_or(rest);
        match scheme {
            "http" | "https" => http(scheme, rest),
            "s3" => {
                let (bucket, key) = rest.split_once('/').unwrap_or((rest, ""));
                let name = format!("s3://{rest}");
                if bucket.is_empty() || bucket.contains(['@', ':', '?', '\\']) || key.contains('\0') {
                    return Err(wrong(&redacted(&name), "it names no bucket", "write it as s3://BUCKET/KEY"));
                }
                Ok(Self::S3 { bucket: bucket.to_owned(), key: key.trim_end_matches('/').to_owned() })
            }
            _ => hub(rest),
        }
    }

    /// What messages call it.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Http { plain, .. } => plain.clone(),
            Self::S3 { bucket, key } => format!("s3://{bucket}/{key}"),
            Self::Hub { repo, revision, path } => {
                let revision = revision.as_ref().map(|revision| format!("@{revision}")).unwrap_or_default();
                format!("hf://datasets/{repo}{revision}/{path}")
            }
        }
    }

    /// The last name of its path.
    pub(super) fn file_name(&self) -> &str {
        let path = match self {
            Self::Http { plain, .. } => plain.split_once("://").and_then(|(_, rest)| rest.split_once('/')),
            Self::S3 { key, .. } => Some(("", key.as_str())),
            Self::Hub { repo, path, .. } => {
                Some(("", if path.is_empty() { repo.as_str() } else { path.as_str() }))
            }
        };
        let path = path.map_or("", |(_, path)| path.trim_end_matches('/'));
        path.rsplit('/').next().unwrap_or_default()
    }

    /// Below this one, as a folder.
    pub(super) fn join(&self, key: &str) -> Self {
        let below = |path: &str| match path.trim_end_matches('/') {
            "" => key.to_owned(),
            path => format!("{path}/{key}"),
        };
        match self {
            Self::Http { plain, .. } => {
                let url = below(plain);
                // Names of files are encoded in an address, and those of a folder were not yet.
                let url = url
                    .strip_suffix(key)
                    .map_or(url.clone(), |start| format!("{start}{}", encoded(key, true)));
                Self::Http { plain: url.clone(), url }
            }
            Self::S3 { bucket, key } => Self::S3 { bucket: bucket.clone(), key: below(key) },
            Self::Hub { repo, revision, path } => {
                Self::Hub { repo: repo.clone(), revision: revision.clone(), path: below(path) }
            }
        }
    }
}

fn wrong(name: &str, reason: &str, fix: &str) -> RemoteError {
    RemoteError::new(RemoteErrorKind::Address, name, reason, fix)
}

/// Whether an address has a query with a credential.
fn has_secret(url: &str) -> bool {
    let query = url.split_once('?').map_or("", |(_, query)| query);
    query.split('&').any(|part| {
        let name = part.split('=').next().unwrap_or_default().to_ascii_lowercase();
        SECRETS.iter().any(|secret| name.contains(secret))
    })
}

/// An address without what may be credentials.
fn redacted(text: &str) -> String {
    let text = text.split(['?', '#']).next().unwrap_or_default();
    match text.split_once("://") {
        Some((scheme, rest)) => {
            let (host, path) = rest.split_once('/').map_or((rest, None), |(host, path)| (host, Some(path)));
            let host = host.rsplit('@').next().unwrap_or_default();
            path.map_or_else(|| format!("{scheme}://{host}"), |path| format!("{scheme}://{host}/{path}"))
        }
        None => text.to_owned(),
    }
}

/// Whether a host is this machine.
pub(super) fn is_loopback(host: &str) -> bool {
    let host = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
}

fn http(scheme: &str, rest: &str) -> Result<Address, RemoteError> {
    let url = format!("{scheme}://{rest}").split('#').next().unwrap_or_default().to_owned();
    let plain = redacted(&url);
    let host = rest.split(['/', '?', '#']).next().unwrap_or_default();
    if host.is_empty() {
        return Err(wrong(&plain, "it names no host", "write it as https://HOST/PATH"));
    }
    if host.contains('@') {
        let fix = "leave it out, and use the variables of s3:// or hf://, or fetch it with another program";
        return Err(wrong(&plain, "it holds a name and a password", fix));
    }
    if scheme == "http" && !is_loopback(host) {
        let fix = "use https://; http:// is for servers on this machine alone";
        return Err(wrong(&plain, "over http:// anybody between could change it", fix));
    }
    if url.bytes().any(|byte| byte <= b' ' || byte >= 0x7f || byte == b'\\') {
        let fix = "write such characters in percent, as %20 for a space";
        return Err(wrong(&plain, "it holds characters that no address has", fix));
    }
    Ok(Address::Http { url, plain })
}

fn hub(rest: &str) -> Result<Address, RemoteError> {
    let name = format!("hf://{rest}");
    let refuse = |reason: &str| {
        Err(wrong(&redacted(&name), reason, "write it as hf://datasets/USER/REPO[@REVISION]/PATH"))
    };
    let Some(rest) = rest.strip_prefix("datasets/") else {
        return refuse("only datasets of the Hub are read");
    };
    let mut parts = rest.splitn(3, '/');
    let (user, repo, path) =
        (parts.next().unwrap_or_default(), parts.next().unwrap_or_default(), parts.next());
    let (repo, revision) =
        repo.split_once('@').map_or((repo, None), |(repo, revision)| (repo, Some(revision)));
    let is_name = |name: &str| {
        let is_part = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte);
        !name.is_empty() && name.bytes().all(is_part) && !name.starts_with('.')
    };
    if !is_name(user) || !is_name(repo) {
        return refuse("it names no repository");
    }
    if revision.is_some_and(str::is_empty) {
        return refuse("it names no revision behind the @");
    }
    Ok(Address::Hub {
        repo: format!("{user}/{repo}"),
        // In the Hub's addresses a slash of a branch is %2F.
        revision: revision.map(|revision| revision.replace("%2F", "/")),
        path: path.unwrap_or_default().trim_end_matches('/').to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> Result<String, String> {
        Address::of(Path::new(text))
            .map(|found| found.name())
            .map_err(|error| format!("{}: {error}", error.name))
    }

    #[test]
    fn addresses_are_read() {
        for same in [
            "https://host/a/b.npz",
            "https://host/a.npz",
            "http://127.0.0.1:80/a",
            "http://localhost/a",
            "http://[::1]:3/a",
            "s3://bucket/a/b.zarr",
            "hf://datasets/user/repo/",
            "hf://datasets/user/repo@v1.0/data/x.h5",
        ] {
            assert_eq!(name(same).unwrap(), same);
        }
        assert_eq!(name("https:/host/a.npz").unwrap(), "https://host/a.npz");
        assert_eq!(name("s3://bucket/a.zarr/").unwrap(), "s3://bucket/a.zarr");
        assert_eq!(name("https://host/a.npz?download=1").unwrap(), "https://host/a.npz");
    }

    #[test]
    fn what_is_refused_shows_no_credential() {
        for (text, reason) in [
            ("http://example.org/a", "use https://"),
            ("https://me:SECRET@host/a", "a name and a password"),
            ("https://host/a?X-Amz-Signature=SECRET", "swm fetch"),
            ("https://host/a?access_token=SECRET", "swm fetch"),
            ("https:///a", "no host"),
            ("s3:///key", "no bucket"),
            ("s3://me:SECRET@bucket/key", "no bucket"),
            ("hf://models/user/repo", "only datasets"),
            ("hf://datasets/user", "no repository"),
            ("hf://datasets/user/repo@/x", "no revision"),
            ("hf://datasets/../x/y", "no repository"),
            ("https://host/a b", "percent"),
        ] {
            let message = name(text).unwrap_err();
            assert!(message.contains(reason) && !message.contains("SECRET"), "{text}: {message}");
        }
    }

    #[test]
    fn names_below_a_folder() {
        let at = |text: &str| Address::of(Path::new(text)).unwrap();
        assert_eq!(at("s3://b/x.zarr").join("data/0.0").name(), "s3://b/x.zarr/data/0.0");
        assert_eq!(at("s3://b").join("x").name(), "s3://b/x");
        assert_eq!(at("https://h/x").join("a b").name(), "https://h/x/a%20b");
        assert_eq!(at("hf://datasets/u/r@1/x").join("y").name(), "hf://datasets/u/r@1/x/y");
        for (text, file) in
            [("https://h/a/x.npz?d=1", "x.npz"), ("s3://b/k/y.h5", "y.h5"), ("hf://datasets/u/r", "r")]
        {
            assert_eq!(at(text).file_name(), file);
        }
        assert_eq!(at("https://h").file_name(), "");
    }
}

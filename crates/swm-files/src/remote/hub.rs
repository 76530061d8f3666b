//! The Hugging Face Hub: revisions, trees of files, and their addresses.

use serde::Deserialize;
use serde_json::Value as Json;

use super::address::is_loopback;
use super::client::{Auth, Client, Link};
use super::error::{RemoteError, RemoteErrorKind as Kind};
use super::list::{Entry, Files, MAX_FILES};
use super::s3::encoded;

/// A repository at a commit.
#[derive(Clone, Debug)]
pub(super) struct Repository {
    name: String,
    pub(super) commit: String,
}

/// An entry of a tree, as the Hub gives it.
#[derive(Deserialize)]
struct Node {
    #[serde(rename = "type")]
    kind: String,
    path: String,
    #[serde(default)]
    size: u64,
    #[serde(default)]
    oid: String,
    lfs: Option<Lfs>,
}

/// A large file.
#[derive(Deserialize)]
struct Lfs {
    /// Its SHA-256.
    oid: String,
    size: u64,
}

fn link(client: &Client, name: &str, path: &str) -> Result<Link, RemoteError> {
    let endpoint = &client.settings.hub.endpoint;
    let is_safe = match endpoint.split_once("://") {
        Some(("https", _)) => true,
        Some(("http", rest)) => is_loopback(rest.split('/').next().unwrap_or_default()),
        _ => false,
    };
    match is_safe {
        true => Ok(Link { name: name.to_owned(), url: format!("{endpoint}/{path}"), auth: Auth::Hub }),
        false => {
            let reason = "HF_ENDPOINT is no address that begins with https://";
            Err(RemoteError::new(Kind::Address, name, reason, "set it to one, or remove it"))
        }
    }
}

impl Repository {
    /// The repository at the commit that a revision is now.
    pub(super) fn at(
        client: &Client,
        name: &str,
        repo: &str,
        revision: Option<&str>,
    ) -> Result<Self, RemoteError> {
        let revision = revision.unwrap_or("main");
        let found = |commit: &str| Self { name: repo.to_owned(), commit: commit.to_owned() };
        let is_hex = |text: &str| text.len() == 40 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        if is_hex(revision) {
            return Ok(found(revision));
        }
        let link = link(client, name, &format!("api/datasets/{repo}/revision/{}", encoded(revision, false)))?;
        let (text, _) = client.text(&link)?;
        let about: Json = serde_json::from_slice(&text).unwrap_or_default();
        match about["sha"].as_str().filter(|commit| is_hex(commit)) {
            Some(commit) => Ok(found(commit)),
            None => Err(odd(name, "no commit of the revision")),
        }
    }

    /// The address of a file.
    pub(super) fn file(&self, client: &Client, name: &str, path: &str) -> Result<Link, RemoteError> {
        let place = format!("datasets/{}/resolve/{}/{}", self.name, self.commit, encoded(path, true));
        link(client, name, &place)
    }

    /// All files below a folder, by their paths in it.
    pub(super) fn files(&self, client: &Client, name: &str, folder: &str) -> Result<Files, RemoteError> {
        let below = if folder.is_empty() { String::new() } else { format!("/{}", encoded(folder, true)) };
        let tree = format!("api/datasets/{}/tree/{}{below}?recursive=true", self.name, self.commit);
        let mut next = Some(link(client, name, &tree)?);
        let mut files = Files::new();
        while let Some(page) = next {
            let (text, headers) = client.text(&page)?;
            let nodes: Vec<Node> = serde_json::from_slice(&text)
                .map_err(|error| odd(name, &format!("no list of files ({error})")))?;
            for node in nodes.into_iter().filter(|node| node.kind == "file") {
                let path =
                    node.path.strip_prefix(folder).unwrap_or(&node.path).trim_start_matches('/').to_owned();
                let (size, sha256) = match node.lfs {
                    Some(large) => (large.size, Some(large.oid)),
                    None => (node.size, None),
                };
                let version = sha256.clone().unwrap_or(node.oid);
                files.insert(path, Entry { size, tag: None, version, sha256 });
            }
            if files.len() > MAX_FILES {
                return Err(odd(name, "too many files"));
            }
            let more = headers.get("link").and_then(|value| next_page(value.to_str().ok()?));
            // Only of the same server: the token goes with it.
            let endpoint = &client.settings.hub.endpoint;
            let more = more
                .filter(|url| url.strip_prefix(endpoint.as_str()).is_some_and(|rest| rest.starts_with('/')));
            next = more.map(|url| Link { url, ..page });
        }
        Ok(files)
    }
}

/// Of `<address>; rel="next"`, the address.
fn next_page(header: &str) -> Option<String> {
    let is_next = |part: &&str| part.contains("rel=\"next\"");
    let (_, rest) = header.split(',').find(is_next)?.split_once('<')?;
    rest.split_once('>').map(|(url, _)| url.to_owned())
}

fn odd(name: &str, what: &str) -> RemoteError {
    RemoteError::new(Kind::Answer, name, format!("the Hub gives {what}"), "check HF_ENDPOINT and the address")
}

#[cfg(test)]
mod tests {
    use super::next_page;

    #[test]
    fn links_to_the_next_page() {
        let header = "<https://h/first>; rel=\"first\", <https://h/tree?cursor=a>; rel=\"next\"";
        assert_eq!(next_page(header).as_deref(), Some("https://h/tree?cursor=a"));
        assert_eq!(next_page("<https://h/first>; rel=\"first\""), None);
    }
}

//! A server on this machine for tests: HTTP with ranges, lists of S3, trees of the Hub, and faults.

#![expect(clippy::unwrap_used, reason = "helpers of tests panic as tests do")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use serde_json::json;
use sha2::{Digest as _, Sha256};

use super::super::sign::hex;

/// What goes wrong with a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Half of the answer, then the end of the connection.
    Cut,
    /// Pauses within the answer that are shorter than what is waited for.
    Slow,
    /// No answer.
    Silent,
    /// This status.
    Status(u16),
}

/// What all connections share.
#[derive(Debug, Default)]
pub struct State {
    /// By path; those of S3 are below their bucket.
    pub files: Mutex<BTreeMap<String, Vec<u8>>>,
    /// Paths and ranges that were asked for.
    pub asked: Mutex<Vec<(String, Option<String>)>>,
    /// What goes wrong next.
    pub faults: Mutex<Vec<Fault>>,
    /// Answers are whole, whatever is asked for.
    pub has_no_ranges: AtomicBool,
    /// Answers have no `ETag`.
    pub has_no_tags: AtomicBool,
    /// The branch of the repository is at another commit, whose files are below `/moved`.
    pub is_moved: AtomicBool,
    /// So many requests are answered; those after are told to come later.
    pub answers: AtomicUsize,
    /// What the header `authorization` must begin with.
    pub wants: Mutex<Option<&'static str>>,
}

/// A running server; it ends with the test.
#[derive(Debug)]
pub struct Server {
    /// Its address, without a slash at its end.
    pub url: String,
    /// What its connections share.
    pub state: Arc<State>,
}

impl Server {
    /// A server of these files, by path.
    #[must_use]
    pub fn start(files: &[(&str, Vec<u8>)]) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let state = Arc::new(State { answers: AtomicUsize::new(usize::MAX), ..State::default() });
        for (path, bytes) in files {
            state.files.lock().unwrap().insert((*path).to_owned(), bytes.clone());
        }
        let (shared, own) = (state.clone(), url.clone());
        thread::spawn(move || {
            for connection in listener.incoming().flatten() {
                let (state, own) = (shared.clone(), own.clone());
                thread::spawn(move || drop(serve(&state, &own, connection)));
            }
        });
        Self { url, state }
    }

    /// Adds a file, or replaces it.
    pub fn put(&self, path: &str, bytes: Vec<u8>) {
        self.state.files.lock().unwrap().insert(path.to_owned(), bytes);
    }

    /// Lets the next requests go wrong, in this order.
    pub fn fail(&self, faults: &[Fault]) {
        self.state.faults.lock().unwrap().extend(faults.iter().rev());
    }

    /// Requests so far.
    #[must_use]
    pub fn count(&self) -> usize {
        self.state.asked.lock().unwrap().len()
    }
}

type Headers = BTreeMap<String, String>;

fn serve(state: &State, url: &str, connection: TcpStream) -> std::io::Result<()> {
    let mut reader = BufReader::new(connection.try_clone()?);
    let mut first = String::new();
    reader.read_line(&mut first)?;
    let target = first.split(' ').nth(1).unwrap_or_default().to_owned();
    let mut headers = Headers::new();
    loop {
        let mut line = String::new();
        reader.read_line(&mut line)?;
        match line.trim().split_once(':') {
            Some((name, value)) => headers.insert(name.to_ascii_lowercase(), value.trim().to_owned()),
            None => break,
        };
    }
    state.asked.lock().unwrap().push((target.clone(), headers.get("range").cloned()));
    let is_over = state
        .answers
        .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| match left {
            usize::MAX => Some(left),
            left => left.checked_sub(1),
        })
        .is_err();
    let fault = state.faults.lock().unwrap().pop().or(is_over.then_some(Fault::Status(503)));
    let is_signed = state
        .wants
        .lock()
        .unwrap()
        .is_none_or(|start| headers.get("authorization").is_some_and(|value| value.starts_with(start)));
    let (status, more, body) = match fault {
        Some(Fault::Status(status)) => (status, String::new(), Vec::new()),
        _ if !is_signed => (403, String::new(), b"<Error><Code>AccessDenied</Code></Error>".to_vec()),
        _ => answer(state, url, &target, &headers),
    };
    let mut out = connection;
    let length = body.len();
    write!(out, "HTTP/1.1 {status} X\r\nconnection: close\r\ncontent-length: {length}\r\n{more}\r\n")?;
    match fault {
        Some(Fault::Cut) => out.write_all(&body[..length / 2]),
        Some(Fault::Silent) => {
            thread::sleep(Duration::from_secs(3));
            Ok(())
        }
        Some(Fault::Slow) => {
            for piece in body.chunks(length / 3 + 1) {
                thread::sleep(Duration::from_millis(700));
                out.write_all(piece)?;
                out.flush()?;
            }
            Ok(())
        }
        _ => out.write_all(&body),
    }
}

fn answer(state: &State, url: &str, target: &str, headers: &Headers) -> (u16, String, Vec<u8>) {
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let files = state.files.lock().unwrap();
    if let Some(prefix) = query.split('&').find_map(|part| part.strip_prefix("prefix=")) {
        return (200, String::new(), list(&files, path, &prefix.replace("%2F", "/"), query).into_bytes());
    }
    if let Some(rest) = path.strip_prefix("/api/datasets/user/repo/") {
        let commit = if state.is_moved.load(Ordering::Relaxed) { OTHER_COMMIT } else { COMMIT };
        return hub(&files, url, commit, rest, query);
    }
    let place = path.strip_prefix("/datasets/user/repo/resolve/");
    let name = match place.and_then(|place| place.split_at_checked(COMMIT.len())) {
        Some((OTHER_COMMIT, name)) => format!("/moved{name}"),
        Some((_, name)) => name.to_owned(),
        None => path.to_owned(),
    };
    match files.get(&name) {
        Some(bytes) => object(state, bytes, headers),
        None => (404, String::new(), Vec::new()),
    }
}

fn tag(bytes: &[u8]) -> String {
    format!("\"{}\"", &hex(&Sha256::digest(bytes))[..8])
}

fn object(state: &State, bytes: &[u8], headers: &Headers) -> (u16, String, Vec<u8>) {
    let tag = tag(bytes);
    if headers.get("if-match").is_some_and(|wanted| *wanted != tag) {
        return (412, String::new(), Vec::new());
    }
    let mut more = String::new();
    if !state.has_no_tags.load(Ordering::Relaxed) {
        more = format!("etag: {tag}\r\n");
    }
    let range = headers.get("range").filter(|_| !state.has_no_ranges.load(Ordering::Relaxed));
    let Some(range) = range else { return (200, more, bytes.to_vec()) };
    let (first, last) = range.trim_start_matches("bytes=").split_once('-').unwrap();
    let (first, last) =
        (first.parse::<usize>().unwrap(), last.parse::<usize>().unwrap().min(bytes.len().max(1) - 1));
    if first >= bytes.len() {
        return (416, format!("content-range: bytes */{}\r\n", bytes.len()), Vec::new());
    }
    write!(more, "content-range: bytes {first}-{last}/{}\r\n", bytes.len()).unwrap();
    (206, more, bytes[first..=last].to_vec())
}

/// Pages of two objects.
fn list(files: &BTreeMap<String, Vec<u8>>, bucket: &str, prefix: &str, query: &str) -> String {
    let start = format!("{bucket}{prefix}");
    let all: Vec<_> = files.iter().filter(|(path, _)| path.starts_with(&start)).collect();
    let page: usize = query
        .split('&')
        .find_map(|part| part.strip_prefix("continuation-token="))
        .map_or(0, |at| at.parse().unwrap());
    let mut text = String::from("<ListBucketResult>");
    for (path, bytes) in all.iter().skip(page * 2).take(2) {
        let (key, size, tag) =
            (path.strip_prefix(bucket).unwrap(), bytes.len(), tag(bytes).replace('"', "&quot;"));
        write!(text, "<Contents><Key>{key}</Key><Size>{size}</Size><ETag>{tag}</ETag></Contents>").unwrap();
    }
    let is_cut = all.len() > page * 2 + 2;
    let next = page + 1;
    write!(text, "<IsTruncated>{is_cut}</IsTruncated><NextContinuationToken>{next}</NextContinuationToken></ListBucketResult>").unwrap();
    text
}

const COMMIT: &str = "0123456789abcdef0123456789abcdef01234567";
const OTHER_COMMIT: &str = "89abcdef0123456789abcdef0123456789abcdef";

/// Trees in pages of two files; large files have their SHA-256.
fn hub(
    files: &BTreeMap<String, Vec<u8>>,
    url: &str,
    commit: &str,
    rest: &str,
    query: &str,
) -> (u16, String, Vec<u8>) {
    if rest.starts_with("revision/") {
        return (200, String::new(), json!({ "sha": commit }).to_string().into_bytes());
    }
    let folder = rest.strip_prefix(&format!("tree/{commit}")).unwrap_or("?");
    let start = format!("{folder}/");
    let all: Vec<_> = files.iter().filter(|(path, _)| path.starts_with(&start)).collect();
    if all.is_empty() {
        return (404, String::new(), Vec::new());
    }
    let page: usize =
        query.split('&').find_map(|part| part.strip_prefix("cursor=")).map_or(0, |at| at.parse().unwrap());
    let node = |(path, bytes): &(&String, &Vec<u8>)| {
        let lfs = json!({ "oid": hex(&Sha256::digest(bytes)), "size": bytes.len() });
        let path = path.trim_start_matches('/');
        json!({ "type": "file", "path": path, "oid": tag(bytes), "size": bytes.len(), "lfs": lfs })
    };
    let nodes: Vec<_> = all.iter().skip(page * 2).take(2).map(node).collect();
    let next = format!(
        "link: <{url}/api/datasets/user/repo/{rest}?recursive=true&cursor={}>; rel=\"next\"\r\n",
        page + 1
    );
    let more = if all.len() > page * 2 + 2 { next } else { String::new() };
    (200, more, json!(nodes).to_string().into_bytes())
}

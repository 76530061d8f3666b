//! A server to talk to, and the requests and messages of a browser, by hand.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::thread::JoinHandle;
use std::time::Duration;

use swm_core::testing::TOY;
use swm_core::{Cancel, EnvEntry, Registry};
use swm_ui::{Options, Server, UiError};

static ENVS: [EnvEntry; 1] = [TOY];

pub(crate) fn registry() -> Registry {
    Registry::new().with(&ENVS).with(swm_data::FORMATS)
}

/// A server that ends with the test.
pub(crate) struct Running {
    pub(crate) address: SocketAddr,
    pub(crate) token: String,
    stop: Cancel,
    pub(crate) thread: Option<JoinHandle<Result<(), UiError>>>,
}

impl Running {
    pub(crate) fn new(options: Options) -> Self {
        let server = Server::bind(options).unwrap();
        let url = server.url();
        let token = url.split_once("token=").unwrap().1.to_owned();
        let (address, stop) = (server.address(), server.stopper());
        Self { address, token, stop, thread: Some(std::thread::spawn(|| server.run())) }
    }

    /// One with a session, whose cookie is returned too.
    pub(crate) fn entered(options: Options) -> (Self, String) {
        let server = Self::new(options);
        let cookie = server.enter();
        (server, cookie)
    }

    pub(crate) fn host(&self) -> String {
        format!("127.0.0.1:{}", self.address.port())
    }

    /// The answer to a request with these lines of headers; `Host` is the server's own, where they name none.
    pub(crate) fn ask(&self, path: &str, headers: &[String]) -> String {
        self.request("GET", path, headers, "")
    }

    /// The same of any method, with a body.
    pub(crate) fn request(&self, method: &str, path: &str, headers: &[String], body: &str) -> String {
        let mut stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let mut request = format!("{method} {path} HTTP/1.1\r\n");
        let stays_open = headers.iter().any(|line| line.starts_with("Connection:"));
        if !stays_open {
            request += "Connection: close\r\n";
        }
        if !headers.iter().any(|line| line.starts_with("Host:")) {
            request += &format!("Host: {}\r\n", self.host());
        }
        headers.iter().for_each(|line| request += &format!("{line}\r\n"));
        if method != "GET" {
            request += &format!("Content-Length: {}\r\n", body.len());
        }
        // A server that refuses what is too large does not read all of it.
        let _ = stream.write_all((request + "\r\n" + body).as_bytes());
        let mut answer = Vec::new();
        let mut piece = [0; 4096];
        while let Ok(read @ 1..) = stream.read(&mut piece) {
            answer.extend_from_slice(&piece[..read]);
            // The head is enough of what stays open.
            if stays_open && answer.windows(4).any(|end| end == b"\r\n\r\n") {
                break;
            }
        }
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// Uses the token; the cookie.
    pub(crate) fn enter(&self) -> String {
        let answer = self.ask(&format!("/?token={}", self.token), &[]);
        let line = answer.lines().find_map(|line| line.strip_prefix("set-cookie: ")).expect("a cookie");
        format!("Cookie: {}", line.split(';').next().unwrap())
    }

    /// The head of a WebSocket's request, from a page of `origin`.
    pub(crate) fn upgrade(origin: Option<&str>, cookie: Option<&str>) -> Vec<String> {
        let mut lines: Vec<String> = [
            "Upgrade: websocket",
            "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        ]
        .map(str::to_owned)
        .to_vec();
        lines.extend(origin.map(|origin| format!("Origin: {origin}")));
        lines.extend(cookie.map(str::to_owned));
        lines
    }

    /// An open WebSocket of the page.
    pub(crate) fn connect(&self, cookie: &str) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let (host, lines) =
            (self.host(), Self::upgrade(Some(&format!("http://{}", self.host())), Some(cookie)));
        let request = format!(
            "GET /api/play HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\n{}\r\n\r\n",
            lines.join("\r\n")
        );
        stream.write_all(request.as_bytes()).unwrap();
        let mut head = Vec::new();
        let mut byte = [0];
        while !head.ends_with(b"\r\n\r\n") && stream.read(&mut byte).unwrap() == 1 {
            head.push(byte[0]);
        }
        assert!(head.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&head));
        stream
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.cancel();
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(std::thread::panicking() || matches!(ended, Ok(Ok(()))));
        }
    }
}

/// A message of the page, masked as browsers do.
pub(crate) fn message(text: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0x81];
    match text.len() {
        len @ ..126 => bytes.push(0x80 | len as u8),
        len @ ..65536 => {
            bytes.push(0x80 | 126);
            bytes.extend((len as u16).to_be_bytes());
        }
        len => {
            bytes.push(0x80 | 127);
            bytes.extend((len as u64).to_be_bytes());
        }
    }
    bytes.extend([0; 4]);
    bytes.extend(text);
    bytes
}

/// The next message of the server: its kind, its content.
pub(crate) fn receive(stream: &mut TcpStream) -> Option<(u8, Vec<u8>)> {
    let mut head = [0; 2];
    stream.read_exact(&mut head).ok()?;
    let len = match head[1] & 0x7f {
        126 => {
            let mut len = [0; 2];
            stream.read_exact(&mut len).ok()?;
            u16::from_be_bytes(len).into()
        }
        127 => {
            let mut len = [0; 8];
            stream.read_exact(&mut len).ok()?;
            u64::from_be_bytes(len)
        }
        len => u64::from(len),
    };
    let mut content = vec![0; len as usize];
    stream.read_exact(&mut content).ok()?;
    Some((head[0] & 0x0f, content))
}

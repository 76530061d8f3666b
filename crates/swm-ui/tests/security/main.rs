//! Who may talk to the server, and what it reads, writes and puts up with. Requests are written by hand: a browser would not
//! send most of them.

#![expect(clippy::unwrap_used, reason = "what a helper cannot do ends its test")]

mod commands;
mod links;
mod requests;
mod server;

use std::fs;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use swm_ui::{Options, Server};

use server::{Running, message, receive, registry};

fn status(answer: &str) -> u16 {
    answer
        .split(' ')
        .nth(1)
        .and_then(|word| word.parse().ok())
        .unwrap_or_else(|| panic!("no status: {answer:?}"))
}

/// The next text of the server.
fn receive_text(stream: &mut TcpStream) -> String {
    loop {
        match receive(stream).expect("the connection is open") {
            (1, content) => return String::from_utf8(content).unwrap(),
            _ => continue,
        }
    }
}

#[test]
fn the_token_opens_the_page_once_and_the_cookie_from_then_on() {
    let server = Running::new(Options::new(registry()));
    assert_eq!(status(&server.ask("/", &[])), 401, "without a token");
    assert_eq!(status(&server.ask("/?token=0000", &[])), 401);
    assert_eq!(
        status(&server.ask(&format!("/api/about?token={}", server.token), &[])),
        401,
        "the token opens the page only"
    );
    let cookie = server.enter();
    assert_eq!(status(&server.ask(&format!("/?token={}", server.token), &[])), 401, "a second browser");
    for path in ["/", "/api/about", "/assets/app.js"] {
        assert_eq!(status(&server.ask(path, std::slice::from_ref(&cookie))), 200, "{path}");
        assert_eq!(status(&server.ask(path, &[])), 401, "{path}");
        assert_eq!(status(&server.ask(path, &[format!("{cookie}0")])), 401, "{path}");
    }
}

#[test]
fn the_cookie_is_for_this_page_alone_and_scripts_do_not_see_it() {
    let server = Running::new(Options::new(registry()));
    let answer = server.ask(&format!("/?token={}", server.token), &[]);
    let cookie = answer.lines().find(|line| line.starts_with("set-cookie: ")).unwrap();
    assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict"), "{cookie}");
    assert!(cookie.contains(&format!("swm_ui_{}=", server.address.port())), "{cookie}");
    assert!(!answer.contains(&format!("={};", server.token)), "the cookie is not the token");
}

#[test]
fn a_name_that_resolves_to_this_machine_is_not_its_name() {
    let (server, cookie) = Running::entered(Options::new(registry()));
    let port = server.address.port();
    let ask = |host: String| status(&server.ask("/api/about", &[format!("Host: {host}"), cookie.clone()]));
    assert_eq!(ask(format!("127.0.0.1:{port}")), 200);
    assert_eq!(ask(format!("localhost:{port}")), 200);
    assert_eq!(ask(format!("evil.example:{port}")), 403);
    assert_eq!(ask(format!("127.0.0.1.evil.example:{port}")), 403);
    assert_eq!(ask("127.0.0.1".to_owned()), 403, "another port");
    let twice = [format!("Host: 127.0.0.1:{port}"), "Host: evil.example".to_owned(), cookie.clone()];
    assert!(matches!(status(&server.ask("/api/about", &twice)), 400 | 403));
}

#[test]
fn pages_of_others_open_no_socket_and_load_nothing() {
    let (server, cookie) = Running::entered(Options::new(registry()));
    let own = format!("http://{}", server.host());
    let open = |origin: Option<&str>, cookie: Option<&str>| {
        let mut stream = TcpStream::connect(server.address).unwrap();
        let lines = Running::upgrade(origin, cookie).join("\r\n");
        let host = server.host();
        write!(stream, "GET /api/play HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\n{lines}\r\n\r\n")
            .unwrap();
        let mut head = [0; 12];
        stream.read_exact(&mut head).unwrap();
        status(&format!("{} ", String::from_utf8_lossy(&head)))
    };
    assert_eq!(open(Some(&own), Some(&cookie)), 101);
    assert_eq!(open(Some("http://evil.example"), Some(&cookie)), 403);
    assert_eq!(open(Some("http://127.0.0.1:1"), Some(&cookie)), 403, "another port is another page");
    assert_eq!(open(Some("null"), Some(&cookie)), 403);
    assert_eq!(open(None, Some(&cookie)), 403);
    assert_eq!(open(Some(&own), None), 401);
    let site =
        |site: &str| status(&server.ask("/api/about", &[cookie.clone(), format!("Sec-Fetch-Site: {site}")]));
    assert_eq!([site("same-origin"), site("cross-site"), site("same-site")], [200, 403, 403]);
}

#[test]
fn every_answer_has_a_strict_content_security_policy() {
    let (server, cookie) = Running::entered(Options::new(registry()));
    for (path, headers) in [
        ("/", vec![cookie.clone()]),
        ("/", vec![]),
        ("/none", vec![cookie.clone()]),
        ("/api/about", vec![cookie]),
    ] {
        let answer = server.ask(path, &headers);
        let policy = answer.lines().find(|line| line.starts_with("content-security-policy: ")).expect(path);
        for part in
            ["default-src 'none'", "script-src 'self'", "frame-ancestors 'none'", "connect-src 'self'"]
        {
            assert!(policy.contains(part), "{path}: {policy}");
        }
        assert!(!policy.contains("unsafe"), "{policy}");
        for header in
            ["x-content-type-options: nosniff", "referrer-policy: no-referrer", "cache-control: no-store"]
        {
            assert!(answer.contains(header), "{path} lacks {header}");
        }
    }
}

#[test]
fn a_page_that_is_named_may_frame_this_one_and_no_other() {
    let mut options = Options::new(registry());
    options.frame_from = Some("http://localhost:8888".to_owned());
    let (server, cookie) = Running::entered(options);
    let answer = server.ask("/", &[cookie]);
    assert!(answer.contains("frame-ancestors http://localhost:8888\r\n"), "{answer}");
    for wrong in ["localhost", "http://", "http://a b", "*", "http://a; script-src *"] {
        let mut options = Options::new(registry());
        options.frame_from = Some(wrong.to_owned());
        assert!(Server::bind(options).is_err(), "{wrong}");
    }
}

#[test]
fn nothing_outside_of_the_given_paths_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let (shown, hidden) = (folder.path().join("shown"), folder.path().join("hidden"));
    fs::create_dir_all(shown.join("below")).unwrap();
    fs::create_dir_all(&hidden).unwrap();
    let manifest = r#"{"budget": 1, "pairs": []}"#;
    for path in [shown.join("below/a.json"), hidden.join("secret.json")] {
        fs::write(path, manifest).unwrap();
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&hidden, shown.join("link")).unwrap();
        std::os::unix::fs::symlink(hidden.join("secret.json"), shown.join("link.json")).unwrap();
    }
    let mut options = Options::new(registry());
    options.paths = vec![shown];
    let (server, cookie) = Running::entered(options);
    let ask = |path: String| server.ask(&path, std::slice::from_ref(&cookie));
    let result = |id: &str| status(&ask(format!("/api/result?id={id}")));
    assert_eq!(result("0/below/a.json"), 200);
    for id in [
        "0/../hidden/secret.json",
        "0/below/../../hidden/secret.json",
        "1",
        "-1",
        "x",
        "0//etc/passwd",
        "0/%2e%2e/hidden/secret.json",
    ] {
        assert_eq!(result(id), 403, "{id}");
    }
    for path in ["/api/data", "/api/training", "/api/data/values"] {
        assert_eq!(status(&ask(format!("{path}?id=0/../hidden/secret.json&episode=0"))), 403, "{path}");
    }
    #[cfg(unix)]
    for id in ["0/link.json", "0/link/secret.json"] {
        assert_eq!(result(id), 403, "{id} is a link that leads out");
    }
    let list = ask("/api/files".to_owned());
    assert!(list.contains("a.json") && !list.contains("link") && !list.contains("secret"), "{list}");
}

/// Opens the toy environment, and says what a message is answered.
fn answer_to(server: &Running, cookie: &str, text: &str) -> String {
    let mut stream = server.connect(cookie);
    stream.write_all(&message(br#"{"type":"open","env":"swm/Toy-v0","image":32,"max_steps":5}"#)).unwrap();
    assert!(receive_text(&mut stream).contains("opened"));
    assert!(receive_text(&mut stream).contains("episode"));
    stream.write_all(&message(text.as_bytes())).unwrap();
    receive_text(&mut stream)
}

#[test]
fn policies_and_settings_read_no_other_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut options = Options::new(registry());
    options.paths = vec![folder.path().to_owned()];
    let (server, cookie) = Running::entered(options);
    for policy in ["mpc:/etc", "onnx:../../model", "cem:@/etc/passwd", "constant:Cargo.toml"] {
        let answer = answer_to(&server, &cookie, &format!(r#"{{"type":"policy","text":"{policy}"}}"#));
        assert!(answer.contains("outside of the paths"), "{policy}: {answer}");
    }
    let mut stream = server.connect(&cookie);
    let open = br#"{"type":"open","env":"swm/Toy-v0","image":32,"max_steps":5,"settings":{"model":["/etc/passwd"]}}"#;
    stream.write_all(&message(open)).unwrap();
    assert!(receive_text(&mut stream).contains("outside of the paths"));
}

#[test]
fn only_the_folder_for_recordings_is_written_to() {
    let folder = tempfile::tempdir().unwrap();
    let save = folder.path().join("recordings");
    let record = |server: &Running, cookie: &str, file: &str| {
        answer_to(server, cookie, &format!(r#"{{"type":"record","file":"{file}","format":null,"image":32}}"#))
    };
    let (server, cookie) = Running::entered(Options::new(registry()));
    assert!(record(&server, &cookie, "a.h5").contains("`save`"));
    drop(server);
    let mut options = Options::new(registry());
    options.save = Some(save.clone());
    let (server, cookie) = Running::entered(options);
    for file in ["../a.h5", "/tmp/a.h5", "b/a.h5", ".a.h5", "", "a\\\\b.h5"] {
        assert!(record(&server, &cookie, file).contains("is no file name"), "{file}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(folder.path().join("outside.h5"), save.join("link.h5")).unwrap();
        assert!(record(&server, &cookie, "link.h5").contains("is a link"));
    }
    assert!(!Path::new(&folder.path().join("a.h5")).exists());
}

#[test]
fn large_messages_and_many_environments_are_refused() {
    let mut options = Options::new(registry());
    options.max_sessions = 2;
    let (server, cookie) = Running::entered(options);
    let own = format!("http://{}", server.host());
    let (first, mut second) = (server.connect(&cookie), server.connect(&cookie));
    let mut lines = Running::upgrade(Some(&own), Some(&cookie));
    lines.push("Connection: Upgrade".to_owned());
    assert_eq!(status(&server.ask("/api/play", &lines)), 503);
    // One byte more than is allowed ends the connection, and makes room.
    second.write_all(&message(&vec![b' '; (256 << 10) + 1])).unwrap();
    while receive(&mut second).is_some_and(|(kind, _)| kind != 8) {}
    drop((first, second));
    let start = Instant::now();
    loop {
        let mut stream = TcpStream::connect(server.address).unwrap();
        let host = server.host();
        let lines = Running::upgrade(Some(&own), Some(&cookie)).join("\r\n");
        write!(stream, "GET /api/play HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\n{lines}\r\n\r\n")
            .unwrap();
        let mut head = [0; 12];
        stream.read_exact(&mut head).unwrap();
        if head.ends_with(b"101") {
            break;
        }
        assert!(start.elapsed() < Duration::from_secs(20), "the places are free again");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_server_that_nobody_looks_at_ends() {
    let mut options = Options::new(registry());
    options.idle = Some(Duration::from_millis(300));
    let mut server = Running::new(options);
    let ended = server.thread.take().unwrap().join().unwrap();
    assert!(ended.is_ok());
}

#[test]
fn an_open_environment_keeps_the_server_and_a_gone_page_lets_it_end() {
    let mut options = Options::new(registry());
    options.idle = Some(Duration::from_millis(300));
    let (mut server, cookie) = Running::entered(options);
    let stream = server.connect(&cookie);
    std::thread::sleep(Duration::from_millis(900));
    assert!(!server.thread.as_ref().unwrap().is_finished());
    drop(stream);
    assert!(server.thread.take().unwrap().join().unwrap().is_ok());
}

#[test]
fn every_address_at_once_is_no_host() {
    for host in ["0.0.0.0", "::"] {
        let mut options = Options::new(registry());
        options.host = host.to_owned();
        let refused = Server::bind(options).err().expect("refused").to_string();
        assert!(refused.contains("name the one by which browsers reach this machine"), "{refused}");
    }
    let mut options = Options::new(registry());
    options.paths = vec!["no/such/path".into()];
    assert!(Server::bind(options).err().unwrap().to_string().contains("no/such/path"));
}

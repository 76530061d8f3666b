//! Links out of the given paths, pipes, and connections of strangers: all routes, all kinds of files.

#![cfg(unix)]

use std::fs;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use swm_core::testing::TOY;
use swm_core::{EnvConfig, ImageSize, Rollout, World, WorldOptions};
use swm_data::WriteMode;
use swm_ui::Options;

use crate::server::{Running, registry};
use crate::status;

const SECRET: &str = "a-word-from-outside";

fn record(path: &Path, format: &str) {
    let image = Some(ImageSize { height: 32, width: 32 });
    let env = EnvConfig { image, ..EnvConfig::default() };
    let mut world = World::new(&TOY, WorldOptions::new(1).max_episode_steps(4).threads(1).env(env)).unwrap();
    world.set_policy(swm_core::policies::random()).unwrap();
    let mut writer = swm_data::create(path, WriteMode::Append, Some(format)).unwrap();
    world.record_dataset(&Rollout::new(0..2).seed(3), writer.as_mut()).unwrap();
}

fn files_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() { files_below(&entry, found) } else { found.push(entry) }
    }
}

/// Moves a file or folder to `outside`, and leaves a link to it.
fn replace_by_link(path: &Path, outside: &Path) {
    fs::create_dir_all(outside).unwrap();
    let there = outside.join(path.file_name().unwrap());
    fs::rename(path, &there).unwrap();
    symlink(&there, path).unwrap();
}

#[test]
fn no_route_follows_a_link_within_a_dataset_or_run() {
    let formats: Vec<&str> = swm_data::FORMATS
        .iter()
        .map(|format| format.name)
        .filter(|name| *name != "hdf5" && *name != "mcap")
        .collect();
    assert!(formats.contains(&"folder"), "{formats:?}");
    for format in formats {
        let folder = tempfile::tempdir().unwrap();
        let (shown, outside) = (folder.path().join("shown"), folder.path().join("outside"));
        fs::create_dir(&shown).unwrap();
        let whole = folder.path().join("whole");
        record(&whole, format);
        let mut files = Vec::new();
        files_below(&whole, &mut files);
        let mut names = Vec::new();
        for (index, file) in files.iter().enumerate() {
            let name = format!("{index}.{format}");
            let copy = shown.join(&name);
            assert!(
                Command::new("cp")
                    .args(["-r", whole.to_str().unwrap(), copy.to_str().unwrap()])
                    .status()
                    .unwrap()
                    .success()
            );
            replace_by_link(&copy.join(file.strip_prefix(&whole).unwrap()), &outside.join(&name));
            names.push(name);
        }
        let mut options = Options::new(registry());
        options.paths = vec![shown.clone()];
        let (server, cookie) = Running::entered(options);
        for (name, file) in names.iter().zip(&files) {
            for route in ["", "/episodes", "/image", "/video", "/values", "/sample"] {
                let path = format!("/api/data{route}?id=0/{name}&episode=0&column=pixels");
                let answer = server.ask(&path, std::slice::from_ref(&cookie));
                assert_eq!(status(&answer), 403, "{format}, a link at {}: {path}: {answer}", file.display());
            }
        }
        // With what they lead to among the paths, links are followed.
        let mut options = Options::new(registry());
        options.paths = vec![shown, outside];
        let (server, cookie) = Running::entered(options);
        let answer = server.ask(&format!("/api/data?id=0/{}", names[0]), std::slice::from_ref(&cookie));
        assert_eq!(status(&answer), 200, "{answer}");
    }
}

#[test]
fn files_of_results_and_runs_are_read_without_links_and_pipes() {
    let folder = tempfile::tempdir().unwrap();
    let (shown, outside) = (folder.path().join("shown"), folder.path().join("outside"));
    fs::create_dir_all(shown.join("run")).unwrap();
    fs::create_dir(&outside).unwrap();
    let secret = format!(r#"{{"budget": 1, "pairs": [], "step": 1, "{SECRET}": 2}}"#);
    fs::write(outside.join("secret.json"), &secret).unwrap();
    symlink(outside.join("secret.json"), shown.join("run/config.json")).unwrap();
    fs::write(shown.join("run/metrics.jsonl"), "{\"step\":1,\"loss\":1}\n").unwrap();
    fs::create_dir(shown.join("other")).unwrap();
    symlink(outside.join("secret.json"), shown.join("other/metrics.jsonl")).unwrap();
    for name in ["x.json", "y.toml", "z.h5", "run/pipe.json", "w.mcap"] {
        assert!(Command::new("mkfifo").arg(shown.join(name)).status().unwrap().success());
    }
    let mut options = Options::new(registry());
    options.paths = vec![shown];
    let (server, cookie) = Running::entered(options);
    let ask = |path: &str| server.ask(path, std::slice::from_ref(&cookie));
    for _ in 0..10 {
        assert_eq!(status(&ask("/api/files")), 200);
    }
    for path in ["training?id=0/run", "training?id=0/other", "result?id=0/run/config.json", "files"] {
        let answer = ask(&format!("/api/{path}"));
        assert!(!answer.contains(SECRET), "{path}: {answer}");
    }
    assert_eq!(status(&ask("/api/training?id=0/run")), 403);
    for route in ["result", "data", "data/episodes", "training"] {
        for name in ["x.json", "y.toml", "z.h5", "w.mcap"] {
            assert!(status(&ask(&format!("/api/{route}?id=0/{name}"))) >= 400, "{route} {name}");
        }
    }
}

#[test]
fn strangers_do_not_lock_the_owner_out() {
    let (server, cookie) = Running::entered(Options::new(registry()));
    let idle: Vec<TcpStream> = (0..200).map(|_| TcpStream::connect(server.address).unwrap()).collect();
    assert_eq!(status(&server.ask("/api/about", std::slice::from_ref(&cookie))), 200);
    // The oldest were closed to make room.
    let mut first = idle.into_iter().next().unwrap();
    let mut byte = [0];
    assert!(matches!(first.read(&mut byte), Ok(0) | Err(_)));
}

/// Sends one request after the other, on a connection that stays open while the server lets it; returns how many were answered.
fn keep_asking(server: &Running, cookie: Option<&str>, is_over: &AtomicBool) -> usize {
    let cookie = cookie.map(|cookie| format!("{cookie}\r\n")).unwrap_or_default();
    let request = format!("GET /api/about HTTP/1.1\r\nHost: {}\r\n{cookie}\r\n", server.host());
    let mut answered = 0;
    while !is_over.load(Ordering::Relaxed) {
        let Ok(mut stream) = TcpStream::connect(server.address) else { continue };
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let mut answer = [0; 4096];
        while !is_over.load(Ordering::Relaxed)
            && stream.write_all(request.as_bytes()).is_ok()
            && matches!(stream.read(&mut answer), Ok(1..))
        {
            answered += 1;
            std::thread::sleep(Duration::from_millis(5));
        }
    }
    answered
}

#[test]
fn the_owner_is_answered_within_a_second_among_idle_and_busy_connections() {
    let (server, cookie) = Running::entered(Options::new(registry()));
    let idle: Vec<TcpStream> = (0..200).map(|_| TcpStream::connect(server.address).unwrap()).collect();
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // Half of them are strangers, half are other tabs of the owner.
        let busy: Vec<_> = (0..200)
            .map(|index| {
                let cookie = (index % 2 == 0).then_some(cookie.as_str());
                let (server, is_over) = (&server, &is_over);
                scope.spawn(move || keep_asking(server, cookie, is_over))
            })
            .collect();
        let answers: Vec<_> = (0..50)
            .map(|_| {
                std::thread::sleep(Duration::from_millis(10));
                let asked = Instant::now();
                (server.ask("/api/about", std::slice::from_ref(&cookie)), asked.elapsed())
            })
            .collect();
        is_over.store(true, Ordering::Relaxed);
        let longest = answers.iter().map(|(_, took)| *took).max().unwrap();
        answers.iter().for_each(|(answer, _)| assert_eq!(status(answer), 200, "{answer}"));
        let answered: usize = busy.into_iter().map(|thread| thread.join().unwrap()).sum();
        assert!(answered > 400, "{answered} requests of the others were answered: they were not busy");
        assert!(longest < Duration::from_secs(1), "{longest:?}");
    });
    drop(idle);
}

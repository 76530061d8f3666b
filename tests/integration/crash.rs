//! A kill at any time loses no committed episode, and appending continues to what an undisturbed run gives.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::Duration;

use rand::RngExt as _;
use swm::core::seed::keyed;
use swm::data::testing::rounds;

#[cfg(target_os = "linux")]
use crate::preload::Preload;
use crate::support::{Folder, PUSHT, content, swm, swm_ok};

const EPISODES: u64 = 60;
/// In a usual run, and in a long one.
const KILLS: [usize; 2] = [20, 200];

fn collect<'a>(out: &'a str, extra: &[&'a str]) -> Vec<&'a str> {
    let base =
        ["collect", PUSHT, "--policy", "weak", "--seed", "11", "--max-steps", "20", "--image-size", "48x48"];
    [&base, &["--num-envs", "3", "--report-every", "0", "--out", out][..], extra].concat()
}

/// Starts a recording and kills it after a delay; returns how many episodes it had committed.
fn killed_after(args: &[&str], delay: Duration) -> u64 {
    let mut child: Child = swm(args).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("it starts");
    let stderr = BufReader::new(child.stderr.take().expect("piped"));
    // The count starts with the first episode, so that the kills hit the writing and not over the start.
    let reader = std::thread::spawn(move || {
        stderr.lines().map_while(Result::ok).filter(|line| is_commit(line)).count()
    });
    std::thread::sleep(delay);
    child.kill().expect("it can be killed");
    child.wait().expect("it ends");
    reader.join().expect("the reader ends with the pipe") as u64
}

fn is_commit(line: &str) -> bool {
    line.starts_with("episode ") && line.contains(" written to ")
}

#[test]
fn kills_lose_nothing_that_was_committed() {
    let folder = Folder::new();
    let whole = folder.path("whole.h5");
    let total = EPISODES.to_string();
    let started = std::time::Instant::now();
    swm_ok(&collect(&whole, &["--total", &total, "--quiet"]));
    let undisturbed_seconds = started.elapsed().as_secs_f64();
    let expected = content(&whole);
    let mut rng = keyed(0, "moments of kills", [0, 0]);
    let mut partial = 0;
    for kill in 0..rounds(KILLS[0], KILLS[1]) {
        let out = folder.path(&format!("killed{kill}.h5"));
        let delay = Duration::from_secs_f64(undisturbed_seconds * rng.random::<f64>());
        let committed = killed_after(&collect(&out, &["--total", &total]), delay);
        if Path::new(&out).exists() {
            let held =
                swm::data::open(out.as_ref()).expect("the file opens after a kill").num_episodes() as u64;
            assert!(held >= committed, "kill {kill}: {committed} episodes committed, {held} left");
            partial += u64::from(held > 0 && held < EPISODES);
        } else {
            assert_eq!(committed, 0, "kill {kill}: episodes were committed, but there is no file");
        }
        swm_ok(&collect(&out, &["--total", &total, "--mode", "append", "--quiet"]));
        assert_eq!(content(&out), expected, "kill {kill} after {delay:?}");
    }
    assert!(partial > 0, "no kill hit the writing; the times are badly chosen");
}

/// A kill that falls amid a write is rare: one in thousands of kills. Here each of the first writes is cut.
#[cfg(target_os = "linux")]
#[test]
fn kills_amid_a_write_lose_nothing_that_was_committed() {
    let Some(preload) = Preload::new() else { return };
    let folder = Folder::new();
    let whole = folder.path("whole.h5");
    swm_ok(&collect(&whole, &["--total", "14", "--quiet"]));
    let expected = content(&whole);
    let (mut kept, mut kills) = (0, 0);
    for count in 0..200 {
        let out = folder.path(&format!("torn{count}.h5"));
        let output = preload.torn(swm(&collect(&out, &["--total", "14"])), count).output().unwrap();
        if output.status.success() {
            break;
        }
        kills += 1;
        if Path::new(&out).exists() {
            let committed =
                String::from_utf8_lossy(&output.stderr).lines().filter(|line| is_commit(line)).count();
            // Every second file is put right before it is opened.
            if count % 2 == 0 {
                swm_ok(&["verify", "--fix", &out]);
            }
            let held = swm::data::open(out.as_ref()).expect("the file opens after a kill").num_episodes();
            assert!(held >= committed, "kill {count}: {committed} episodes committed, {held} left");
            kept += usize::from(held > 0);
        }
        swm_ok(&collect(&out, &["--total", "14", "--mode", "append", "--quiet"]));
        assert_eq!(content(&out), expected, "kill {count}");
    }
    assert!(
        kills > 10 && kept > 5,
        "{kills} kills, {kept} of them after an episode: no block lies over a page's end"
    );
}

#[cfg(unix)]
#[test]
fn an_interrupt_keeps_what_was_committed_and_says_how_to_continue() {
    let folder = Folder::new();
    for (signal, status) in [("-INT", 130), ("-TERM", 75)] {
        let out = folder.path(&format!("interrupted{signal}.h5"));
        let mut child: Child = swm(&collect(&out, &["--episodes", "1000000"]))
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("it starts");
        let mut lines = BufReader::new(child.stderr.take().expect("piped")).lines().map_while(Result::ok);
        let mut committed = lines.by_ref().take(3).filter(|line| is_commit(line)).count();
        assert_eq!(committed, 3);
        let kill = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status();
        assert!(kill.expect("kill is there").success());
        let rest: Vec<String> = lines.collect();
        assert_eq!(child.wait().expect("it ends").code(), Some(status), "{rest:?}");
        committed += rest.iter().filter(|line| is_commit(line)).count();
        let held = swm::data::open(out.as_ref()).expect("the file opens").num_episodes();
        assert_eq!(held, committed);
        let said = rest.last().expect("it says what is safe");
        let expected =
            format!("interrupted: {held} episodes are safe in {out}; to continue, repeat the command");
        assert!(said.starts_with(&expected) && said.contains("--mode append --total 1000000"), "{said}");
    }
}

#[cfg(unix)]
#[test]
fn nothing_is_left_of_a_recording_without_an_episode() {
    let folder = Folder::new();
    let formats = ["data.h5", "data.folder", "data.video", "data.mcap"].map(|name| (name, "random"));
    // A plan that takes minutes: the loop does not see the interrupt.
    for (name, policy) in
        formats.into_iter().chain([("data.h5", "cem:samples=20000"), ("data.folder", "cem:samples=20000")])
    {
        let out = folder.path(name);
        let base =
            ["collect", PUSHT, "--image-size", "16x16", "--num-envs", "1", "--out", &out, "--episodes", "1"];
        let args = [&base[..], &["--max-steps", "1000000000", "--policy", policy]].concat();
        let child = swm(&args).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("it starts");
        while !Path::new(&out).exists() {
            std::thread::sleep(Duration::from_millis(2));
        }
        // It is still bringing the new name to the disk.
        std::thread::sleep(Duration::from_millis(300));
        let kill = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
        assert!(kill.expect("kill is there").success());
        let ended = child.wait_with_output().expect("it ends");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(130), "{said}");
        assert!(
            said.contains("interrupted: no episode was recorded; to continue, repeat the command"),
            "{said}"
        );
        let left = std::fs::read_dir(folder.path("")).expect("the folder is ours").count();
        assert_eq!(left, 0, "{name}, {policy}");
        swm_ok(&[&base[..], &["--max-steps", "3", "--quiet"]].concat());
        assert_eq!(swm::data::open(out.as_ref()).expect("it opens").num_episodes(), 1);
        let path = Path::new(&out);
        match path.is_dir() {
            true => std::fs::remove_dir_all(path).expect("the folder is ours"),
            false => std::fs::remove_file(path).expect("the folder is ours"),
        }
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_evaluation_ends_with_its_own_status() {
    let args = ["eval", PUSHT, "--policy", "weak", "--episodes", "1000000"];
    let mut child = swm(&args).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("it starts");
    std::thread::sleep(Duration::from_secs(1));
    let kill = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(kill.expect("kill is there").success());
    let said: Vec<String> =
        BufReader::new(child.stderr.take().expect("piped")).lines().map_while(Result::ok).collect();
    assert_eq!(child.wait().expect("it ends").code(), Some(130), "{said:?}");
    assert_eq!(
        said.last().map(|line| line.starts_with("interrupted: nothing is kept")),
        Some(true),
        "{said:?}"
    );
}

//! The command in a shell: exit statuses, pipes, full disks, completions, manual pages, `swm doctor`, `swm --version`.

use serde_json::json;

use crate::support::{Folder, PUSHT, swm, swm_fails, swm_json, swm_ok};

#[test]
fn the_doctor_says_what_is_missing_and_what_fixes_it() {
    let healthy = swm_json(&["doctor"]);
    let checks = healthy.as_array().unwrap();
    assert!(checks.iter().all(|check| check["state"] != "missing"), "{healthy}");
    let (folder, program) = (Folder::new(), env!("CARGO_BIN_EXE_swm-under-test"));
    let sick = std::process::Command::new(program)
        .args(["doctor", "--json"])
        .env("SWM_HOME", folder.path("none"))
        .output()
        .unwrap();
    assert_eq!(sick.status.code(), Some(1));
    let checks: serde_json::Value = serde_json::from_slice(&sick.stdout).unwrap();
    let library = checks.as_array().unwrap().iter().find(|check| check["what"] == "MuJoCo").unwrap();
    assert_eq!((&library["state"], &library["fix"]), (&json!("missing"), &json!("cargo xtask setup")));
}

#[test]
fn the_doctor_knows_that_setup_cannot_write_there() {
    let sick = swm(&["doctor", "--json"]).env("SWM_HOME", "/dev/null/data").output().unwrap();
    let checks: serde_json::Value = serde_json::from_slice(&sick.stdout).unwrap();
    let folder = checks.as_array().unwrap().iter().find(|check| check["what"] == "data folder").unwrap();
    assert!(folder["fix"].as_str().unwrap().contains("set SWM_HOME to a folder that can"), "{folder}");
}

#[test]
fn exit_statuses_are_those_that_the_help_names() {
    let folder = Folder::new();
    let data = folder.path("data.h5");
    let collect = ["collect", PUSHT, "--policy", "weak", "--episodes", "1", "--max-steps", "3", "--out"];
    swm_ok(&[&collect[..], &[&data]].concat());
    let other = folder.path("other.h5");
    swm_ok(&[&collect[..], &[&other, "--seed", "9"]].concat());
    let help = swm_ok(&["--help"]);
    assert!(
        help.contains("Exit status: 0 done, 1 the work failed or found a difference, 2 the request"),
        "{help}"
    );
    // A difference; nothing at the place; somewhere that no file can be.
    swm_fails(1, &["diff", &data, &other]);
    swm_fails(1, &["inspect", &folder.path("none.h5")]);
    swm_fails(1, &[&collect[..], &["/dev/null/data.h5"]].concat());
    // An unknown environment, option, command, policy.
    swm_fails(2, &["collect", "swm/PushTT-v1", "--out", &data]);
    swm_fails(2, &["collect", PUSHT, "--outt", &data]);
    swm_fails(2, &["colect"]);
    swm_fails(2, &["eval", PUSHT, "--policy", "expertt"]);
    // A reader that has seen enough is no failure.
    let mut patient = swm(&["envs"]).stdout(std::process::Stdio::piped()).spawn().unwrap();
    drop(patient.stdout.take());
    assert_eq!(patient.wait().unwrap().code(), Some(0));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_named() {
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let output = swm(&["envs"]).stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("cannot write to the standard output: No space left"), "{message}");
}

#[test]
fn completions_and_pages_are_whole_and_nothing_is_colored_without_a_terminal() {
    let folder = Folder::new();
    for (shell, part) in [("bash", "complete -F _swm"), ("fish", "complete -c swm"), ("zsh", "#compdef swm")]
    {
        let script = swm_ok(&["completions", shell]);
        assert!(script.contains(part) && script.contains("verify-result"), "{shell}");
        let file = folder.path(shell);
        std::fs::write(&file, script).unwrap();
        let option = if shell == "fish" { "--no-execute" } else { "-n" };
        match std::process::Command::new(shell).args([option, &file]).output() {
            Ok(read) => assert!(read.status.success(), "{shell}: {}", String::from_utf8_lossy(&read.stderr)),
            Err(_) => eprintln!("{shell} is not installed: its completions are not read by it"),
        }
    }
    swm_ok(&["man", &folder.path("man")]);
    let page = std::fs::read_to_string(folder.path("man/swm.1")).unwrap();
    assert!(page.contains("Exit status: 0 done"), "{page}");
    assert!(std::fs::read_dir(folder.path("man")).unwrap().count() > 20);
    assert!(!swm_fails(2, &["evns"]).contains('\u{1b}'));
    assert!(!swm_ok(&["--help"]).contains('\u{1b}'));
}

#[test]
fn the_version_names_what_results_depend_on() {
    let text = swm_ok(&["--version"]);
    for part in ["renderer: swm-render", "physics: swm-envs-2d", "MuJoCo 3.17.0", "features: "] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn there_is_a_manual_page_for_every_command() {
    let folder = Folder::new();
    swm_ok(&["man", &folder.path("man1")]);
    let page = std::fs::read_to_string(folder.path("man1/swm-collect.1")).unwrap();
    assert!(page.contains("swm collect swm/PushT\\-v1") && page.contains("\\-\\-episodes"), "{page}");
}

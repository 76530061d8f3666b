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

#[cfg(unix)]
#[test]
fn the_doctor_notes_installed_versions_that_surprise() {
    use std::os::unix::fs::PermissionsExt as _;

    let folder = Folder::new();
    let python = folder.path("python");
    let packages = |listed: &str| {
        std::fs::write(&python, format!("#!/bin/sh\nprintf '{listed}'\n")).unwrap();
        std::fs::set_permissions(&python, std::fs::Permissions::from_mode(0o755)).unwrap();
        let output = swm(&["doctor", "--json"]).env("SWM_PYTHON", &python).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "a note is no failure");
        let checks: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).unwrap();
        checks.into_iter().filter(|check| check["what"] == "packages of Python").collect::<Vec<_>>()
    };
    let found = packages("package safetensors 0.8.0\\npackage numpy 2.4.6\\nnoise\\n");
    let [one] = found.as_slice() else { panic!("{found:?}") };
    assert_eq!(one["state"], "note");
    let text = one["found"].as_str().unwrap();
    assert!(text.starts_with("safetensors 0.8.0: ") && text.contains("transposed array"), "{text}");
    assert!(one["fix"].as_str().unwrap().contains("np.ascontiguousarray"), "{one}");
    let none = packages("package safetensors 0.9.0\\n");
    assert_eq!((none.len(), &none[0]["state"]), (1, &json!("works")), "{none:?}");
}

/// A data folder with the files of the installed one, to change some of them.
#[cfg(all(unix, feature = "mujoco"))]
fn copied_home(folder: &Folder) -> std::path::PathBuf {
    let home = std::path::PathBuf::from(folder.path("home"));
    let installed = swm::envs_mujoco::mujoco::assets::data_folder().expect("the data folder can be copied");
    copy_files(&installed.join("dm_control"), &home.join("dm_control"));
    for name in ["mujoco", "ogbench"] {
        std::os::unix::fs::symlink(installed.join(name), home.join(name))
            .expect("the data folder can be copied");
    }
    home
}

#[cfg(all(unix, feature = "mujoco"))]
fn copy_files(from: &std::path::Path, to: &std::path::Path) {
    std::fs::create_dir_all(to).expect("the data folder can be copied");
    for entry in std::fs::read_dir(from)
        .expect("the data folder can be copied")
        .map(|entry| entry.expect("the data folder can be read"))
    {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_files(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("the data folder can be copied");
        }
    }
}

#[cfg(all(unix, feature = "mujoco"))]
#[test]
fn altered_models_and_libraries_are_not_used() {
    let folder = Folder::new();
    let (home, cache, data) = (copied_home(&folder), folder.path("cache"), folder.path("data.h5"));
    let run = |args: &[&str]| {
        let output = swm(args).env("SWM_HOME", &home).env("XDG_CACHE_HOME", &cache).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned(), output.stdout)
    };
    let collect =
        ["collect", "swm/CheetahDMControl-v0", "--episodes", "1", "--max-steps", "3", "--out", &data];
    let (status, message, _) = run(&collect);
    assert_eq!(status, Some(0), "{message}");
    // The record names what the environment was made from.
    let recorded = |path: &str| {
        let dataset = swm::data::open(std::path::Path::new(path)).unwrap();
        dataset.metadata().unwrap().made_from.clone()
    };
    let record = recorded(&data);
    let names: Vec<&str> = record.keys().map(String::as_str).collect();
    assert_eq!(names, ["MuJoCo 3.17.0", "dm_control 1.0.50, suite"]);
    assert!(record.values().all(|hash| hash.len() == 64), "{record:?}");

    let model = home.join("dm_control/1.0.50/suite/walker.xml");
    let sound = std::fs::read(&model).unwrap();
    std::fs::write(&model, [&sound[..], b"<!-- heavier -->"].concat()).unwrap();
    let other = folder.path("other.h5");
    let other = [&collect[..7], &[&other]].concat();
    let (status, message, _) = run(&other);
    assert_eq!(status, Some(2), "{message}");
    for part in ["walker.xml is not the file that was published", "SHA-256", "cargo xtask setup"] {
        assert!(message.contains(part), "{message}");
    }
    let (status, _, checks) = run(&["doctor", "--json"]);
    let checks: serde_json::Value = serde_json::from_slice(&checks).unwrap();
    let suite = checks.as_array().unwrap().iter().find(|check| check["state"] == "missing").unwrap();
    assert_eq!((status, &suite["what"]), (Some(1), &json!("models of the Control Suite")));
    assert!(suite["found"].as_str().unwrap().contains("walker.xml is not the file"), "{suite}");

    // A library that lies there is not run before it was compared.
    std::fs::write(&model, sound).unwrap();
    std::fs::remove_file(home.join("mujoco")).unwrap();
    let library = swm::envs_mujoco::mujoco::assets::library_path().unwrap();
    let place = home.join("mujoco/3.17.0").join(library.file_name().unwrap());
    std::fs::create_dir_all(place.parent().unwrap()).unwrap();
    let bytes = std::fs::read(&library).unwrap();
    std::fs::write(&place, [&bytes[..], b"0"].concat()).unwrap();
    let (status, message, _) = run(&other);
    assert_eq!(status, Some(2), "{message}");
    assert!(message.contains("is not the file that was published"), "{message}");
    // The user's own choice is.
    let choice = folder.path("own.so");
    std::fs::rename(&place, &choice).unwrap();
    let own = swm(&other).env("SWM_HOME", &home).env("SWM_MUJOCO_LIB", &choice).output().unwrap();
    assert!(own.status.success(), "{}", String::from_utf8_lossy(&own.stderr));
    assert_ne!(recorded(other[7])["MuJoCo 3.17.0"], record["MuJoCo 3.17.0"]);
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
    // A difference; somewhere that no file can be.
    swm_fails(1, &["diff", &data, &other]);
    swm_fails(1, &[&collect[..], &["/dev/null/data.h5"]].concat());
    // A file that is not there; an unknown environment, option, command, policy.
    swm_fails(2, &["inspect", &folder.path("none.h5")]);
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

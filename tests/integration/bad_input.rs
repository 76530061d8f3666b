//! Wrong requests and damaged files: a message that names the object, the reason and the fix, and nothing lost.

use crate::support::{Folder, PUSHT, collecting, content, record, says, swm, swm_fails, swm_ok};

#[test]
fn unknown_names_are_told_with_the_nearest() {
    let folder = Folder::new();
    let out = folder.path("a.h5");
    says(2, &["fovs", "swm/PushTT-v1"], &["`swm/PushTT-v1`", "did you mean `swm/PushT-v1`?", "swm envs"]);
    let with = |extra: &[&'static str]| [&collecting(&out, "--episodes 1")[..], extra].concat();
    says(2, &with(&["--vary", "blok.color"]), &["`blok.color`", "did you mean `block.color`?"]);
    says(2, &with(&["--set", "agent.colour=1,2,3"]), &["`agent.colour`", "`agent.color`"]);
    says(2, &with(&["--policy", "wek"]), &["`wek`", "did you mean `weak`?"]);
    says(2, &with(&["--env-option", "rendr=fast"]), &["rendr", "render"]);
    says(2, &with(&["--format", "hdf"]), &["`hdf`", "hdf5"]);
    says(2, &collecting(&folder.path("a.xyz"), "--episodes 1"), &["`xyz`", ".h5"]);
    says(2, &with(&["--policy", "weak:reach=3"]), &["weak", "reach", "dist_constraint"]);
    assert!(!std::path::Path::new(&out).exists(), "a refused request leaves no file");
}

#[test]
fn a_file_in_the_place_of_an_environment_is_told_where_it_belongs() {
    let folder = Folder::new();
    let file = folder.path("task.toml");
    std::fs::write(&file, "").unwrap();
    for command in [&["eval", &file, "--policy", "random"][..], &["quality", &file]] {
        says(2, command, &["task.toml is a file", "swm/PushT-v1", "--manifest", "--dataset"]);
    }
}

#[test]
fn a_filter_of_another_program_is_told_in_a_sentence() {
    let path = crate::support::root().join("tests/golden/hostile/long_filter.h5");
    for command in ["inspect", "verify"] {
        says(1, &[command, path.to_str().unwrap()], &["long_filter.h5", "`odd`", "more than 32 parameters"]);
    }
}

#[test]
fn environments_on_rapier_name_what_is_wrong() {
    let folder = Folder::new();
    let out = folder.path("a.h5");
    let with = |env: &'static str, extra: &[&'static str]| {
        [&["collect", env, "--episodes", "1", "--out", &out][..], extra].concat()
    };
    let maze = "swm/PointMaze-v0";
    says(
        2,
        &with(maze, &["--set", "agent.start_cell=1,3"]),
        &["agent.start_cell", "free cell of maze.layout"],
    );
    says(2, &with(maze, &["--set", "goal.cell=40,1"]), &["goal.cell", "40"]);
    says(2, &with(maze, &["--policy", "explorer:-1"]), &["explorer", "std -1"]);
    let rapier = "swm/PushTRapier-v0";
    says(2, &with(rapier, &["--env-option", "friction=-1"]), &["friction -1", "0 or more"]);
    says(2, &with(PUSHT, &["--env-option", "friction=0.3"]), &["no friction", "swm/PushTRapier-v0"]);
    assert!(!std::path::Path::new(&out).exists(), "a refused request leaves no file");
}

#[test]
fn factor_values_outside_their_bounds_are_told_with_the_bounds() {
    let folder = Folder::new();
    let out = folder.path("a.h5");
    let set = |value: &'static str| [collecting(&out, "--episodes 1 --set"), vec![value]].concat();
    says(2, &set("block.scale=61"), &["`block.scale`", "between 20 and 60", "61"]);
    says(2, &set("block.color=1,2"), &["`block.color`", "[3]", "2 value"]);
    says(2, &set("block.shape=2.5"), &["`block.shape`", "2.5"]);
    says(2, &set("agent.color=256,0,0"), &["`agent.color`", "0 and 255", "256"]);
    says(2, &set("agent=1"), &["`agent` is a group", "agent.color"]);
    says(2, &set("block.angle=[1"), &["[1", "number"]);
    says(2, &set("block.scale=abc"), &["abc", "number"]);
    says(2, &set("block.scale"), &["NAME=VALUE"]);
    assert!(!std::path::Path::new(&out).exists(), "a refused request leaves no file");
}

#[test]
fn sizes_and_counts_are_checked_before_anything_is_made() {
    let folder = Folder::new();
    let out = folder.path("a.h5");
    let with = |extra: &[&'static str]| [&collecting(&out, "--episodes 1")[..], extra].concat();
    says(2, &with(&["--image-size", "0x64"]), &["0x64", "1 to 4096"]);
    says(2, &with(&["--image-size", "99999999"]), &["99999999", "1 to 4096"]);
    says(2, &with(&["--image-size", "ten"]), &["HEIGHTxWIDTH"]);
    says(2, &with(&["--num-envs", "0"]), &["--num-envs", "1 to"]);
    says(2, &with(&["--num-envs", "10000000"]), &["--num-envs", "65536"]);
    says(2, &with(&["--threads", "0"]), &["threads"]);
    says(2, &with(&["--frame-skip", "0"]), &["--frame-skip"]);
    says(2, &with(&["--max-steps", "0"]), &["--max-steps: 0 steps"]);
    says(2, &with(&["--threads", "100000000"]), &["threads", "1024"]);
    says(2, &with(&["--frame-skip", "4294967295"]), &["--frame-skip", "1000"]);
    says(2, &with(&["--num-envs", "60000", "--image-size", "4096"]), &["image", "GB", "fewer environments"]);
    says(2, &with(&["--vary", "none,block"]), &["`none` stands alone"]);
    says(2, &with(&["--without", "variation.block.angle"]), &["variation.block.angle", "restore"]);
    says(2, &collecting(&out, "--episodes 0"), &["--episodes 0", "1 or more"]);
    says(2, &with(&["--policy", "cem:samples=5,elites=9"]), &["elites"]);
    says(2, &with(&["--policy", "constant:1,2,3"]), &["constant", "3 value(s)"]);
    says(2, &with(&["--policy", "weak:inf"]), &["weak", "inf"]);
    says(
        2,
        &[collecting(&out, "--episodes 1 --replayable"), vec!["0"]].concat(),
        &["--replayable: ", "0 steps"],
    );
    let eval = |more: &'static str| {
        ["eval", PUSHT, "--policy", "random"].into_iter().chain(more.split(' ')).collect::<Vec<_>>()
    };
    says(2, &eval("--budget 0"), &["--budget 0"]);
    says(2, &eval("--dataset a.h5 --goal-offset 0"), &["--goal-offset 0", "1 or more"]);
    let discrete = ["render", "swm/PushT-Discrete-v1", "--steps", "1", "--out", &out, "--policy"];
    let png = folder.path("a.png");
    let discrete: Vec<&str> =
        discrete.iter().map(|arg| if *arg == out { png.as_str() } else { *arg }).collect();
    says(1, &[&discrete[..], &["constant:300,200"]].concat(), &["300", "between"]);
    says(2, &[&discrete[..], &["constant:3.5,2"]].concat(), &["3.5", "no integer"]);
    says(2, &with(&["--policy", "constant:nan,0"]), &["constant", "numbers"]);
    assert!(!std::path::Path::new(&out).exists(), "a refused request leaves no file");
}

#[test]
fn unusable_files_are_named_with_the_reason() {
    let folder = Folder::new();
    let good = record(&folder, "good.h5", "--episodes 2 --max-steps 5 --image-size none");
    let bytes = std::fs::read(&good).unwrap();
    let damaged = [
        ("empty.h5", Vec::new()),
        ("text.h5", b"this is no dataset".to_vec()),
        ("half.h5", bytes[..bytes.len() / 2].to_vec()),
        ("head.h5", bytes[..40].to_vec()),
    ];
    for (name, content) in damaged {
        let path = folder.path(name);
        std::fs::write(&path, content).unwrap();
        for command in [
            &["inspect", path.as_str()][..],
            &["replay", path.as_str()],
            &["eval", PUSHT, "--policy", "random", "--dataset", path.as_str()],
        ] {
            let message = swm_fails(1, command);
            assert!(message.contains(name), "{command:?} does not name the file:\n{message}");
        }
    }
    // What is missing is said, whatever the library meets first.
    let whole = bytes.len();
    for tenths in [1, 3, 5, 7, 9] {
        let path = folder.path("cut.h5");
        std::fs::write(&path, &bytes[..whole * tenths / 10]).unwrap();
        let there = format!("{} of {whole} bytes", whole * tenths / 10);
        for command in [&["inspect", path.as_str()][..], &["verify", &path], &["verify", &path, "--fix"]] {
            says(1, command, &["cut.h5 is damaged", "cut short", &there, "copy or record it again"]);
        }
    }
    says(1, &["inspect", &folder.path("head.h5")], &["cut short: 40 bytes"]);
    says(1, &["inspect", &folder.path("text.h5")], &["text.h5 is not a dataset", "format hdf5"]);
    for (content, told) in [
        ("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", "git lfs pull"),
        ("\n<!DOCTYPE html><html></html>", "web page"),
    ] {
        let path = folder.path("download.h5");
        std::fs::write(&path, content).unwrap();
        says(1, &["inspect", &path], &["download.h5", told]);
    }
    says(1, &collecting("/proc/nowhere/folder/a.h5", "--episodes 1"), &["/proc/nowhere/folder"]);
    says(2, &collecting(&good, "--episodes 1 --image-size none"), &["good.h5", "append", "overwrite"]);
    says(
        1,
        &["eval", PUSHT, "--policy", "random", "--dataset", &good, "--episodes", "500"],
        &["500", "fewer episodes"],
    );
}

#[test]
fn a_number_of_threads_is_checked_by_every_command_that_divides_work() {
    let folder = Folder::new();
    let good = record(&folder, "good.h5", "--episodes 1 --max-steps 3 --image-size none --threads 1");
    let good = good.as_str();
    for command in [
        &["quality", PUSHT][..],
        &["train", "lewm", "--dataset", good, "--out", "run"],
        &["stats", good],
        &["verify", good],
        &["replay", good],
        &["convert", good, "a.folder"],
        &["render", PUSHT, "--out", "a.png"],
    ] {
        let with = |count| [command, &["--threads", count]].concat();
        says(2, &with("0"), &["--threads 0: use 1 to 1024"]);
        says(2, &with("1025"), &["--threads 1025"]);
    }
    swm_ok(&["verify", good, "--threads", "1"]);
}

#[test]
fn datasets_with_images_of_other_sizes_name_the_option_that_joins_them() {
    let folder = Folder::new();
    let small = record(&folder, "small.h5", "--episodes 1 --max-steps 2 --image-size 16x16");
    let large = record(&folder, "large.h5", "--episodes 1 --max-steps 2 --image-size 24x24");
    let out = folder.path("both.h5");
    let merge = ["merge", &small, &large, "--out", &out];
    let fix = "give --image-size 16x16 for images of one size";
    says(2, &merge, &["small.h5 holds images of 16x16", "large.h5 holds images of 24x24", fix]);
    swm_ok(&[&merge[..], &["--image-size", "16x16", "--quiet"]].concat());
}

#[test]
fn a_difference_is_said_once() {
    let folder = Folder::new();
    let [first, second] = ["1", "2"].map(|seed| {
        let how = format!("--episodes 1 --max-steps 3 --image-size none --seed {seed}");
        record(&folder, &format!("{seed}.h5"), &how)
    });
    let output = swm(&["diff", &first, &second]).output().unwrap();
    let (text, error) =
        (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert_eq!((output.status.code(), error.as_str()), (Some(1), ""));
    assert!(text.ends_with(&format!("{first} and {second} differ\n")), "{text}");
    assert_eq!(text.matches("differ\n").count(), 1, "{text}");
    assert!(swm_ok(&["diff", &first, &first]).ends_with("are equal\n"));
}

#[test]
fn a_file_that_is_not_there_is_a_wrong_request() {
    let folder = Folder::new();
    let good = record(&folder, "good.h5", "--episodes 1 --max-steps 3 --image-size none");
    let (no, out) = (folder.path("nowhere"), folder.path("out"));
    let (no, out, good) = (no.as_str(), out.as_str(), good.as_str());
    let (policy, page) = (format!("cem:@{no}"), format!("{out}.html"));
    let commands: &[&[&str]] = &[
        &["inspect", no],
        &["preview", no, "--out", "a.png"],
        &["stats", no],
        &["verify", no],
        &["verify", no, "--fix"],
        &["diff", no, good],
        &["diff", good, no],
        &["convert", no, out],
        &["merge", no, good, "--out", out],
        &["merge", good, no, "--out", out],
        &["split", no, "--out", "{}.h5"],
        &["replay", no],
        &["manifest", "show", no],
        &["manifest", "make", PUSHT, "--tier", "moderate", "--dataset", no, "--out", out],
        &["manifest", "make", PUSHT, "--tier", "moderate", "--stream", no, "--episodes", "2", "--out", out],
        &["eval", "--manifest", no, "--policy", "random"],
        &["eval", PUSHT, "--dataset", no, "--policy", "random"],
        &["eval", PUSHT, "--policy", &policy],
        &["sweep", "--manifest", no, "--policy", "random"],
        &["compare", no],
        &["verify-result", no],
        &["report", no, "--out", &page],
        &["quality", PUSHT, "--dataset", no],
        &["jobs", no],
        &["task", no, "--index", "1"],
        #[cfg(feature = "ui")]
        &["ui", no, "--no-open"],
    ];
    for command in commands {
        says(2, command, &[no]);
    }
    assert!(!std::path::Path::new(out).exists(), "a refused request leaves no file");
}

/// Files of the kernel's that not even root may read, and a place where nobody makes any.
#[cfg(target_os = "linux")]
const LOCKED: (&str, &str) = ("/proc/sys/vm/compact_memory", "/sys/swm");

#[cfg(target_os = "linux")]
#[test]
fn a_place_without_permission_is_a_wrong_request_of_every_command() {
    let (secret, locked) = LOCKED;
    if !std::path::Path::new(secret).exists() {
        println!("{secret} is not on this system");
        return;
    }
    let folder = Folder::new();
    let good = record(&folder, "good.h5", "--episodes 2 --max-steps 8 --image-size 16x16");
    let (task, result) = (folder.path("task.toml"), folder.path("result"));
    swm_ok(&[
        "manifest",
        "make",
        PUSHT,
        "--tier",
        "historic",
        "--episodes",
        "2",
        "--budget",
        "4",
        "--out",
        &task,
    ]);
    swm_ok(&["eval", "--manifest", &task, "--policy", "random", "--reference", "none", "--out", &result]);
    let linked = |name: &str| {
        let path = folder.path(name);
        std::os::unix::fs::symlink(secret, &path).unwrap();
        path
    };
    // Names are those of what is asked for, so that no ending is what is refused.
    let (data, toml, receipt) = (linked("a.h5"), linked("b.toml"), linked("c.json"));
    let (data, toml, receipt) = (data.as_str(), toml.as_str(), receipt.as_str());
    let (out, h5, page) = (folder.path("out"), folder.path("out.h5"), folder.path("out.html"));
    let policy = format!("cem:@{receipt}");
    let other = record(&folder, "other.h5", "--episodes 2 --max-steps 8 --image-size 16x16 --seed 7");
    let bundle = folder.path("bundle");
    swm_ok(&["bundle", &result, "--out", &bundle]);
    let [locked_h5, locked_toml, locked_html, locked_png, locked_parts] =
        [".h5", ".toml", ".html", ".png", "-{}.h5"].map(|ending| format!("{locked}{ending}"));
    let read: &[&[&str]] = &[
        &["inspect", data],
        &["preview", data, "--out", "a.png"],
        &["stats", data],
        &["verify", data],
        &["diff", data, &good],
        &["diff", &good, data],
        &["convert", data, &h5],
        &["merge", data, &good, "--out", &h5],
        &["split", data, "--out", "{}.h5"],
        &["replay", data],
        &["manifest", "show", toml],
        &["manifest", "make", PUSHT, "--tier", "moderate", "--dataset", data, "--out", &out],
        &["eval", "--manifest", toml, "--policy", "random"],
        &["eval", PUSHT, "--dataset", data, "--policy", "random"],
        &["eval", PUSHT, "--policy", &policy],
        &["sweep", "--manifest", toml, "--policy", "random"],
        &["compare", receipt, &result],
        &["verify-result", receipt],
        &["report", receipt, "--out", &page],
        &["bundle", receipt, "--out", &out],
        &["quality", PUSHT, "--dataset", data],
    ];
    let written: &[&[&str]] = &[
        &[
            "collect",
            PUSHT,
            "--policy",
            "random",
            "--episodes",
            "1",
            "--max-steps",
            "2",
            "--image-size",
            "none",
            "--out",
            &locked_h5,
        ],
        &["preview", &good, "--out", &locked_png],
        &["convert", &good, &locked_h5],
        &["merge", &good, &other, "--out", &locked_h5],
        &["split", &good, "--parts", "a=0.5,b=0.5", "--out", &locked_parts],
        &["manifest", "make", PUSHT, "--tier", "historic", "--episodes", "1", "--out", &locked_toml],
        &["eval", PUSHT, "--policy", "random", "--episodes", "1", "--budget", "2", "--out", locked],
        &["eval", "--manifest", &task, "--policy", "random", "--reference", "none", "--out", locked],
        &["sweep", "--manifest", &task, "--policy", "random", "--factors", "block.color", "--out", locked],
        &["report", &result, "--videos", "0", "--out", &locked_html],
        &["bundle", &result, "--out", locked],
        &["board", &bundle, "--out", locked],
        &["plan", PUSHT, "--policy", "cem:samples=6,iterations=2,elites=3", "--trace", locked],
        &["render", PUSHT, "--steps", "1", "--out", &locked_png],
        &["new-env", "a", "--out", locked],
        &["man", locked],
    ];
    let mut wrong = Vec::new();
    // Some write beside the place first.
    for (place, commands) in [("", read), ("/sys/", written)] {
        for command in commands {
            let output = swm(command).output().unwrap();
            let message = String::from_utf8_lossy(&output.stderr);
            if output.status.code() != Some(2) || !message.contains(place) || !message.contains("ermi") {
                wrong.push(format!("{:?} of {}: {message}", output.status.code(), command.join(" ")));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let left: Vec<_> =
        [&out, &h5, &page].into_iter().filter(|path| std::path::Path::new(path).exists()).collect();
    assert!(left.is_empty(), "a refused request leaves {left:?}");
}

#[test]
fn appending_what_does_not_fit_is_refused_and_loses_nothing() {
    let folder = Folder::new();
    let out = record(&folder, "a.h5", "--max-steps 5 --episodes 2 --image-size 16x16");
    let before = content(&out);
    let append = |more: &'static str| {
        [collecting(&out, "--max-steps 5 --episodes 2 --mode append"), more.split(' ').collect()].concat()
    };
    says(1, &append("--image-size 24x24"), &["a.h5", "images of 16x16, what is added with images of 24x24"]);
    says(1, &append("--image-size 16x16 --vary all"), &["a.h5"]);
    let refused = swm_fails(1, &append("--image-size 16x16 --env-option damping=0.5"));
    assert!(refused.contains("damping"), "{refused}");
    assert!(!refused.contains("is appended"), "nothing is appended: {refused}");
    assert_eq!(content(&out), before);
}

#[test]
fn a_full_disk_is_told_and_earlier_episodes_stay() {
    let folder = Folder::new();
    let out = folder.path("a.h5");
    // A limit on the size of files stands in for the disk; the shell ignores the signal that comes with it.
    let script = format!(
        "trap '' XFSZ; ulimit -f 4000; exec '{}' collect {PUSHT} --policy weak --episodes 500 --max-steps 30 \
         --image-size 64x64 --vary all --report-every 0 --out '{out}'",
        env!("CARGO_BIN_EXE_swm-under-test"),
    );
    let output = std::process::Command::new("bash").args(["-c", &script]).output().expect("bash starts");
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("a.h5") && message.contains("error"), "{message}");
    let committed = message.matches("written to").count();
    assert!(committed > 0, "nothing was written before the limit:\n{message}");
    let held = swm::data::open(std::path::Path::new(&out)).expect("the file opens").num_episodes();
    assert!(held >= committed, "{committed} episodes were committed, {held} are left");
}

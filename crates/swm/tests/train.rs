//! Trainings by the command: what is refused, and on what is learned.

#![expect(clippy::unwrap_used, reason = "what a helper cannot do ends its test")]

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use serde_json::{Map, Value as Json, json};
use swm::baselines::train::RunFolder;
use swm::core::Registry;
use swm::tasks::request::{self, Request as _};

/// Runs the program; what it prints where it fails, with its exit status.
fn program(
    words: impl IntoIterator<Item = impl AsRef<std::ffi::OsStr>>,
) -> Result<(), (Option<i32>, String)> {
    let ran = Command::new(env!("CARGO_BIN_EXE_swm")).arg("-q").args(words).output().unwrap();
    let text = || String::from_utf8_lossy(&ran.stderr).into_owned();
    if ran.status.success() { Ok(()) } else { Err((ran.status.code(), text())) }
}

/// Runs a line of the program without blanks in its words.
fn line(words: &str) -> Result<(), (Option<i32>, String)> {
    program(words.split_whitespace())
}

#[test]
fn what_is_wrong_is_worded_as_options() {
    for (words, reason) in [
        ("train", "baseline: must be given"),
        (
            "train lewm --dataset no.h5",
            "--out: name the folder of the new run; give --resume to continue one",
        ),
        ("train tdmpc2 --out no/run", "give --env swm/CartpoleDMControl-v0, or --dataset"),
        ("train sac --env swm/PushT-v1 --batch 4 --out no/run", "give --set batch=4, or leave out --batch"),
        ("train lewm --out no/run --dataset-split val", "--dataset: name the dataset that lewm learns from"),
        (
            "train sac --env swm/PushT-v1 --dataset-split val --out no/run",
            "--dataset-split: is about a dataset, and none is named; give --dataset, or leave out --dataset-split",
        ),
        (
            "train sac --env swm/TwoRoom-v2 --observe pixels --out no/run",
            "sac learns from vectors alone; leave `pixels` out",
        ),
    ] {
        let (status, message) = line(words).unwrap_err();
        assert!(status == Some(2) && message.contains(reason), "{words}: {message}");
    }
    let registry = swm::registry();
    let env = registry.env("swm/PushT-v1").unwrap();
    let message = registry.policy_entry(env, "keypoint-wm").unwrap_err().to_string();
    assert!(message.contains("it is a model; to plan with a trained one, use `mpc:RUN`"), "{message}");
}

/// Runs of the command in a folder of their own, which is removed at the end.
struct Bench {
    registry: Registry,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        Self { registry: swm::registry(), folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn collect(&self, how: &str, file: &str) {
        let words =
            format!("swm -q collect swm/TwoRoom-v2 --policy random --episodes 6 --max-steps 30 {how} --out");
        let words = words.split_whitespace().map(OsString::from);
        let _ = swm::cli::run(&self.registry, words.chain([self.path(file).into()]));
    }

    fn train(&self, words: &str, data: &str, run: &str) -> Result<(), String> {
        let batch = if words.contains("--batch") || words.starts_with("tdmpc2") { "" } else { "--batch 2" };
        let words = format!("train {words} --steps 1 {batch}");
        let [data, run] = [data, run].map(|name| OsString::from(self.path(name)));
        let paths = [OsString::from("--dataset"), data, "--out".into(), run];
        let words = words.split_whitespace().map(OsString::from).chain(paths);
        program(words).map_err(|(_, message)| message)
    }
}

#[test]
fn what_cannot_be_measured_is_refused_before_a_run_is_written() {
    let bench = Bench::new();
    bench.collect("--image-size 64x64", "a.h5");
    for (words, reason) in [
        (
            "gcbc --preset small --quality-every 1",
            "--quality-every: measures world models, and gcbc is a policy; leave out --quality-every",
        ),
        ("lewm --preset small --quality-every 1 --split 0.8", "needs 2 or more"),
        ("conv-jepa --preset paper", "it has: small"),
    ] {
        let message = bench.train(words, "a.h5", "run").unwrap_err();
        assert!(message.contains(reason), "{message}");
        assert!(!bench.path("run").exists(), "{words} left a run behind");
    }
    bench.train("gcbc --preset small", "a.h5", "run").unwrap();
    assert!(bench.path("run").exists());
}

#[test]
fn a_resumed_run_is_measured_on() {
    let bench = Bench::new();
    bench.collect("--image-size 64x64", "a.h5");
    bench.train("lewm --preset small --quality-every 1 --split 0.5", "a.h5", "run").unwrap();
    let run = bench.path("run");
    let resume = |words: &str| {
        line(&format!("train --resume {} {words}", run.display())).unwrap();
        let metrics = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap();
        metrics.lines().filter(|line| line.contains(r#""part":"quality""#)).count()
    };
    assert_eq!(resume("--steps 2"), 2);
    assert_eq!(resume("--steps 3 --quality-every 0"), 2);
}

#[test]
fn of_trainings_that_begin_in_one_folder_at_once_one_is_made() {
    let bench = Bench::new();
    bench.collect("--image-size 64x64", "a.h5");
    for round in ["first", "second"] {
        let begin = |seed: u64| bench.train(&format!("gcbc --preset small --seed {seed}"), "a.h5", round);
        let ended = std::thread::scope(|scope| {
            let all = [1, 2, 3].map(|seed| (seed, scope.spawn(move || begin(seed))));
            all.map(|(seed, thread)| (seed, thread.join().unwrap()))
        });
        let won: Vec<u64> = ended.iter().filter(|(_, end)| end.is_ok()).map(|(seed, _)| *seed).collect();
        let lost = ended.iter().filter_map(|(_, end)| end.as_ref().err());
        for message in lost {
            assert!(
                message.contains("is being written by ") || message.contains("a run is there already"),
                "{message}"
            );
        }
        let config = std::fs::read(bench.path(round).join("config.json")).unwrap();
        let config: Json = serde_json::from_slice(&config).unwrap();
        assert_eq!(won, [config["fit"]["seed"].as_u64().unwrap()]);
    }
}

#[test]
fn a_run_is_not_resumed_on_other_images() {
    let bench = Bench::new();
    bench.collect("--seed 1 --image-size 64x64", "white.h5");
    bench.collect("--seed 1 --image-size 64x64 --set background.color=black", "black.h5");
    bench.collect("--seed 1 --image-size 64x64", "again.h5");
    bench.train("gcbc --preset small", "white.h5", "run").unwrap();
    let agent = "tdmpc2 --preset small --observe pixels --set image.size=64 --set batch=4 --set horizon=2";
    bench.train(agent, "white.h5", "agent").unwrap();
    for run in ["run", "agent"] {
        let resume = |data: &str, steps: u64| {
            let run = bench.path(run);
            line(&format!(
                "train --resume {} --steps {steps} --dataset {}",
                run.display(),
                bench.path(data).display()
            ))
        };
        let (_, message) = resume("black.h5", 2).unwrap_err();
        assert!(message.contains("black.h5 is not the dataset that it was begun with"), "{message}");
        resume("again.h5", 2).unwrap();
        // A run of an earlier version does not say what its images are, and is not changed to.
        let config = bench.path(run).join("config.json");
        let mut old: Json = serde_json::from_slice(&std::fs::read(&config).unwrap()).unwrap();
        assert!(old["data"].as_object_mut().unwrap().remove("sample").is_some());
        std::fs::write(&config, serde_json::to_vec(&old).unwrap()).unwrap();
        resume("again.h5", 3).unwrap();
        let now: Json = serde_json::from_slice(&std::fs::read(&config).unwrap()).unwrap();
        assert_eq!(now["data"], old["data"]);
    }
}

#[test]
fn a_run_is_resumed_by_its_folder() {
    for (words, reason) in [
        ("--resume no/run", "no/run"),
        ("--resume --out no/run", "no/run"),
        ("--resume no/run -o no/run", "no/run"),
        ("--resume", "swm train --resume RUN"),
        ("--resume a --out b", "--out: a run is resumed in its own folder"),
    ] {
        let (_, message) = line(&format!("train {words}")).unwrap_err();
        assert!(message.contains(reason), "{words}: {message}");
    }
}

#[test]
fn weights_do_not_depend_on_threads() {
    let bench = Bench::new();
    bench.collect("--image-size 64x64", "a.h5");
    let weights = |threads: &str| {
        let run = bench.path(threads);
        let words =
            format!("swm -q train lewm --preset small --steps 1 --batch 2 --threads {threads} --dataset");
        let paths = [bench.path("a.h5").into(), OsString::from("--out"), run.clone().into()];
        let _ = swm::cli::run(&bench.registry, words.split_whitespace().map(OsString::from).chain(paths));
        std::fs::read(RunFolder::open(&run).unwrap().weights(1)).unwrap()
    };
    assert!(weights("1") == weights("3"));
}

#[test]
fn a_recording_without_images_trains_the_same_weights() {
    let bench = Bench::new();
    bench.collect("--image-size 64x64", "seen.h5");
    bench.collect("--replayable", "replayable.h5");
    bench.collect("--image-size none", "plain.h5");
    let weights = |data: &str, run: &str| {
        bench.train("lewm --preset small", data, run).unwrap();
        std::fs::read(RunFolder::open(&bench.path(run)).unwrap().weights(1)).unwrap()
    };
    let seen = weights("seen.h5", "on-seen");
    assert!(weights("replayable.h5", "on-replayable") == seen, "rendered by replay from checkpoints");
    assert!(weights("plain.h5", "on-plain") == seen, "rendered by replay from the reset");
}

/// What a run wrote: its files without the time in them, by their places.
fn written(run: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for file in ["config.json", "metrics.jsonl", "episodes.h5"].map(|name| run.join(name)) {
        let Ok(bytes) = std::fs::read(&file) else { continue };
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let timeless = |line: &str| {
            let mut line: Json = serde_json::from_str(line).unwrap();
            line.as_object_mut().unwrap().retain(|name, _| name != "clips_per_s" && name != "elapsed_s");
            format!("{line}\n").into_bytes()
        };
        let bytes = match name.as_str() {
            "metrics.jsonl" => String::from_utf8(bytes).unwrap().lines().flat_map(timeless).collect(),
            _ => bytes,
        };
        found.insert(name, bytes);
    }
    for entry in std::fs::read_dir(run.join("checkpoints")).unwrap().map(|entry| entry.unwrap().path()) {
        let name = entry.file_name().unwrap().to_string_lossy().into_owned();
        found.insert(name, std::fs::read(&entry).unwrap());
    }
    assert!(found.len() > 3, "{:?}", found.keys());
    found
}

/// The words of the command for a request.
fn words(request: &Map<String, Json>) -> Vec<String> {
    let mut words = Vec::new();
    for (name, value) in request {
        let option = format!("--{}", name.replace('_', "-"));
        match value {
            Json::Object(each) => {
                let one = |(name, value): (&String, &Json)| format!("{name}={}", request::value_text(value));
                words.extend(each.iter().flat_map(|pair| [option.clone(), one(pair)]));
            }
            value if name == "baseline" => words.insert(0, request::value_text(value)),
            value => words.extend([option, request::value_text(value)]),
        }
    }
    words
}

#[test]
fn a_run_is_the_same_from_the_request_the_command_and_a_job() {
    let bench = Bench::new();
    bench.collect("--image-size 64x64", "a.h5");
    let data = bench.path("a.h5").display().to_string();
    let table = include_str!("../../../tests/requests/train.json").replace("DATA", &data);
    let table: Vec<Map<String, Json>> = serde_json::from_str(&table).unwrap();
    let ran = |line: &[String]| {
        let words = ["swm", "-q"].into_iter().map(OsString::from).chain(line.iter().map(OsString::from));
        assert!(swm::cli::run(&bench.registry, words) == ExitCode::SUCCESS, "{line:?}");
    };
    for (index, asked) in table.iter().enumerate() {
        let [value, command, job] =
            ["value", "command", "job"].map(|by| bench.path(&format!("{by}-{index}")));
        let mut request = request::Train::from_json(asked).unwrap();
        request.out.clone_from(&value);
        request.run(&bench.registry, &mut ()).unwrap();
        let train = [vec!["train".to_owned()], words(asked)].concat();
        let out = ["--out".to_owned(), command.display().to_string()];
        ran(&[train.clone(), out.to_vec()].concat());
        assert!(written(&command) == written(&value), "{asked:?}");
        let job = job.display().to_string();
        let submit = ["submit", "--job", &job, "--no-copy", "--on", "script", "--"].map(str::to_owned);
        ran(&[submit.to_vec(), train].concat());
        if index % 2 == 1 {
            // As a former version wrote it: in words.
            let file = Path::new(&job).join("job.json");
            let mut held: Json = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
            let request = held.as_object_mut().unwrap().remove("request").unwrap();
            assert_eq!(request["train"][0]["baseline"], asked["baseline"]);
            std::fs::write(&file, serde_json::to_vec(&held).unwrap()).unwrap();
        }
        ran(&["task", &job, "--all"].map(str::to_owned));
        assert!(written(&Path::new(&job).join("runs/0001")) == written(&value), "{asked:?}");
    }
}

#[test]
fn a_job_whose_model_would_see_no_images_is_not_submitted() {
    let bench = Bench::new();
    bench.collect("--image-size 64x64", "a.h5");
    bench.train("lewm --preset small", "a.h5", "run").unwrap();
    let run = |words: String| {
        let words = format!("swm -q {words}");
        let _ = swm::cli::run(&bench.registry, words.split(' ').map(OsString::from));
    };
    let at = |name: &str| bench.path(name).display().to_string();
    for (size, is_submitted) in [("none", false), ("64x64", true)] {
        let (task, job) = (at(&format!("{size}.toml")), at(&format!("job-{size}")));
        run(format!(
            "manifest make swm/TwoRoom-v2 --tier historic --episodes 2 --image-size {size} --out {task}"
        ));
        let eval = format!("eval --manifest {task} --policy mpc:{} --reference none", at("run"));
        run(format!("submit --on script --shards 1 --no-copy --job {job} -- {eval}"));
        assert_eq!(bench.path(&format!("job-{size}")).exists(), is_submitted, "{size}");
    }
}

/// Every value of a JSON document, by its pointer.
fn leaves(json: &Json, at: &str, found: &mut Vec<String>) {
    match json {
        Json::Object(fields) => {
            fields.iter().for_each(|(name, value)| leaves(value, &format!("{at}/{name}"), found));
        }
        Json::Array(items) => {
            items
                .iter()
                .enumerate()
                .for_each(|(index, value)| leaves(value, &format!("{at}/{index}"), found));
            found.push(at.to_owned());
        }
        _ => found.push(at.to_owned()),
    }
}

#[test]
fn files_of_a_run_with_other_values_are_refused_or_used() {
    let bench = Bench::new();
    bench.collect("--image-size 64x64", "a.h5");
    bench.train("gcbc --preset small", "a.h5", "gcbc").unwrap();
    bench.train("lewm --preset small", "a.h5", "lewm").unwrap();
    let agent =
        "tdmpc2 --preset small --set batch=4 --set horizon=2 --set plan.samples=14 --set plan.elites=2";
    bench.train(agent, "a.h5", "tdmpc2").unwrap();
    let run = |words: String| {
        let words = words.split_whitespace().map(OsString::from);
        // An error is an answer; a panic fails this test, and too much memory ends it.
        let _ = swm::cli::run(&bench.registry, words);
    };
    for (name, policy) in [("gcbc", "gcbc"), ("lewm", "mpc"), ("tdmpc2", "tdmpc2")] {
        let path = bench.path(name);
        for file in ["config.json", "checkpoints/step-00000001.json"] {
            let file = path.join(file);
            let whole = std::fs::read(&file).unwrap();
            let json: Json = serde_json::from_slice(&whole).unwrap();
            let mut all = Vec::new();
            leaves(&json, "", &mut all);
            assert!(all.len() > 5, "{all:?}");
            for leaf in all {
                let old = json.pointer(&leaf).unwrap();
                let values = match old {
                    Json::Number(_) => {
                        vec![json!(0), json!(3), json!(1_u64 << 32), json!(u64::MAX), json!(-1)]
                    }
                    Json::Array(_) => vec![json!([]), json!([0, 0]), json!([u64::MAX, u64::MAX, 5])],
                    Json::String(_) => vec![json!(""), json!("../x")],
                    _ => vec![json!(u64::MAX)],
                };
                for value in values {
                    let mut changed = json.clone();
                    *changed.pointer_mut(&leaf).unwrap() = value;
                    std::fs::write(&file, serde_json::to_vec(&changed).unwrap()).unwrap();
                    let path = path.display();
                    let steps = json.pointer("/step").map_or(1, |step| step.as_u64().unwrap());
                    run(format!("swm -q train --resume {path} --steps {steps}"));
                    let how = if policy == "mpc" {
                        ",samples=4,elites=2,iterations=1,horizon=1,receding_horizon=1"
                    } else {
                        ""
                    };
                    let env = "eval swm/TwoRoom-v2 --episodes 1 --budget 1 --num-envs 1";
                    run(format!("swm -q {env} --image-size 64x64 --policy {policy}:{path}{how}"));
                }
            }
            std::fs::write(&file, &whole).unwrap();
        }
    }
}

/// The weights below a folder, by name.
fn weights(folder: &Path) -> BTreeMap<OsString, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() {
            found.extend(weights(&entry));
        } else if entry.extension().is_some_and(|extension| extension == "safetensors" || extension == "pt") {
            found.insert(entry.file_name().unwrap().to_owned(), std::fs::read(&entry).unwrap());
        }
    }
    found
}

#[test]
fn of_two_exports_or_imports_into_one_folder_at_once_one_is_made() {
    let bench = Bench::new();
    bench.collect("--image-size 64x64", "a.h5");
    let path = |name: &str| bench.path(name).display().to_string();
    let run = |line: &str| {
        let words = format!("swm -q {line}");
        swm::cli::run(&bench.registry, words.split_whitespace().map(OsString::from)) == ExitCode::SUCCESS
    };
    let data = path("a.h5");
    let [runs, exported, imported] =
        [["run-1", "run-2"], ["export-1", "export-2"], ["import-1", "import-2"]].map(|names| names.map(path));
    for (seed, out) in runs.iter().enumerate() {
        let train = "train tdmpc2 --preset small --steps 1 --set batch=4 --set horizon=2";
        assert!(run(&format!("{train} --dataset {data} --seed {seed} --out {out}")));
    }
    let table = [("export", &runs, &exported), ("import", &exported, &imported)];
    for (line, inputs, alone) in table {
        for (input, out) in inputs.iter().zip(alone) {
            assert!(run(&format!("{line} {input} --out {out}")), "{line}");
        }
        let expected = alone.each_ref().map(|out| weights(Path::new(out)));
        assert!(!expected[0].is_empty() && expected[0] != expected[1], "{line}");
        for round in 0..3 {
            let out = path(&format!("{line}-at-once-{round}"));
            let lines = inputs.each_ref().map(|input| format!("{line} {input} --out {out}"));
            let succeeded = std::thread::scope(|scope| {
                let both = lines.each_ref().map(|line| scope.spawn(|| run(line)));
                both.map(|thread| thread.join().unwrap())
            });
            let winner = succeeded.iter().position(|&succeeded| succeeded).expect("one of them succeeds");
            assert_ne!(succeeded[0], succeeded[1], "{line}: both succeeded");
            assert!(weights(Path::new(&out)) == expected[winner], "{line}: the result is of the other one");
        }
    }
}

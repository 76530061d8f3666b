//! One request from every front end gives equal files. `crates/swm-py/tests/test_requests.py` reads the same tables from Python.

#![expect(clippy::unwrap_used, reason = "what a helper cannot do ends its test")]

use serde_json::{Map, Value as Json, json};
use swm::tasks::request::{
    Convert, Diff, Evaluate, Inspect, MakeManifest, Measure, Merge, Plan, Preview, Record, Render, Replay,
    Request, Split, Stats, Sweep, Train, TrainerEntry, Verify, value_text,
};

use crate::support::{Folder, swm_fails, swm_finds, swm_json, swm_ok};
use crate::ui::Page;

/// The requests of a table, with the path of a dataset in the place of `DATA`.
fn table(text: &str, data: &str) -> Vec<Map<String, Json>> {
    serde_json::from_str(&text.replace("DATA", data)).unwrap()
}

/// The words of the command for a request.
fn words(request: &Map<String, Json>) -> Vec<String> {
    let mut words = Vec::new();
    for (name, value) in request {
        let option = format!("--{}", name.replace('_', "-"));
        match (name.as_str(), value) {
            ("env", env) => words.insert(0, value_text(env)),
            ("distractor" | "probe" | "violation", Json::Array(each)) => {
                words.extend(each.iter().flat_map(|one| [option.clone(), value_text(one)]));
            }
            ("set" | "env_option", Json::Object(each)) => {
                let assignment = |(name, value): (&String, &Json)| format!("{name}={}", value_text(value));
                words.extend(each.iter().map(assignment).flat_map(|one| [option.clone(), one]));
            }
            ("image_size", Json::Null) => words.extend([option, "none".to_owned()]),
            // What is named by its place.
            ("source" | "target" | "first" | "second", path) => words.insert(place(&words), value_text(path)),
            // Where it is all that a command is about.
            ("dataset", path) if !request.contains_key("env") => {
                words.insert(place(&words), value_text(path));
            }
            ("sources", Json::Array(each)) => words.splice(0..0, each.iter().map(value_text)).for_each(drop),
            ("opening", Json::Object(each)) => {
                for (name, value) in each {
                    words.extend([format!("--{}", name.replace('_', "-")), value_text(value)]);
                }
            }
            (_, Json::Bool(true)) => words.push(option),
            (_, Json::Bool(false)) => words.push(format!("--no-{}", &option[2..])),
            (_, value) => words.extend([option, value_text(value)]),
        }
    }
    words
}

/// Where the next word without an option belongs.
fn place(words: &[String]) -> usize {
    words.iter().position(|word| word.starts_with("--")).unwrap_or(words.len())
}

/// Runs the command for a request.
fn run(command: &[&str], request: &Map<String, Json>) {
    let words = words(request);
    swm_ok(&[command, &words.iter().map(String::as_str).collect::<Vec<_>>()[..]].concat());
}

/// Runs the command for a request as a job of two shards; its folder.
fn run_job(command: &str, request: &Map<String, Json>, job: &str) {
    let words = words(request);
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let submit = ["submit", "--job", job, "--shards", "2", "--no-copy", "--on", "script", "--", command];
    swm_ok(&[&submit[..], &words].concat());
    swm_ok(&["task", job, "--all"]);
    swm_ok(&["task", job, "--finish"]);
}

/// A request that writes to this path.
fn to(request: &Map<String, Json>, out: &str) -> Map<String, Json> {
    let mut request = request.clone();
    request.insert("out".to_owned(), out.into());
    request
}

#[test]
fn a_recording_is_the_same_from_the_request_the_command_the_page_and_a_job() {
    let (folder, registry) = (Folder::new(), swm::registry());
    let save = folder.path("save");
    let page = Page::open(&[], &save);
    for (index, request) in table(include_str!("../requests/record.json"), "").into_iter().enumerate() {
        let [task, command] = ["task", "command"].map(|name| folder.path(&format!("{name}-{index}.h5")));
        let job = folder.path(&format!("job-{index}"));
        let made = Record::from_json(&to(&request, &task)).unwrap().run(&registry, &mut ()).unwrap();
        assert_eq!(Some(made.total_episodes), request["episodes"].as_u64());
        run(&["collect", "--quiet"], &to(&request, &command));
        run_job("collect", &request, &job);
        let ran = page.run(&json!({ "record": request }), &format!("page-{index}.h5"));
        assert_eq!((&ran["done"], &ran["total"]), (&request["episodes"], &request["episodes"]));
        for path in [command, format!("{job}/result.h5"), format!("{save}/page-{index}.h5")] {
            assert!(std::fs::read(&path).unwrap() == std::fs::read(&task).unwrap(), "{path}: {request:?}");
        }
        // The command that the page shows makes the same.
        let shown: Vec<&str> = ran["words"].as_array().unwrap().iter().filter_map(Json::as_str).collect();
        std::fs::remove_file(format!("{save}/page-{index}.h5")).unwrap();
        swm_ok(&shown);
        assert!(std::fs::read(format!("{save}/page-{index}.h5")).unwrap() == std::fs::read(&task).unwrap());
    }
}

#[test]
fn a_manifest_is_the_same_from_the_request_the_command_and_the_page() {
    let folder = Folder::new();
    let (data, save) = (folder.path("a.h5"), folder.path("save"));
    let collect = "collect swm/PushT-v1 --policy weak --episodes 30 --max-steps 60 --image-size none --seed 3 --quiet --out";
    swm_ok(&collect.split(' ').chain([data.as_str()]).collect::<Vec<_>>());
    let page = Page::open(&[&data], &save);
    let (id, registry) = (page.id("dataset"), swm::registry());
    let mut pages = 0;
    for (index, request) in
        table(include_str!("../requests/make_manifest.json"), &data).into_iter().enumerate()
    {
        let [task, command] = ["task", "command"].map(|name| folder.path(&format!("{name}-{index}.toml")));
        let made = MakeManifest::from_json(&to(&request, &task)).unwrap().run(&registry, &mut ()).unwrap();
        let bytes = std::fs::read(&task).unwrap();
        run(&["manifest", "make"], &to(&request, &command));
        assert_eq!(std::fs::read(&command).unwrap(), bytes, "{request:?}");
        if let Some(pairs) = request.get("pairs") {
            let file = format!("page-{index}.toml");
            let asked =
                json!({ "id": id, "pairs": pairs, "tier": made.tier, "budget": made.budget, "file": file });
            let answer = page.json("POST /api/manifest", &asked.to_string());
            assert_eq!(std::fs::read(format!("{save}/{file}")).unwrap(), bytes, "{answer}");
            pages += 1;
        }
    }
    assert!(pages > 0, "the page takes chosen pairs");
}

#[test]
fn a_receipt_is_the_same_from_the_request_the_command_the_page_and_a_job() {
    let folder = Folder::new();
    let (task, save, registry) = (folder.path("task.toml"), folder.path("save"), swm::registry());
    let request = json!({ "env": "swm/PushT-v1", "episodes": 3, "budget": 6, "out": task });
    let Json::Object(request) = request else { panic!("it is an object") };
    MakeManifest::from_json(&request).unwrap().run(&registry, &mut ()).unwrap();
    for (index, request) in table(include_str!("../requests/evaluate.json"), "").into_iter().enumerate() {
        let [value, command, job] =
            ["value", "command", "job"].map(|name| folder.path(&format!("{name}-{index}")));
        let to = |out: &str| {
            let mut request = request.clone();
            request.extend([("manifest".to_owned(), task.clone().into()), ("out".to_owned(), out.into())]);
            request
        };
        Evaluate::from_json(&to(&value)).unwrap().run(&registry, &mut ()).unwrap();
        let words = words(&to(&command));
        swm_ok(&[&["eval", "--quiet"], &words.iter().map(String::as_str).collect::<Vec<_>>()[..]].concat());
        let receipt =
            |dir: &str| without_time(&std::fs::read_to_string(format!("{dir}/receipt.json")).unwrap());
        assert_eq!(receipt(&command), receipt(&value), "{request:?}");
        let mut divided = to(&job);
        divided.remove("out");
        run_job("eval", &divided, &job);
        assert_eq!(receipt(&job), receipt(&value), "{request:?}");
        let page = Page::open(&[&task], &save);
        let ran = page.run(&json!({ "evaluate": divided }), &format!("page-{index}"));
        assert_eq!(receipt(&format!("{save}/page-{index}")), receipt(&value), "{request:?}");
        let shown: Vec<&str> = ran["words"].as_array().unwrap().iter().filter_map(Json::as_str).collect();
        std::fs::remove_dir_all(format!("{save}/page-{index}")).unwrap();
        swm_ok(&shown);
        assert_eq!(receipt(&format!("{save}/page-{index}")), receipt(&value), "{shown:?}");
    }
}

#[test]
fn a_sweep_is_the_same_from_the_request_the_command_the_page_and_a_job() {
    let folder = Folder::new();
    let (task, save, registry) = (folder.path("task.toml"), folder.path("save"), swm::registry());
    swm_ok(&[
        "manifest",
        "make",
        "swm/PushT-v1",
        "--episodes",
        "3",
        "--budget",
        "6",
        "--out",
        &task,
        "--quiet",
    ]);
    for (index, request) in table(include_str!("../requests/sweep.json"), "").into_iter().enumerate() {
        let [value, command, job] =
            ["value", "command", "job"].map(|name| folder.path(&format!("{name}-{index}")));
        let on = |out: &str| {
            let mut request = to(&request, out);
            request.insert("manifest".to_owned(), task.clone().into());
            request
        };
        Sweep::from_json(&on(&value)).unwrap().run(&registry, &mut ()).unwrap();
        run(&["sweep", "--quiet"], &on(&command));
        let mut divided = on(&job);
        divided.remove("out");
        run_job("sweep", &divided, &job);
        let page = Page::open(&[&task], &save);
        page.run(&json!({ "sweep": divided }), &format!("page-{index}"));
        let of_page = format!("{save}/page-{index}");
        for file in ["sweep.json", "sweep.csv", "sweep.svg"] {
            let bytes = |dir: &str| std::fs::read(format!("{dir}/{file}")).unwrap();
            assert!(bytes(&command) == bytes(&value), "{file}: {request:?}");
            assert!(bytes(&job) == bytes(&value), "{file} of the job: {request:?}");
            assert!(bytes(&of_page) == bytes(&value), "{file} of the page: {request:?}");
        }
    }
}

#[test]
fn a_run_is_the_same_from_the_request_and_the_page() {
    let (folder, registry) = (Folder::new(), swm::registry());
    // A build without baselines trains nothing.
    if TrainerEntry::all(&registry).is_err() {
        return;
    }
    let (data, save) = (folder.path("a.h5"), folder.path("save"));
    let collect = "collect swm/TwoRoom-v2 --policy random --episodes 6 --max-steps 30 --image-size 64x64 --seed 3 --quiet --out";
    swm_ok(&collect.split(' ').chain([data.as_str()]).collect::<Vec<_>>());
    let page = Page::open(&[&data], &save);
    for (index, request) in table(include_str!("../requests/train.json"), &data).into_iter().enumerate() {
        let value = folder.path(&format!("value-{index}"));
        Train::from_json(&to(&request, &value)).unwrap().run(&registry, &mut ()).unwrap();
        page.run(&json!({ "train": request }), &format!("page-{index}"));
        let weights = |run: &str| {
            let files =
                std::fs::read_dir(format!("{run}/checkpoints")).unwrap().map(|file| file.unwrap().path());
            let mut files: Vec<_> =
                files.filter(|file| file.extension().is_some_and(|end| end == "safetensors")).collect();
            files.sort();
            files
                .iter()
                .map(|file| (file.file_name().unwrap().to_owned(), std::fs::read(file).unwrap()))
                .collect::<Vec<_>>()
        };
        let of_page = weights(&format!("{save}/page-{index}"));
        assert!(!of_page.is_empty() && of_page == weights(&value), "{request:?}");
    }
}

#[test]
fn images_of_an_episode_are_the_same_from_the_request_and_the_command() {
    let (folder, registry) = (Folder::new(), swm::registry());
    for (index, request) in table(include_str!("../requests/render.json"), "").into_iter().enumerate() {
        for end in ["png", "gif"] {
            let [value, command] =
                ["value", "command"].map(|name| folder.path(&format!("{name}-{index}.{end}")));
            Render::from_json(&to(&request, &value)).unwrap().run(&registry, &mut ()).unwrap();
            run(&["render", "--quiet"], &to(&request, &command));
            assert!(std::fs::read(&command).unwrap() == std::fs::read(&value).unwrap(), "{request:?}");
        }
    }
}

#[test]
fn a_trace_is_the_same_from_the_request_and_the_command() {
    let (folder, registry) = (Folder::new(), swm::registry());
    for (index, request) in table(include_str!("../requests/plan.json"), "").into_iter().enumerate() {
        let [value, command] = ["value", "command"].map(|name| folder.path(&format!("{name}-{index}")));
        let on = |trace: &str| {
            let mut request = request.clone();
            let more = [("env", "swm/PushT-v1"), ("video_format", "gif"), ("trace", trace)];
            request.extend(more.map(|(name, text)| (name.to_owned(), text.into())));
            request
        };
        let planned = Plan::from_json(&on(&value)).unwrap().run(&registry, &mut ()).unwrap();
        assert!(!planned.summary.plans.is_empty() && planned.written.is_ok());
        run(&["plan", "--quiet"], &on(&command));
        let trace = |dir: &str| std::fs::read(format!("{dir}/trace.jsonl")).unwrap();
        assert!(trace(&command) == trace(&value), "{request:?}");
    }
}

#[test]
fn measures_of_a_model_are_the_same_from_the_request_and_the_command() {
    let registry = swm::registry();
    for request in table(include_str!("../requests/measure.json"), "") {
        let value = Measure::from_json(&request).unwrap().run(&registry, &mut ()).unwrap();
        let words = words(&request);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        // As the command prints it.
        let value: Json = serde_json::from_str(&serde_json::to_string(&value).unwrap()).unwrap();
        assert_eq!(swm_json(&[&["quality", "--quiet"], &words[..]].concat()), value, "{request:?}");
    }
}

/// Recordings to copy: two of one kind, one of other images, the first of two parts.
fn recordings(folder: &Folder) -> String {
    for (name, more) in [
        ("a.h5", "--episodes 3 --image-size 20x20 --vary agent.color --seed 1"),
        ("b.h5", "--episodes 2 --image-size 20x20 --seed 2"),
        ("small.h5", "--episodes 1 --image-size 8x8 --seed 3"),
        ("part1.h5", "--total 4 --shard 1/2 --image-size 20x20"),
    ] {
        let out = folder.path(name);
        let collect = format!("collect swm/PushT-v1 --policy weak --max-steps 6 --quiet {more} --out {out}");
        swm_ok(&collect.split(' ').collect::<Vec<_>>());
    }
    folder.path("a.h5").trim_end_matches("/a.h5").to_owned()
}

/// The bytes of a file, or of all files of a folder by their names.
fn content(path: &str) -> Vec<(String, Vec<u8>)> {
    let path = std::path::Path::new(path);
    if path.is_file() {
        return vec![(String::new(), std::fs::read(path).unwrap())];
    }
    let mut all = Vec::new();
    for entry in std::fs::read_dir(path).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().into_string().unwrap();
        let inner = content(&entry.path().display().to_string());
        all.extend(inner.into_iter().map(|(below, bytes)| (format!("{name}/{below}"), bytes)));
    }
    all.sort();
    all
}

/// The requests of a table on recordings and datasets of other programs.
fn copies(text: &str, data: &str) -> Vec<Map<String, Json>> {
    let field = crate::support::root().join("tests/golden/field").display().to_string();
    table(&text.replace("FIELD", &field), data)
}

#[test]
fn a_copy_is_the_same_from_the_request_and_the_command() {
    let (folder, registry) = (Folder::new(), swm::registry());
    let data = recordings(&folder);
    let check = |command: &str, out: &str, request: &Map<String, Json>, make: &dyn Fn(&Map<String, Json>)| {
        let to = |path: &str| {
            let mut request = request.clone();
            request.insert(out.to_owned(), path.into());
            request
        };
        let [value, words] = ["value", "command"].map(|by| folder.path(&format!("{by}-{{}}.h5")));
        make(&to(&value));
        run(&[command, "--quiet"], &to(&words));
        let written: Vec<String> = ["{}", "train", "val", "a", "b"].map(str::to_owned).to_vec();
        let mut compared = 0;
        for part in written {
            let [one, other] = [&value, &words].map(|path| path.replace("{}", &part));
            if !std::path::Path::new(&one).exists() {
                continue;
            }
            assert!(content(&one) == content(&other), "{command} {request:?}, {part}");
            for path in [one, other] {
                let is_file = std::path::Path::new(&path).is_file();
                if is_file { std::fs::remove_file(path) } else { std::fs::remove_dir_all(path) }.unwrap();
            }
            compared += 1;
        }
        assert!(compared > 0, "{command} {request:?} wrote nothing");
    };
    for request in copies(include_str!("../requests/convert.json"), &data) {
        check("convert", "target", &request, &|asked| {
            Convert::from_json(asked).unwrap().run(&registry, &mut ()).unwrap();
        });
    }
    for request in copies(include_str!("../requests/merge.json"), &data) {
        check("merge", "out", &request, &|asked| {
            Merge::from_json(asked).unwrap().run(&registry, &mut ()).unwrap();
        });
    }
    for request in copies(include_str!("../requests/split.json"), &data) {
        check("split", "out", &request, &|asked| {
            Split::from_json(asked).unwrap().run(&registry, &mut ()).unwrap();
        });
    }
}

/// What a request of the table gives is what its command prints.
fn assert_found<R: Request<Outcome: serde::Serialize>>(command: &str, table: &str, data: &str) {
    for request in copies(table, data) {
        let made = R::from_json(&request).unwrap().run(&swm::registry(), &mut ()).unwrap();
        let words = words(&request);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let found = swm_finds(&[&[command, "--quiet"], &words[..]].concat());
        assert_eq!(serde_json::to_value(&made).unwrap(), found, "{request:?}");
    }
}

#[test]
fn what_is_found_in_datasets_is_the_same_from_the_request_and_the_command() {
    let folder = Folder::new();
    let data = recordings(&folder);
    assert_found::<Verify>("verify", include_str!("../requests/verify.json"), &data);
    assert_found::<Replay>("replay", include_str!("../requests/replay.json"), &data);
    assert_found::<Diff>("diff", include_str!("../requests/diff.json"), &data);
    assert_found::<Inspect>("inspect", include_str!("../requests/inspect.json"), &data);
    assert_found::<Stats>("stats", include_str!("../requests/stats.json"), &data);
}

#[test]
fn images_of_a_dataset_are_the_same_from_the_request_and_the_command() {
    let (folder, registry) = (Folder::new(), swm::registry());
    let data = recordings(&folder);
    for (index, request) in copies(include_str!("../requests/preview.json"), &data).into_iter().enumerate() {
        for end in ["png", "gif"] {
            let [value, command] =
                ["value", "command"].map(|name| folder.path(&format!("{name}-{index}.{end}")));
            Preview::from_json(&to(&request, &value)).unwrap().run(&registry, &mut ()).unwrap();
            run(&["preview", "--quiet"], &to(&request, &command));
            assert!(std::fs::read(&command).unwrap() == std::fs::read(&value).unwrap(), "{request:?}");
        }
    }
}

/// A receipt without its wall time.
fn without_time(receipt: &str) -> String {
    assert_eq!(receipt.matches("\"wall_time_s\"").count(), 1);
    receipt.lines().filter(|line| !line.contains("\"wall_time_s\"")).collect::<Vec<_>>().join("\n")
}

#[test]
fn the_command_words_a_remedy_as_options() {
    let folder = Folder::new();
    let out = folder.path("task.toml");
    let make = |more: &str| {
        let words = format!("manifest make swm/PushT-v1 --out {out} {more}");
        swm_fails(2, &words.split_whitespace().collect::<Vec<_>>())
    };
    for (more, message) in [
        ("--budget 0", "--budget 0: no action is allowed; use 1 or more"),
        (
            "--distractor noise --distractor blur",
            "--distractor noise --distractor blur: changes images, and there are none; give --image-size 64x64",
        ),
        ("--vary agent.colr", "did you mean `agent.color`?); `swm fovs swm/PushT-v1` lists them"),
    ] {
        let said = make(more).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains(message), "{said}");
    }
    let data = recordings(&folder);
    for (line, message) in [
        ("convert a.h5 a.h5", "the one to write; give another target"),
        ("convert a.h5 b.h5", "or --overwrite to replace it"),
        ("merge a.h5 small.h5 --out c.h5", "give --image-size 20x20 for images of one size"),
        ("split a.h5 --out c.h5", "--out c.h5: write `{}`"),
        ("convert a.h5 c.h5 --key-frames 5", "--key-frames: the format `hdf5` has no videos"),
    ] {
        let words = line.split(' ').map(|word| match word {
            "a.h5" | "b.h5" | "small.h5" => format!("{data}/{word}"),
            word => word.to_owned(),
        });
        let words: Vec<String> = words.collect();
        let said = swm_fails(2, &words.iter().map(String::as_str).collect::<Vec<_>>());
        let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains(message), "{said}");
    }
}

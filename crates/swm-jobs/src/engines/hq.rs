//! HyperQueue: a job file with a task per shard, and one that depends on all of them and joins the shards. The server is the user's.

use std::fmt::Write as _;
use std::fs;

use serde_json::Value as Json;
use swm_tasks::request::cannot;

use super::task;
use crate::engine::{Driver, Engine, Queued, Request, Settings};
use crate::error::JobError;
use crate::job::JobFolder;
use crate::process::{quoted, run};

pub(crate) const ENGINE: Engine = Engine {
    name: "hq",
    about: "HyperQueue, on a server and workers that run already",
    keys: &[
        ("cpus", "CPUs of a task, such as 4 or all; default 1"),
        ("gpus", "NVIDIA GPUs of a task"),
        ("time", "the time that a worker must have left, such as 1h"),
        ("crash_limit", "how many lost workers a task survives; default 20"),
    ],
    driver: &HyperQueue,
};

/// Lost workers that a task survives.
const CRASH_LIMIT: u64 = 20;
/// The task that joins the shards; those of the shards count from 1.
const FINISH: u64 = 0;

#[derive(Debug)]
struct HyperQueue;

impl Driver for HyperQueue {
    fn entries(&self, shards: u64, _: &Settings) -> Result<u64, JobError> {
        Ok(shards)
    }

    fn script(&self, request: &Request<'_>) -> Result<String, JobError> {
        let Request { folder, settings, indices, .. } = request;
        let (task, crash_limit) = (task(folder), settings.number("crash_limit")?.unwrap_or(CRASH_LIMIT));
        let resources = resources(settings)?;
        let mut text = format!("name = {}\n", toml(&folder.job.name()));
        for index in *indices {
            // A failed task would cancel the one that joins the shards, which is to say what is missing. 75: again, later.
            let failed = quoted(&folder.failed(*index).display().to_string());
            let command = format!(
                "s=75; while [ $s = 75 ]; do {task} --index {index}; s=$?; [ $s != 75 ] || sleep 10; done; [ $s = 0 ] || test -e \
                 {failed}"
            );
            push_task(&mut text, *index, &command);
            let _ = writeln!(text, "crash_limit = {crash_limit}\n{resources}");
        }
        push_task(&mut text, FINISH, &format!("{task} --finish"));
        let deps: Vec<String> = indices.iter().map(ToString::to_string).collect();
        let _ = writeln!(text, "deps = [{}]", deps.join(", "));
        Ok(text)
    }

    fn submit(&self, request: &Request<'_>, script: &str) -> Result<Option<String>, JobError> {
        let file = request.folder.dir.join("hq.toml");
        fs::write(&file, script).map_err(cannot("write", &file))?;
        let file = file.display().to_string();
        let said = hq(&["job", "submit-file", &file, "--output-mode", "json"])?;
        let id = json_in(&said).and_then(|json| json["id"].as_u64());
        match id {
            Some(id) => Ok(Some(id.to_string())),
            None => Err(failed(format!(" job submit-file names no job: {}", said.trim()))),
        }
    }

    fn queued(&self, folder: &JobFolder) -> Result<Vec<Queued>, JobError> {
        let mut queued = Vec::new();
        for id in jobs_of(folder)? {
            let said = hq(&["task", "list", &id, "--output-mode", "json"])?;
            let json =
                json_in(&said).ok_or_else(|| failed(format!(" task list: no JSON in: {}", said.trim())))?;
            for task in json[&id].as_array().into_iter().flatten() {
                let (Some(number), Some(state)) = (task["id"].as_u64(), task["state"].as_str()) else {
                    continue;
                };
                if ["waiting", "running"].contains(&state) {
                    let entry = (number != FINISH).then_some(number);
                    let is_running = state == "running";
                    queued.push(Queued { id: id.clone(), entry, is_running, state: state.to_owned() });
                }
            }
        }
        Ok(queued)
    }

    fn cancel(&self, folder: &JobFolder) -> Result<(), JobError> {
        jobs_of(folder)?.iter().try_for_each(|id| hq(&["job", "cancel", id]).map(drop))
    }
}

/// The running and waiting jobs of HyperQueue that have the job's name.
fn jobs_of(folder: &JobFolder) -> Result<Vec<String>, JobError> {
    let said = hq(&["job", "list", "--output-mode", "json"])?;
    let json = json_in(&said).ok_or_else(|| failed(format!(" job list: no JSON in: {}", said.trim())))?;
    let name = folder.job.name();
    let ours = json.as_array().into_iter().flatten().filter(|job| job["name"] == name.as_str());
    Ok(ours.filter_map(|job| Some(job["id"].as_u64()?.to_string())).collect())
}

/// Asks the server.
fn hq(args: &[&str]) -> Result<String, JobError> {
    let said = run("hq", args, "")?;
    match said.is_ok {
        true => Ok(said.out),
        false => Err(failed(format!(
            " {}: {} (a server must run: `hq server start`)",
            args[..2.min(args.len())].join(" "),
            said.words()
        ))),
    }
}

fn failed(answer: String) -> JobError {
    JobError::Engine { program: "hq", answer }
}

/// The JSON of an output, which warnings may precede.
fn json_in(text: &str) -> Option<Json> {
    let starts = text
        .char_indices()
        .filter(|&(at, c)| (c == '{' || c == '[') && (at == 0 || text.as_bytes()[at - 1] == b'\n'));
    starts.map(|(at, _)| &text[at..]).find_map(|text| serde_json::from_str(text).ok())
}

/// Appends a task. Its output goes to the log of its shard, not to two more files.
fn push_task(text: &mut String, id: u64, command: &str) {
    let command = toml(command);
    let _ = writeln!(
        text,
        "\n[[task]]\nid = {id}\nstdout = \"none\"\nstderr = \"none\"\ncommand = [\"/bin/bash\", \"-c\", {command}]"
    );
}

/// The resources of a task.
fn resources(settings: &Settings) -> Result<String, JobError> {
    let mut all = Vec::new();
    if let Some(cpus) = settings.get("cpus") {
        all.push(format!("cpus = {}", toml(cpus)));
    }
    if let Some(gpus) = settings.number("gpus")? {
        all.push(format!("\"gpus/nvidia\" = {gpus}"));
    }
    if all.is_empty() {
        all.push("cpus = \"1\"".to_owned());
    }
    let time = settings.get("time").map_or(String::new(), |time| format!("time_request = {}\n", toml(time)));
    Ok(format!("[[task.request]]\nresources = {{ {} }}\n{time}", all.join(", ")))
}

/// A text of TOML.
fn toml(text: &str) -> String {
    // JSON's escapes are TOML's.
    Json::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_is_found_behind_warnings() {
        assert_eq!(json_in("{\"id\": 3}").unwrap()["id"], 3);
        let text = "[2026-01-01] WARN versions differ\n[\n {\"id\": 1}\n]\n";
        assert_eq!(json_in(text).unwrap()[0]["id"], 1);
        assert_eq!(json_in("no server"), None);
    }

    #[test]
    fn resources_are_tables() {
        let (_, settings) = crate::engine::engine("hq:cpus=4,gpus=1,time=1h").unwrap();
        let text = resources(&settings).unwrap();
        assert!(text.contains("cpus = \"4\", \"gpus/nvidia\" = 1") && text.contains("time_request = \"1h\""));
        let (_, settings) = crate::engine::engine("hq:crash_limit=0").unwrap();
        assert!(settings.number("crash_limit").is_err());
    }
}

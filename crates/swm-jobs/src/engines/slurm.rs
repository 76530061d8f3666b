//! Slurm: a job array, and one more job that joins the shards. Only `sbatch`, `squeue`, `scontrol` and `scancel` are needed, no
//! accounting database.

use std::fmt::Write as _;

use swm_tasks::request::Message;

use super::task;
use crate::engine::{Driver, Engine, Queued, Request, Settings, wrong};
use crate::error::JobError;
use crate::files::ranges;
use crate::job::JobFolder;
use crate::process::{Said, run};

pub(crate) const ENGINE: Engine = Engine {
    name: "slurm",
    about: "a Slurm job array",
    keys: &[
        ("partition", "the partition"),
        ("account", "the account"),
        ("qos", "the quality of service"),
        ("time", "the time limit of a task, such as 2:00:00"),
        ("mem", "the memory of a task, such as 16G"),
        ("gpus", "GPUs of a task"),
        ("cpus", "CPUs of a task"),
        ("tasks", "how many tasks run at once; default 64"),
        ("max", "the number of array entries, each of which runs several shards; default: the site's limit"),
        ("raw", "a further line for sbatch, such as --constraint=avx512; comes last"),
    ],
    driver: &Slurm,
};

/// Tasks that run at once.
const TASKS: u64 = 64;
/// `MaxArraySize` where `scontrol` does not say it: Slurm's default.
const MAX_ARRAY_SIZE: u64 = 1001;
/// Seconds before the time limit at which tasks are asked to end: signals come up to 60 s early.
const EARLY: u64 = 120;
/// Options of `sbatch` that are sent as they are.
const OPTIONS: &[(&str, &str)] = &[
    ("partition", "--partition"),
    ("account", "--account"),
    ("qos", "--qos"),
    ("time", "--time"),
    ("mem", "--mem"),
    ("gpus", "--gpus"),
    ("cpus", "--cpus-per-task"),
];
/// Options that the task that joins the shards needs, too.
const FINISH_OPTIONS: &[&str] = &["partition", "account", "qos", "time", "mem"];

/// Time limits that are none.
const UNLIMITED: [&str; 2] = ["UNLIMITED", "INFINITE"];

#[derive(Debug)]
struct Slurm;

impl Driver for Slurm {
    fn entries(&self, shards: u64, settings: &Settings) -> Result<u64, JobError> {
        // Where it does not answer, `sbatch` says why.
        let config = run("scontrol", &["show", "config"], "").map(|said| said.out).unwrap_or_default();
        let size = config.lines().find_map(|line| {
            let (key, value) = line.split_once('=')?;
            (key.trim() == "MaxArraySize").then(|| value.trim().parse::<u64>().ok()).flatten()
        });
        // The limit is on the index, not on the number of entries.
        let limit = size.unwrap_or(MAX_ARRAY_SIZE).saturating_sub(1).max(1);
        Ok(shards.min(limit).min(settings.number("max")?.unwrap_or(u64::MAX)))
    }

    fn check(&self, settings: &Settings) -> Result<(), JobError> {
        match settings.get("time") {
            Some(time) if time_limit(time).is_none() && !UNLIMITED.contains(&time) => Err(wrong(format!(
                "slurm: time={time} is no time limit; write H:M:S, such as 2:00:00, or D-H:M:S"
            ))),
            _ => Ok(()),
        }
    }

    fn script(&self, request: &Request<'_>) -> Result<String, JobError> {
        let Request { folder, settings, entries, indices, .. } = request;
        let at_once = settings.number("tasks")?.unwrap_or(TASKS);
        let mut text = head(folder, &folder.job.name(), settings, |_| true)?;
        let _ = writeln!(text, "#SBATCH --array={}%{at_once}", ranges(*indices));
        let _ = writeln!(text, "#SBATCH --requeue");
        let _ = writeln!(text, "#SBATCH --signal=B:TERM@{EARLY}");
        if let Some(seconds) = settings.get("time").and_then(time_limit) {
            let _ = writeln!(text, "export SWM_TIME_LIMIT={}", seconds.saturating_sub(EARLY));
        }
        let packed =
            if *entries < folder.job.shards { format!(" --entries {entries}") } else { String::new() };
        text += &format!(
            "\
# The signal reaches this shell alone, which would end without passing it on if it waited in the foreground.
{} --index \"$SLURM_ARRAY_TASK_ID\"{packed} & task=$!
trap 'kill -TERM \"$task\" 2>/dev/null' TERM
while :; do wait \"$task\"; status=$?; kill -0 \"$task\" 2>/dev/null || break; done
# 75: stopped in time, to be continued. What Slurm itself ends is completing: it starts what it preempted again, and what was canceled
# must not start. Slurm ends this shell then; if the shell ended by itself, that could end the next start of the task. The number of a job
# alone may mean the whole array.
me=${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID
if [ \"$status\" = 75 ]; then
  case $(squeue -h -j \"$me\" -o %T) in *COMPLETING*) ;; *) scontrol requeue \"$me\" ;; esac
  sleep 60
fi
exit \"$status\"
",
            task(folder)
        );
        Ok(text)
    }

    fn submit(&self, request: &Request<'_>, script: &str) -> Result<Option<String>, JobError> {
        if request.indices.is_empty() {
            return self.submit_finish(request, "").map(|()| None);
        }
        sbatch(script).map(Some)
    }

    fn finish_script(&self, request: &Request<'_>, id: &str) -> Result<Option<String>, JobError> {
        let Request { folder, settings, after, .. } = request;
        let name = format!("{}-finish", folder.job.name());
        let mut text = head(folder, &name, settings, |key| FINISH_OPTIONS.contains(&key))?;
        let ids: Vec<&str> =
            after.iter().map(String::as_str).chain([id]).filter(|id| !id.is_empty()).collect();
        if !ids.is_empty() {
            // Not `afterok`: after one failure it would wait for ever. The task looks itself at what is done.
            let _ = writeln!(text, "#SBATCH --dependency=afterany:{}", ids.join(":"));
        }
        let _ = writeln!(text, "exec {} --finish", task(folder));
        Ok(Some(text))
    }

    fn submit_finish(&self, request: &Request<'_>, id: &str) -> Result<(), JobError> {
        self.finish_script(request, id)?.map_or(Ok(()), |script| sbatch(&script).map(drop))
    }

    fn queued(&self, folder: &JobFolder) -> Result<Vec<Queued>, JobError> {
        let name = folder.job.name();
        let names = format!("{name},{name}-finish");
        let said = run("squeue", &["-h", "--me", "-r", "-n", &names, "-o", "%K|%T|%r|%i|%j"], "")?;
        if !said.is_ok && !said.err.contains("Invalid job id") {
            return Err(refused("squeue", &said));
        }
        Ok(said.out.lines().filter_map(|line| queued_line(line, &name)).collect())
    }

    fn cancel(&self, folder: &JobFolder) -> Result<(), JobError> {
        let name = folder.job.name();
        for name in [format!("{name}-finish"), name] {
            let said = run("scancel", &["--me", "-n", &name], "")?;
            if !said.is_ok {
                return Err(refused("scancel", &said));
            }
        }
        Ok(())
    }
}

/// The first lines of a script.
fn head(
    folder: &JobFolder,
    name: &str,
    settings: &Settings,
    wants: impl Fn(&str) -> bool,
) -> Result<String, JobError> {
    let dir = folder.dir.display().to_string();
    if dir.contains(['%', '"', '\\', '\n']) {
        return Err(Message::new(format!(
            "{dir}: Slurm cannot write its output into a folder with %, \" or \\ in its name"
        ))
        .into());
    }
    // A folder that is missing would end every task without a word, so it is made before. One file per array: tasks have logs of
    // their own.
    let mut text = format!(
        "#!/bin/bash\n#SBATCH --job-name={name}\n#SBATCH --output=\"{dir}/logs/slurm-%A.log\"\n#SBATCH --open-mode=append\n"
    );
    for (key, option) in OPTIONS.iter().filter(|(key, _)| wants(key)) {
        if let Some(value) = settings.get(key) {
            let _ = writeln!(text, "#SBATCH {option}={value}");
        }
    }
    if let Some(raw) = settings.get("raw") {
        let _ = writeln!(text, "#SBATCH {raw}");
    }
    Ok(text)
}

/// Submits a script; returns the job's number.
fn sbatch(script: &str) -> Result<String, JobError> {
    let said = run("sbatch", &["--parsable"], script)?;
    // Behind warnings: the number, or `NUMBER;CLUSTER` on federations.
    let number = said.out.lines().rev().find_map(|line| {
        let number = line.trim().split(';').next().unwrap_or_default();
        (!number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit())).then(|| number.to_owned())
    });
    match number {
        Some(number) if said.is_ok => Ok(number),
        _ if is_unconfigured(&said) => Err(refused("sbatch", &said)),
        _ => {
            Err(JobError::Engine { program: "sbatch", answer: format!(" refused the job: {}", said.words()) })
        }
    }
}

/// Whether a program of Slurm found no cluster that it belongs to.
fn is_unconfigured(said: &Said) -> bool {
    said.words().contains("establish a configuration source")
}

/// Why a program of Slurm did not do what it was asked, in one line.
fn refused(program: &'static str, said: &Said) -> JobError {
    if is_unconfigured(said) {
        return JobError::NoCluster(program);
    }
    let own = format!("{program}: ");
    let lines = said.words().lines().map(|line| line.strip_prefix(&own).unwrap_or(line).trim());
    JobError::Engine { program, answer: format!(": {}", lines.collect::<Vec<_>>().join("; ")) }
}

/// A line of `squeue`; anything else is a warning.
fn queued_line(line: &str, name: &str) -> Option<Queued> {
    let fields: Vec<&str> = line.trim().split('|').collect();
    let [index, state, reason, id, of] = fields.as_slice() else { return None };
    let is_state = !state.is_empty() && state.bytes().all(|byte| byte.is_ascii_uppercase() || byte == b'_');
    let is_ours = *of == name || of.strip_suffix("-finish") == Some(name);
    let entry = if *of == name { Some(index.parse().ok()?) } else { None };
    (is_state && is_ours).then(|| Queued {
        id: id.split('_').next().unwrap_or_default().to_owned(),
        entry,
        is_running: ["RUNNING", "COMPLETING"].contains(state),
        state: match *reason {
            "None" | "" => state.to_lowercase(),
            reason => format!("{} ({reason})", state.to_lowercase()),
        },
    })
}

/// Seconds of a time limit: `MINUTES`, `M:S`, `H:M:S`, `D-H`, `D-H:M` or `D-H:M:S`.
fn time_limit(text: &str) -> Option<u64> {
    let numbers = |text: &str| text.split(':').map(|part| part.parse().ok()).collect::<Option<Vec<u64>>>();
    let (hours, minutes, seconds) = match text.split_once('-') {
        Some((days, rest)) => {
            let rest = numbers(rest)?;
            let at = |index: usize| rest.get(index).copied().unwrap_or(0);
            (days.parse::<u64>().ok()? * 24 + at(0), at(1), at(2))
        }
        None => match *numbers(text)?.as_slice() {
            [minutes] => (0, minutes, 0),
            [minutes, seconds] => (0, minutes, seconds),
            [hours, minutes, seconds] => (hours, minutes, seconds),
            _ => return None,
        },
    };
    Some(hours * 3600 + minutes * 60 + seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_limits_are_those_of_slurm() {
        let limits = ["30", "1:30", "2:00:00", "1-2", "1-2:3", "1-2:3:4", "x", "UNLIMITED"].map(time_limit);
        let days = 86400 + 7200;
        assert_eq!(limits[..3], [Some(1800), Some(90), Some(7200)]);
        assert_eq!(limits[3..], [Some(days), Some(days + 180), Some(days + 184), None, None]);
    }

    #[test]
    fn refusals_are_one_line() {
        let said = |err: &str| Said { is_ok: false, out: String::new(), err: err.to_owned() };
        let message =
            refused("squeue", &said("squeue: error: slow\nsqueue: error: no controller\n")).to_string();
        assert_eq!(message, "squeue: error: slow; error: no controller");
        let alone = "squeue: error: resolve_ctls_from_dns_srv: res_nsearch error: Unknown host\n\
                     squeue: error: fetch_config: DNS SRV lookup failed\n\
                     squeue: fatal: Could not establish a configuration source\n";
        let message = refused("squeue", &said(alone)).to_string();
        assert!(message.contains("no Slurm cluster") && message.contains("SLURM_CONF"), "{message}");
        assert!(!message.contains("resolve_ctls") && !message.contains('\n'), "{message}");
    }

    #[test]
    fn warnings_of_squeue_are_no_tasks() {
        let line = |text: &str| queued_line(text, "swm-0123");
        let task = line("7|PENDING|Priority|12_7|swm-0123").unwrap();
        assert_eq!((task.entry, task.is_running, task.id.as_str()), (Some(7), false, "12"));
        assert_eq!(task.state, "pending (Priority)");
        let finish = line("N/A|PENDING|Dependency|13|swm-0123-finish").unwrap();
        assert_eq!((finish.entry, finish.id.as_str()), (None, "13"));
        assert!(line("3|RUNNING|None|12_3|swm-0123").unwrap().is_running);
        for noise in ["squeue: warning: slow", "a|b|c|d|e", "", "7|PENDING|Priority|12_7|other"] {
            assert_eq!(line(noise), None, "{noise}");
        }
    }
}

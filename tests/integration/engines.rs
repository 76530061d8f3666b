//! Jobs on engines: stand-ins for the programs of Slurm and HyperQueue that record, refuse, hang and warn.

#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value as Json;

use crate::evaluation::read;
use crate::jobs::{Cluster, collect, collect_line_by_line, fails, ok, said, signal, wait_for, whole};
use crate::support::swm;

/// `sbatch` that keeps what it gets and numbers jobs from 101, behind a warning; `squeue` that prints the file `queue`.
fn slurm(max_array_size: u64) -> Cluster {
    let cluster = Cluster::new();
    cluster.program(
        "sbatch",
        "n=$(( $(cat $ROOT/count 2>/dev/null || echo 100) + 1 )); echo $n > $ROOT/count; cat > $ROOT/job-$n.sh\n\
         env | grep -c '^SLURM_JOB' > $ROOT/env-$n\n\
         echo 'sbatch: warning: partition is busy' >&2; echo 'lua: hello'; echo \"$n;cluster\"",
    );
    cluster.program(
        "squeue",
        "echo 'squeue: warning: slow'; echo \"$@\" >> $ROOT/asked; cat $ROOT/queue 2>/dev/null; exit 0",
    );
    cluster.program(
        "scontrol",
        &format!("echo \"$@\" >> $ROOT/scontrol; echo 'MaxArraySize            = {max_array_size}'"),
    );
    cluster.program("scancel", "echo \"$@\" >> $ROOT/canceled");
    cluster.program("sleep", "exit 0");
    cluster
}

#[test]
fn slurm_gets_an_array_and_a_join() {
    let cluster = slurm(1001);
    let whole = whole(&cluster.folder, "10");
    let on = "slurm:partition=cpu,time=1:00:00,cpus=2,tasks=3,raw=--constraint=a,b";
    let dry = ok(&cluster.submit(&["--on", on, "--dry-run"], "5", &collect("10")));
    assert!(dry.contains("#   #SBATCH --dependency=afterany:ARRAY_ID"), "the join: {dry}");
    assert!(!Path::new(&cluster.path("job")).exists() && !Path::new(&cluster.path("count")).exists());
    let mut submitted = cluster.swm(&[
        "submit",
        "--job",
        &cluster.path("job"),
        "--on",
        on,
        "--shards",
        "5",
        "--no-copy",
        "--json",
        "--",
    ]);
    let submitted = submitted.args(collect("10")).env("SLURM_JOB_ID", "7").output().unwrap();
    let json: Json = serde_json::from_str(&ok(&submitted)).unwrap();
    assert_eq!((&json["id"], json["submitted"].as_array().unwrap().len()), (&"101".into(), 5));
    let script = cluster.text("job-101.sh");
    assert!(dry.starts_with(&script), "a dry run prints what is submitted: {dry}");
    let name = json["name"].as_str().unwrap();
    for line in [
        &format!("#SBATCH --job-name={name}\n"),
        "#SBATCH --array=1-5%3\n",
        "#SBATCH --partition=cpu\n",
        "#SBATCH --time=1:00:00\n",
        "#SBATCH --cpus-per-task=2\n",
        "#SBATCH --constraint=a,b\n",
        "#SBATCH --requeue\n",
        "#SBATCH --signal=B:TERM@120\n",
        "export SWM_TIME_LIMIT=3480\n",
    ] {
        assert!(script.contains(line), "{line} in\n{script}");
    }
    let finish = cluster.text("job-102.sh");
    assert!(finish.contains("--dependency=afterany:101\n") && finish.contains(" --finish\n"), "{finish}");
    assert!(!finish.contains("--array") && !finish.contains("--cpus-per-task"), "{finish}");
    assert_eq!(cluster.text("env-101"), "0\n", "settings of a surrounding job are not handed on");

    // Everything is queued: nothing is sent. A warning is no task.
    let queue = |lines: &str| fs::write(cluster.path("queue"), lines).unwrap();
    let all: String = (1..=5).map(|index| format!("{index}|PENDING|Priority|101_{index}|{name}\n")).collect();
    queue(&format!("{all}N/A|PENDING|Dependency|102|{name}-finish\n"));
    let job = cluster.path("job");
    let again = || cluster.swm(&["submit", "--job", &job]).output().unwrap();
    assert!(ok(&again()).contains("nothing to submit: of 5 shards 0 are done and 5 are queued"));
    let page = ok(&cluster.swm(&["jobs", &job]).output().unwrap());
    assert!(page.contains("5 waiting") && page.contains("pending (Priority)"), "{page}");

    // Two are done, one runs, two were lost: the two are sent, and the join waits for all three.
    let run = |script: &str, index: &str| {
        let mut bash = cluster.with_path(Command::new("bash"));
        bash.arg(cluster.path(script))
            .env("SLURM_ARRAY_TASK_ID", index)
            .env("SLURM_ARRAY_JOB_ID", "101")
            .output()
            .unwrap()
    };
    ok(&run("job-101.sh", "1"));
    ok(&run("job-101.sh", "4"));
    queue(&format!("2|RUNNING|None|101_2|{name}\n"));
    assert!(ok(&again()).contains("submitted 2 shards to slurm as job 103 (2 done, 1 queued before)"));
    assert!(cluster.text("job-103.sh").contains("#SBATCH --array=3,5%3\n"));
    assert!(cluster.text("job-104.sh").contains("--dependency=afterany:101:103\n"));
    queue("");
    for index in ["2", "3", "5"] {
        ok(&run("job-103.sh", index));
    }
    assert!(ok(&again()).contains("all shards are done; their join was submitted to slurm"));
    assert!(!cluster.text("job-105.sh").contains("--dependency"));
    ok(&run("job-105.sh", ""));
    assert!(fs::read(cluster.path("job/result.h5")).unwrap() == whole);
    assert!(cluster.text("job/logs/0001.log").contains("by slurm 101: 0 committed"));
    assert_eq!(cluster.text("job/submissions.jsonl").lines().count(), 2);
    ok(&cluster.swm(&["jobs", "--cancel", &job]).output().unwrap());
    assert!(cluster.text("canceled").contains(&format!("--me -n {name}\n")));
    assert!(
        ok(&cluster.swm(&["jobs", "--logs", &job, "2"]).output().unwrap()).contains("swm task: attempt 1 on")
    );
}

#[test]
fn more_shards_than_an_array_may_have_are_packed() {
    let cluster = slurm(4);
    let whole = whole(&cluster.folder, "10");
    ok(&cluster.submit(&["--on", "slurm"], "10", &collect("10")));
    let script = cluster.text("job-101.sh");
    assert!(script.contains("--array=1-3%64\n") && script.contains("--entries 3 &"), "{script}");
    let run = |index: &str, limit: &str| {
        let mut bash = cluster.with_path(Command::new("bash"));
        bash.arg(cluster.path("job-101.sh")).env("SLURM_ARRAY_TASK_ID", index);
        bash.env("SLURM_ARRAY_JOB_ID", "101")
            .env("SLURM_JOB_ID", "101")
            .env("SWM_TIME_LIMIT", limit)
            .output()
            .unwrap()
    };
    // No time for a second shard: the rest is requeued.
    fails(75, &run("1", "0.001"));
    assert!(cluster.text("scontrol").contains("requeue 101_1\n"));
    let done = || fs::read_dir(cluster.path("job/done")).unwrap().count();
    assert_eq!(done(), 1);
    for index in ["1", "2", "3"] {
        ok(&run(index, "1000"));
    }
    assert_eq!(done(), 10);
    ok(&cluster.swm(&["task", &cluster.path("job"), "--finish"]).output().unwrap());
    assert!(fs::read(cluster.path("job/result.h5")).unwrap() == whole);
    // A site can allow less than its maximum.
    let cluster = slurm(4);
    ok(&cluster.submit(&["--on", "slurm:max=2"], "10", &collect("10")));
    assert!(cluster.text("job-101.sh").contains("--array=1-2%64\n"));
}

#[test]
fn a_task_that_slurm_stops_is_requeued_unless_it_is_canceled() {
    let cluster = slurm(1001);
    ok(&cluster.submit(&["--on", "slurm"], "2", &collect_line_by_line("100000")));
    let stop = |index: &str| {
        let mut bash = cluster.with_path(Command::new("bash"));
        bash.arg(cluster.path("job-101.sh")).env("SLURM_ARRAY_TASK_ID", index);
        let mut child = bash.env("SLURM_ARRAY_JOB_ID", "101").stderr(Stdio::null()).spawn().unwrap();
        let log = format!("job/logs/000{index}.log");
        wait_for("episodes", || cluster.text(&log).contains(" written to "));
        // As Slurm sends it: to the shell alone, and twice.
        signal(&child, "-TERM");
        signal(&child, "-TERM");
        assert_eq!(child.wait().unwrap().code(), Some(75));
        assert!(cluster.text(&log).contains("interrupted: "));
        cluster.text("scontrol").contains(&format!("requeue 101_{index}\n"))
    };
    assert!(stop("2"), "{}", cluster.text("scontrol"));
    fs::write(cluster.path("queue"), "COMPLETING\n").unwrap();
    assert!(!stop("1"), "{}", cluster.text("scontrol"));
}

#[test]
fn a_task_without_progress_is_given_up() {
    let cluster = slurm(1001);
    let job = cluster.path("job");
    ok(&cluster.submit(&["--on", "slurm"], "2", &collect("4")));
    let attempt =
        |number: u64, id: &str| format!("swm task: attempt {number} on n1 by slurm {id}: 0 committed\n");
    let earlier: String = (1..=3).map(|number| attempt(number, "101")).collect();
    fs::write(cluster.path("job/logs/0001.log"), earlier).unwrap();
    let task =
        |id: &str| swm(&["task", &job, "--index", "1"]).env("SLURM_ARRAY_JOB_ID", id).output().unwrap();
    let message = fails(1, &task("101"));
    assert!(
        message.contains("no progress") && message.contains("3 times") && message.contains("more time"),
        "{message}"
    );
    assert_eq!(read(&cluster.path("job/done/0001.failed"))["status"], 1);
    let page = ok(&cluster.swm(&["jobs", &job]).output().unwrap());
    assert!(page.contains("1 failed") && page.contains("makes no progress"), "{page}");
    // Submitted again, it is tried again, and the failure is forgotten.
    ok(&cluster.swm(&["submit", "--job", &job]).output().unwrap());
    assert!(!Path::new(&cluster.path("job/done/0001.failed")).exists());
    ok(&task("103"));
}

#[test]
fn a_scheduler_that_refuses_or_hangs_is_named() {
    let cluster = slurm(1001);
    // What is known before leaves no folder behind.
    let message = fails(2, &cluster.submit(&["--on", "slurm:time=soon"], "2", &collect("4")));
    assert!(message.contains("time=soon is no time limit"), "{message}");
    cluster.program("squeue", "echo 'squeue: error: no controller' >&2; exit 1");
    let message = fails(1, &cluster.submit(&["--on", "slurm"], "2", &collect("4")));
    assert!(message.contains("squeue: error: no controller"), "{message}");
    assert!(!Path::new(&cluster.path("job")).exists());
    // The programs are installed, and there is no cluster.
    cluster.program(
        "squeue",
        "echo 'squeue: error: resolve_ctls_from_dns_srv: res_nsearch error: Unknown host' >&2\n\
         echo 'squeue: fatal: Could not establish a configuration source' >&2; exit 1",
    );
    let message = fails(1, &cluster.submit(&["--on", "slurm"], "2", &collect("4")));
    assert!(message.contains("belongs to no Slurm cluster") && message.contains("--dry-run"), "{message}");
    assert!(!message.contains("resolve_ctls") && message.lines().count() == 1, "{message}");
    cluster.program("squeue", "cat $ROOT/queue 2>/dev/null; exit 0");
    cluster.program("sbatch", "cat > /dev/null; echo 'sbatch: error: invalid account' >&2; exit 1");
    let message = fails(1, &cluster.submit(&["--on", "slurm"], "2", &collect("4")));
    assert!(message.contains("sbatch refused the job: sbatch: error: invalid account"), "{message}");
    // Nothing is queued, and the same command goes on.
    assert!(!Path::new(&cluster.path("job/submissions.jsonl")).exists());
    cluster.program("squeue", "echo 'slurm_load_jobs error: Unable to contact slurm controller' >&2; exit 1");
    let message = fails(1, &cluster.submit(&["--on", "slurm"], "2", &collect("4")));
    assert!(message.contains("cannot find out what is queued: squeue: slurm_load_jobs error"), "{message}");
    cluster.program("squeue", "exec /bin/sleep 100");
    let job = cluster.path("job");
    let started = Instant::now();
    let hung = cluster
        .swm(&["submit", "--job", &job, "--on", "slurm"])
        .env("SWM_ENGINE_TIMEOUT", "1")
        .output()
        .unwrap();
    assert!(fails(1, &hung).contains("`squeue` does not answer for 1 s"));
    assert!(started.elapsed() < Duration::from_secs(20));
    // Progress stands in files: without the scheduler it is shown, too.
    fs::write(cluster.path("job/submissions.jsonl"), "{\"on\":\"slurm\",\"id\":\"1\",\"entries\":2,\"indices\":\"1-2\",\"script\":\"\",\"time\":1}\n{\"cut").unwrap();
    let shown = cluster.swm(&["jobs", &job]).env("SWM_ENGINE_TIMEOUT", "1").output().unwrap();
    assert!(ok(&shown).contains("2 not submitted") && said(&shown).contains("does not answer"));
    // A job that Slurm has forgotten is not queued.
    cluster.program("squeue", "echo 'slurm_load_jobs error: Invalid job id specified' >&2; exit 1");
    let cluster_swm = cluster.swm(&["submit", "--job", &job]).output().unwrap();
    assert!(fails(1, &cluster_swm).contains("invalid account"));
}

#[test]
fn two_submissions_at_once_are_one() {
    let cluster = slurm(1001);
    cluster.program(
        "sbatch",
        "cat > /dev/null; touch $ROOT/started; while [ ! -e $ROOT/go ]; do /bin/sleep 0.01; done; echo 5",
    );
    let job = cluster.path("job");
    let mut first = cluster.swm(
        &[&["submit", "--job", &job, "--on", "slurm", "--shards", "2", "--no-copy", "--"][..], &collect("4")]
            .concat(),
    );
    let first = first.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for("sbatch", || Path::new(&cluster.path("started")).exists());
    let message = fails(1, &cluster.submit(&["--on", "slurm"], "2", &collect("4")));
    assert!(message.contains(&format!("process {}", first.id())), "{message}");
    fs::write(cluster.path("go"), "").unwrap();
    ok(&first.wait_with_output().unwrap());
    assert_eq!(cluster.text("job/submissions.jsonl").lines().count(), 1);
}

#[test]
fn waiting_ends_with_the_result_or_without() {
    let cluster = slurm(1001);
    // The whole cluster in one program: every index at once, then the join.
    cluster.program(
        "sbatch",
        "cat > $ROOT/script; if grep -q array $ROOT/script; then for i in 1 2; do SLURM_ARRAY_TASK_ID=$i bash $ROOT/script; done; \
         else bash $ROOT/script; fi > /dev/null 2>&1; echo 5",
    );
    ok(&cluster.submit(&["--on", "slurm", "--wait"], "2", &collect("4")));
    assert!(fs::read(cluster.path("job/result.h5")).unwrap() == whole(&cluster.folder, "4"));
    let lost = slurm(1001);
    let message = fails(1, &lost.submit(&["--on", "slurm", "--wait"], "2", &collect("4")));
    assert!(message.contains("has ended without a result") && message.contains("1-2"), "{message}");
}

#[test]
fn hyperqueue_gets_tasks_and_a_join_that_depends_on_them() {
    let cluster = Cluster::new();
    let whole = whole(&cluster.folder, "6");
    cluster.program(
        "hq",
        "echo '[2026-01-01T00:00:00Z] WARN client is newer'\n\
         case \"$1 $2\" in\n\
         'job submit-file') cp \"$3\" $ROOT/job.toml; echo '{\"id\": 7}' ;;\n\
         'job list') cat $ROOT/list 2>/dev/null || echo '[]' ;;\n\
         'task list') echo '{\"7\": [{\"id\": 1, \"state\": \"running\"}, {\"id\": 2, \"state\": \"finished\"}, {\"id\": 0, \"state\": \"waiting\"}]}' ;;\n\
         'job cancel') echo $3 > $ROOT/canceled ;;\n\
         esac",
    );
    let submitted = cluster.submit(&["--on", "hq:cpus=2,time=1h", "--json"], "3", &collect("6"));
    let json: Json = serde_json::from_str(&ok(&submitted)).unwrap();
    assert_eq!(json["id"], "7");
    let text = cluster.text("job.toml");
    let file: toml::Table = text.parse().expect("it is TOML");
    assert_eq!(file["name"].as_str(), json["name"].as_str());
    let tasks = file["task"].as_array().unwrap();
    assert_eq!(tasks.len(), 4);
    assert_eq!(tasks[0]["crash_limit"].as_integer(), Some(20));
    assert_eq!(tasks[0]["request"][0]["resources"]["cpus"].as_str(), Some("2"));
    assert_eq!(tasks[0]["request"][0]["time_request"].as_str(), Some("1h"));
    assert_eq!(tasks[3]["deps"].as_array().unwrap().len(), 3);
    let name = json["name"].as_str().unwrap();
    fs::write(
        cluster.path("list"),
        format!("[{{\"id\": 7, \"name\": \"{name}\"}}, {{\"id\": 8, \"name\": \"x\"}}]"),
    )
    .unwrap();
    let job = cluster.path("job");
    let page = ok(&cluster.swm(&["jobs", &job]).output().unwrap());
    assert!(page.contains("1 running") && page.contains("2 not submitted"), "{page}");
    let run = |at: usize| {
        let words: Vec<&str> =
            tasks[at]["command"].as_array().unwrap().iter().filter_map(toml::Value::as_str).collect();
        Command::new(words[0]).args(&words[1..]).env("HQ_JOB_ID", "7").output().unwrap()
    };
    // A shard that fails does not cancel the join, which says what is missing.
    let log = cluster.path("job/parts/0002-of-0003.h5");
    fs::write(&log, "no recording").unwrap();
    ok(&run(0));
    ok(&run(1));
    assert!(Path::new(&cluster.path("job/done/0002.failed")).exists());
    ok(&run(2));
    let message = fails(1, &run(3));
    assert!(message.contains("1 of 3 shards") && message.contains("failed: 2"), "{message}");
    fs::remove_file(log).unwrap();
    fs::remove_file(cluster.path("list")).unwrap();
    ok(&cluster.swm(&["submit", "--job", &job]).output().unwrap());
    let again: toml::Table = cluster.text("job.toml").parse().unwrap();
    assert_eq!(again["task"].as_array().unwrap().len(), 2, "the shard that failed, and the join");
    ok(&run(1));
    ok(&run(3));
    assert!(fs::read(cluster.path("job/result.h5")).unwrap() == whole);
    fs::write(cluster.path("list"), format!("[{{\"id\": 7, \"name\": \"{name}\"}}]")).unwrap();
    ok(&cluster.swm(&["jobs", "--cancel", &job]).output().unwrap());
    assert_eq!(cluster.text("canceled"), "7\n");
    cluster.program("hq", "echo 'No server is running' >&2; exit 1");
    let message = fails(1, &cluster.swm(&["submit", "--job", &job, "--on", "hq"]).output().unwrap());
    assert!(message.contains("No server is running") && message.contains("hq server start"), "{message}");
}

#[test]
fn a_thousand_shards_are_listed_at_once() {
    let cluster = slurm(1001);
    let job = cluster.path("job");
    let started = Instant::now();
    ok(&cluster.submit(&["--on", "slurm"], "1000", &collect("1000000")));
    let submitted = started.elapsed();
    assert!(cluster.text("job-101.sh").contains("--array=1-1000%64\n"));
    for shard in 1..=990 {
        let done = format!(
            "{{\"shard\":{shard},\"range\":[0,1000],\"episodes\":1000,\"bytes\":1,\"sha256\":\"\",\"attempt\":1,\"node\":\"n\",\"seconds\":9.5}}"
        );
        fs::write(cluster.path(&format!("job/parts/{shard:04}-of-1000.h5")), "").unwrap();
        fs::write(cluster.path(&format!("job/done/{shard:04}.json")), done).unwrap();
    }
    let started = Instant::now();
    let status: Json =
        serde_json::from_str(&ok(&cluster.swm(&["jobs", &job, "--json"]).output().unwrap())).unwrap();
    let listed = started.elapsed();
    assert_eq!((&status["done"], &status["episodes"]), (&990.into(), &990_000.into()));
    assert_eq!(status["missing"].as_array().unwrap().len(), 10);
    println!("submit: {submitted:?}, jobs: {listed:?}");
    assert_eq!(
        fs::read_dir(cluster.path("job")).unwrap().count(),
        5,
        "a file less for each shard that is not begun"
    );
}

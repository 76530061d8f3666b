//! Jobs on a real Slurm of three nodes on this machine, which `tests/cluster/slurm.sh` starts. Where Slurm is not installed the
//! tests say so and pass; `SWM_SLURM_INSTALL=1` lets the script install Debian's packages.

#![cfg(unix)]

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::support::{Folder, root, short_recording, swm, swm_ok};

/// What the script says if it cannot run here.
const SKIPPED: i32 = 77;

/// A running cluster; it is stopped when this is dropped.
struct Slurm {
    folder: Folder,
    /// Ports from here on are the cluster's.
    port: &'static str,
}

impl Slurm {
    /// Starts the cluster; `None`, and a line, where there cannot be one.
    fn start(port: &'static str) -> Option<Self> {
        let slurm = Self { folder: Folder::new(), port };
        let up = slurm.script(&["up"]).output().expect("it starts");
        if up.status.code() == Some(SKIPPED) {
            println!("skipped: {}", String::from_utf8_lossy(&up.stderr).trim());
            return None;
        }
        ok(&up);
        Some(slurm)
    }

    fn script(&self, args: &[&str]) -> Command {
        let mut command = Command::new(root().join("tests/cluster/slurm.sh"));
        command.args(args).env("SWM_SLURM_ROOT", self.folder.path("slurm")).env("SWM_SLURM_PORT", self.port);
        command
    }

    fn with_conf(&self, mut command: Command) -> Command {
        command.env("SLURM_CONF", self.folder.path("slurm/slurm.conf"));
        command
    }

    fn swm(&self, args: &[&str]) -> Output {
        self.with_conf(swm(args)).output().expect("it starts")
    }

    fn slurm(&self, program: &str, args: &[&str]) -> String {
        let mut command = Command::new(program);
        command.args(args);
        ok(&self.with_conf(command).output().expect("it starts"))
    }

    fn submit(&self, job: &str, on: &str, shards: &str, episodes: &str, more: &[&str]) -> String {
        let out = self.folder.path(job);
        let submit = ["submit", "--job", &out, "--on", on, "--shards", shards, "--no-copy"];
        ok(&self.swm(&[&submit[..], more, &["--"], &collect(episodes)].concat()))
    }

    /// What one process records.
    fn undivided(&self) -> Vec<u8> {
        let whole = self.folder.path("whole.h5");
        swm_ok(&[&collect("4000")[..], &["--out", &whole, "--quiet"]].concat());
        fs::read(whole).expect("it was recorded")
    }

    fn bytes(&self, path: &str) -> Vec<u8> {
        fs::read(self.folder.path(path)).unwrap_or_default()
    }

    fn text(&self, path: &str) -> String {
        String::from_utf8_lossy(&self.bytes(path)).into_owned()
    }

    /// Lets requeued tasks start, which else wait until their credentials have expired; and, as an operator does, those that are held as
    /// a controller that lost its state numbered them as one that a node still runs.
    fn release(&self) {
        let control = |args: &[&str]| {
            let mut command = Command::new("scontrol");
            command.args(args);
            // It may have started in the meantime.
            let _ = self.with_conf(command).output();
        };
        for line in self.slurm("squeue", &["-h", "-r", "-t", "PENDING", "-o", "%i %r"]).lines() {
            match line.split_once(' ') {
                Some((id, "BeginTime")) => control(&["update", &format!("JobId={id}"), "StartTime=now"]),
                Some((id, "launch failed requeued held")) => {
                    control(&["update", "NodeName=ALL", "State=RESUME"]);
                    control(&["release", id]);
                }
                _ => {}
            }
        }
    }

    #[track_caller]
    fn wait_for_result(&self, job: &str) {
        let finished = PathBuf::from(self.folder.path(&format!("{job}/finished.json")));
        self.wait_for(job, || {
            self.release();
            finished.is_file()
        });
    }

    #[track_caller]
    fn wait_for_the_end(&self) {
        self.wait_for("an empty queue", || self.slurm("squeue", &["-h", "-r"]).is_empty());
    }

    /// Submits a job without an end, does something to it, and waits until its first shard goes on; then cancels it.
    #[track_caller]
    fn survives(&self, job: &str, partition: &str, disturb: impl FnOnce()) {
        self.submit(job, &format!("slurm:partition={partition},time=5"), "2", "4000000", &[]);
        self.wait_for_a_start(job);
        disturb();
        let log = format!("{job}/logs/0001.log");
        let again = || {
            self.text(&log)
                .lines()
                .find_map(|line| line.strip_prefix("swm task: attempt 2 on ").map(str::to_owned))
        };
        self.wait_for(job, || {
            self.release();
            again().is_some()
        });
        let held = again().and_then(|line| line.split(": ").nth(1)?.split(' ').next()?.parse::<u64>().ok());
        assert!(held > Some(3), "what was committed is not recorded again: {held:?}");
        ok(&self.swm(&["jobs", "--cancel", &self.folder.path(job)]));
        // What is canceled does not start again.
        self.wait_for_the_end();
    }

    #[track_caller]
    fn wait_for_a_start(&self, job: &str) {
        let log = format!("{job}/logs/0001.log");
        self.wait_for("a shard", || self.text(&log).matches(" written to ").count() > 3);
    }

    #[track_caller]
    fn wait_for(&self, what: &str, is_there: impl Fn() -> bool) {
        let started = Instant::now();
        while !is_there() {
            let is_in_time = started.elapsed() < Duration::from_secs(120);
            assert!(
                is_in_time,
                "waited too long: {what}\n{}{}",
                self.slurm("squeue", &["-r"]),
                self.ends_of_logs()
            );
            sleep(Duration::from_millis(50));
        }
    }

    /// The ends of what the jobs and the daemons wrote, and the locks.
    fn ends_of_logs(&self) -> String {
        let files = |folder: &str| fs::read_dir(self.folder.path(folder)).into_iter().flatten().flatten();
        let of_jobs = files("").flat_map(|job| {
            let job = job.file_name().to_string_lossy().into_owned();
            [format!("{job}/logs"), format!("{job}/done")]
        });
        let folders: Vec<_> = of_jobs.chain(["slurm/log".to_owned()]).collect();
        let end = |path: PathBuf| {
            let text = fs::read(&path).unwrap_or_default();
            let text = String::from_utf8_lossy(&text[text.len().saturating_sub(500)..]);
            format!("\n=== {}\n{text}", path.display())
        };
        folders.iter().flat_map(|folder| files(folder)).map(|file| end(file.path())).collect()
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        // A test that fails leaves no daemons either.
        let _ = self.script(&["down"]).output();
    }
}

#[track_caller]
fn ok(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn collect(episodes: &str) -> Vec<&str> {
    short_recording(&["--num-envs", "1", "--threads", "1", "--report-every", "0", "--episodes", episodes])
}

/// The process that runs a shard, from its lock.
fn process_of(slurm: &Slurm, job: &str, shard: &str) -> Option<String> {
    let lock = slurm.text(&format!("{job}/done/{shard}.lock"));
    Some(lock.strip_prefix("process ")?.split(' ').next()?.to_owned())
}

#[test]
fn what_a_cluster_does_to_a_job_does_not_change_its_result() {
    let Some(slurm) = Slurm::start("17400") else { return };
    let whole = slurm.undivided();

    // Undisturbed.
    slurm.submit("calm", "slurm:partition=cpu,time=5,cpus=1", "6", "4000", &["--wait"]);
    assert!(slurm.bytes("calm/result.h5") == whole);

    // A process is killed: its shard fails alone, the join says so, and submitted again it goes on.
    slurm.submit("killed", "slurm:partition=cpu,time=5", "2", "4000", &[]);
    slurm.wait_for_a_start("killed");
    let kill = |process: String| ok(&Command::new("kill").args(["-KILL", &process]).output().unwrap());
    kill(process_of(&slurm, "killed", "0001").expect("it is at work"));
    slurm.wait_for_the_end();
    let out = slurm.folder.path("killed");
    let join = slurm.swm(&["task", &out, "--finish"]);
    assert!(String::from_utf8_lossy(&join.stderr).contains("1 of 2 shards"), "{join:?}");
    assert!(ok(&slurm.swm(&["submit", "--job", &out])).contains("submitted 1 shard to slurm"));
    assert!(ok(&slurm.swm(&["submit", "--job", &out])).contains("nothing to submit"));
    slurm.wait_for_result("killed");
    assert!(slurm.bytes("killed/result.h5") == whole);

    slurm.survives("requeued", "cpu", || {
        let id = slurm.text("requeued/submissions.jsonl");
        let id: serde_json::Value = serde_json::from_str(id.trim()).unwrap();
        slurm.slurm("scontrol", &["requeue", &format!("{}_1", id["id"].as_str().unwrap())]);
    });
    assert!(slurm.text("requeued/logs/0001.log").contains("\ninterrupted: "));

    // More important work takes every node: Slurm stops the tasks of `spot`, and starts them again.
    slurm.survives("preempted", "spot", || {
        let urgent = ["--partition", "cpu", "--nodes", "3", "--exclusive", "--output", "/dev/null"];
        slurm.slurm("sbatch", &[&urgent[..], &["--wrap", "sleep 1"]].concat());
    });

    // A node is lost with all that ran on it.
    slurm.survives("lost", "cpu", || {
        let places = slurm.slurm("squeue", &["-h", "-r", "-t", "RUNNING", "-o", "%K %N"]);
        let node = places.lines().find_map(|line| line.strip_prefix("1 n")).expect("shard 1 is at work");
        ok(&slurm.script(&["kill-node", node]).output().unwrap());
    });

    // More shards than an array can have: the limit is on the index.
    let script = slurm.submit("packed", "slurm", "1100", "4000", &["--dry-run"]);
    assert!(script.contains("--array=1-1000%64") && script.contains("--entries 1000"), "{script}");
}

#[test]
fn a_lost_controller_does_not_change_a_result() {
    let Some(slurm) = Slurm::start("17440") else { return };
    let whole = slurm.undivided();
    slurm.submit("headless", "slurm:partition=cpu,time=5", "2", "4000", &[]);
    slurm.wait_for_a_start("headless");
    // With it goes what it had not yet saved. `swm jobs` counts files.
    ok(&slurm.script(&["kill-controller"]).output().unwrap());
    let out = slurm.folder.path("headless");
    let shown = slurm.swm(&["jobs", &out]);
    assert!(ok(&shown).contains("headless"), "{shown:?}");
    assert!(String::from_utf8_lossy(&shown.stderr).contains("cannot find out what is queued"), "{shown:?}");
    ok(&slurm.script(&["start-controller"]).output().unwrap());
    slurm.wait_for("the controller", || slurm.swm(&["jobs", "--cancel", &out]).status.success());
    slurm.wait_for_the_end();
    ok(&slurm.swm(&["submit", "--job", &out]));
    slurm.wait_for_result("headless");
    assert!(slurm.bytes("headless/result.h5") == whole);
}

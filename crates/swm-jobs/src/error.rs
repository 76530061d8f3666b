//! Why a job cannot be made, opened, submitted or run.

use std::io;
use std::path::PathBuf;

use swm_data::DataError;
use swm_tasks::request::{FileError, Message, TaskError};

/// Why a job cannot be made, opened, submitted or run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JobError {
    /// The folder has other files than those of a job.
    #[error("{} holds no job but other files; give another folder", .0.display())]
    NoJob(PathBuf),
    /// The job in the folder is of a version that this program does not read.
    #[error("{} is a job of a newer version ({version}); use a newer `swm`", .dir.display())]
    Newer {
        /// The folder.
        dir: PathBuf,
        /// The version of the job.
        version: u32,
    },
    /// `job.json` has a content that cannot be.
    #[error("{}: {reason}", .file.display())]
    Damaged {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// `finished.json` has a result that cannot be.
    #[error("{0} names the result `{named}`, which is no file of the job; remove {0}", .file.display())]
    OtherResult {
        /// The file.
        file: PathBuf,
        /// The result.
        named: String,
    },
    /// An input of the job is not what it was.
    #[error(
        "{} has changed since the job was submitted; restore it, or submit another job for it", .0.display()
    )]
    Changed(PathBuf),
    /// This process is not the program of the job, or computes other results.
    #[error("{0}")]
    OtherProgram(String),
    /// A program of an engine is not on this machine.
    #[error("there is no program `{0}` here; run this where it is, such as on a login node")]
    NoProgram(&'static str),
    /// A program of an engine is there and cannot be started.
    #[error("cannot start `{program}`: {source}")]
    NotStarted {
        /// The program.
        program: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// A program of an engine does not end.
    #[error("`{program}` does not answer for {seconds} s; try again later")]
    NoAnswer {
        /// The program.
        program: &'static str,
        /// How long it was waited for.
        seconds: u64,
    },
    /// This machine is outside of the cluster of a program of Slurm.
    #[error(
        "this machine belongs to no Slurm cluster: `{0}` is here and finds no configuration; run this on a login node, or name the file of \
         the cluster in SLURM_CONF"
    )]
    NoCluster(&'static str),
    /// A program of an engine failed, with this output or answer.
    #[error("{program}{answer}")]
    Engine {
        /// The program.
        program: &'static str,
        /// Its output or answer.
        answer: String,
    },
    /// An engine did not answer what it holds.
    #[error("cannot find out what is queued: {0}")]
    Queue(Box<Self>),
    /// The shards are submitted, and their join is not.
    #[error(
        "the shards are submitted as job {id}, but not their join: {reason}; when they are done, submit the job {} again", .dir.display()
    )]
    JoinNotSubmitted {
        /// The engine's name for the shards.
        id: String,
        /// Why the join is not submitted.
        reason: Box<Self>,
        /// The folder of the job.
        dir: PathBuf,
    },
    /// An engine starts a shard again and again in vain.
    #[error(
        "it makes no progress: {engine} started it {starts} times without a new episode; give its tasks more time, or make more shards"
    )]
    NoProgress {
        /// The engine and its job.
        engine: String,
        /// How often.
        starts: usize,
    },
    /// Shards are not done, or their parts are not what they wrote.
    #[error("{0}")]
    Parts(String),
    /// A file or folder cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The system refused something else.
    #[error("{0}")]
    System(#[from] io::Error),
    /// What is to be written is no JSON, such as a path that is no text.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// Another process has the job.
    #[error(transparent)]
    Locked(#[from] DataError),
    /// The request of the job is wrong, or one of its files cannot be hashed.
    #[error(transparent)]
    Task(#[from] TaskError),
}

impl From<Message> for JobError {
    fn from(refusal: Message) -> Self {
        Self::Task(refusal.into())
    }
}

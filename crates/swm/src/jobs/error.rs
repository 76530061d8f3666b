//! Why a job cannot be made, opened, submitted or run.

use std::io;
use std::path::PathBuf;

use swm_data::DataError;
use swm_tasks::request::{FileError, TaskError};

/// By what helps.
#[derive(Debug, thiserror::Error)]
pub(crate) enum JobError {
    /// The folder has other files than those of a job.
    #[error("{} holds no job but other files; give another folder", .0.display())]
    NoJob(PathBuf),
    /// The job in the folder is of a version that this program does not read.
    #[error("{} is a job of a newer version ({version}); use a newer `swm`", .dir.display())]
    Newer { dir: PathBuf, version: u32 },
    /// `job.json` has a content that cannot be.
    #[error("{}: {reason}", .file.display())]
    Damaged { file: PathBuf, reason: String },
    /// `finished.json` has a result that cannot be.
    #[error("{0} names the result `{named}`, which is no file of the job; remove {0}", .file.display())]
    OtherResult { file: PathBuf, named: String },
    /// An input of the job is not what it was.
    #[error(
        "{} has changed since the job was submitted; restore it, or submit another job for it", .0.display()
    )]
    Changed(PathBuf),
    /// This process is not the program of the job, or computes other results.
    #[error("{0}")]
    OtherProgram(String),
    /// What an engine is given is wrong.
    #[error("{0}")]
    Setting(String),
    /// A program of an engine is not on this machine.
    #[error("there is no program `{0}` here; run this where it is, such as on a login node")]
    NoProgram(&'static str),
    /// A program of an engine is there and cannot be started.
    #[error("cannot start `{program}`: {source}")]
    NotStarted { program: &'static str, source: io::Error },
    /// A program of an engine does not end.
    #[error("`{program}` does not answer for {seconds} s; try again later")]
    NoAnswer { program: &'static str, seconds: u64 },
    /// This machine is outside of the cluster of a program of Slurm.
    #[error(
        "this machine belongs to no Slurm cluster: `{0}` is here and finds no configuration; run this on a login node, or name the file of \
         the cluster in SLURM_CONF"
    )]
    NoCluster(&'static str),
    /// A program of an engine failed, with this output or answer.
    #[error("{program}{answer}")]
    Engine { program: &'static str, answer: String },
    /// An engine did not answer what it holds.
    #[error("cannot find out what is queued: {0}")]
    Queue(Box<Self>),
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

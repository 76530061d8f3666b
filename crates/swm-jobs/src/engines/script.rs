//! No engine: the commands are printed, and a person or another program starts them, in any order, anywhere.

use std::fmt::Write as _;

use super::task;
use crate::engine::{Driver, Engine, Queued, Request, Settings};
use crate::error::JobError;
use crate::job::JobFolder;

pub(crate) const ENGINE: Engine = Engine {
    name: "script",
    about: "prints a command per shard and starts nothing",
    keys: &[],
    driver: &Script,
};

#[derive(Debug)]
struct Script;

impl Driver for Script {
    fn entries(&self, shards: u64, _: &Settings) -> Result<u64, JobError> {
        Ok(shards)
    }

    fn script(&self, request: &Request<'_>) -> Result<String, JobError> {
        let task = task(request.folder);
        let mut text = String::new();
        for index in request.indices {
            // Writing to a text cannot fail.
            let _ = writeln!(text, "{task} --index {index}");
        }
        let _ = writeln!(text, "{task} --finish");
        Ok(text)
    }

    fn submit(&self, _: &Request<'_>, _: &str) -> Result<Option<String>, JobError> {
        Ok(None)
    }

    fn queued(&self, _: &JobFolder) -> Result<Vec<Queued>, JobError> {
        Ok(Vec::new())
    }

    fn cancel(&self, _: &JobFolder) -> Result<(), JobError> {
        Ok(())
    }
}

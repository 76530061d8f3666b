//! No engine: the commands are printed, and a person or another program starts them, in any order, anywhere.

use std::fmt::Write as _;

use super::super::JobFolder;
use super::super::engine::{Driver, Engine, Queued, Request, Settings};
use super::super::error::JobError;
use super::task;

pub(in super::super) const ENGINE: Engine = Engine {
    name: "script",
    about: "prints a command per shard and starts nothing",
    keys: &[],
    driver: &Script,
};

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

//! A dataset of one of our formats with options of opening: other names of columns, a rate, an environment.

use std::sync::Arc;

use swm_core::{Metadata, Schema};

use super::inner::of_inner;
use crate::dataset::{Dataset, DatasetInfo, Origin};
use crate::error::DataError;
use crate::foreign::{RewardsAt, source_record};
use crate::open_options::OpenOptions;

/// A dataset whose description differs.
struct Opened {
    inner: Box<dyn Dataset>,
    info: DatasetInfo,
}

/// The dataset as the options describe it. Those in `known` acted already; others that only files of other programs need are refused.
///
/// # Errors
///
/// [`DataError::Option`]: an option is wrong, or would not act.
pub fn opened_with(
    inner: Box<dyn Dataset>,
    options: &OpenOptions,
    known: &[&str],
) -> Result<Box<dyn Dataset>, DataError> {
    if options.is_default() {
        return Ok(inner);
    }
    let refuse = |option, reason| Err(DataError::Option { option, reason });
    let all: Vec<&str> = ["map", "fps", "env"].into_iter().chain(known.iter().copied()).collect();
    options.only(&format!("the format `{}`", inner.info().format), &all)?;
    let mut info = inner.info().clone();
    let mut fields = info.schema.fields().to_vec();
    for (new, old) in &options.map {
        // By its name here, or by that in the files.
        let in_files = || info.mapping.iter().find(|(_, there)| there == old).map(|(new, _)| new);
        let found = inner.schema().index(old).or_else(|| inner.schema().index(in_files()?));
        let Some(at) = found else {
            let known: Vec<_> = inner.schema().fields().iter().map(|field| field.name.as_str()).collect();
            return refuse("map", format!("there is no column `{old}`; there are {}", known.join(", ")));
        };
        new.clone_into(&mut fields[at].name);
    }
    if !options.map.is_empty() {
        info.schema = Schema::new(fields)
            .map_err(|error| DataError::Option { option: "map", reason: error.to_string() })?;
        let names = info.schema.fields().iter().zip(inner.schema().fields());
        // The names in the files, where these are others already.
        let in_files = |name: &String| {
            let known = info.mapping.iter().find(|(new, _)| new == name);
            known.map_or_else(|| name.clone(), |(_, old)| old.clone())
        };
        info.mapping = names.map(|(new, old)| (new.name.clone(), in_files(&old.name))).collect();
    }
    let mut runs = info.runs.to_vec();
    if runs.is_empty() {
        runs.push((0, Metadata::unknown()));
    }
    for (_, run) in &mut runs {
        // A recording of this program stays one, and a copy keeps how its source was read.
        let is_read_here = match &run.source {
            Some(source) => source["format"] == info.format,
            None => run.known_env().is_none(),
        };
        if is_read_here {
            let rewards = Some(RewardsAt::of(run));
            run.source = source_record(info.format, options, &info.mapping, None, None, rewards).source;
        }
        run.rows_per_second = options.fps.or(run.rows_per_second);
        match (&options.env, run.known_env()) {
            (Some(env), Some(known)) if env != known => {
                return refuse("env", format!("the dataset was recorded in {known}; leave it out"));
            }
            (Some(env), None) => {
                env.clone_into(&mut run.env);
                run.settings = options.env_options.clone();
            }
            _ => {}
        }
    }
    info.runs = Arc::from(runs);
    info.rows_per_second = options.fps.or(info.rows_per_second);
    info.opening = Arc::new(options.record());
    Ok(Box::new(Opened { inner, info }))
}

impl Dataset for Opened {
    fn info(&self) -> &DatasetInfo {
        &self.info
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { inner: self.inner.share(), info: self.info.clone() })
    }

    fn origin(&self) -> Option<Origin> {
        Some(self.inner.origin()?.with(format_args!("opened {:?}", self.info.opening)))
    }

    of_inner!(rows, checks, encodings);
}

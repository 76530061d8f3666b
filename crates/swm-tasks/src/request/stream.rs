//! Streams of tasks for continual learning: phases of episodes with factors of their own, laid over a manifest.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use serde_json::Value as Json;
use swm_core::evaluate::witness;
use swm_core::{Batch, EnvConfig, EnvEntry, Episode, EpisodeSeed, Manifest, Schema};

use super::{Fix, Message, TaskError, wrong};
use crate::text_file::{read_text, toml_error};

/// The phases, in order: `[[phase]]` with `episodes`, and `vary` or `set`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Stream {
    phase: Vec<Phase>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Phase {
    episodes: usize,
    #[serde(default)]
    vary: Vec<String>,
    #[serde(default)]
    set: BTreeMap<String, Json>,
}

/// Reads a stream.
pub(super) fn read_stream(path: &Path) -> Result<Stream, TaskError> {
    let wrong = |reason: String| wrong(format!("stream {}: {reason}", path.display()));
    let text = read_text(path).map_err(|error| wrong(error.to_string()))?;
    let stream: Stream = toml::from_str(&text).map_err(|error| wrong(toml_error(&text, &error)))?;
    if stream.phase.is_empty() || stream.phase.iter().any(|phase| phase.episodes == 0) {
        return Err(wrong("needs phases of 1 or more episodes each: [[phase]], episodes = 20".to_owned()));
    }
    Ok(stream)
}

impl Stream {
    /// Gives every pair its phase, with the phase's factors on top of its own.
    pub(super) fn lay_over(&self, manifest: &mut Manifest, entry: &EnvEntry) -> Result<(), TaskError> {
        let total: usize = self.phase.iter().map(|phase| phase.episodes).sum();
        if total != manifest.pairs.len() {
            let reason = format!("the phases have {total} episodes, the manifest {}", manifest.pairs.len());
            return Err(Message::new(reason).fix(Fix::set("episodes", total)).into());
        }
        let mut env = entry.make(&EnvConfig { image: None, settings: manifest.settings.clone() })?;
        let spec = env.spec().clone();
        let drawn: Vec<String> =
            spec.factors.iter().filter(|factor| factor.sampled_by_default).map(|f| f.name.clone()).collect();
        let mut row = Batch::new(Schema::new(spec.fields.clone())?, 1);
        let phases = self.phase.iter().enumerate();
        let phases = phases.flat_map(|(index, phase)| std::iter::repeat_n((index, phase), phase.episodes));
        for (pair, (index, phase)) in manifest.pairs.iter_mut().zip(phases) {
            pair.phase = Some(index);
            pair.set.retain(|name, _| !spec.samples(&phase.vary, name));
            pair.set.extend(phase.set.clone());
            if !phase.vary.is_empty() {
                pair.vary.get_or_insert_with(|| drawn.clone()).extend(phase.vary.clone());
            }
            let reset = pair.reset()?;
            env.reset(&Episode::new(EpisodeSeed::new(pair.seed as u64), &reset))?;
            env.write_episode(&mut row.rows_mut());
            env.observe(&mut row.rows_mut());
            pair.witness = witness(&spec, row.row(0));
        }
        Ok(())
    }
}

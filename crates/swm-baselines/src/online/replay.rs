//! What an agent has collected: every episode is committed to the run's dataset, and its transitions go into the replay
//! buffer, from which clips are sampled.
//!
//! A resumed run collects again what it had collected after its last checkpoint. The dataset holds it already, so it is
//! compared and not written.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

use swm_core::env::PIXELS;
use swm_core::{Batch, BoxError, EpisodeSink, Metadata, Schema, Slice};
use swm_data::dataset::DatasetWriter;
use swm_data::{ClipOptions, ReplayBuffer, Sampler, WriteMode};

use super::agent::{OnlineAgent, Transitions};
use super::interface::{ACTION, Goals, Interface, OBSERVATION, REWARD, TERMINATED};
use crate::error::BaselineError;
use crate::images::Images;

/// Transitions in memory, and the sampler of clips from them.
pub(super) struct Clips {
    buffer: ReplayBuffer,
    sampler: Sampler,
    batch: Batch,
    /// The side of images, if there are any.
    image: Option<usize>,
}

impl Clips {
    /// None yet, and room for `capacity` steps.
    pub(super) fn new(
        interface: &Interface,
        agent: &dyn OnlineAgent,
        capacity: usize,
    ) -> Result<Self, BaselineError> {
        let schema = interface.schema();
        let mut buffer = ReplayBuffer::new(capacity);
        buffer.begin(&schema, &Metadata::default()).map_err(|error| failed(&error))?;
        let keys = schema.fields().iter().map(|field| field.name.clone()).collect();
        let options = ClipOptions::default().num_steps(agent.clip_steps()).keys(Some(keys)).threads(Some(1));
        let sampler = Sampler::new(options, agent.config().seed);
        Ok(Self { buffer, sampler, batch: Batch::new(Arc::default(), 0), image: interface.image })
    }

    /// Adds the transitions of an episode; the oldest leave where there is no room.
    pub(super) fn push(&mut self, transitions: &Batch) -> Result<(), BaselineError> {
        self.buffer.write_episode(transitions).map_err(|error| failed(&error))
    }

    /// Steps that it holds, the last one of each episode included.
    pub(super) fn rows(&self) -> usize {
        self.buffer.rows()
    }

    /// Samples `size` clips for update `index`.
    ///
    /// # Errors
    ///
    /// No episode is as long as a clip.
    pub(super) fn sample(&mut self, size: usize, index: u64) -> Result<Transitions<'_>, BaselineError> {
        self.sampler.sample(&self.buffer, size, index, &mut self.batch)?;
        let clips = &self.batch;
        let values = |name: &str| match clips.schema().index(name).map(|index| clips.column(index)) {
            Some(Slice::F32(values)) => values,
            _ => &[],
        };
        let reward = values(REWARD);
        let steps = reward.len() / size.max(1);
        let images = self.image.zip(clips.schema().index(PIXELS)).and_then(|(side, index)| {
            let Slice::U8(values) = clips.column(index) else { return None };
            Some(Images { values, rows: size, steps, height: side, width: side, channels_last: true })
        });
        Ok(Transitions {
            rows: size,
            steps,
            observation: values(OBSERVATION),
            images,
            action: values(ACTION),
            reward,
            terminated: values(TERMINATED),
        })
    }
}

fn failed(error: &BoxError) -> BaselineError {
    BaselineError::data(OBSERVATION, error.to_string())
}

/// Dataset, buffer and sampler of an online run.
pub(super) struct Replay {
    pub(super) clips: Clips,
    /// The policy of the episodes, in their record.
    policy: String,
    interface: Interface,
    writer: Box<dyn DatasetWriter>,
    is_begun: bool,
    /// Transitions of the episodes that the dataset holds and the last checkpoint does not know.
    ahead: VecDeque<Batch>,
    /// Vectors, `[N, O]`, that the agent has not been shown.
    observed: Vec<f32>,
}

impl Replay {
    /// That of a run in whose checkpoint `episodes` were collected, committed to the dataset at `path`.
    ///
    /// # Errors
    ///
    /// The dataset cannot be read or written, or holds fewer episodes.
    pub(super) fn open(
        path: &Path,
        interface: &Interface,
        agent: &dyn OnlineAgent,
        episodes: u64,
    ) -> Result<Self, BaselineError> {
        let mut clips = Clips::new(interface, agent, agent.collect().capacity)?;
        let mut ahead = VecDeque::new();
        if path.exists() {
            let mut dataset = swm_data::open(path)?;
            let held = dataset.num_episodes();
            if (held as u64) < episodes {
                let reason =
                    format!("it holds {held} of the {episodes} episodes of the run; bring back the rest");
                return Err(BaselineError::Run { path: path.to_owned(), reason });
            }
            let mut rows = Batch::new(dataset.schema().clone(), 0);
            for episode in 0..held {
                dataset.read(episode, 0..dataset.episode_len(episode), &mut rows)?;
                let transitions = interface.transitions(&rows, Goals::Recorded)?;
                if (episode as u64) < episodes {
                    clips.push(&transitions)?;
                } else {
                    ahead.push_back(transitions);
                }
            }
        } else if episodes > 0 {
            let reason = format!("it is gone, with the {episodes} episodes of the run; bring it back");
            return Err(BaselineError::Run { path: path.to_owned(), reason });
        }
        Ok(Self {
            clips,
            policy: format!("{} in training", agent.config().agent),
            interface: interface.clone(),
            writer: swm_data::create(path, WriteMode::Append, None)?,
            is_begun: false,
            ahead,
            observed: Vec::new(),
        })
    }

    /// The vectors that came since the last call.
    pub(super) fn take_observed(&mut self) -> Vec<f32> {
        std::mem::take(&mut self.observed)
    }
}

impl EpisodeSink for Replay {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        if !std::mem::replace(&mut self.is_begun, true) {
            self.writer.begin(schema, &Metadata { policy: self.policy.clone(), ..metadata.clone() })?;
        }
        Ok(self.clips.buffer.written())
    }

    fn holds(&self, column: &str) -> bool {
        self.writer.holds(column)
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        let transitions = self.interface.transitions(rows, Goals::Recorded)?;
        match self.ahead.pop_front() {
            Some(known) if !is_same(&known, &transitions) => {
                let episode = self.clips.buffer.written();
                return Err(format!(
                    "episode {episode} is another one than the run's dataset holds; another version of the program or of the \
                     environment collected it: begin a new run"
                )
                .into());
            }
            Some(_) => {}
            None => self.writer.write_episode(rows)?,
        }
        if let Some(index) = transitions.schema().index(OBSERVATION)
            && let Slice::F32(values) = transitions.column(index)
        {
            self.observed.extend_from_slice(values);
        }
        self.clips.buffer.write_episode(&transitions)
    }

    /// The next round goes on with the same dataset.
    fn finish(&mut self) -> Result<(), BoxError> {
        Ok(())
    }
}

/// Whether two episodes have the same bits.
fn is_same(a: &Batch, b: &Batch) -> bool {
    let same = |column: usize| match (a.column(column), b.column(column)) {
        (Slice::F32(a), Slice::F32(b)) => {
            a.iter().map(|value| value.to_bits()).eq(b.iter().map(|value| value.to_bits()))
        }
        (Slice::U8(a), Slice::U8(b)) => a == b,
        _ => false,
    };
    a.schema() == b.schema() && (0..a.schema().fields().len()).all(same)
}

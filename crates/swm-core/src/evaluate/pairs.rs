//! Sampling the pairs of a manifest: from recorded rows, or from the environment's own resets.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use rand::RngExt as _;
use rand::seq::SliceRandom as _;
use serde_json::Value as Json;

use super::chosen::ChosenPair;
use super::from_dataset::choose_starts;
use super::hash::witness;
use super::manifest::{Excluded, MANIFEST_VERSION, Manifest, Pair, PairSource, Tier};
use crate::batch::{Batch, Schema, Value};
use crate::dataset::{Dataset, Metadata, recorded_goal, recorded_state};
use crate::env::{Env, EnvConfig, Episode, ImageSize};
use crate::error::{BoxError, WorldError};
use crate::registry::EnvEntry;
use crate::seed::{EpisodeSeed, keyed};
use crate::success::{Condition, Judge, SuccessRule};

/// What a manifest is made of, apart from its pairs.
#[derive(Clone, Debug, PartialEq)]
pub struct ManifestOptions {
    /// How pairs are chosen.
    pub tier: Tier,
    /// How many.
    pub pairs: usize,
    /// Actions allowed.
    pub budget: u64,
    /// Environment steps per action.
    pub frame_skip: u32,
    /// Size of the images that policies see.
    pub image: Option<ImageSize>,
    /// Seed of the choice.
    pub seed: u64,
    /// Factors to sample: names, groups, `all`. `None`: the environment's default list online, none on recorded rows.
    pub vary: Option<Vec<String>>,
    /// Factors to set.
    pub set: BTreeMap<String, Value>,
    /// What changes the images that policies see.
    pub distractors: Vec<String>,
    /// When an episode is a success.
    pub success: SuccessRule,
    /// How much must lie between start and goal: the condition must *not* hold at the start. None in historic manifests.
    pub motion: Option<Condition>,
    /// Elements of start columns that are set to zero, so that a policy that sees one image knows all: velocities.
    pub rest: Vec<(String, Range<usize>)>,
}

impl Default for ManifestOptions {
    /// 100 historic pairs, 200 actions, no images, seed 42, the environment's own factors and test.
    fn default() -> Self {
        Self {
            tier: Tier::default(),
            pairs: 100,
            budget: 200,
            frame_skip: 1,
            image: None,
            seed: 42,
            vary: None,
            set: BTreeMap::new(),
            distractors: Vec::new(),
            success: SuccessRule::default(),
            motion: None,
            rest: Vec::new(),
        }
    }
}

/// Recorded rows to sample pairs from.
#[non_exhaustive]
pub struct RecordedPairs<'a> {
    /// The episodes.
    pub source: &'a mut dyn Dataset,
    /// File name, for people.
    pub name: String,
    /// SHA-256 of the file.
    pub hash: String,
    /// The goal is this many rows after the start.
    pub goal_offset: usize,
    /// The share of episodes to sample from; 1: all.
    pub held_out: f64,
    /// The pairs themselves, in place of sampled ones: then `goal_offset`, `held_out` and the number of pairs do not count.
    pub chosen: Option<Vec<ChosenPair>>,
}

impl<'a> RecordedPairs<'a> {
    /// Pairs of all episodes of `source`, whose file has this name and SHA-256; goals lie 25 rows after starts.
    pub fn new(source: &'a mut dyn Dataset, name: String, hash: String) -> Self {
        Self { source, name, hash, goal_offset: 25, held_out: 1.0, chosen: None }
    }
}

/// Whether an episode of a dataset is held out from training and kept for evaluation: a share of all episodes, by a hash
/// of the index. Whoever trains on the others can claim moderate and strict results.
pub fn is_held_out(episode: usize, share: f64) -> bool {
    keyed(0, "held-out episodes", [episode as u64, 0]).random::<f64>() < share
}

/// Candidates tried online for every pair that is wanted, before giving up.
const MOST_TRIES: usize = 1000;

/// Makes a manifest for environments of `entry`, made as `config` says.
///
/// # Errors
///
/// No pairs are asked for, a held-out share out of range, what [`Manifest::check`] refuses, a dataset of another environment or that
/// cannot be read, too few starts and goals that pass the tier's rules. What making and resetting the environment may meet.
pub fn make_manifest(
    entry: &EnvEntry,
    config: &EnvConfig,
    options: &ManifestOptions,
    recorded: Option<RecordedPairs<'_>>,
) -> Result<Manifest, WorldError> {
    let wrong = |reason: &str| WorldError::Option { option: "pairs", reason: reason.to_owned() };
    let chosen = recorded.as_ref().and_then(|recorded| recorded.chosen.as_ref());
    if chosen.map_or(options.pairs, Vec::len) == 0 {
        return Err(wrong("0 pairs asked for; use 1 or more"));
    }
    let env = entry.make(&EnvConfig { image: None, ..config.clone() })?;
    let mut sample = Sample::new(env, options)?;
    let (source, pairs) = match recorded {
        None => (PairSource::Online, sample.online()?),
        Some(mut recorded) => {
            sample.check_source(&recorded)?;
            if !(recorded.held_out > 0.0 && recorded.held_out <= 1.0) {
                let reason = format!("a share of {}; use one above 0 and at most 1", recorded.held_out);
                return Err(WorldError::Option { option: "held_out", reason });
            }
            let chosen = recorded.chosen.take();
            let pairs = match (&chosen, options.tier) {
                (Some(chosen), _) => sample.chosen(&mut recorded, chosen)?,
                (None, Tier::Historic) => sample.historic(&mut recorded).map_err(WorldError::Dataset)?,
                (None, _) => sample.held_out(&mut recorded).map_err(WorldError::Dataset)?,
            };
            let RecordedPairs { source, name, hash, goal_offset, held_out, .. } = recorded;
            let episodes = source.num_episodes();
            let rows = (0..episodes).map(|episode| source.episode_len(episode)).sum();
            let held_out = if options.tier == Tier::Historic { 1.0 } else { held_out };
            let source = match chosen {
                Some(_) => PairSource::Chosen { name, hash, episodes, rows },
                None => PairSource::Dataset { name, hash, episodes, rows, goal_offset, held_out },
            };
            (source, pairs)
        }
    };
    let manifest = Manifest {
        version: MANIFEST_VERSION,
        env: entry.id.to_owned(),
        settings: config.settings.clone(),
        tier: options.tier,
        budget: options.budget,
        frame_skip: options.frame_skip,
        image: options.image,
        seed: options.seed,
        distractors: options.distractors.clone(),
        success: options.success.clone(),
        source,
        excluded: sample.excluded,
        solved_at_start: sample.solved,
        pairs,
    };
    manifest.check()?;
    Ok(manifest)
}

/// An environment that candidates are tried in.
struct Sample<'a> {
    env: Box<dyn Env>,
    row: Batch,
    options: &'a ManifestOptions,
    judge: Option<Judge>,
    motion: Option<Judge>,
    excluded: Excluded,
    solved: usize,
}

impl<'a> Sample<'a> {
    fn new(env: Box<dyn Env>, options: &'a ManifestOptions) -> Result<Self, WorldError> {
        let schema: Arc<Schema> = Schema::new(env.spec().fields.clone())?;
        let judge = options.success.judge(&schema)?;
        let motion = options.motion.iter().cloned().collect();
        let motion = SuccessRule { hold: 1, all: motion }.judge(&schema)?;
        let row = Batch::new(schema, 1);
        Ok(Self { env, row, options, judge, motion, excluded: Excluded::default(), solved: 0 })
    }

    fn check_source(&self, recorded: &RecordedPairs<'_>) -> Result<(), WorldError> {
        let (options, id) = (self.options, &self.env.spec().id);
        let refuse = |reason: String| Err(WorldError::Dataset(reason.into()));
        if recorded.goal_offset == 0 && recorded.chosen.is_none() {
            let reason = "every start would be its goal; use 1 or more".to_owned();
            return Err(WorldError::Option { option: "goal_offset", reason });
        }
        // What other programs recorded, and its copies, may fit.
        let known = recorded.source.metadata().and_then(Metadata::of_known_env);
        let Some(metadata) = known else { return Ok(()) };
        if metadata.env != *id {
            return refuse(format!("was recorded in `{}`, the manifest is for `{id}`", metadata.env));
        }
        if metadata.frame_skip != options.frame_skip {
            let (found, wanted) = (metadata.frame_skip, options.frame_skip);
            return refuse(format!("was recorded with frame skip {found}, the manifest has {wanted}"));
        }
        Ok(())
    }

    /// Stands at the start of `pair`; completes its witness. Whether it is solved, and whether there is motion.
    fn stand(&mut self, pair: &mut Pair) -> Result<[bool; 2], WorldError> {
        let options = pair.reset()?;
        let seed = EpisodeSeed::new(pair.seed as u64);
        let outcome = self.env.reset(&Episode::new(seed, &options))?;
        self.env.write_episode(&mut self.row.rows_mut());
        self.env.observe(&mut self.row.rows_mut());
        let row = self.row.row(0);
        pair.witness = witness(self.env.spec(), row);
        let solved = match &self.judge {
            Some(judge) => judge.margin_of(row) < 1.0,
            None => outcome.success == Some(true),
        };
        let moves = self.motion.as_ref().is_none_or(|motion| motion.margin_of(row) >= 1.0);
        Ok([solved, moves])
    }

    /// Takes a candidate, unless the tier leaves it out.
    fn take(&mut self, mut pair: Pair, pairs: &mut Vec<Pair>) -> Result<(), WorldError> {
        let [solved, moves] = self.stand(&mut pair)?;
        if self.options.tier != Tier::Historic && solved {
            self.excluded.solved_at_start += 1;
        } else if !moves {
            self.excluded.little_motion += 1;
        } else {
            self.solved += usize::from(solved);
            pairs.push(pair);
        }
        Ok(())
    }

    fn online(&mut self) -> Result<Vec<Pair>, WorldError> {
        let options = self.options;
        let set: BTreeMap<String, Json> =
            options.set.iter().map(|(name, value)| (name.clone(), value.to_json())).collect();
        let mut pairs = Vec::with_capacity(options.pairs);
        for candidate in 0..(options.pairs * MOST_TRIES) as u64 {
            if pairs.len() == options.pairs {
                break;
            }
            let pair = Pair {
                seed: EpisodeSeed::of(options.seed, candidate).value(),
                phase: None,
                vary: options.vary.clone(),
                set: set.clone(),
                start: None,
                goal: None,
                from: None,
                goal_episode: None,
                witness: String::new(),
            };
            self.take(pair, &mut pairs)?;
        }
        if pairs.len() < options.pairs {
            let reason =
                format!("only {} of {} pairs found online: {}", pairs.len(), options.pairs, self.left_out());
            return Err(WorldError::Option { option: "pairs", reason });
        }
        Ok(pairs)
    }

    fn left_out(&self) -> String {
        let Excluded { solved_at_start, little_motion, too_short } = self.excluded;
        let shorter = if too_short > 0 { ", for which a smaller goal offset helps" } else { "" };
        format!(
            "{solved_at_start} candidate(s) are solved at the start, {little_motion} have too little motion, \
             {too_short} are too short{shorter}; ask for fewer pairs, or another tier"
        )
    }

    /// Rows sampled uniformly from all episodes, as published.
    fn historic(&mut self, recorded: &mut RecordedPairs<'_>) -> Result<Vec<Pair>, BoxError> {
        let options = self.options;
        let lengths = &recorded.source.info().lengths;
        let starts = choose_starts(lengths, options.pairs, recorded.goal_offset, options.seed)?;
        let mut pairs = Vec::with_capacity(starts.len());
        for start in starts {
            let pair = self.recorded_pair(recorded, ChosenPair::ahead(start, recorded.goal_offset))?;
            self.take(pair, &mut pairs)?;
        }
        Ok(pairs)
    }

    /// The pairs that were chosen, in their order. One that the tier leaves out is refused.
    fn chosen(
        &mut self,
        recorded: &mut RecordedPairs<'_>,
        chosen: &[ChosenPair],
    ) -> Result<Vec<Pair>, WorldError> {
        let tier = self.options.tier.name();
        let mut pairs = Vec::with_capacity(chosen.len());
        for (at, wanted) in chosen.iter().enumerate() {
            wanted.check(&*recorded.source, &chosen[..at])?;
            let pair = self.recorded_pair(recorded, *wanted).map_err(WorldError::Dataset)?;
            self.take(pair, &mut pairs)?;
            if pairs.len() == at {
                let why = match self.excluded.solved_at_start {
                    0 => "has too little motion from start to goal",
                    _ => "is a success at its start",
                };
                return Err(wanted.refuse(&format!(
                    "{why} by the rules of the tier {tier}; choose other steps, or the tier historic"
                )));
            }
        }
        Ok(pairs)
    }

    /// One pair per held-out episode, episodes in random order, rows uniform within.
    fn held_out(&mut self, recorded: &mut RecordedPairs<'_>) -> Result<Vec<Pair>, BoxError> {
        let options = self.options;
        let mut episodes: Vec<usize> =
            (0..recorded.source.num_episodes()).filter(|&e| is_held_out(e, recorded.held_out)).collect();
        let candidates = episodes.len();
        episodes.shuffle(&mut keyed(options.seed, "evaluation episodes", [0, 0]));
        let mut pairs = Vec::with_capacity(options.pairs);
        for episode in episodes {
            if pairs.len() == options.pairs {
                break;
            }
            let valid = recorded.source.episode_len(episode).saturating_sub(recorded.goal_offset);
            if valid == 0 {
                self.excluded.too_short += 1;
                continue;
            }
            let row = keyed(options.seed, "evaluation row", [episode as u64, 0]).random_range(0..valid);
            let rows = ChosenPair::ahead([episode, row], recorded.goal_offset);
            let pair = self.recorded_pair(recorded, rows)?;
            self.take(pair, &mut pairs)?;
        }
        if pairs.len() < options.pairs {
            let (all, share) = (recorded.source.num_episodes(), recorded.held_out);
            let found = format!("only {} of {} pairs found", pairs.len(), options.pairs);
            return Err(format!(
                "{found}: one pair comes from each held-out episode, of which there are {candidates} (about {share} of {all}, chosen \
                 by a hash of their index); {}, a larger held-out share, or more episodes",
                self.left_out()
            )
            .into());
        }
        pairs.sort_by_key(|pair| pair.from);
        Ok(pairs)
    }

    fn recorded_pair(&self, recorded: &mut RecordedPairs<'_>, rows: ChosenPair) -> Result<Pair, BoxError> {
        let (options, spec) = (self.options, self.env.spec());
        let ChosenPair { start: [episode, row], goal: [goal_episode, goal_row] } = rows;
        let recorded_start = recorded_state(spec, recorded.source, episode, row)?;
        let (mut factors, mut start) =
            (recorded_start.variation_values, recorded_start.start.unwrap_or_default());
        // Extras belong to the state as it was recorded.
        start.retain(|name, _| options.rest.is_empty() || spec.start_columns.contains(&name.as_str()));
        for (column, elements) in &options.rest {
            if let Some(value) = start.get_mut(column) {
                let mut numbers = value.to_f64s(column)?;
                let elements = elements.start..elements.end.min(numbers.len());
                numbers.get_mut(elements).into_iter().flatten().for_each(|number| *number = 0.0);
                *value = Value { shape: value.shape.clone(), ..Value::vector(&numbers) };
            }
        }
        let goal_step = [goal_episode, goal_row];
        let goal = recorded_goal(spec, recorded.source, goal_step, options.image.is_some())?;
        if spec.goal_columns.is_empty() {
            return Err(format!(
                "{} sets no goals from recorded rows, so that a dataset gives no pairs; leave out the dataset",
                spec.id
            )
            .into());
        }
        if goal.is_empty() {
            let columns = spec.goal_columns.join("`, `");
            return Err(
                format!("holds none of the columns that {} sets goals from: `{columns}`", spec.id).into()
            );
        }
        let vary = options.vary.clone().unwrap_or_default();
        factors.retain(|name, _| !spec.samples(&vary, name));
        factors.extend(options.set.clone());
        let json = |columns: BTreeMap<String, Value>| -> BTreeMap<String, Json> {
            columns.into_iter().map(|(name, value)| (name, value.to_json())).collect()
        };
        Ok(Pair {
            seed: EpisodeSeed::of(options.seed, (episode as u64) << 32 | row as u64).value(),
            phase: None,
            vary: Some(vary),
            set: json(factors),
            start: Some(json(start)),
            goal: Some(json(goal)),
            from: Some([episode, row, goal_row]),
            goal_episode: (goal_episode != episode).then_some(goal_episode),
            witness: String::new(),
        })
    }
}

//! Starts and goals are chosen, and written into a file: an evaluation task.

use std::path::PathBuf;

use serde_json::{Map, Value as Json, json};
use swm_core::Settings as _;
use swm_core::evaluate::{ChosenPair, ManifestOptions, Tier, make_manifest};
use swm_core::{EnvConfig, EnvEntry, ImageSize, Manifest, Registry, SuccessRule};
use swm_data::OpenOptions;

use super::clear::ClearManifest;
use super::source::check_opening;
use super::stream::read_stream;
use super::{
    Assignment, Fix, Message, Report, Request, Scenario, TaskError, check_recorded_in, create_parent,
    must_be_given, open_dataset_with, wrong,
};
use crate::distractors;
use crate::evaluation::{TierRules, holds_manifest, recorded_pairs, tier_rules, write_manifest};

/// Actions allowed per episode where the environment samples starts and goals (the reference's).
pub const BUDGET_ONLINE: u64 = 200;
/// Actions allowed per episode on recorded pairs (the reference's).
pub const BUDGET_DATASET: u64 = 50;

swm_core::settings! {
    /// Choose starts and goals, and write them into a file.
    pub struct MakeManifest {
        /// The environment's id.
        env: String = String::new() => "must be given",
        /// Settings of the environment, by name.
        ///
        /// They are laid over those of the dataset.
        env_option: Map<String, Json> = Map::new() => "none",
        /// How pairs are chosen, and what counts as success: historic, moderate or strict.
        tier: Tier = Tier::Historic => "historic",
        /// The manifest to write: JSON if the name ends in .json, else TOML.
        out: PathBuf = PathBuf::new() => "must be given",
        /// Number of pairs.
        episodes: usize = 100,
        /// Seed of the pairs.
        seed: u64 = 42,
        /// Take starts and goals from this dataset. Without it, the environment samples them.
        dataset: Option<PathBuf> = None => "none",
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        /// With a dataset: these pairs and no others.
        ///
        /// In place of `episodes`, `goal_offset` and `held_out`.
        pairs: Option<Vec<ChosenPair>> = None => "sampled",
        /// With a dataset: pairs, test of success, budget and seed of this manifest of CLEAR-LeWM.
        ///
        /// In place of `tier`, `pairs`, `episodes`, `goal_offset`, `held_out`, `budget` and `seed`.
        clear: Option<PathBuf> = None => "none",
        /// With a dataset: the goal is this many steps after the start.
        goal_offset: usize = 25,
        /// With a dataset and the tier moderate or strict: the fraction of episodes that is held out from training. 1: all.
        held_out: f64 = 0.2,
        /// Actions allowed per episode.
        budget: Option<u64> = None => "200, or 50 with a dataset",
        /// How often each action is applied per step.
        frame_skip: Option<u32> = None => "1, or the dataset's",
        /// Size of the images that policies see.
        image_size: Option<ImageSize> = None => "none",
        /// Distractors that change those images: NAME or NAME:KEY=VALUE,….
        distractor: Vec<String> = Vec::new() => "none",
        /// A TOML file with the phases of a stream: a number of episodes each, with the factors of the phase.
        stream: Option<PathBuf> = None => "none",
        /// Factors to sample per episode: names, groups, `*.color`, `default`, `all` or `none`; `+NAME` adds to the default ones.
        vary: Option<Vec<String>> = None => "the default factors",
        /// Factors to set, by name: numbers, or names of colors and choices.
        set: Map<String, Json> = Map::new() => "none",
        /// Replace an existing file.
        overwrite: bool = false,
    }
}

impl Request for MakeManifest {
    const NAME: &'static str = "make_manifest";
    type Outcome = Manifest;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        self.check_given()?;
        registry.env(&self.env)?;
        self.check_bounds()?;
        self.check_pairs()?;
        distractors::parse_all(&self.distractor).map_err(wrong)?;
        Ok(())
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Manifest, TaskError> {
        self.check(registry)?;
        let manifest = self.make(registry, report)?;
        if self.overwrite || !holds_manifest(&self.out, &manifest)? {
            create_parent(&self.out)?;
            write_manifest(&self.out, &manifest)?;
        }
        Ok(manifest)
    }
}

impl MakeManifest {
    fn check_given(&self) -> Result<(), TaskError> {
        must_be_given(&[("env", self.env.is_empty()), ("out", self.out.as_os_str().is_empty())])
    }

    fn check_bounds(&self) -> Result<(), TaskError> {
        if let Some(ImageSize { height, width }) = self.image_size {
            ImageSize::new(height, width).map_err(wrong)?;
        }
        if !self.distractor.is_empty() && self.image_size.is_none() {
            let message =
                Message::about("distractor", json!(self.distractor), "changes images, and there are none");
            return Err(message.fix(Fix::set("image_size", json!({ "height": 64, "width": 64 }))).into());
        }
        if !(self.held_out > 0.0 && self.held_out <= 1.0) {
            // JSON has no NaN.
            let value = self.held_out.to_string();
            return Err(Message::about("held_out", value, "use a share above 0 and at most 1").into());
        }
        if self.budget == Some(0) {
            return Err(Message::about("budget", 0, "no action is allowed; use 1 or more").into());
        }
        Ok(())
    }

    /// Refuses settings that go with a dataset where there is none, and others than chosen pairs where there are such.
    fn check_pairs(&self) -> Result<(), TaskError> {
        check_opening(self.dataset.is_some(), &self.opening)?;
        let default = Self::default();
        let given = [
            ("episodes", json!(self.episodes), self.episodes != default.episodes),
            ("goal_offset", json!(self.goal_offset), self.goal_offset != default.goal_offset),
            ("held_out", json!(self.held_out), self.held_out != default.held_out),
        ];
        self.check_clear()?;
        let needs_dataset = |name: &'static str, value: Json| {
            let setting = Assignment::name("dataset");
            Message::about(name, value, "is about a dataset, and none is named")
                .fix(Fix::Any(vec![Fix::Set { setting, to: "" }, Fix::Leave(name)]))
        };
        if let (Some(pairs), None) = (&self.pairs, &self.dataset) {
            return Err(needs_dataset("pairs", json!(pairs)).into());
        }
        if let (Some(clear), None) = (&self.clear, &self.dataset) {
            return Err(needs_dataset("clear", json!(clear)).into());
        }
        for (name, value, is_given) in given {
            if is_given && self.pairs.is_some() {
                let message = Message::about(name, value, "does not go with pairs that are chosen");
                return Err(message.fix(Fix::Any(vec![Fix::Leave(name), Fix::Leave("pairs")])).into());
            }
            if is_given && name != "episodes" && self.dataset.is_none() {
                return Err(needs_dataset(name, value).into());
            }
        }
        Ok(())
    }

    /// Refuses what a manifest of CLEAR-LeWM says itself.
    fn check_clear(&self) -> Result<(), TaskError> {
        if self.clear.is_none() {
            return Ok(());
        }
        let changed = self.changed();
        for name in ["tier", "pairs", "episodes", "goal_offset", "held_out", "budget", "seed", "stream"] {
            if let Some(value) = changed.get(name) {
                let message = Message::about(
                    name,
                    value.clone(),
                    "does not go with a manifest of CLEAR-LeWM, which has its own",
                );
                return Err(message.fix(Fix::Any(vec![Fix::Leave(name), Fix::Leave("clear")])).into());
            }
        }
        Ok(())
    }

    fn make(&self, registry: &Registry, report: &mut dyn Report) -> Result<Manifest, TaskError> {
        let entry = registry.env(&self.env)?;
        let open = |path| open_dataset_with(registry, path, &self.opening);
        let mut dataset = self.dataset.as_deref().map(open).transpose()?;
        if let Some(dataset) = &dataset {
            check_recorded_in(dataset.as_ref(), entry, self.frame_skip)?;
        }
        let recorded = dataset.as_ref().and_then(|dataset| dataset.metadata()).cloned();
        let mut settings = recorded.as_ref().map_or_else(Map::new, |recorded| recorded.settings.clone());
        settings.extend(self.env_option.clone());
        let config = EnvConfig { image: self.image_size, settings };
        let clear = self.clear.as_deref().map(ClearManifest::read).transpose()?;
        let rules = match &clear {
            Some(clear) => clear.rules(entry.id, &config.settings, report)?,
            None => tier_rules(entry.id, &config.settings, self.tier)?,
        };
        if self.tier == Tier::Moderate && rules == TierRules::default() {
            report.note(&Message::new(format!(
                "{} has no moderate rules of its own: success is the environment's test, starts may move, and goals may be near",
                entry.id
            )));
        }
        note_rewards_only(entry, &rules.success, report);
        let made = entry.make(&EnvConfig { image: None, ..config.clone() })?;
        let factors = made.spec().factors.clone();
        let scenario = Scenario { vary: self.vary.as_deref(), set: &self.set };
        let scenario = match &dataset {
            None => scenario.options(entry, &factors, report)?,
            Some(_) => scenario.recorded_options(entry, &factors, report)?,
        };
        let usual = if dataset.is_some() { BUDGET_DATASET } else { BUDGET_ONLINE };
        let budget = self.budget.or(clear.as_ref().map(ClearManifest::budget)).unwrap_or(usual);
        let options = ManifestOptions {
            tier: clear.as_ref().map_or(self.tier, |clear| clear.tier),
            pairs: self.episodes,
            budget,
            frame_skip: self.frame_skip.or(recorded.map(|recorded| recorded.frame_skip)).unwrap_or(1),
            image: config.image,
            seed: clear.as_ref().map_or(self.seed, ClearManifest::seed),
            distractors: self.distractor.clone(),
            vary: scenario.variation,
            set: scenario.variation_values,
            success: rules.success,
            motion: rules.motion,
            rest: rules.rest,
        };
        let pairs = match (&mut dataset, &self.dataset) {
            (Some(dataset), Some(path)) => {
                let listed = clear.as_ref().map(|clear| clear.pairs(dataset.as_ref())).transpose()?;
                let mut recorded = recorded_pairs(dataset, path)?;
                recorded.goal_offset = self.goal_offset;
                recorded.held_out = self.held_out;
                recorded.chosen = listed.or_else(|| self.pairs.clone());
                Some(recorded)
            }
            _ => None,
        };
        let mut manifest = make_manifest(entry, &config, &options, pairs)?;
        if let Some(path) = &self.stream {
            read_stream(path)?.lay_over(&mut manifest, entry)?;
        }
        Ok(manifest)
    }
}

/// Notes where no episode can be a success.
pub fn note_rewards_only(entry: &EnvEntry, success: &SuccessRule, report: &mut dyn Report) {
    if success.all.is_empty() && entry.success.is_empty() {
        report.note(&Message::new(format!(
            "{} has rewards and no success test, and a manifest counts successes: all rates will be 0; an evaluation without a \
             manifest reports returns",
            entry.id
        )));
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use swm_core::testing::{DISCRETE_TOY, TOY};
    use swm_core::{Rollout, World, WorldOptions, policies};
    use swm_data::WriteMode;

    use super::*;
    use crate::evaluation::read_manifest;

    fn registry() -> Registry {
        Registry::new().with(swm_data::FORMATS).with(&[TOY, DISCRETE_TOY])
    }

    fn object(json: Json) -> Map<String, Json> {
        match json {
            Json::Object(map) => map,
            other => panic!("{other} is no object"),
        }
    }

    /// A dataset of the toy environment: episodes of up to 5 actions.
    fn record(path: &Path) {
        let mut world = World::new(&TOY, WorldOptions::new(1).max_episode_steps(5)).unwrap();
        world.set_policy(policies::random()).unwrap();
        let mut writer = swm_data::create(path, WriteMode::Error, None).unwrap();
        world.record_dataset(&Rollout::new(0..3), writer.as_mut()).unwrap();
    }

    #[test]
    fn every_refusal_names_the_setting_and_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let (data, out) = (folder.path().join("toy.h5"), folder.path().join("task.toml"));
        record(&data);
        let missing = folder.path().join("none.h5");
        let leave = Fix::Leave;
        let any = |fixes: &[Fix]| Some(Fix::Any(fixes.to_vec()));
        let name_dataset = Fix::Set { setting: Assignment::name("dataset"), to: "" };
        let size = Some(Fix::set("image_size", json!({ "height": 64, "width": 64 })));
        let pair = json!(["0:0-1"]);
        let other_env = [Fix::Change("dataset"), Fix::set("env", TOY.id)];
        let table = [
            (json!({ "env": "" }), "env: must be given", None),
            (json!({ "out": "" }), "out: must be given", None),
            (json!({ "out": "task.yaml" }), "a manifest is TOML or JSON", None),
            (json!({ "budgt": 3 }), "budgt=3: unknown (did you mean `budget`?)", None),
            (json!({ "budget": -1 }), "budget=-1: must be a whole number, 0 or more", None),
            (json!({ "budget": 0 }), "budget=0: no action is allowed; use 1 or more", None),
            (json!({ "tier": "lenient" }), "tier=lenient: ", None),
            (
                json!({ "held_out": 0.0, "dataset": data }),
                "held_out=0: use a share above 0 and at most 1",
                None,
            ),
            (json!({ "held_out": 1.5, "dataset": data }), "held_out=1.5: use a share", None),
            (json!({ "image_size": { "height": 0, "width": 8 } }), "image size 0x8 is out of range", None),
            (
                json!({ "distractor": ["noise"] }),
                "distractor=noise: changes images, and there are none",
                size,
            ),
            (
                json!({ "distractor": ["noize"], "image_size": { "height": 8, "width": 8 } }),
                "did you mean `noise`?",
                None,
            ),
            (
                json!({ "pairs": pair }),
                "pairs=0:0-1: is about a dataset, and none is named",
                any(&[name_dataset.clone(), leave("pairs")]),
            ),
            (
                json!({ "goal_offset": 3 }),
                "goal_offset=3: is about a dataset",
                any(&[name_dataset.clone(), leave("goal_offset")]),
            ),
            (
                json!({ "held_out": 0.5 }),
                "held_out=0.5: is about a dataset",
                any(&[name_dataset.clone(), leave("held_out")]),
            ),
            (
                json!({ "opening": { "camera": "wrist" } }),
                "camera: is about a dataset, and none is named",
                any(&[name_dataset, leave("camera")]),
            ),
            (json!({ "dataset": data, "opening": { "camera": "wrist" } }), "has no use for it", None),
            (json!({ "dataset": data, "opening": { "fps": -1 } }), "above 0", None),
            (json!({ "dataset": data, "opening": { "lens": 1 } }), "lens: unknown", None),
            (
                json!({ "dataset": data, "pairs": pair, "episodes": 3 }),
                "episodes=3: does not go with pairs that are chosen",
                any(&[leave("episodes"), leave("pairs")]),
            ),
            (json!({ "dataset": data, "pairs": ["0:1"] }), "pairs=0:1: write EPISODE:START-GOAL", None),
            (json!({ "dataset": missing }), "none.h5", None),
            (
                json!({ "dataset": data, "env": DISCRETE_TOY.id }),
                "was recorded in swm/Toy-v0, not",
                any(&other_env),
            ),
            (
                json!({ "dataset": data, "frame_skip": 2 }),
                "frame_skip=2: the dataset",
                Some(leave("frame_skip")),
            ),
            (json!({ "tier": "strict" }), "`swm/Toy-v0` has no strict tier", None),
            (
                json!({ "vary": [""] }),
                "vary: it names no factor",
                Some(Fix::Set { setting: Assignment::of("vary", json!(["none"])), to: "to sample none" }),
            ),
            (json!({ "set": { "point.gain": "much" } }), "set=point.gain=much: `much` is not a number", None),
            (json!({ "stream": missing }), "stream ", None),
        ];
        for (given, text, fix) in table {
            let mut asked = object(json!({ "env": TOY.id, "out": out }));
            asked.extend(object(given));
            let refused = MakeManifest::from_json(&asked).and_then(|asked| asked.run(&registry(), &mut ()));
            let error = match refused {
                Err(error @ TaskError::Request(_)) => error,
                other => panic!("{asked:?}: {other:?}"),
            };
            assert!(error.to_string().contains(text), "{text}: {error}");
            assert_eq!(error.fix(), fix.as_ref(), "{error}");
            assert!(!out.exists(), "nothing is written for a wrong request");
        }
    }

    #[test]
    fn a_manifest_is_replaced_on_request_only() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new/task.toml");
        let mut request =
            MakeManifest { env: TOY.id.to_owned(), out: out.clone(), episodes: 2, ..MakeManifest::default() };
        let mut notes: Vec<Message> = Vec::new();
        let made = request.run(&registry(), &mut notes).unwrap();
        assert_eq!((made.budget, made.seed, notes.as_slice()), (BUDGET_ONLINE, 42, [].as_slice()));
        assert_eq!(
            request.run(&registry(), &mut ()).unwrap().hash(),
            made.hash(),
            "the same is there already"
        );
        request.episodes = 3;
        request.tier = Tier::Moderate;
        let error = request.run(&registry(), &mut notes).unwrap_err();
        assert!(error.to_string().contains("holds another manifest (swm/Toy-v0, 2 pairs)"), "{error}");
        let replace = Fix::Set { setting: Assignment::of("overwrite", true), to: "to replace it" };
        assert_eq!(error.fix(), Some(&Fix::Any(vec![Fix::Change("out"), replace])));
        assert!(notes[0].text.contains("has no moderate rules of its own"), "{notes:?}");
        request.overwrite = true;
        request.run(&registry(), &mut ()).unwrap();
        assert_eq!(read_manifest(&out).unwrap().pairs.len(), 3);
    }

    #[test]
    fn a_request_is_its_json() {
        let request = MakeManifest {
            env: TOY.id.to_owned(),
            pairs: Some(vec!["3:10-4:0".parse().unwrap()]),
            image_size: Some(ImageSize { height: 8, width: 9 }),
            ..MakeManifest::default()
        };
        let json = serde_json::to_value(&request).unwrap();
        assert_eq!(MakeManifest::from_json(&object(json)).unwrap(), request);
        let changed =
            json!({ "env": TOY.id, "pairs": ["3:10-4:0"], "image_size": { "height": 8, "width": 9 } });
        assert_eq!(Json::Object(swm_core::Settings::changed(&request)), changed);
    }
}

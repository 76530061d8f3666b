//! Manifests of the benchmark CLEAR-LeWM: the rows of a published dataset that are starts and goals, and the test of success.
//!
//! Source of the form and of the rules: github.com/DavidSunok/CLEAR-LeWM at `ab8849c4`, `EVALUATION_SPEC.md` and `manifests/v0.5`;
//! every release since 0.1 writes `clear-lewm-manifest-v1` with its whole protocol in it.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Map, Value as Json};
use swm_core::evaluate::{ChosenPair, Condition, Measure, Tier};
use swm_core::{Dataset, SuccessRule};

use super::{Fix, Message, Report, TaskError, wrong};
use crate::evaluation::{TierRules, tier_rules};
use crate::text_file::{json_error, read_text};

/// The form that is read.
const SCHEMA: &str = "clear-lewm-manifest-v1";

/// The benchmark's tasks, and the environments that they are here.
const TASKS: [(&str, &str); 4] = [
    ("pusht", "swm/PushT-v1"),
    ("tworoom", "swm/TwoRoom-v2"),
    ("reacher", "swm/ReacherDMControl-v0"),
    ("cube", "swm/OGBCube-v0"),
];

/// Settings of a protocol about the choice of pairs, which a manifest has made already, and texts.
const OF_THE_CHOICE: [&str; 11] = [
    "name",
    "description",
    "sampling",
    "split",
    "heldout_fraction",
    "exclude_initial_success",
    "goal_offset",
    "min_difficulty",
    "reproduce_upstream_off_by_one",
    "tworoom_crossroom_only",
    "tworoom_source_window_clean",
];

/// A manifest of the benchmark.
pub(super) struct ClearManifest {
    path: PathBuf,
    file: ClearFile,
    pub(super) tier: Tier,
}

/// What stands in its file; what else does is a record of how it was made.
#[derive(Deserialize)]
struct ClearFile {
    schema_version: String,
    task: String,
    seed: u64,
    protocol: Protocol,
    dataset: ClearDataset,
    pairs: Vec<ClearPair>,
}

#[derive(Deserialize)]
struct ClearDataset {
    name: String,
}

/// One pair: an episode by its number, steps in it, and the same two rows counted over the whole dataset.
#[derive(Deserialize)]
struct ClearPair {
    episode_id: usize,
    start_step: usize,
    goal_step: usize,
    start_row: usize,
    goal_row: usize,
}

/// The test of success, with the settings of all four tasks.
#[derive(Deserialize)]
struct Protocol {
    name: String,
    eval_budget: u64,
    success_mode: String,
    #[serde(flatten)]
    settings: Map<String, Json>,
}

impl Protocol {
    fn number(&self, name: &str) -> Option<f64> {
        self.settings.get(name)?.as_f64()
    }

    fn holds(&self, name: &str) -> bool {
        self.settings.get(name).and_then(Json::as_bool).unwrap_or(false)
    }

    fn text(&self, name: &str) -> Option<&str> {
        self.settings.get(name)?.as_str()
    }

    /// In how many steps on end the conditions must hold.
    fn hold(&self, task: &str) -> u64 {
        let number = |name: &str| self.settings.get(name).and_then(Json::as_u64);
        number(&format!("{task}_sustained_steps")).or_else(|| number("sustained_steps")).unwrap_or(1)
    }
}

impl ClearManifest {
    /// Reads its file.
    pub(super) fn read(path: &Path) -> Result<Self, TaskError> {
        let refused = |reason: String| wrong(format!("{}: {reason}", path.display()));
        let text = read_text(path).map_err(|error| refused(error.to_string()))?;
        let no_manifest = |reason: String| refused(format!("is no manifest of CLEAR-LeWM: {reason}"));
        let file: ClearFile =
            serde_json::from_str(&text).map_err(|error| no_manifest(json_error(&text, &error)))?;
        if file.schema_version != SCHEMA {
            let reason = format!("its form is `{}`, and this program reads {SCHEMA}", file.schema_version);
            return Err(no_manifest(reason));
        }
        let tier = match file.protocol.name.as_str() {
            "official" | "official-compat" => Tier::Historic,
            "moderate" => Tier::Moderate,
            "strict" => Tier::Strict,
            other => {
                let reason = format!("its protocol is `{other}`; official, moderate and strict are known");
                return Err(refused(reason));
            }
        };
        if file.pairs.is_empty() {
            return Err(refused("holds no pairs".to_owned()));
        }
        Ok(Self { path: path.to_owned(), file, tier })
    }

    pub(super) fn seed(&self) -> u64 {
        self.file.seed
    }

    pub(super) fn budget(&self) -> u64 {
        self.file.protocol.eval_budget
    }

    fn refused(&self, reason: &str) -> Message {
        Message::about("clear", self.path.display().to_string(), reason)
    }

    /// Its pairs in `dataset`, whose rows must lie where the manifest has them.
    pub(super) fn pairs(&self, dataset: &dyn Dataset) -> Result<Vec<ChosenPair>, TaskError> {
        let mut first = vec![0];
        for episode in 0..dataset.num_episodes() {
            first.push(first[episode] + dataset.episode_len(episode));
        }
        let place = |pair: &ClearPair| -> Result<ChosenPair, TaskError> {
            let ClearPair { episode_id: episode, start_step, goal_step, start_row, goal_row } = *pair;
            let end = first.get(episode + 1).copied();
            let at = |step: usize| Some(first.get(episode)? + step).filter(|row| Some(*row) < end);
            if (at(start_step), at(goal_step)) == (Some(start_row), Some(goal_row)) {
                return Ok(ChosenPair { start: [episode, start_step], goal: [episode, goal_step] });
            }
            let reason = format!(
                "its pair {episode}:{start_step}-{goal_step} is rows {start_row} and {goal_row} of {}, and not of {}, which has {} \
                 episodes and {} rows",
                self.file.dataset.name,
                dataset.path().display(),
                dataset.num_episodes(),
                first.last().unwrap_or(&0),
            );
            Err(self.refused(&reason).fix(Fix::Change("dataset")).into())
        };
        self.file.pairs.iter().map(place).collect()
    }

    /// The test of success in the environment `env`. Starts are as they were recorded, and the pairs have motion enough.
    pub(super) fn rules(
        &self,
        env: &str,
        settings: &Map<String, Json>,
        report: &mut dyn Report,
    ) -> Result<TierRules, TaskError> {
        let ClearFile { task, protocol, .. } = &self.file;
        let here = TASKS.iter().find(|(known, _)| known == task).map(|(_, here)| *here);
        match here {
            None => {
                let known = TASKS.map(|(task, _)| task).join(", ");
                let reason = format!("its task is `{task}`; known are {known}");
                return Err(self.refused(&reason).into());
            }
            Some(here) if here != env => {
                let reason = format!("its task, {task}, is {here} here, not {env}");
                return Err(self.refused(&reason).fix(Fix::set("env", here)).into());
            }
            Some(_) => {}
        }
        let success = match protocol.success_mode.as_str() {
            "upstream" => SuccessRule::default(),
            "task-sustained" => {
                let all = self.conditions(env, settings, report)?;
                SuccessRule { hold: protocol.hold(task), all }
            }
            other => {
                let reason = format!("its success_mode is `{other}`; upstream and task-sustained are known");
                return Err(self.refused(&reason).into());
            }
        };
        self.note_rest(report);
        Ok(TierRules { success, ..TierRules::default() })
    }

    /// Its conditions, on the columns that the tiers of this program read.
    fn conditions(
        &self,
        env: &str,
        settings: &Map<String, Json>,
        report: &mut dyn Report,
    ) -> Result<Vec<Condition>, TaskError> {
        let ClearFile { task, protocol, .. } = &self.file;
        let tier = |tier| tier_rules(env, settings, tier).map(|rules| rules.success.all);
        let (moderate, strict) = (tier(Tier::Moderate)?, tier(Tier::Strict)?);
        let bound = |name: &str| -> Result<f64, TaskError> {
            let lacks = || self.refused(&format!("its protocol has no number `{name}`"));
            Ok(protocol.number(name).ok_or_else(lacks)?)
        };
        let below = |condition: &Condition, below: f64| Condition { below, ..condition.clone() };
        Ok(match task.as_str() {
            "pusht" => {
                // The block alone, or agent and block in one norm.
                let place = if protocol.holds("pusht_block_only") { &strict[0] } else { &moderate[0] };
                vec![
                    below(place, bound("pusht_position_threshold")?),
                    below(&moderate[1], bound("pusht_angle_threshold_deg")?.to_radians()),
                ]
            }
            "cube" => {
                let mut all = vec![below(&moderate[0], bound("cube_position_threshold_m")?)];
                if let Some(degrees) = protocol.number("cube_orientation_threshold_deg") {
                    if !protocol.holds("cube_symmetry_aware") {
                        let reason =
                            "it tells the sides of a cube apart, which no condition of this program does";
                        return Err(self.refused(reason).into());
                    }
                    all.push(below(&strict[1], degrees.to_radians()));
                }
                all
            }
            "reacher" if protocol.text("reacher_success_mode") == Some("endpoint") => {
                let metres = bound("reacher_endpoint_threshold_m")?;
                report.note(&Message::new(format!(
                    "{}: the fingertip within {metres} m is judged by the joints, as in this program's strict tier: within {} rad",
                    self.path.display(),
                    strict[0].below
                )));
                strict
            }
            "reacher" => {
                let below = bound("reacher_joint_threshold_rad")?;
                let joint = |measure, elements: &[usize]| Condition {
                    measure,
                    elements: elements.to_vec(),
                    below,
                    ..moderate[0].clone()
                };
                let wraps = protocol.holds("reacher_wrap_angles");
                match protocol.text("reacher_angle_mode").unwrap_or(if wraps {
                    "all-periodic"
                } else {
                    "raw"
                }) {
                    "raw" => vec![joint(Measure::Largest, &[0, 1])],
                    "all-periodic" => vec![joint(Measure::Angle, &[0, 1])],
                    "shoulder-periodic" => vec![joint(Measure::Angle, &[0]), joint(Measure::Largest, &[1])],
                    other => {
                        let reason = format!(
                            "its reacher_angle_mode is `{other}`; raw, all-periodic and shoulder-periodic are known"
                        );
                        return Err(self.refused(&reason).into());
                    }
                }
            }
            _ => vec![below(&moderate[0], bound("tworoom_distance_threshold")?)],
        })
    }

    /// Notes what no condition says: rules about routes, walls, and settings that later releases have.
    fn note_rest(&self, report: &mut dyn Report) {
        let ClearFile { task, protocol, .. } = &self.file;
        let is_set = |value: &Json| !(value.is_null() || value == false);
        let is_of_others = |name: &str| {
            TASKS.iter().any(|(other, _)| other != task && name.starts_with(&format!("{other}_")))
        };
        let known = |name: &str| {
            OF_THE_CHOICE.contains(&name)
                || name == "sustained_steps"
                || [
                    "sustained_steps",
                    "position_threshold",
                    "angle_threshold_deg",
                    "block_only",
                    "position_threshold_m",
                    "orientation_threshold_deg",
                    "symmetry_aware",
                    "joint_threshold_rad",
                    "wrap_angles",
                    "angle_mode",
                    "success_mode",
                    "endpoint_threshold_m",
                    "distance_threshold",
                ]
                .iter()
                .any(|setting| name == format!("{task}_{setting}"))
        };
        let rest: Vec<String> = protocol
            .settings
            .iter()
            .filter(|(name, value)| is_set(value) && !known(name) && !is_of_others(name))
            .map(|(name, value)| format!("{name}={}", super::value_text(value)))
            .collect();
        if !rest.is_empty() {
            report.note(&Message::new(format!(
                "{}: not judged here, but left to the physics of the environment: {}",
                self.path.display(),
                rest.join(", ")
            )));
        }
    }
}

#[cfg(test)]
mod tests;

//! What the tiers ask for, task by task: the test of success, the least motion, and what is at rest at the start. A task
//! that is not in the table has a historic tier, and a moderate one with the environment's own test.
//!
//! Sources: the reference's tests; the moderate and strict rules are those of CLEAR-LeWM 0.9 (least motion: its first
//! tracks), where the columns of this program can say them; TwoRoom-v1, whose image is 512 pixels wide, and the tests marked
//! *ours* are not among them.

use std::ops::Range;

use serde_json::{Map, Value as Json};
use swm_core::evaluate::{Condition, Measure, SuccessRule, Symmetry, Tier};

use super::probes::ProbeTarget;
use crate::error::{TaskError, wrong};

/// What a tier asks for in one environment.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct TierRules {
    /// When an episode is a success.
    pub success: SuccessRule,
    /// A condition that must not hold at the start.
    pub motion: Option<Condition>,
    /// Elements of start columns that are set to zero.
    pub rest: Vec<(String, Range<usize>)>,
}

/// The rules of `tier` for an environment.
///
/// # Errors
///
/// [`TaskError::Request`], which names the environments that have the tier.
pub fn tier_rules(env: &str, settings: &Map<String, Json>, tier: Tier) -> Result<TierRules, TaskError> {
    if tier == Tier::Historic {
        return Ok(TierRules::default());
    }
    let fits = |task: &&Task| {
        task.envs.contains(&env)
            && task.setting.as_ref().is_none_or(|Chosen { name, value, is_default }| {
                match settings.get(*name) {
                    Some(given) => given.as_str() == Some(value),
                    None => *is_default,
                }
            })
    };
    let Some(task) = TASKS.iter().find(fits) else {
        let known: Vec<String> = TASKS.iter().flat_map(Task::names).collect();
        return match tier {
            Tier::Strict => Err(wrong(format!(
                "`{env}` has no strict tier; those with one are {}. Use another tier, or write the test into a manifest",
                known.join(", ")
            ))),
            _ => Ok(TierRules::default()),
        };
    };
    let rule = if tier == Tier::Strict { &task.strict } else { &task.moderate };
    Ok(TierRules {
        success: SuccessRule {
            hold: rule.hold,
            all: rule.all.iter().map(|test| test.condition(task)).collect(),
        },
        motion: Some(rule.motion.condition(task)),
        rest: task.rest.iter().map(|(name, elements)| ((*name).to_owned(), elements.clone())).collect(),
    })
}

/// Every environment that has rules of its own, with the settings under which it has them.
pub fn ruled_envs() -> impl Iterator<Item = (&'static str, Map<String, Json>)> {
    TASKS.iter().flat_map(|task| {
        let settings: Map<String, Json> =
            task.setting.iter().map(|chosen| (chosen.name.to_owned(), chosen.value.into())).collect();
        task.envs.iter().map(move |env| (*env, settings.clone()))
    })
}

/// The parts of the true state that the moderate tier's test of success reads in an environment; none where that is the
/// environment's own.
pub fn task_probes(env: &str, settings: &Map<String, Json>) -> Vec<ProbeTarget> {
    let rules = tier_rules(env, settings, Tier::Moderate).unwrap_or_default();
    let target = |Condition { column, elements, measure, .. }| ProbeTarget {
        column,
        elements,
        is_angle: measure == Measure::Angle,
    };
    rules.success.all.into_iter().map(target).collect()
}

struct Task {
    envs: &'static [&'static str],
    /// A setting that the environment must have.
    setting: Option<Chosen>,
    /// The column that tests read, and that of the goal.
    columns: [&'static str; 2],
    rest: &'static [(&'static str, Range<usize>)],
    moderate: Rule,
    strict: Rule,
}

/// A setting with the value that a task is about.
struct Chosen {
    name: &'static str,
    value: &'static str,
    is_default: bool,
}

struct Rule {
    hold: u64,
    all: &'static [Test],
    motion: Test,
}

struct Test {
    /// Other columns than the task's.
    columns: Option<[&'static str; 2]>,
    elements: &'static [usize],
    measure: Measure,
    symmetry: Option<Divided>,
    below: f64,
}

/// The column of a factor, and into how many parts its values divide a turn.
type Divided = (&'static str, &'static [[u32; 2]]);

impl Test {
    fn condition(&self, task: &Task) -> Condition {
        let [column, goal] = self.columns.unwrap_or(task.columns).map(str::to_owned);
        let Self { elements, measure, symmetry, below, .. } = *self;
        let symmetry =
            symmetry.map(|(column, folds)| Symmetry { column: column.to_owned(), folds: folds.to_vec() });
        Condition { column, goal, elements: elements.to_vec(), measure, turn: None, symmetry, below }
    }
}

impl Task {
    fn names(&self) -> impl Iterator<Item = String> {
        let setting = self.setting.as_ref().filter(|setting| !setting.is_default);
        let setting =
            setting.map(|Chosen { name, value, .. }| format!(" with {name}={value}")).unwrap_or_default();
        self.envs.iter().map(move |env| format!("`{env}`{setting}"))
    }
}

const fn distance(elements: &'static [usize], below: f64) -> Test {
    Test { columns: None, elements, measure: Measure::Distance, symmetry: None, below }
}

const fn angle(elements: &'static [usize], below: f64) -> Test {
    Test { columns: None, elements, measure: Measure::Angle, symmetry: None, below }
}

/// The angle of PushT's block: a Z and an I look the same after half a turn, a square and a plus after a quarter.
const fn block_angle(below: f64) -> Test {
    const SHAPES: Divided = ("variation.block.shape", &[[3, 2], [4, 4], [5, 2], [7, 4]]);
    Test { symmetry: Some(SHAPES), ..angle(&[4], below) }
}

const fn largest(elements: &'static [usize], below: f64) -> Test {
    Test { columns: None, elements, measure: Measure::Largest, symmetry: None, below }
}

/// The orientation of the first cube against that of its marker.
const fn cube_rotation(below: f64) -> Test {
    const COLUMNS: [&str; 2] = ["privileged.block_0_quat", "mocap_quat"];
    Test {
        columns: Some(COLUMNS),
        symmetry: None,
        elements: &[0, 1, 2, 3],
        measure: Measure::CubeRotation,
        below,
    }
}

const fn degrees(degrees: f64) -> f64 {
    degrees * std::f64::consts::PI / 180.0
}

const TASKS: &[Task] = &[
    // Agent x, y; block x, y; block angle; agent velocity.
    Task {
        envs: &["swm/PushT-v1", "swm/PushT-Discrete-v1", "swm/PushTRapier-v0"],
        setting: None,
        columns: ["state", "goal_state"],
        rest: &[("state", 5..7)],
        moderate: Rule {
            hold: 1,
            all: &[distance(&[0, 1, 2, 3], 20.0), block_angle(degrees(20.0))],
            motion: distance(&[2, 3], 25.0),
        },
        strict: Rule {
            hold: 3,
            all: &[distance(&[2, 3], 10.0), block_angle(degrees(10.0))],
            motion: distance(&[2, 3], 50.0),
        },
    },
    Task {
        envs: &["swm/TwoRoom-v2"],
        setting: None,
        columns: ["state", "goal_state"],
        rest: &[],
        moderate: Rule { hold: 1, all: &[distance(&[], 16.0)], motion: distance(&[], 32.0) },
        // Motion: ours.
        strict: Rule { hold: 1, all: &[distance(&[], 8.0)], motion: distance(&[], 64.0) },
    },
    // Ours: the discs overlap by half at about 12 px.
    Task {
        envs: &["swm/TwoRoom-v1"],
        setting: None,
        columns: ["pos_agent", "goal_pos_agent"],
        rest: &[],
        moderate: Rule { hold: 1, all: &[distance(&[], 12.0)], motion: distance(&[], 73.0) },
        strict: Rule { hold: 1, all: &[distance(&[], 6.0)], motion: distance(&[], 146.0) },
    },
    // The shoulder turns freely, the wrist has limits.
    Task {
        envs: &["swm/ReacherDMControl-v0"],
        setting: Some(Chosen { name: "task", value: "qpos_match", is_default: false }),
        columns: ["qpos", "target_qpos"],
        rest: &[("qvel", 0..2)],
        moderate: Rule {
            hold: 1,
            all: &[angle(&[0], 0.05), largest(&[1], 0.05)],
            motion: angle(&[0, 1], 0.1),
        },
        // Ours, for CLEAR-LeWM's 0.01 m of the fingertip: arms of 0.12 m keep within 0.36 m × 0.025 rad.
        strict: Rule {
            hold: 2,
            all: &[angle(&[0], 0.025), largest(&[1], 0.025)],
            motion: angle(&[0, 1], 0.25),
        },
    },
    // One cube, and the marker that stands where it was in the goal's row.
    Task {
        envs: &["swm/OGBCube-v0"],
        setting: Some(Chosen { name: "env_type", value: "single", is_default: true }),
        columns: ["privileged.block_0_pos", "mocap_pos"],
        rest: &[("qvel", 0..20)],
        // Motion: ours, what the test of success asks for.
        moderate: Rule { hold: 1, all: &[distance(&[0, 1, 2], 0.04)], motion: distance(&[0, 1, 2], 0.04) },
        strict: Rule {
            hold: 3,
            all: &[distance(&[0, 1, 2], 0.03), cube_rotation(degrees(15.0))],
            motion: distance(&[0, 1, 2], 0.08),
        },
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_that_decide_are_probed() {
        let probes = |env: &str| -> Vec<String> {
            task_probes(env, &Map::new()).iter().map(ToString::to_string).collect()
        };
        assert_eq!(probes("swm/PushT-v1"), ["state[0,1,2,3]", "angle(state[4])"]);
        assert_eq!(probes("swm/TwoRoom-v2"), ["state"]);
        assert!(probes("swm/CheetahDMControl-v0").is_empty());
    }

    #[test]
    fn other_tasks_have_no_strict_tier() {
        let none = Map::new();
        assert!(
            tier_rules("swm/CheetahDMControl-v0", &none, Tier::Strict)
                .unwrap_err()
                .to_string()
                .contains("PushT-v1")
        );
        let rules = tier_rules("swm/CheetahDMControl-v0", &none, Tier::Moderate).unwrap();
        assert!(rules.success.is_environment());
        let cubes = |count: &str| Map::from_iter([("env_type".to_owned(), count.into())]);
        assert!(tier_rules("swm/OGBCube-v0", &none, Tier::Strict).unwrap().motion.is_some());
        assert!(tier_rules("swm/OGBCube-v0", &cubes("double"), Tier::Strict).is_err());
        // Reacher's other tasks are not about angles.
        assert!(tier_rules("swm/ReacherDMControl-v0", &none, Tier::Strict).is_err());
    }
}

//! The experts: scripts that read the row and nothing else, but for Slide, whose strike is planned (see `strike`).

use swm_core::policy::write_action;
use swm_core::{
    Actor, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Setting, Settings as _,
    SliceMut, SlotView,
};

use super::strike::{Strike, plan};
use super::task::Task;
use super::variant;
use crate::suite::normal;

/// The policies of the scripted tasks.
pub(super) const POLICIES: &[PolicyEntry] = &[
    PolicyEntry::new("expert", "brings gripper or block to the goal by a script", |context, args| {
        args.parse_as::<swm_core::registry::NoArgs>()?;
        make(context, args, 0.0)
    }),
    NOISY,
];

/// The policies of Slide.
pub(super) const SLIDE_POLICIES: &[PolicyEntry] = &[
    PolicyEntry::new(
        "expert",
        "plans one strike on the true dynamics, by cross-entropy over its direction, speed and length",
        |context, args| {
            args.parse_as::<swm_core::registry::NoArgs>()?;
            make(context, args, 0.0)
        },
    ),
    NOISY,
];

const NOISY: PolicyEntry = PolicyEntry::new(
    "noisy-expert",
    "the expert with normal noise on its actions (`noisy-expert:STD`)",
    |context, args| {
        let Noise { std } = args.parse_with("std")?;
        args.check_not_negative("std", std)?;
        make(context, args, std)
    },
)
.settings(SETTINGS);

swm_core::settings! {
    /// Arguments of the noisy expert. Unknown names are refused.
    struct Noise {
        /// Standard deviation of the noise on each value of an action.
        std: f64 = 0.2,
    }
}

const SETTINGS: &[Setting] = Noise::SETTINGS;

fn make(context: &PolicyContext<'_>, args: &PolicyArgs, std: f64) -> Result<Box<dyn Policy>, PolicyError> {
    let task = variant(context.env.id).task;
    let description = if std > 0.0 { format!("{}:std={std}", args.name) } else { args.name.clone() };
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let script = match task {
            Task::Reach => Script::Reach,
            Task::Push => Script::Push,
            Task::Slide => Script::Slide(plan(view)?),
            Task::PickAndPlace => Script::PickAndPlace(Grasp::default()),
        };
        Ok(Box::new(Expert { script, std }) as Box<dyn Actor>)
    })))
}

/// The expert in one episode.
struct Expert {
    script: Script,
    std: f64,
}

enum Script {
    Reach,
    Push,
    Slide(Strike),
    PickAndPlace(Grasp),
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let (sight, goal) = (view.row.get::<f64>("proprio")?, view.row.get::<f64>("desired_goal")?);
        let sight = Sight::new(sight, goal);
        let chosen = match &mut self.script {
            Script::Reach => steer(sight.goal, sight.grip, 10.0, 0.0),
            Script::Push => push(&sight),
            Script::Slide(strike) => strike.act(&sight),
            Script::PickAndPlace(grasp) => grasp.act(&sight),
        };
        let mut stream = view.episode.seed.indexed("policy fetch noise", [view.episode.step, 0]);
        let noise: [f64; 4] = match self.std {
            0.0 => [0.0; 4],
            std => std::array::from_fn(|_| std * normal(&mut stream)),
        };
        let limited = |k: usize| (chosen[k] + noise[k]).clamp(-1.0, 1.0) as f32;
        write_action(&mut action, &[limited(0), limited(1), limited(2), limited(3)]);
        Ok(())
    }
}

/// What a script knows: places in m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    pub(super) grip: [f64; 3],
    pub(super) object: [f64; 3],
    pub(super) goal: [f64; 3],
}

impl Sight {
    /// From an observation and the goal.
    pub(super) fn new(observation: &[f64], goal: &[f64]) -> Self {
        let triple = |values: &[f64]| [values[0], values[1], values[2]];
        Self { grip: triple(observation), object: triple(&observation[3..]), goal: triple(goal) }
    }

    /// Where the gripper is, seen from the object.
    fn relative(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.grip[k] - self.object[k])
    }
}

/// The action towards a place; at a gain of 20 the whole way, as far as one action goes.
pub(super) fn steer(to: [f64; 3], from: [f64; 3], gain: f64, fingers: f64) -> [f64; 4] {
    [gain * (to[0] - from[0]), gain * (to[1] - from[1]), gain * (to[2] - from[2]), fingers]
}

/// The direction from one place to another on the table, and the distance.
pub(super) fn heading(from: [f64; 3], to: [f64; 3]) -> ([f64; 2], f64) {
    let (x, y) = (to[0] - from[0], to[1] - from[1]);
    let distance = x.hypot(y);
    let length = distance.max(1e-6);
    ([x / length, y / length], distance)
}

/// Goes behind the block, over it where it is in the way, and pushes it straight to the goal.
fn push(sight: &Sight) -> [f64; 4] {
    /// How near the block is left alone, m.
    const NEAR: f64 = 0.015;
    /// The gripper below the middle of the block, m.
    const DEPTH: f64 = 0.009;
    let ([x, y], left) = heading(sight.object, sight.goal);
    if left < NEAR {
        return [0.0; 4];
    }
    let low = sight.goal[2] - DEPTH;
    let relative = sight.relative();
    let along = relative[0] * x + relative[1] * y;
    let side = [relative[0] - along * x, relative[1] - along * y];
    let aside = side[0].hypot(side[1]);
    if along < -0.02 && aside < 0.02 && relative[2] < 0.03 {
        let speed = (10.0 * left).min(1.0);
        let lift = 10.0 * (low - sight.grip[2]);
        return [x * speed - 12.0 * side[0], y * speed - 12.0 * side[1], lift, 0.0];
    }
    let behind = [sight.object[0] - 0.08 * x, sight.object[1] - 0.08 * y, low];
    let is_clear = along < -0.045 && aside < 0.06;
    let target = if is_clear { behind } else { over(sight, behind, [0.03, 0.09]) };
    steer(target, sight.grip, 15.0, 0.0)
}

/// The way to a place beside the object: up first, then there, then down. `near` is how near on the table one goes down, and
/// `rise` how high one goes.
pub(super) fn over(sight: &Sight, to: [f64; 3], [near, rise]: [f64; 2]) -> [f64; 3] {
    let mut target = to;
    if heading(sight.grip, to).1 > near {
        target[2] = to[2] + rise;
        if heading(sight.grip, sight.object).1 < 0.08 && sight.grip[2] < to[2] + 0.6 * rise {
            [target[0], target[1]] = [sight.grip[0], sight.grip[1]];
        }
    }
    target
}

/// Grasps the block and carries it.
#[derive(Default)]
struct Grasp {
    /// Control steps that the fingers have closed for.
    closing: u32,
}

impl Grasp {
    /// So many control steps close the fingers.
    const CLOSED: u32 = 3;
    /// A block that is farther from the gripper was lost, m.
    const LOST: f64 = 0.04;

    fn act(&mut self, sight: &Sight) -> [f64; 4] {
        let relative = sight.relative();
        let aside = relative[0].hypot(relative[1]);
        if self.closing >= Self::CLOSED {
            if aside.hypot(relative[2]) <= Self::LOST {
                return steer(sight.goal, sight.object, 10.0, -1.0);
            }
            self.closing = 0;
        }
        let above = |rise: f64| [sight.object[0], sight.object[1], sight.object[2] + rise];
        if aside > 0.015 {
            self.closing = 0;
            return steer(above(if aside < 0.03 { 0.03 } else { 0.07 }), sight.grip, 16.0, 1.0);
        }
        if relative[2].abs() > 0.012 {
            self.closing = 0;
            return steer(above(0.0), sight.grip, 16.0, 1.0);
        }
        self.closing += 1;
        [0.0, 0.0, 0.0, -1.0]
    }
}

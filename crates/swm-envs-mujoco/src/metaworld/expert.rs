//! The experts: the rules of the package, which read the row and nothing else, with better ones for the door and the peg.

use swm_core::policy::write_action;
use swm_core::{
    Actor, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Setting, Settings as _,
    SliceMut, SlotView,
};

use super::robot::{minus, norm};
use super::task::{Grip, Rule, Script, To, When};
use crate::suite::normal;

/// The policies of all tasks.
pub(super) const POLICIES: &[PolicyEntry] = &[
    PolicyEntry::new("expert", "solves the task by rules on the present row", |context, args| {
        args.parse_as::<swm_core::registry::NoArgs>()?;
        Ok(make(context, args, 0.0))
    }),
    PolicyEntry::new(
        "noisy-expert",
        "the expert with normal noise on its actions (`noisy-expert:STD`)",
        |context, args| {
            let Noise { std } = args.parse_with("std")?;
            args.check_not_negative("std", std)?;
            Ok(make(context, args, std))
        },
    )
    .settings(SETTINGS),
];

swm_core::settings! {
    /// Arguments of the noisy expert. Unknown names are refused.
    struct Noise {
        /// Standard deviation of the noise on each value of an action.
        std: f64 = 0.1,
    }
}

const SETTINGS: &[Setting] = Noise::SETTINGS;

fn make(context: &PolicyContext<'_>, args: &PolicyArgs, std: f64) -> Box<dyn Policy> {
    let script = super::task(context.env.id).script;
    let description = if std > 0.0 { format!("{}:std={std}", args.name) } else { args.name.clone() };
    Box::new(PerEpisode::new(description, move |_: &SlotView<'_>| {
        Ok(Box::new(Expert { script, std }) as Box<dyn Actor>)
    }))
}

struct Expert {
    script: Script,
    std: f64,
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let (seen, goal) = (view.row.get::<f64>("observation")?, view.row.get::<f64>("desired_goal")?);
        let triple = |values: &[f64]| [values[0], values[1], values[2]];
        let sight =
            Sight { hand: triple(seen), gripper: seen[3], object: triple(&seen[4..]), goal: triple(goal) };
        let chosen = match self.script {
            Script::Rules { offset, rules, grip } => sight.follow(offset, rules, grip),
            Script::Peg => sight.insert(),
        };
        let mut stream = view.episode.seed.indexed("policy metaworld noise", [view.episode.step, 0]);
        let noise: [f64; 4] = match self.std {
            0.0 => [0.0; 4],
            std => std::array::from_fn(|_| std * normal(&mut stream)),
        };
        let limited: [f32; 4] = std::array::from_fn(|k| (chosen[k] + noise[k]).clamp(-1.0, 1.0) as f32);
        write_action(&mut action, &limited);
        Ok(())
    }
}

/// What a script reads: places in m.
struct Sight {
    hand: [f64; 3],
    gripper: f64,
    object: [f64; 3],
    goal: [f64; 3],
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + b[k])
}

impl Sight {
    /// Distances of the hand from a place: along x and y, along z, and whole.
    fn away(&self, place: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = minus(self.hand, place);
        [norm([x, y]), z.abs(), norm([x, y, z])]
    }

    fn towards(&self, place: [f64; 3], gain: f64, grip: f64) -> [f64; 4] {
        let [x, y, z] = minus(place, self.hand).map(|off| gain * off);
        [x, y, z, grip]
    }

    fn follow(&self, offset: [f64; 3], rules: &[Rule], grip: Grip) -> [f64; 4] {
        let (object, hand) = (plus(self.object, offset), self.hand);
        let [flat, high, whole] = self.away(object);
        let holds = |Rule(when, ..): &&Rule| match *when {
            When::Far(most) => flat > most,
            When::High(most) => high > most,
            When::HighOver(most, below) => high > most && object[2] < below,
            When::BehindBelow(rise) => hand[1] > object[1] && hand[2] < object[2] + rise,
            When::Behind => hand[1] > object[1],
            When::Open(wide) => self.gripper > wide,
            When::Always => true,
        };
        let effort = match grip {
            Grip::Constant(effort) => effort,
            Grip::Beside(far, above) => {
                if flat > far || high > above {
                    0.0
                } else {
                    0.6
                }
            }
            Grip::Within(near) => f64::from(u8::from(whole < near)),
        };
        let Some(Rule(_, to, gain)) = rules.iter().find(holds) else { return [0.0; 4] };
        let place = match *to {
            To::Object(by) => plus(object, by),
            To::Goal => self.goal,
            To::Stay => hand,
            To::Rise(by) => [hand[0], hand[1], object[2] + by],
        };
        self.towards(place, *gain, effort)
    }

    /// Grasps the peg, aligns it before the hole and pushes it in.
    fn insert(&self) -> [f64; 4] {
        const GAIN: f64 = 10.0;
        /// x and z of the peg in the hole, m; y is the goal's.
        const HOLE: [f64; 2] = [-0.35, 0.14];
        /// How near the peg is to the line through the hole, m, and how far from the hole it is aligned.
        const ALIGNED: f64 = 0.02;
        const BEFORE: f64 = 0.2;
        let Self { hand, gripper, object: peg, goal } = *self;
        let [flat, high, _] = self.away(peg);
        if flat > 0.04 {
            return self.towards(plus(peg, [0.0, 0.0, 0.3]), GAIN, -1.0);
        }
        if high > 0.05 {
            return self.towards(peg, GAIN, if high > 0.1 { -1.0 } else { 1.0 });
        }
        if gripper > 0.5 {
            return self.towards(peg, GAIN, 1.0);
        }
        let is_off = (peg[1] - goal[1]).abs() > ALIGNED || (peg[2] - HOLE[1]).abs() > ALIGNED;
        let x = if is_off { peg[0].max(goal[0] + BEFORE) } else { HOLE[0] };
        self.towards(plus(hand, minus([x, goal[1], HOLE[1]], peg)), GAIN, 1.0)
    }
}

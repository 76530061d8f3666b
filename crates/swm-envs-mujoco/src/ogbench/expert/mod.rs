//! The experts: OGBench's scripted oracles as policies. `expert` follows a plan of poses and times, with noise on the
//! plan; `markov-expert` decides by the present row alone, with noise on its actions. Both read the row and nothing else.

mod markov;
mod plan;
mod sight;

use rand::RngExt as _;
use swm_core::policy::write_action;
use swm_core::seed::Stream;
use swm_core::{
    Actor, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Setting, Settings as _,
    SliceMut, SlotView,
};

use self::markov::Markov;
use self::plan::Plan;
use self::sight::Sight;
use super::SCENE_ID;
use super::layout::Kind;
use crate::suite::{normal, uniform};

/// The policies of both environments.
pub(super) const POLICIES: &[PolicyEntry] = &[
    PolicyEntry::new(
        "expert",
        "follows plans of poses to one target after the other, with noise on the plan",
        |context, args| make(context, args, Method::Plan),
    )
    .settings(SETTINGS),
    PolicyEntry::new(
        "markov-expert",
        "decides by the present observation alone, with noise on its actions",
        |context, args| make(context, args, Method::Markov),
    )
    .settings(SETTINGS),
];

swm_core::settings! {
    /// Arguments of the policies. Unknown names are refused.
    #[derive(Copy)]
    struct Arguments {
        /// Amplitude of the noise of the plan or the actions; 0: none.
        noise: f64 = 0.1,
        /// Probability of a random action at a step.
        p_random_action: f64 = 0.0,
        /// Steps over which the noise of a plan is smoothed.
        noise_smoothing: f64 = 0.5,
        /// Shortest motion command of `markov-expert`, in m.
        min_norm: f64 = 0.4,
    }
}

const SETTINGS: &[Setting] = Arguments::SETTINGS;

/// How it decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Method {
    Plan,
    Markov,
}

fn make(
    context: &PolicyContext<'_>,
    args: &PolicyArgs,
    method: Method,
) -> Result<Box<dyn Policy>, PolicyError> {
    let arguments: Arguments = args.parse_with("noise")?;
    for (name, value) in [
        ("noise", arguments.noise),
        ("noise_smoothing", arguments.noise_smoothing),
        ("min_norm", arguments.min_norm),
    ] {
        args.check_not_negative(name, value)?;
    }
    if !(0.0..=1.0).contains(&arguments.p_random_action) {
        return Err(args.wrong(format!("p_random_action {} must be 0 to 1", arguments.p_random_action)));
    }
    let kind = if context.env.id == SCENE_ID { Kind::Scene } else { Kind::Cubes(1) };
    let description = format!("{}:noise={}", args.name, arguments.noise);
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let mut stream = view.episode.seed.stream("policy expert");
        let std = uniform(&mut stream, 0.0, arguments.noise);
        let expert = Expert { arguments, method, kind, std, attempt: 0, pursuit: None };
        Ok(Box::new(expert) as Box<dyn Actor>)
    })))
}

/// The expert in one episode.
struct Expert {
    arguments: Arguments,
    method: Method,
    kind: Kind,
    /// Standard deviation of the noise on actions in this episode.
    std: f64,
    /// Targets pursued so far, again and again counted.
    attempt: u64,
    pursuit: Option<Pursuit>,
}

/// The way to one target.
struct Pursuit {
    /// Which target: its number and its kind.
    of: [i64; 2],
    way: Way,
}

enum Way {
    Plan(Plan),
    Markov(Markov),
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let sight = Sight::of(view)?;
        if self
            .pursuit
            .as_ref()
            .is_none_or(|pursuit| pursuit.of != sight.target_key() || pursuit.is_done(&sight))
        {
            self.attempt += 1;
            let mut stream = view.episode.seed.indexed("policy expert target", [self.attempt, 0]);
            self.pursuit = Some(self.begin(&sight, &mut stream));
        }
        let mut stream = view.episode.seed.indexed("policy expert step", [view.episode.step, 0]);
        let chosen = if self.arguments.p_random_action > 0.0
            && uniform(&mut stream, 0.0, 1.0) < self.arguments.p_random_action
        {
            std::array::from_fn(|_| stream.random_range(-1.0..=1.0))
        } else {
            self.choose(&sight, &mut stream)
        };
        write_action(&mut action, &chosen.map(|value: f64| value.clamp(-1.0, 1.0) as f32));
        Ok(())
    }
}

impl Expert {
    fn begin(&self, sight: &Sight, stream: &mut Stream) -> Pursuit {
        let Arguments { noise, noise_smoothing, min_norm, .. } = self.arguments;
        let bounds = self.kind.bounds().arm;
        let way = match self.method {
            Method::Plan => Way::Plan(Plan::new(sight, bounds, [noise, noise_smoothing], stream)),
            Method::Markov => Way::Markov(Markov::new(sight, bounds, min_norm, stream)),
        };
        Pursuit { of: sight.target_key(), way }
    }

    fn choose(&mut self, sight: &Sight, stream: &mut Stream) -> [f64; 5] {
        match self.pursuit.as_mut().map(|pursuit| &mut pursuit.way) {
            Some(Way::Plan(plan)) => plan.action(sight),
            Some(Way::Markov(markov)) => {
                let mut action = markov.action(sight);
                for (value, share) in action.iter_mut().zip([1.0, 1.0, 1.0, 3.0, 10.0]) {
                    *value += self.std * share * normal(stream);
                }
                action
            }
            None => [0.0; 5],
        }
    }
}

impl Pursuit {
    fn is_done(&self, sight: &Sight) -> bool {
        match &self.way {
            Way::Plan(plan) => plan.is_done(sight),
            Way::Markov(markov) => markov.is_done(),
        }
    }
}

//! The expert of TwoRoom: walks the shortest way to the target, with noise if asked. It knows the rooms; the factors are
//! read from the environment once per episode.

use rand_distr::{Distribution as _, StandardUniform};
use swm_core::policy::{add_noise, write_action};
use swm_core::settings::Table;
use swm_core::{
    Actor, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Settings as _, SliceMut,
    SlotView,
};
use swm_fov::FactorEnv;

use super::env::TwoRoom;
use super::room::{Room, distance};
use super::route;

/// `expert`.
pub(super) const EXPERT: PolicyEntry =
    PolicyEntry::new("expert", "walks the shortest way to the target", |context, args| {
        make(context, args, args.parse_as::<Arguments>()?)
    })
    .settings(Arguments::SETTINGS);

/// `noisy-expert`.
pub(super) const NOISY_EXPERT: PolicyEntry = PolicyEntry::new(
    "noisy-expert",
    "the expert with normal noise on its actions (`noisy-expert:NOISE`; the reference collects with 2)",
    |context, args| {
        let mut noisy = args.clone();
        if noisy.positional.is_empty() {
            noisy.named.entry("noise").or_insert(REFERENCE_NOISE.into());
        }
        make(context, args, noisy.parse_with::<Arguments>("noise")?)
    },
)
.settings(NOISY_SETTINGS.as_slice());

/// The noise of the published datasets.
const REFERENCE_NOISE: f64 = 2.0;

const NOISY_SETTINGS: &Table = &Table::of(&[Arguments::SETTINGS]).with_default("noise", "2");

swm_core::settings! {
    /// Arguments of the policy. Unknown names are refused.
    #[derive(Copy)]
    struct Arguments {
        /// Standard deviation of the noise on each component of the action, which is then clipped to -1..1.
        noise: f64 = 0.0,
        /// Probability that the previous action is repeated.
        action_repeat_prob: f64 = 0.0,
    }
}

fn make(
    context: &PolicyContext<'_>,
    args: &PolicyArgs,
    arguments: Arguments,
) -> Result<Box<dyn Policy>, PolicyError> {
    let Arguments { noise, action_repeat_prob } = arguments;
    args.check_not_negative("noise", noise)?;
    if !(0.0..=1.0).contains(&action_repeat_prob) {
        return Err(args.wrong(format!("action_repeat_prob {action_repeat_prob} must be 0 to 1")));
    }
    let space = FactorEnv::<TwoRoom>::factors(context.config)?;
    let frame_skip = f64::from(context.frame_skip);
    let description = describe(&args.name, arguments);
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let (fov, _) = FactorEnv::<TwoRoom>::episode(&space, view)?;
        let room = Room::new(&fov);
        let reach_px = f64::from(room.speed) * frame_skip;
        Ok(Box::new(Expert { room, reach_px, arguments, last: None }) as Box<dyn Actor>)
    })))
}

/// The policy's name with the arguments that are not 0.
fn describe(name: &str, Arguments { noise, action_repeat_prob }: Arguments) -> String {
    let named = [("noise", noise), ("action_repeat_prob", action_repeat_prob)];
    let given = named.iter().filter(|(_, value)| *value > 0.0);
    let given: Vec<String> = given.map(|(key, value)| format!("{key}={value}")).collect();
    if given.is_empty() { name.to_owned() } else { format!("{name}:{}", given.join(",")) }
}

/// The expert in one episode.
struct Expert {
    room: Room,
    /// How far one action of length 1 leads.
    reach_px: f64,
    arguments: Arguments,
    last: Option<[f32; 2]>,
}

impl Expert {
    /// The way's direction, of length 1, or shorter where the next corner is nearer than that leads.
    fn heading(&self, agent: [f64; 2], target: [f64; 2]) -> [f64; 2] {
        let next = route::way(&self.room, agent, target).next;
        let reach = self.reach_px.max(distance(agent, next));
        if reach == 0.0 { [0.0; 2] } else { [0, 1].map(|axis| (next[axis] - agent[axis]) / reach) }
    }
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let Arguments { noise, action_repeat_prob } = self.arguments;
        let position = |field: &str| -> Result<[f64; 2], PolicyError> {
            let values: &[f32] = view.row.get(field)?;
            Ok([0, 1].map(|axis| f64::from(values[axis])))
        };
        let heading = self.heading(position("state")?, position("goal_state")?);
        let mut chosen = heading.map(|component| component as f32);
        if noise > 0.0 {
            let mut noisy = heading;
            add_noise(view, "policy expert noise", noise, &mut noisy);
            chosen = noisy.map(|component| component.clamp(-1.0, 1.0) as f32);
        }
        if let Some(last) = self.last.filter(|_| action_repeat_prob > 0.0) {
            let mut stream = view.episode.seed.indexed("policy expert repeat", [view.episode.step, 0]);
            let sampled: f64 = StandardUniform.sample(&mut stream);
            if sampled < action_repeat_prob {
                chosen = last;
            }
        }
        self.last = Some(chosen);
        write_action(&mut action, &chosen);
        Ok(())
    }
}

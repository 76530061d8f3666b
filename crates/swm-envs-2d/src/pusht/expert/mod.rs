//! The expert of PushT: a search over push primitives on the true simulator.
//!
//! Instead of single actions it chooses whole pushes (where on the block's outline, in which direction, how strongly),
//! tries each on a copy of the simulator, and carries the best one out; the copy is exact, so what succeeds in a trial
//! succeeds in the environment. It knows the true state, and is therefore a source of demonstrations and an upper
//! bound for planners, not a competitor of policies that see images.
//!
//! | file | duty |
//! |---|---|
//! | `search` | one decision |
//! | `primitive`, `rollout` | what is tried, and how it is carried out |
//! | `scene` | what an episode is like |
//! | `outline`, `obstacle`, `route` | where to push, where not to stand, how to get there |
//! | `steering` | from places to actions |

mod obstacle;
mod outline;
mod primitive;
mod rollout;
mod route;
mod scene;
mod search;
mod settings;
mod steering;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use swm_core::{
    Actor, EnvState, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Settings as _,
    SliceMut, SlotView,
};
use swm_fov::FovSpace;

use self::primitive::normal;
use self::scene::Scene;
use self::settings::ExpertSettings;
use self::steering::{ActionKind, Command};
use super::engine::Engine;
use super::env::LoadedState;
use super::factors::factors;
use super::goal::observed_state;
use super::settings::Settings;

/// `expert`.
pub(super) const fn expert<E: Engine>() -> PolicyEntry {
    PolicyEntry::new("expert", "searches over pushes on the true simulator", |context, args| {
        make::<E>(context, args, ExpertSettings::parse(args)?)
    })
    .settings(settings::SETTINGS)
}

/// `noisy-expert`.
pub(super) const fn noisy_expert<E: Engine>() -> PolicyEntry {
    PolicyEntry::new(
        "noisy-expert",
        "the expert with normal noise on its actions (`noisy-expert:STD`), which plans anew every few steps",
        |context, args| make::<E>(context, args, ExpertSettings::parse_noisy(args)?),
    )
    .settings(settings::NOISY_SETTINGS)
}

/// What all episodes share.
struct Expert {
    env: &'static str,
    factors: FovSpace,
    env_settings: Settings,
    kind: ActionKind,
    frame_skip: u32,
    settings: ExpertSettings,
}

fn make<E: Engine>(
    context: &PolicyContext<'_>,
    args: &PolicyArgs,
    settings: ExpertSettings,
) -> Result<Box<dyn Policy>, PolicyError> {
    let env = context.env.id;
    let env_settings: Settings = context.config.parse_settings(env)?;
    let kind = match (env == super::PUSHT_DISCRETE.id, env_settings.relative) {
        (true, _) => ActionKind::Discrete,
        (false, true) => ActionKind::Relative,
        (false, false) => ActionKind::Absolute,
    };
    let factors = factors().with_defaults(env, &env_settings.init_value)?;
    let description = settings.describe_as(&args.name);
    let expert =
        Arc::new(Expert { env, factors, env_settings, kind, frame_skip: context.frame_skip, settings });
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        Ok(Box::new(ExpertActor::<E>::new(Arc::clone(&expert), view)?) as Box<dyn Actor>)
    })))
}

/// The expert in one episode.
struct ExpertActor<E> {
    expert: Arc<Expert>,
    scene: Scene,
    /// Where the environment should be if nothing interferes.
    sim: E,
    saved: EnvState,
    plan: Vec<Command>,
    /// Commands of the plan that have been carried out.
    done: usize,
}

impl<E: Engine> ExpertActor<E> {
    fn new(expert: Arc<Expert>, view: &SlotView<'_>) -> Result<Self, PolicyError> {
        let mut saved = EnvState::new();
        let loaded = expert.loaded::<E>(view, &mut saved)?;
        let motion = (expert.kind, expert.frame_skip);
        let scene = Scene::new(&expert.settings, motion, &loaded).map_err(|error| {
            PolicyError::Unsupported { policy: "expert".to_owned(), reason: error.to_string() }
        })?;
        Ok(Self { expert, scene, sim: loaded.sim, saved, plan: Vec::new(), done: 0 })
    }

    /// Whether the environment is not where the plan supposes it: something else acted.
    fn is_off_plan(&self, view: &SlotView<'_>) -> Result<bool, PolicyError> {
        let state: &[f64] = view.row.get("state")?;
        Ok(state != observed_state(&self.sim))
    }
}

impl Expert {
    fn loaded<E: Engine>(
        &self,
        view: &SlotView<'_>,
        saved: &mut EnvState,
    ) -> Result<LoadedState<E>, PolicyError> {
        view.snapshot(saved)?;
        Ok(LoadedState::load(self.env, &self.factors, &self.env_settings, saved)?)
    }
}

impl<E: Engine> Actor for ExpertActor<E> {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let settings = &self.expert.settings;
        if self.done >= self.plan.len().min(settings.replan) || self.is_off_plan(view)? {
            self.sim = self.expert.loaded(view, &mut self.saved)?.sim;
            let mut stream = view.episode.seed.indexed("policy expert", [view.episode.step, 0]);
            self.plan = search::decide(&self.scene, settings, &self.sim, &mut stream);
            self.done = 0;
        }
        let mut command = self.plan.get(self.done).copied().unwrap_or_default();
        if settings.std > 0.0 {
            let mut stream = view.episode.seed.indexed("policy expert noise", [view.episode.step, 0]);
            command = command.map(|component| {
                let noisy = f64::from(component) + settings.std * normal(&mut stream);
                noisy.clamp(-1.0, 1.0) as f32
            });
        }
        self.scene.steering.write(&self.sim, command, &mut action)?;
        let scene = &self.scene;
        scene.steering.drive(&mut self.sim, command, |sim| scene.is_success(sim));
        self.done += 1;
        Ok(())
    }
}

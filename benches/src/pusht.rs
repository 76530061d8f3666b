//! PushT as the benchmarks use it: worlds, and one environment without a world.

use anyhow::{Context as _, Result};
use rand::RngExt as _;
use swm_core::{
    Batch, Env, EnvConfig, EnvEntry, EnvState, Episode, EpisodeSeed, ImageSize, Registry, ResetOptions,
    Schema, Slice, World, WorldOptions, seed,
};
use swm_envs_2d::ENVS;
use swm_envs_2d::pusht::physics::BodyId;
use swm_envs_2d::pusht::{PUSHT, PushT};
use swm_fov::FactorEnv;

/// Steps between two resets, as in the reference's default time limit.
pub const EPISODE_STEPS: usize = 100;

/// The images that a world draws: none, or squares of a side in one of the two styles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Image {
    /// Height and width; 0: no images.
    pub side: usize,
    /// `exact` or `fast`.
    pub style: &'static str,
}

impl Image {
    /// No images.
    pub const NONE: Self = Self { side: 0, style: "exact" };

    /// What is measured everywhere: none, and both styles at the two usual sizes.
    pub const ALL: [Self; 5] = [
        Self::NONE,
        Self { side: 64, style: "exact" },
        Self { side: 224, style: "exact" },
        Self { side: 64, style: "fast" },
        Self { side: 224, style: "fast" },
    ];

    /// `none`, `64/exact`.
    pub fn name(self) -> String {
        if self.side == 0 { "none".to_owned() } else { format!("{}/{}", self.side, self.style) }
    }

    /// The configuration of environments that draw it.
    pub fn config(self) -> EnvConfig {
        let image = (self.side > 0).then_some(ImageSize { height: self.side, width: self.side });
        let settings = serde_json::Map::from_iter([("render".to_owned(), self.style.into())]);
        EnvConfig { image, settings }
    }
}

/// Who acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Actions {
    /// Uniform actions: the agent wanders, and seldom touches the block.
    Random,
    /// The weak policy: the agent stays near the block and pushes it about.
    Weak,
}

impl Actions {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Random, Self::Weak];

    /// The name of the policy.
    pub fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::Weak => "weak",
        }
    }
}

/// A world of PushT without a time limit.
///
/// # Errors
///
/// The world cannot be made.
pub fn world(image: Image, actions: Actions, num_envs: usize, threads: usize) -> Result<World> {
    world_of(&PUSHT, image, actions.name(), num_envs, threads)
}

/// A world of any environment, without a time limit of its own.
///
/// # Errors
///
/// The world cannot be made, or there is no such policy.
pub fn world_of(
    entry: &'static EnvEntry,
    image: Image,
    policy: &str,
    num_envs: usize,
    threads: usize,
) -> Result<World> {
    let (mut env, threads) = (image.config(), Some(threads));
    if !entry.settings.iter().any(|setting| setting.name == "render") {
        env.settings.clear();
    }
    let options = WorldOptions::new(num_envs).env(env).threads(threads).max_episode_steps(None);
    let mut world = World::new(entry, options)?;
    world.set_policy(Registry::new().with(ENVS).policy(policy, &world)?)?;
    Ok(world)
}

/// One environment and one row of a table to observe it in: what a step costs without any world around it.
pub struct BareEnv {
    env: FactorEnv<PushT>,
    row: Batch,
}

impl BareEnv {
    /// Without images: the reference's bare step draws none.
    ///
    /// # Errors
    ///
    /// The environment cannot be made.
    pub fn new() -> Result<Self> {
        let env = FactorEnv::new(&EnvConfig::default())?;
        let row = Batch::new(Schema::new(env.spec().fields.clone())?, 1);
        Ok(Self { env, row })
    }

    /// Begins the episode of `seed`.
    ///
    /// # Errors
    ///
    /// The environment cannot be reset.
    pub fn reset(&mut self, seed: u64) -> Result<()> {
        self.env.reset(&Episode::new(EpisodeSeed::new(seed), &ResetOptions::default()))?;
        self.env.write_episode(&mut self.row.rows_mut());
        Ok(())
    }

    /// What the reference's `step` does: physics, reward and success, observation and info.
    ///
    /// # Errors
    ///
    /// The environment diverged.
    pub fn step(&mut self, action: [f32; 2]) -> Result<f64> {
        let outcome = self.env.step(Slice::F32(&action))?;
        self.env.observe(&mut self.row.rows_mut());
        Ok(outcome.reward)
    }

    /// Actions for the episode of `seed` from its start, `[EPISODE_STEPS, 2]`. The environment is left at its end.
    ///
    /// # Errors
    ///
    /// The environment cannot be reset, or diverged.
    pub fn actions(&mut self, seed: u64, kind: Actions) -> Result<Vec<[f32; 2]>> {
        let mut stream = seed::keyed(seed, "benchmark actions", [0, 0]);
        self.reset(seed)?;
        let next = |_| {
            let sim = self.env.scene().sim();
            let (agent, block) = (sim.position(BodyId::Agent), sim.position(BodyId::Block));
            let action = [0, 1].map(|axis| {
                let wish: f64 = stream.random_range(-1.0..=1.0);
                let target = (agent[axis] + 100.0 * wish).clamp(block[axis] - 100.0, block[axis] + 100.0);
                match kind {
                    Actions::Random => wish as f32,
                    Actions::Weak => ((target - agent[axis]) / 100.0).clamp(-1.0, 1.0) as f32,
                }
            });
            self.step(action)?;
            Ok(action)
        };
        (0..EPISODE_STEPS).map(next).collect::<Result<_>>().context("acting in PushT")
    }

    /// The current state.
    ///
    /// # Errors
    ///
    /// The state cannot be written down.
    pub fn snapshot(&self) -> Result<EnvState> {
        let mut state = EnvState::new();
        self.env.snapshot(&mut state)?;
        Ok(state)
    }

    /// Restores a saved state.
    ///
    /// # Errors
    ///
    /// It is no state of this environment.
    pub fn restore(&mut self, state: &EnvState) -> Result<()> {
        Ok(self.env.restore(state)?)
    }

    /// The environment.
    pub fn env(&mut self) -> &mut FactorEnv<PushT> {
        &mut self.env
    }
}

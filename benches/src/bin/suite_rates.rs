//! `suite-rates steps|resets|threads [SECONDS]`: rates of the DeepMind Control Suite's environments as JSON, for
//! `peers/dmc.py`. Without images, unless a case says so.

use anyhow::{Context as _, Result, bail};
use swm_benches::{EPISODE_STEPS, Measurement, print, seconds};
use swm_core::{
    Batch, Env, EnvConfig, EnvEntry, Episode, EpisodeSeed, ImageSize, ResetOptions, Schema, Slice, Value,
    World, WorldOptions, policies,
};
use swm_envs_mujoco::{CHEETAH, ENVS, HUMANOID};

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let what = arguments.next().context("usage: suite-rates steps|resets|threads [SECONDS]")?;
    let seconds = seconds(arguments.next())?;
    let measurements = match what.as_str() {
        "steps" => steps(seconds)?,
        "resets" => resets(seconds)?,
        "threads" => threads(seconds)?,
        other => bail!("`{other}` is not measured; steps, resets and threads are"),
    };
    print(&measurements)
}

/// Control steps of one environment without a world, and steps of a world of one (two control steps each).
fn steps(seconds: f64) -> Result<Vec<Measurement>> {
    let mut all = Vec::new();
    for entry in [&CHEETAH, &HUMANOID] {
        let mut bare = Bare::new(entry, &[("action_repeat", 1.into())], None)?;
        let actions = bare.actions();
        all.push(Measurement::repeat(
            format!("control/{}", short(entry)),
            EPISODE_STEPS as u64,
            seconds,
            |episode, clock| {
                bare.reset(episode, &ResetOptions::default())?;
                clock.time(|| actions.chunks_exact(bare.width).try_for_each(|action| bare.step(action)))
            },
        )?);
        let mut world = world(entry, 1, 1)?;
        all.push(Measurement::world_steps(format!("world/{}", short(entry)), &mut world, seconds)?);
    }
    Ok(all)
}

/// Resets of every environment with nothing changed, and with each factor drawn alone; all of them without images, and
/// those of the cheetah with images too.
fn resets(seconds: f64) -> Result<Vec<Measurement>> {
    let mut all = Vec::new();
    for entry in ENVS {
        let sides: &[usize] = if entry.id == CHEETAH.id { &[0, 64] } else { &[0] };
        for &side in sides {
            let image = (side > 0).then_some(ImageSize { height: side, width: side });
            let mut bare = Bare::new(entry, &[], image)?;
            let factors: Vec<String> = bare.env.spec().factors.iter().map(|f| f.name.clone()).collect();
            for factor in [None].into_iter().chain(factors.into_iter().map(Some)) {
                let name = factor.as_deref().unwrap_or("nothing");
                let images = if side > 0 { "/images" } else { "" };
                let mut options = ResetOptions::default().vary(["none"]);
                options.variation.get_or_insert_default().extend(factor.clone());
                // A switch that is drawn changes nothing half of the time.
                if name.ends_with("_locked") {
                    options = ResetOptions::default().vary(["none"]).set(name, Value::scalar(0_i64));
                }
                all.push(Measurement::repeat(
                    format!("reset/{}/{name}{images}", short(entry)),
                    1,
                    seconds,
                    |episode, clock| clock.time(|| bare.reset(episode, &options)),
                )?);
            }
        }
    }
    Ok(all)
}

/// Steps of a world of eight environments on one thread and on two.
fn threads(seconds: f64) -> Result<Vec<Measurement>> {
    let mut all = Vec::new();
    for entry in [&CHEETAH, &HUMANOID] {
        for threads in [1, 2] {
            let mut world = world(entry, 8, threads)?;
            all.push(Measurement::world_steps(
                format!("world8/{}/{threads}", short(entry)),
                &mut world,
                seconds,
            )?);
        }
    }
    Ok(all)
}

fn world(entry: &'static EnvEntry, num_envs: usize, threads: usize) -> Result<World> {
    let options = WorldOptions::new(num_envs).threads(threads).max_episode_steps(None);
    let mut world = World::new(entry, options)?;
    world.set_policy(policies::random())?;
    Ok(world)
}

/// `cheetah` of `swm/CheetahDMControl-v0`.
fn short(entry: &EnvEntry) -> String {
    let name = entry.id.trim_start_matches("swm/");
    name.split("DMControl").next().unwrap_or(name).to_lowercase()
}

/// One environment and one row of a table to observe it in.
struct Bare {
    env: Box<dyn Env>,
    row: Batch,
    /// Dimension of an action.
    width: usize,
}

impl Bare {
    fn new(
        entry: &'static EnvEntry,
        settings: &[(&str, serde_json::Value)],
        image: Option<ImageSize>,
    ) -> Result<Self> {
        let settings = settings.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
        let env = entry.make(&EnvConfig { image, settings })?;
        let row = Batch::new(Schema::new(env.spec().fields.clone())?, 1);
        let width = env.spec().action.dim();
        Ok(Self { env, row, width })
    }

    /// Uniform actions for an episode, `[EPISODE_STEPS, A]`.
    fn actions(&self) -> Vec<f64> {
        let mut stream = EpisodeSeed::new(1).stream("benchmark actions");
        let sample = |_| self.env.spec().action.sample(&mut stream).to_f64s("action").unwrap_or_default();
        (0..EPISODE_STEPS).flat_map(sample).collect()
    }

    fn reset(&mut self, seed: u64, options: &ResetOptions) -> Result<()> {
        self.env.reset(&Episode::new(EpisodeSeed::new(seed), options))?;
        self.env.write_episode(&mut self.row.rows_mut());
        Ok(())
    }

    fn step(&mut self, action: &[f64]) -> Result<()> {
        self.env.step(Slice::F64(action))?;
        self.env.observe(&mut self.row.rows_mut());
        Ok(())
    }
}

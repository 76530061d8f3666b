//! Records an episode of an in-house environment as a golden file, for those that have no reference to record from:
//! `cargo run --release -p swm-tests --bin record_golden -- ENV POLICY SEED STEPS OUT.npz`. All factors are varied;
//! replay must then agree to the bit. To be run again only when an environment changes on purpose.

use std::fs::File;

use anyhow::{Context as _, Result};
use clap::Parser;
use ndarray::{Array1, Array2};
use ndarray_npy::NpzWriter;
use serde_json::{Map, Value as Json, json};
use swm::core::error::BoxError;
use swm::core::{EnvConfig, EpisodeEnd, ImageSize, LiveStep, Recorder, Rollout, Value, World, WorldOptions};

/// Side of the recorded images, pixels.
const SIDE: usize = 64;

/// Record a golden episode of an in-house environment.
#[derive(Parser)]
struct Args {
    /// Environment id.
    env: String,
    /// Policy, with its arguments.
    policy: String,
    /// Seed of the run; its first episode is recorded.
    seed: u64,
    /// Steps to record at most.
    steps: u64,
    /// The `.npz` file to write.
    out: std::path::PathBuf,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let registry = swm::registry();
    let entry = registry.env(&args.env)?;
    let size = ImageSize { height: SIDE, width: SIDE };
    let env = EnvConfig { image: Some(size), ..EnvConfig::default() };
    let options = WorldOptions::default().env(env).max_episode_steps(args.steps);
    let mut world = World::new(entry, options)?;
    world.set_policy(registry.policy(&args.policy, &world)?)?;
    let mut tape =
        Tape { names: world.spec().factors.iter().map(|f| f.name.clone()).collect(), ..Tape::default() };
    let rollout = Rollout::new(0..1).seed(args.seed).vary(["all"]);
    world.run(&rollout, &mut tape)?;
    tape.write(&args)
}

/// What is kept of an episode.
#[derive(Default)]
struct Tape {
    /// Names of the factors.
    names: Vec<String>,
    factors: Map<String, Json>,
    goal_state: Vec<f64>,
    goal: Vec<u8>,
    /// The first image and the last.
    images: [Vec<u8>; 2],
    states: Vec<Vec<f64>>,
    /// As the rows show them: the last has no action, the first no reward.
    actions: Vec<Vec<f64>>,
    rewards: Vec<f64>,
}

impl Recorder for Tape {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        let schema = row.values.schema();
        let value = |name: &str| -> Result<Value, BoxError> {
            let index = schema.require(name)?;
            Ok(Value::from_slice(&schema.fields()[index].shape, row.values.at(index)))
        };
        let numbers = |name: &str| -> Result<Vec<f64>, BoxError> { Ok(value(name)?.to_f64s(name)?) };
        let image: &[u8] = row.values.get("pixels")?;
        if row.episode.step == 0 {
            for name in &self.names {
                self.factors.insert(name.clone(), value(&format!("variation.{name}"))?.to_json());
            }
            self.goal_state = numbers("goal_state")?;
            self.goal = row.values.get("goal")?.to_vec();
            self.images[0] = image.to_vec();
        }
        self.images[1] = image.to_vec();
        self.states.push(numbers("state")?);
        self.actions.push(numbers("action")?);
        self.rewards.extend(numbers("reward")?);
        Ok(())
    }

    fn episode(&mut self, _: &EpisodeEnd) -> Result<(), BoxError> {
        Ok(())
    }
}

impl Tape {
    fn write(mut self, args: &Args) -> Result<()> {
        self.actions.pop();
        let steps = self.actions.len();
        let meta = json!({
            "env_id": args.env, "policy": args.policy, "seed": args.seed,
            "options": { "variation_values": self.factors },
        });
        let mut npz = NpzWriter::new_compressed(File::create(&args.out)?);
        npz.add_array("meta", &Array1::from_vec(serde_json::to_vec(&meta)?))?;
        npz.add_array("goal_state", &Array1::from_vec(self.goal_state))?;
        npz.add_array("goal_png", &png(&self.goal)?)?;
        npz.add_array("img_0_png", &png(&self.images[0])?)?;
        npz.add_array(format!("img_{steps}_png"), &png(&self.images[1])?)?;
        npz.add_array("actions", &table(&self.actions)?)?;
        npz.add_array("obs_state", &table(&self.states)?)?;
        npz.add_array("reward", &Array1::from_vec(self.rewards.split_off(1)))?;
        npz.finish()?;
        println!("{}: {steps} steps", args.out.display());
        Ok(())
    }
}

/// An image as PNG bytes.
fn png(pixels: &[u8]) -> Result<Array1<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, SIDE as u32, SIDE as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(pixels)?;
    Ok(Array1::from_vec(bytes))
}

fn table(rows: &[Vec<f64>]) -> Result<Array2<f64>> {
    let width = rows.first().context("no rows")?.len();
    Ok(Array2::from_shape_vec((rows.len(), width), rows.concat())?)
}

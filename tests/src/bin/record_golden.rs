//! Records a trajectory of one of our own environments as a golden file, for those that have no reference to record
//! from: `cargo run -p swm-tests --bin record_golden -- ENV POLICY SEED STEPS OUT.npz`. All factors are varied; replay
//! must then agree to the bit. To be run again only when an environment changes on purpose.

use std::fs::File;

use anyhow::{Context as _, Result};
use clap::Parser;
use ndarray::{Array1, Array2};
use ndarray_npy::NpzWriter;
use serde_json::{Map, json};
use swm::core::{
    Batch, EnvConfig, ImageSize, PolicyArgs, PolicyContext, ResetOptions, Value, World, WorldOptions,
};

/// Side of the recorded pictures, pixels.
const SIDE: usize = 64;

/// Record a golden trajectory of one of our own environments.
#[derive(Parser)]
struct Args {
    /// Environment id.
    env: String,
    /// Policy, with its arguments.
    policy: String,
    /// Seed of the episode.
    seed: u64,
    /// Steps to record at most.
    steps: usize,
    /// The `.npz` file to write.
    out: std::path::PathBuf,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let registry = swm::registry();
    let entry = registry.env(&args.env)?;
    let size = ImageSize { height: SIDE, width: SIDE };
    let env = EnvConfig { image: Some(size), ..EnvConfig::default() };
    let context = PolicyContext { env: entry, config: &env, frame_skip: 1 };
    let policy = registry.policy(&context, &PolicyArgs::parse(&args.policy)?)?;
    let options = WorldOptions { env: env.clone(), max_episode_steps: None, ..WorldOptions::default() };
    let mut world = World::new(entry, options)?;
    world.set_policy(policy);
    world.reset(args.seed, &ResetOptions::default().vary(&["all"]))?;

    let mut npz = NpzWriter::new(File::create(&args.out)?);
    let factors: Map<String, serde_json::Value> = (world.spec().factors.iter())
        .map(|factor| {
            let value = value(world.infos(), &format!("variation.{}", factor.name))?;
            Ok((factor.name.clone(), value.to_json()))
        })
        .collect::<Result<_>>()?;
    let meta = json!({
        "env_id": args.env, "policy": args.policy, "seed": args.seed,
        "options": { "variation_values": factors },
    });
    npz.add_array("meta", &Array1::from_vec(serde_json::to_vec(&meta)?))?;
    npz.add_array(
        "goal_state",
        &Array1::from_vec(value(world.infos(), "goal_state")?.numbers("goal_state")?),
    )?;
    npz.add_array("goal_png", &picture(world.infos(), "goal")?)?;
    npz.add_array("img_0_png", &picture(world.infos(), "pixels")?)?;

    let (mut states, mut actions, mut rewards) = (Vec::new(), Vec::new(), Vec::new());
    states.push(value(world.infos(), "state")?.numbers("state")?);
    while actions.len() < args.steps {
        world.step()?;
        let infos = world.infos();
        actions.push(value(infos, "action")?.numbers("action")?);
        rewards.push(value(infos, "reward")?.numbers("reward")?[0]);
        states.push(value(infos, "state")?.numbers("state")?);
        if infos.row(0).get::<bool>("terminated")?[0] {
            break;
        }
    }
    npz.add_array(format!("img_{}_png", actions.len()), &picture(world.infos(), "pixels")?)?;
    npz.add_array("actions", &table(&actions)?)?;
    npz.add_array("obs_state", &table(&states)?)?;
    npz.add_array("reward", &Array1::from_vec(rewards))?;
    npz.finish()?;
    println!("{}: {} steps", args.out.display(), actions.len());
    Ok(())
}

/// A field of the only row.
fn value(infos: &Batch, name: &str) -> Result<Value> {
    let index = infos.schema().require(name)?;
    Ok(Value::from_slice(&infos.schema().fields()[index].shape, infos.column(index)))
}

/// PNG bytes of a picture field.
fn picture(infos: &Batch, name: &str) -> Result<Array1<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, SIDE as u32, SIDE as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(infos.row(0).get(name)?)?;
    Ok(Array1::from_vec(bytes))
}

fn table(rows: &[Vec<f64>]) -> Result<Array2<f64>> {
    let width = rows.first().context("no rows")?.len();
    Ok(Array2::from_shape_vec((rows.len(), width), rows.concat())?)
}

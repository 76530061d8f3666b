//! `network_times CASE [SECONDS]`: CPU and wall time of the quickest training step, or of the quickest round of
//! candidates, as JSON. For `benches/peers/networks.py`.
//!
//! Cases: `train:MODEL:PRESET:CLIPS`, `plan:MODEL:PRESET:SAMPLES` and `descend:MODEL:PRESET:SAMPLES` (with gradients), each
//! on made-up data. Plans are 5 blocks long. `RAYON_NUM_THREADS` sets the number of threads.

use std::error::Error;
use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};
use serde_json::json;
use swm_baselines::{Baseline, ClipBatch, DataDims, Images, MakeOptions, PlanningBatch, Step, Vectors, make};
use swm_solvers::{Candidates, Outputs};

const HORIZON: usize = 5;
const ACTION: usize = 2;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let usage = "usage: network_times train|plan|descend:MODEL:PRESET:COUNT [SECONDS]";
    let case = arguments.next().ok_or(usage)?;
    let seconds: f64 = arguments.next().map_or(Ok(2.0), |text| text.parse())?;
    let parts: Vec<&str> = case.split(':').collect();
    let [kind, name, preset, count] = parts[..] else { return Err(usage.into()) };
    let count: usize = count.parse()?;
    let dims = DataDims { action_dim: ACTION, proprio_dim: 4 };
    let model = make(name, &MakeOptions { seed: 1, ..MakeOptions::new(preset, dims) })?;
    let times = match kind {
        "train" => train(model, count, seconds)?,
        "plan" | "descend" => plan(model.as_ref(), count, kind == "descend", seconds)?,
        _ => return Err(usage.into()),
    };
    println!("{}", json!({ "case": case, "cpu_s": times.0, "wall_s": times.1 }));
    Ok(())
}

/// Made-up bytes: images of noise.
fn bytes(count: usize) -> Vec<u8> {
    (0..count).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect()
}

fn train(mut model: Box<dyn Baseline>, clips: usize, seconds: f64) -> Result<(f64, f64), Box<dyn Error>> {
    let input_spec = model.input_spec().clone();
    let (steps, side, dim) = (input_spec.num_steps, input_spec.image, input_spec.frameskip * ACTION);
    let images =
        |values, steps| Images { values, rows: clips, steps, height: side, width: side, channels_last: true };
    let pixels = bytes(clips * steps * 3 * side * side);
    let goals = bytes(clips * 3 * side * side);
    let action: Vec<f32> = (0..clips * steps * dim).map(|i| (i as f32).sin()).collect();
    let proprio = vec![0.5; clips * steps * 4];
    let vectors = |values, steps, dim| Vectors { values, rows: clips, steps, dim };
    let batch = ClipBatch {
        pixels: images(&pixels, steps),
        latents: None,
        canonical: None,
        action: vectors(&action, steps, dim),
        proprio: Some(vectors(&proprio, steps, 4)),
        goal_pixels: Some(images(&goals, 1)),
        goal_proprio: Some(vectors(&proprio[..clips * 4], 1, 4)),
    };
    quickest(seconds, |step| {
        model.train_step(&batch, &Step { seed: 1, phase: 0, step, total: 1_000_000 })?;
        Ok(())
    })
}

fn plan(
    model: &dyn Baseline,
    samples: usize,
    with_gradient: bool,
    seconds: f64,
) -> Result<(f64, f64), Box<dyn Error>> {
    let mut planner = model.planner().ok_or("this model does not plan")?;
    let side = model.input_spec().image;
    let pixels = bytes(3 * side * side);
    let image = Images { values: &pixels, rows: 1, steps: 1, height: side, width: side, channels_last: true };
    let proprio = Vectors { values: &[0.5; 4], rows: 1, steps: 1, dim: 4 };
    let dim = planner.block_dim();
    planner.prepare(&PlanningBatch {
        pixels: image,
        action: Vectors { values: &[], rows: 1, steps: 0, dim },
        proprio: Some(proprio),
        goal_pixels: image,
        goal_proprio: Some(proprio),
    })?;
    let actions: Vec<f32> = (0..samples * HORIZON * dim).map(|i| (i as f32).sin()).collect();
    let candidates = Candidates { actions: &actions, episodes: 1, samples, horizon: HORIZON, dim };
    let (mut costs, mut gradient) = (vec![0.0; samples], vec![0.0; actions.len()]);
    quickest(seconds, |_| {
        let gradient = with_gradient.then_some(&mut gradient[..]);
        planner.evaluate(&candidates, &mut Outputs { gradient, ..Outputs::new(&mut costs) })?;
        Ok(())
    })
}

/// Least CPU time, and least wall time, of one call among those of so many seconds of CPU time.
fn quickest(
    seconds: f64,
    mut work: impl FnMut(u64) -> Result<(), Box<dyn Error>>,
) -> Result<(f64, f64), Box<dyn Error>> {
    work(0)?;
    let begin = cpu();
    let mut best = (f64::INFINITY, f64::INFINITY);
    for call in 1.. {
        let (cpu_before, wall_before) = (cpu(), Instant::now());
        work(call)?;
        let wall = wall_before.elapsed();
        best = (best.0.min((cpu() - cpu_before).as_secs_f64()), best.1.min(wall.as_secs_f64()));
        if (cpu() - begin).as_secs_f64() > seconds {
            break;
        }
    }
    Ok(best)
}

/// CPU time of all threads.
fn cpu() -> Duration {
    let now = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

//! `solve-times [SECONDS]`: how long one plan takes by every solver when its cost is next to nothing, as JSON.
//!
//! The side of `peers/solvers.py` that runs in this process: one episode, one thread, CPU time.

use anyhow::{Context as _, Result};
use serde::Serialize;
use swm_benches::{Clock, SolveCase};

/// One measurement.
#[derive(Serialize)]
struct Measurement {
    solver: &'static str,
    /// Plans made.
    count: u64,
    /// CPU time of the quickest plan, seconds.
    best_s: f64,
    /// CPU time of a plan in the middle, seconds.
    median_s: f64,
}

fn main() -> Result<()> {
    let seconds: f64 =
        std::env::args().nth(1).map_or(Ok(0.5), |text| text.parse()).context("SECONDS must be a number")?;
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(1).build().context("a thread cannot be started")?;
    let measurements = pool.install(|| -> Result<Vec<Measurement>> {
        SolveCase::all(1)?.into_iter().map(|case| measure(case, seconds)).collect()
    })?;
    println!("{}", serde_json::to_string_pretty(&measurements)?);
    Ok(())
}

/// Plans until that took `seconds`, 5 times or more.
fn measure(mut case: SolveCase, seconds: f64) -> Result<Measurement> {
    let (mut times, mut total) = (Vec::new(), 0.0);
    while total < seconds || times.len() < 5 {
        let mut clock = Clock::new();
        clock.time(|| case.solve()).with_context(|| format!("{} failed", case.name))?;
        let time = clock.elapsed().cpu_s;
        total += time;
        times.push(time);
    }
    times.sort_by(f64::total_cmp);
    let (count, best_s, median_s) = (times.len() as u64, times[0], times[times.len() / 2]);
    Ok(Measurement { solver: case.name, count, best_s, median_s })
}

//! Drives a double integrator past an obstacle, with a new plan every 20 ms, on this crate alone:
//! `cargo run --release -p swm-solvers --example plan_at_50_hz`.

mod model;

use std::time::{Duration, Instant};

use model::{Body, GOAL, OBSTACLE, RADIUS, STEP_S};
use swm_solvers::models::ControlCost;
use swm_solvers::{Mpc, PlanError};

fn main() -> Result<(), PlanError> {
    let mut mpc = Mpc::new(Box::new(model::solver()), model::config(), model::actions())?
        .with_deadline(Duration::from_millis(15));
    let mut cost = ControlCost::new(Body { now: [0.0; 4] });
    let (mut times, mut nearest, mut cut) = (Vec::new(), f64::INFINITY, 0);
    let mut next_step = Instant::now();
    while times.len() < 250 && (Body::distance(&cost.model.now, GOAL) > 0.05 || times.len() < 50) {
        let started = Instant::now();
        let action = mpc.next(&mut cost, None)?;
        let action = [f64::from(action[0]), f64::from(action[1])];
        times.push(started.elapsed());
        cut += usize::from(mpc.last_plan().is_some_and(|plan| plan.iterations[0] < 6));
        // A robot would be sent the acceleration here, and its state be measured at the next step.
        cost.model.now = Body::after(&cost.model.now, action);
        nearest = nearest.min(Body::distance(&cost.model.now, OBSTACLE) - RADIUS);
        next_step += Duration::from_secs_f64(STEP_S);
        std::thread::sleep(next_step.saturating_duration_since(Instant::now()));
    }
    times.sort_unstable();
    let at = |part: usize| times[(times.len() - 1) * part / 100].as_secs_f64() * 1e3;
    println!(
        "{} steps of 20 ms; {:.2} m from the goal; {:.2} m clear of the obstacle",
        times.len(),
        Body::distance(&cost.model.now, GOAL),
        nearest,
    );
    println!(
        "a plan took {:.2} ms (median), {:.2} ms (99 %), {:.2} ms (longest); {cut} ended at the deadline",
        at(50),
        at(99),
        at(100),
    );
    Ok(())
}

//! One decision: which primitive to carry out next, by a search of two levels.
//!
//! Many primitives are tried, the best are varied, and from the ends of the best of those a second primitive each is
//! tried. A primitive counts as good as the best pair that it begins. As soon as one primitive leads to success, the
//! second level is left out, and the shortest success wins.

use swm_core::seed::Stream;

use super::primitive::{Primitive, uniform};
use super::rollout::{Outcome, Rollout};
use super::scene::Scene;
use super::settings::ExpertSettings;
use super::steering::Command;
use crate::pusht::engine::Engine;

/// Candidates kept between refinements, and how many of them are varied.
const KEPT: usize = 20;
const VARIED: usize = 12;

#[derive(Clone, Copy, Debug)]
struct Candidate {
    primitive: Primitive,
    outcome: Outcome,
}

/// Plans from `sim` on. The commands reach to the end of the chosen primitive, or to success.
pub(super) fn decide(
    scene: &Scene,
    settings: &ExpertSettings,
    sim: &impl Engine,
    stream: &mut Stream,
) -> Vec<Command> {
    let mut finish = Rollout::new(scene, sim).recorded();
    if scene.is_nearly_placed(sim) {
        finish.finish();
        if finish.success {
            return finish.commands.unwrap_or_default();
        }
    }
    let routes = scene.routes(sim);
    let try_out = |primitive: Primitive| Candidate {
        outcome: Rollout::new(scene, sim).perform(&primitive, &routes),
        primitive,
    };
    let mut candidates: Vec<Candidate> = Vec::with_capacity(settings.samples + KEPT);
    for _ in 0..settings.samples {
        candidates.push(try_out(Primitive::sample(scene, stream)));
    }
    keep_best(&mut candidates);
    for round in 1..=settings.refinements {
        for index in 0..settings.samples / 2 {
            let parent = candidates[index % VARIED.min(candidates.len().min(KEPT))];
            candidates.push(try_out(parent.primitive.vary(scene, 1.0 / round as f64, stream)));
        }
        keep_best(&mut candidates);
    }
    if !candidates[0].outcome.success && settings.beams > 0 {
        candidates.truncate(settings.beams);
        for _ in 0..settings.detours {
            candidates.push(try_out(Primitive::sample_detour(scene, stream)));
        }
        for candidate in &mut candidates {
            candidate.outcome.cost = two_level_cost(scene, settings, sim, &candidate.primitive, stream);
        }
        sort(&mut candidates);
    }
    let chosen = pick(&candidates, settings.temperature, stream);
    let mut rollout = Rollout::new(scene, sim).recorded();
    rollout.perform(&chosen.primitive, &routes);
    // Where nothing helps, anything else is better than standing still: the next decision sees another world.
    while rollout.steps == 0 {
        rollout.perform(&Primitive::sample_detour(scene, stream), &routes);
    }
    rollout.commands.unwrap_or_default()
}

/// The cost after the best second primitive that is found.
fn two_level_cost(
    scene: &Scene,
    settings: &ExpertSettings,
    sim: &impl Engine,
    first: &Primitive,
    stream: &mut Stream,
) -> f64 {
    let mut rollout = Rollout::new(scene, sim);
    let own = rollout.perform(first, &scene.routes(sim)).cost;
    let routes = scene.routes(&rollout.sim);
    (0..settings.beam_samples)
        .map(|_| rollout.clone().perform(&Primitive::sample(scene, stream), &routes).cost)
        .fold(own, f64::min)
}

fn sort(candidates: &mut [Candidate]) {
    candidates.sort_by(|a, b| a.outcome.cost.total_cmp(&b.outcome.cost));
}

fn keep_best(candidates: &mut Vec<Candidate>) {
    sort(candidates);
    candidates.truncate(KEPT);
}

/// The first of the sorted candidates, or, at a temperature, one sampled by the softmax of their costs.
fn pick<'a>(candidates: &'a [Candidate], temperature: f64, stream: &mut Stream) -> &'a Candidate {
    let best = &candidates[0];
    if temperature == 0.0 {
        return best;
    }
    let weight = |candidate: &Candidate| ((best.outcome.cost - candidate.outcome.cost) / temperature).exp();
    let total: f64 = candidates.iter().map(weight).sum();
    let mut rest = total * uniform(stream);
    for candidate in candidates {
        rest -= weight(candidate);
        if rest < 0.0 {
            return candidate;
        }
    }
    best
}

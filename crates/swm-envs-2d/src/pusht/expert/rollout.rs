//! Rollouts of primitives on copies of the simulator: approach, push, finish.
//!
//! A copy holds everything that the future depends on, so a plan that succeeds here succeeds when it is carried out.

use super::primitive::{Primitive, Start};
use super::route::Routes;
use super::scene::Scene;
use super::steering::{Command, Steering};
use crate::pusht::engine::Engine;
use crate::pusht::physics::{BodyId, Rotation, Vec2, vec2};

/// An approach ends this near its target, pixels.
const ARRIVED_PX: f64 = 5.0;
/// An agent that moves less than this in a control step is held by something, pixels.
const HELD_PX: f64 = 0.5;

/// A copy of the world that a plan is tried on.
#[derive(Clone)]
pub(super) struct Rollout<'a, E> {
    scene: &'a Scene,
    pub(super) sim: E,
    pub(super) steps: u32,
    pub(super) success: bool,
    /// What was commanded, if it is to be kept.
    pub(super) commands: Option<Vec<Command>>,
}

/// What a primitive leads to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Outcome {
    /// Lower is better; far below zero for a success.
    pub(super) cost: f64,
    pub(super) success: bool,
}

/// A success is better than anything else, and a short one better than a long one.
const SUCCESS_COST: f64 = -1000.0;
/// What it costs to leave the block no better than it was: without it, standing still is cheap.
const IDLE_COST: f64 = 20.0;

impl<'a, E: Engine> Rollout<'a, E> {
    pub(super) fn new(scene: &'a Scene, sim: &E) -> Rollout<'a, E> {
        Rollout { scene, sim: sim.clone(), steps: 0, success: false, commands: None }
    }

    /// Keeps the commands from now on.
    pub(super) fn recorded(mut self) -> Rollout<'a, E> {
        self.commands = Some(Vec::new());
        self
    }

    /// Carries a primitive out and, if the block is then nearly placed, tries to finish. After a failed finish the
    /// rollout stands at the primitive's end.
    pub(super) fn perform(&mut self, primitive: &Primitive, routes: &Routes) -> Outcome {
        let before = self.scene.block_cost(&self.sim);
        self.apply(primitive, routes);
        if !self.success && self.scene.is_nearly_placed(&self.sim) {
            let end = self.clone();
            self.finish();
            if !self.success {
                *self = end;
            }
        }
        self.outcome(before)
    }

    fn outcome(&self, before: f64) -> Outcome {
        let after = self.scene.block_cost(&self.sim);
        let base = match self.success {
            true => SUCCESS_COST,
            false if after < before => after,
            false => after + IDLE_COST,
        };
        Outcome { cost: base + self.scene.step_weight * f64::from(self.steps), success: self.success }
    }

    fn apply(&mut self, primitive: &Primitive, routes: &Routes) {
        let Primitive { start, turn_rad, strength, duration, follow } = *primitive;
        let mut direction = vec2(1.0, 0.0);
        if let Start::At(spot) = start {
            let Some((place, normal)) = self.scene.standoff(&self.sim, routes, spot) else { return };
            self.walk(routes, place, self.scene.limits.approach);
            direction = -normal;
        }
        if self.success {
            return;
        }
        match start {
            Start::At(spot) if follow => {
                self.push(duration, |scene, sim| scene.push_at(sim, spot, turn_rad, strength));
            }
            _ => {
                let direction = Rotation::new(turn_rad).world_from_body(direction);
                let command = Steering::push(direction, strength);
                self.push(duration, |_, _| command);
            }
        }
    }

    /// Goes to the agent's goal, or as near as the block lets it, then straight on.
    pub(super) fn finish(&mut self) {
        let goal = self.scene.agent_goal();
        let routes = self.scene.routes(&self.sim);
        let beside = routes.obstacle().outside(goal);
        self.walk(&routes, beside, self.scene.limits.finish);
        for _ in 0..6 {
            if self.success {
                break;
            }
            self.step(self.scene.steering.toward(&self.sim, goal));
        }
    }

    /// Follows the way to `target`, cutting corners where the view is free.
    fn walk(&mut self, routes: &Routes, target: Vec2, limit: u32) {
        let path = routes.to(target);
        let points = path.points();
        let mut next = 0;
        let mut held = 0;
        for _ in 0..limit {
            let position = self.agent();
            if self.success || (target - position).norm() < ARRIVED_PX {
                break;
            }
            while next + 1 < points.len() && routes.obstacle().is_free(position, points[next + 1]) {
                next += 1;
            }
            self.step(self.scene.steering.toward(&self.sim, points[next]));
            held = if (self.agent() - position).norm() < HELD_PX { held + 1 } else { 0 };
            if held == 2 {
                break;
            }
        }
    }

    /// Repeats a command for a while, or for long, and then returns to the best state.
    fn push(&mut self, duration: Option<u32>, command: impl Fn(&Scene, &E) -> Command) {
        if let Some(duration) = duration {
            for _ in 0..duration {
                if !self.success {
                    self.step(command(self.scene, &self.sim));
                }
            }
            return;
        }
        let mut best = (self.scene.block_cost(&self.sim), self.steps, self.sim.clone());
        let step_weight = self.scene.step_weight;
        let first = self.steps;
        for _ in 0..self.scene.limits.push {
            self.step(command(self.scene, &self.sim));
            if self.success {
                return;
            }
            let cost = self.scene.block_cost(&self.sim) + step_weight * f64::from(self.steps - first);
            if cost < best.0 {
                best = (cost, self.steps, self.sim.clone());
            } else if self.steps - best.1 >= self.scene.limits.patience {
                break;
            }
        }
        (_, self.steps, self.sim) = best;
        if let Some(commands) = &mut self.commands {
            commands.truncate(self.steps as usize);
        }
    }

    fn step(&mut self, command: Command) {
        let scene = self.scene;
        let command = scene.steering.limited(&self.sim, command);
        self.success = scene.steering.drive(&mut self.sim, command, |sim| scene.is_success(sim));
        self.steps += 1;
        if let Some(commands) = &mut self.commands {
            commands.push(command);
        }
    }

    fn agent(&self) -> Vec2 {
        self.sim.position(BodyId::Agent).into()
    }
}

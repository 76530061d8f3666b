//! `demo/IceRink-v0`: reset, step, observation, saved states.

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{
    Dtype, Env, EnvConfig, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome, RowsMut, Slice,
    Space,
};
use swm_fov::{Fov, FovSpace, SavedFov};
use swm_render::{Geometry, Renderer, Style};

use crate::ICE_RINK;
use crate::factors::{REACH, factors};

const STEP_S: f64 = 0.05;
/// Acceleration of a puck of mass 1 at full action, in rinks per second squared.
const PUSH: f64 = 2.0;
/// The puck lies on the mark only if it is slower than this, in rinks per second.
const REST: f64 = 0.2;

/// Side of the canvas that images are drawn on; the whole rink.
const CANVAS: f64 = 512.0;

// Field indices, in the order of `fields`.
const STATE: usize = 0;
const GOAL_STATE: usize = 1;
const FACTORS: usize = 2;

/// A puck that slides, bounces off the boards and can be pushed.
pub struct Rink {
    spec: EnvSpec,
    space: FovSpace,
    fov: Fov,
    puck: Puck,
    mark: [f64; 2],
    renderer: Option<Renderer>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Puck {
    position: [f64; 2],
    velocity: [f64; 2],
}

/// A saved moment.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    puck: Puck,
    mark: [f64; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {}

impl Rink {
    /// Makes the environment.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        config.parse_settings::<Settings>(ICE_RINK.id)?;
        let space = factors();
        let fov = space.defaults();
        let spec = spec(config.image, &space);
        let renderer = match config.image {
            Some(size) => Some(Renderer::new(Style::Fast, Geometry::new(size.height, size.width))?),
            None => None,
        };
        Ok(Self { spec, space, fov, puck: Puck::default(), mark: [0.0; 2], renderer })
    }

    fn distance(&self) -> f64 {
        (self.puck.position[0] - self.mark[0]).hypot(self.puck.position[1] - self.mark[1])
    }

    fn outcome(&self) -> Outcome {
        let [vx, vy] = self.puck.velocity;
        let success = self.distance() <= REACH && vx.hypot(vy) <= REST;
        Outcome { reward: -self.distance(), terminated: success, success: Some(success) }
    }
}

impl Env for Rink {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.sample(&self.spec.id, episode)?;
        // A recorded row may say where the puck starts and what the goal is, else factors do.
        self.puck = match episode.start(&self.spec, "state")?.as_deref() {
            Some(&[x, y, vx, vy]) => Puck { position: [x, y], velocity: [vx, vy] },
            _ => Puck { position: self.fov.vector("puck.start_position"), velocity: [0.0; 2] },
        };
        self.mark = match episode.goal(&self.spec, "state")?.as_deref() {
            Some(&[x, y, ..]) => [x, y],
            _ => self.fov.vector("mark.position"),
        };
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let keeps = 1.0 - self.fov.f64("ice.friction") * STEP_S;
        let force = PUSH / self.fov.f64("puck.mass");
        for axis in 0..2 {
            let push = action.as_f64(axis).unwrap_or(0.0).clamp(-1.0, 1.0);
            let (position, velocity) = (&mut self.puck.position[axis], &mut self.puck.velocity[axis]);
            *velocity = (*velocity + force * push * STEP_S) * keeps;
            *position += *velocity * STEP_S;
            if !(0.0..=1.0).contains(position) {
                *position = position.clamp(0.0, 1.0);
                *velocity = -*velocity;
            }
        }
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &[self.mark[0], self.mark[1], 0.0, 0.0]);
        self.fov.write(FACTORS, out);
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        let Puck { position: [x, y], velocity: [vx, vy] } = self.puck;
        out.write(STATE, &[x, y, vx, vy]);
        if let Some(renderer) = &mut self.renderer {
            let pixels: &mut [u8] = out.at(self.spec.fields.len() - 1);
            let [ice, mark, puck] =
                ["ice.color", "mark.color", "puck.color"].map(|factor| self.fov.rgb(factor));
            let drawn = renderer.render(pixels, |painter| {
                painter.fill(ice);
                painter.disc(self.mark.map(|place| CANVAS * place), CANVAS * REACH, mark);
                painter.disc([x, y].map(|place| CANVAS * place), CANVAS * REACH, puck);
            });
            drawn.expect("the field has the renderer's size");
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved { fov: self.fov.save(), puck: self.puck, mark: self.mark };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        self.fov = self.space.recall(&saved.fov)?;
        (self.puck, self.mark) = (saved.puck, saved.mark);
        Ok(())
    }

    /// How far the puck is from the mark, and a little for its speed: it shall come to lie there.
    fn task_cost(&self) -> Option<f64> {
        let [vx, vy] = self.puck.velocity;
        Some(self.distance() + 0.1 * vx.hypot(vy))
    }
}

fn spec(image: Option<ImageSize>, space: &FovSpace) -> EnvSpec {
    let mut fields =
        vec![Field::step("state", Dtype::F64, &[4]), Field::episode("goal_state", Dtype::F64, &[4])];
    fields.extend(space.fields());
    fields.extend(image.map(|size| size.field(PIXELS)));
    EnvSpec::new(ICE_RINK.id, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
        .factors(space.specs())
        .time_step_s(STEP_S)
        .start_columns(&["state"])
        .goal_columns(&["state"])
}

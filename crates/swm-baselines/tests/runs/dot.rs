//! An environment to train and act in: tiny, with images.

use swm_core::{
    Dtype, Env, EnvConfig, EnvEntry, EnvError, EnvSpec, EnvState, Episode, Field, ImageSize, Outcome,
    RowsMut, Slice, Space,
};

/// A dot that is pushed over a square.
pub(crate) const DOT: EnvEntry =
    EnvEntry::new("swm/Dot-v0", "a dot on a square (for tests)", |config| Ok(Box::new(Dot::new(config, 2))));

/// The same in all but its name.
pub(crate) const TWIN: EnvEntry = EnvEntry::new("swm/Dot-v1", DOT.summary, |config| DOT.make(config));

/// The same with a third action component, which does nothing.
pub(crate) const WIDE: EnvEntry =
    EnvEntry::new("swm/DotWide-v0", DOT.summary, |config| Ok(Box::new(Dot::new(config, 3))));

pub(crate) const SIDE: usize = 16;
pub(crate) const IMAGE: ImageSize = ImageSize { height: SIDE, width: SIDE };

struct Dot {
    spec: EnvSpec,
    at: [f32; 2],
    goal: [f32; 2],
}

impl Dot {
    fn new(config: &EnvConfig, pushes: usize) -> Self {
        let mut fields =
            vec![Field::step("state", Dtype::F32, &[2]), Field::episode("goal_state", Dtype::F32, &[2])];
        if let Some(size) = config.image {
            fields.push(size.field("pixels"));
            fields.push(Field::episode("goal", Dtype::U8, &size.shape()));
        }
        let spec = EnvSpec::new(DOT.id, Space::uniform_box(Dtype::F32, &[pushes], -1.0, 1.0), fields)
            .time_step_s(0.1)
            .start_columns(&["state"])
            .goal_columns(&["state"]);
        Self { spec, at: [0.0; 2], goal: [0.0; 2] }
    }

    fn draws(&self) -> bool {
        self.spec.fields.len() > 2
    }
}

fn draw([x, y]: [f32; 2], pixels: &mut [u8]) {
    for (index, pixel) in pixels.chunks_exact_mut(3).enumerate() {
        let (column, row) = ((index % SIDE) as f32, (index / SIDE) as f32);
        let near = (-((column - x).powi(2) + (row - y).powi(2)) / 4.0).exp();
        pixel.copy_from_slice(&[255, (255.0 * (1.0 - near)) as u8, 128]);
    }
}

impl Env for Dot {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let sampled = Space::uniform_box(Dtype::F32, &[4], 0.0, (SIDE - 1) as f64)
            .sample(&mut episode.seed.stream("start and goal"))
            .to_f64s("start")?;
        (self.at, self.goal) =
            ([sampled[0] as f32, sampled[1] as f32], [sampled[2] as f32, sampled[3] as f32]);
        Ok(Outcome { reward: f64::NAN, terminated: false, success: Some(false) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        for axis in 0..2 {
            let push = action.as_f64(axis).unwrap_or(0.0) as f32;
            self.at[axis] = (self.at[axis] + push).clamp(0.0, (SIDE - 1) as f32);
        }
        Ok(Outcome { reward: 0.0, terminated: false, success: Some(false) })
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(1, &self.goal);
        if self.draws() {
            draw(self.goal, out.at(3));
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        out.write(0, &self.at);
        if self.draws() {
            draw(self.at, out.at(2));
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        state.store(DOT.id, &(self.at, self.goal))
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        (self.at, self.goal) = state.load(DOT.id)?;
        Ok(())
    }
}

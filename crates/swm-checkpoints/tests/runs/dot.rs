//! An environment to train and act in: tiny, with images.

use std::collections::BTreeMap;

use swm_core::{
    Dtype, Env, EnvConfig, EnvEntry, EnvError, EnvSpec, EnvState, Episode, FactorSpec, Field, ImageSize,
    Outcome, RowsMut, Slice, Space, Value,
};

/// A dot that is pushed over a square.
pub(crate) const DOT: EnvEntry =
    EnvEntry::new("swm/Dot-v0", "a dot on a square (for tests)", |config| Ok(Box::new(Dot::new(config, 2))));

/// The same in all but its name.
pub(crate) const TWIN: EnvEntry = EnvEntry::new("swm/Dot-v1", DOT.summary, |config| DOT.make(config));

/// The same with a third action component, which does nothing.
pub(crate) const WIDE: EnvEntry =
    EnvEntry::new("swm/DotWide-v0", DOT.summary, |config| Ok(Box::new(Dot::new(config, 3))));

/// The same on a table whose shade is a visual factor.
pub(crate) const SHADED: EnvEntry = EnvEntry::new("swm/DotShaded-v0", DOT.summary, |config| {
    let mut dot = Dot::new(config, 2);
    dot.spec.id = SHADED.id.to_owned();
    let shade = FactorSpec::new(SHADE, Space::uniform_box(Dtype::F64, &[], 0.0, 255.0), 255.0);
    dot.spec.factors.push(shade.visual(true));
    dot.spec.fields.push(Field::episode("variation.table.shade", Dtype::F64, &[]));
    Ok(Box::new(dot))
});

pub(crate) const SHADE: &str = "table.shade";

pub(crate) const SIDE: usize = 16;
pub(crate) const IMAGE: ImageSize = ImageSize { height: SIDE, width: SIDE };

struct Dot {
    spec: EnvSpec,
    at: [f32; 2],
    goal: [f32; 2],
    renders: bool,
    shade: u8,
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
        Self { spec, at: [0.0; 2], goal: [0.0; 2], renders: config.image.is_some(), shade: 255 }
    }
}

fn draw([x, y]: [f32; 2], shade: u8, pixels: &mut [u8]) {
    for (index, pixel) in pixels.chunks_exact_mut(3).enumerate() {
        let (column, row) = ((index % SIDE) as f32, (index / SIDE) as f32);
        let near = (-((column - x).powi(2) + (row - y).powi(2)) / 4.0).exp();
        pixel.copy_from_slice(&[shade, (255.0 * (1.0 - near)) as u8, 128]);
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
        if self.renders {
            draw(self.goal, self.shade, out.at(3));
        }
        if !self.spec.factors.is_empty() {
            out.write(self.spec.fields.len() - 1, &[255.0_f64]);
        }
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        out.write(0, &self.at);
        if self.renders {
            draw(self.at, self.shade, out.at(2));
        }
    }

    fn dress(&mut self, look: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let shade = look.get(SHADE).map(|shade| shade.to_f64s(SHADE)).transpose()?;
        self.shade = shade.map_or(255, |shade| shade[0] as u8);
        Ok(())
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        state.store(DOT.id, &(self.at, self.goal))
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        (self.at, self.goal) = state.load(DOT.id)?;
        Ok(())
    }
}

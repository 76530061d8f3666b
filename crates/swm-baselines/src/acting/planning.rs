//! From infos of environments to planning batches: images as they are, vectors scaled as in training.

use std::borrow::Cow;
use std::collections::BTreeMap;

use rayon::prelude::*;
use swm_core::env::PIXELS;
use swm_core::{Row, Slice};

use crate::baseline::{Baseline, Canonicalizer};
use crate::data::{Images, PlanningBatch, Vectors};
use crate::error::BaselineError;
use crate::train::{DataConfig, PROPRIO, Scale};

/// The field that shows the goal.
const GOAL: &str = "goal";
/// Fields that may hold the goal's `proprio`, the first that is there.
const GOAL_PROPRIO: [&str; 2] = ["goal_proprio", "goal_state"];

/// Collects the planning batch of B environments; its memory is reused.
#[derive(Default)]
pub(super) struct PlanningTable {
    rows: usize,
    frames: usize,
    /// `[H, W]` of the images.
    size: [usize; 2],
    /// What draws them in the canonical look, if anything does.
    canonical: Option<Canonical>,
    pixels: Vec<u8>,
    goal_pixels: Vec<u8>,
    /// F × A.
    block: usize,
    action: Vec<f32>,
    proprio: Option<State>,
}

/// What all images pass through, and those that have not yet.
struct Canonical {
    canonicalizer: Box<dyn Canonicalizer>,
    /// `[H, W]` of the environment's images.
    size: [usize; 2],
    /// Earlier and present observations, and goals, as they are.
    pixels: Vec<u8>,
    goals: Vec<u8>,
}

impl Canonical {
    /// Draws all images of each of `rows` environments, each by itself, in parallel: each observation beside the goal, and the goal
    /// beside the present one.
    fn draw(&self, rows: usize) -> Result<[Vec<u8>; 2], BaselineError> {
        let [height, width] = self.size;
        let image = 3 * height * width;
        let observed = self.pixels.len() / rows.max(1);
        let draw = |(pixels, goal): (&[u8], &[u8])| {
            let count = observed / image.max(1);
            let all = [pixels, goal].concat();
            let now = &pixels[observed.saturating_sub(image)..];
            let others = [&goal.repeat(count)[..], now].concat();
            let images =
                |values| Images { values, rows: count + 1, steps: 1, height, width, channels_last: true };
            self.canonicalizer.draw(&images(&all), &images(&others)).map(|drawn| (drawn, count))
        };
        let each = self.pixels.par_chunks(observed.max(1)).zip(self.goals.par_chunks(image.max(1)));
        let drawn: Vec<Result<(Vec<u8>, usize), BaselineError>> = each.map(draw).collect();
        let [mut pixels, mut goals] = [Vec::new(), Vec::new()];
        for drawn in drawn {
            let (drawn, count) = drawn?;
            let (observed, goal) = drawn.split_at(drawn.len() / (count + 1) * count);
            pixels.extend_from_slice(observed);
            goals.extend_from_slice(goal);
        }
        Ok([pixels, goals])
    }
}

/// Single observations of B environments.
pub(super) struct Seen<'a> {
    values: Cow<'a, [u8]>,
    proprio: Option<(Cow<'a, [f32]>, usize)>,
    rows: usize,
    size: [usize; 2],
}

impl Seen<'_> {
    /// `[B, 1, …]`.
    pub(super) fn pixels(&self) -> Images<'_> {
        let &Self { ref values, rows, size: [height, width], .. } = self;
        Images { values, rows, steps: 1, height, width, channels_last: true }
    }

    /// `[B, 1, …]`.
    pub(super) fn proprio(&self) -> Option<Vectors<'_>> {
        let (values, dim) = self.proprio.as_ref()?;
        Some(Vectors { values, rows: self.rows, steps: 1, dim: *dim })
    }
}

/// `proprio` of observations and goals.
#[derive(Debug)]
struct State {
    scale: Scale,
    now: Vec<f32>,
    goal: Vec<f32>,
}

impl PlanningTable {
    /// For a model that was trained on such data.
    pub(super) fn new(baseline: &dyn Baseline, data: &DataConfig) -> Self {
        let scale = |scales: &BTreeMap<String, Scale>| scales.get(PROPRIO).cloned();
        let needed = baseline.input_spec().proprio.then(|| scale(&data.scales)).flatten();
        Self {
            block: baseline.input_spec().frameskip * data.action,
            proprio: needed.map(|scale| State { scale, now: Vec::new(), goal: Vec::new() }),
            ..Self::default()
        }
    }

    /// With all images drawn in the canonical look.
    pub(super) fn with_canonical(mut self, canonicalizer: Option<Box<dyn Canonicalizer>>) -> Self {
        self.canonical = canonicalizer.map(|canonicalizer| Canonical {
            canonicalizer,
            size: [0; 2],
            pixels: Vec::new(),
            goals: Vec::new(),
        });
        self
    }

    /// The fields whose history the model uses.
    pub(super) fn fields(&self) -> Vec<String> {
        let proprio = self.proprio.as_ref().map(|_| PROPRIO.to_owned());
        [PIXELS.to_owned()].into_iter().chain(proprio).collect()
    }

    /// Empties the batch; the next problems have `frames` observations each.
    pub(super) fn clear(&mut self, frames: usize) {
        (self.rows, self.frames) = (0, frames);
        self.pixels.clear();
        self.goal_pixels.clear();
        if let Some(canonical) = &mut self.canonical {
            canonical.pixels.clear();
            canonical.goals.clear();
        }
        self.action.clear();
        if let Some(State { now, goal, .. }) = &mut self.proprio {
            now.clear();
            goal.clear();
        }
    }

    /// Adds the current observation and goal of an environment, after its history (see [`PlanningTable::push_past`]), if it has one.
    pub(super) fn push(&mut self, row: Row<'_>) -> Result<(), BaselineError> {
        let size = size_of(row, PIXELS)?;
        if size != size_of(row, GOAL)? {
            return Err(BaselineError::data(GOAL, "the image of the goal has another size than `pixels`"));
        }
        let [now, goal] = [bytes(row, PIXELS)?, bytes(row, GOAL)?];
        self.size = size;
        let Self { pixels, goal_pixels, canonical, .. } = self;
        let (pixels, goals) = match canonical {
            Some(canonical) => {
                canonical.size = size;
                (&mut canonical.pixels, &mut canonical.goals)
            }
            None => (pixels, goal_pixels),
        };
        pixels.extend_from_slice(now);
        goals.extend_from_slice(goal);
        if let Some(State { scale, now, goal }) = &mut self.proprio {
            let found = GOAL_PROPRIO.iter().find(|name| row.schema().index(name).is_some());
            let found = found.ok_or_else(|| {
                BaselineError::data(
                    "goal_proprio",
                    "the environment does not have it, and the model was trained with it",
                )
            })?;
            scaled(scale, vector(row, PROPRIO)?, now);
            scaled(scale, vector(row, found)?, goal);
        }
        self.rows += 1;
        Ok(())
    }

    /// Adds an earlier observation of the environment whose current one comes next.
    pub(super) fn push_past<'a>(&mut self, field: impl Fn(usize) -> Slice<'a>) -> Result<(), BaselineError> {
        let Slice::U8(pixels) = field(0) else { return Err(no_images(PIXELS, false)) };
        let seen = self.canonical.as_mut().map_or(&mut self.pixels, |canonical| &mut canonical.pixels);
        seen.extend_from_slice(pixels);
        if let Some(State { scale, now, .. }) = &mut self.proprio {
            scaled(scale, field(1), now);
        }
        Ok(())
    }

    /// Adds one scaled action `[A]` between two observations.
    pub(super) fn push_action(&mut self, action: &[f32]) {
        self.action.extend_from_slice(action);
    }

    /// Ends a batch: draws its images in the canonical look, if there is one.
    pub(super) fn finish(&mut self) -> Result<(), BaselineError> {
        if let Some(canonical) = &self.canonical {
            [self.pixels, self.goal_pixels] = canonical.draw(self.rows)?;
            self.size = [canonical.canonicalizer.side(); 2];
        }
        Ok(())
    }

    /// The present observations, and the goals, of a batch that is finished.
    pub(super) fn present_and_goals(&self) -> [Seen<'_>; 2] {
        let &Self { rows, frames, size, .. } = self;
        let state = |values: fn(&State) -> &Vec<f32>, frames| {
            let state = self.proprio.as_ref()?;
            let dim = state.scale.mean.len();
            Some((newest(values(state), frames, dim), dim))
        };
        let image = 3 * size[0] * size[1];
        let (now, goal) = (newest(&self.pixels, frames, image), newest(&self.goal_pixels, 1, image));
        [
            Seen { values: now, proprio: state(|state| &state.now, frames), rows, size },
            Seen { values: goal, proprio: state(|state| &state.goal, 1), rows, size },
        ]
    }

    /// The planning batch, once it is finished.
    pub(super) fn batch(&self) -> PlanningBatch<'_> {
        let &Self { rows, frames, size: [height, width], block, .. } = self;
        let images = |values, steps| Images { values, rows, steps, height, width, channels_last: true };
        let state = |values, steps, scale: &Scale| Vectors { values, rows, steps, dim: scale.mean.len() };
        PlanningBatch {
            pixels: images(&self.pixels, frames),
            action: Vectors { values: &self.action, rows, steps: frames - 1, dim: block },
            proprio: self.proprio.as_ref().map(|known| state(&known.now, frames, &known.scale)),
            goal_pixels: images(&self.goal_pixels, 1),
            goal_proprio: self.proprio.as_ref().map(|known| state(&known.goal, 1, &known.scale)),
        }
    }
}

/// The newest of `frames` items of `size` values in each row.
fn newest<V: Clone>(values: &[V], frames: usize, size: usize) -> Cow<'_, [V]> {
    if frames <= 1 {
        return Cow::Borrowed(values);
    }
    let rows = values.chunks_exact((frames * size).max(1));
    rows.flat_map(|row| row[(frames - 1) * size..].iter().cloned()).collect()
}

/// Why there are no images of this name, where there are none at all or, `beside` others, none of the goal.
fn no_images(name: &'static str, beside: bool) -> BaselineError {
    let reason = if beside {
        "the environment has images, and none of its goal, to which the model plans; choose a task whose goals are whole states, such \
         as Reacher's `qpos_match`"
    } else {
        "the environment shows no such images, and the model sees nothing else; set the size of images, such as 64x64, \
         in the manifest, or in the request where there is no manifest"
    };
    BaselineError::data(name, reason)
}

/// `[H, W]` of an image.
pub(super) fn size_of(row: Row<'_>, name: &'static str) -> Result<[usize; 2], BaselineError> {
    let schema = row.schema();
    let index = schema.index(name).ok_or_else(|| no_images(name, schema.index(PIXELS).is_some()))?;
    match schema.fields()[index].shape[..] {
        [height, width, 3] => Ok([height, width]),
        _ => Err(no_images(name, false)),
    }
}

pub(super) fn bytes<'a>(row: Row<'a>, name: &'static str) -> Result<&'a [u8], BaselineError> {
    row.get(name).map_err(|error| BaselineError::data(name, error.to_string()))
}

pub(super) fn vector<'a>(row: Row<'a>, name: &str) -> Result<Slice<'a>, BaselineError> {
    match row.schema().index(name) {
        Some(index) => Ok(row.at(index)),
        None => Err(BaselineError::data(
            PROPRIO,
            "the environment does not have it, and the model was trained with it",
        )),
    }
}

pub(super) fn scaled(scale: &Scale, values: Slice<'_>, out: &mut Vec<f32>) {
    let start = out.len();
    out.extend((0..values.len()).map(|at| values.as_f64(at).unwrap_or(f64::NAN) as f32));
    scale.apply(&mut out[start..]);
}

#[cfg(test)]
mod tests {
    use swm_core::{Batch, Dtype, Field, Schema};

    use super::*;

    const BYTES: usize = 12;

    /// Draws images of one value as ten times that value and once that of the other.
    struct Mixer;

    impl Canonicalizer for Mixer {
        fn side(&self) -> usize {
            2
        }

        fn draw(&self, images: &Images<'_>, others: &Images<'_>) -> Result<Vec<u8>, BaselineError> {
            assert_eq!((images.rows, images.steps), (others.rows, others.steps));
            let pairs = images.values.chunks(BYTES).zip(others.values.chunks(BYTES));
            Ok(pairs.flat_map(|(image, other)| vec![10 * image[0] + other[0]; BYTES]).collect())
        }

        fn share(&self) -> Box<dyn Canonicalizer> {
            Box::new(Self)
        }
    }

    fn observed(now: u8, goal: u8) -> Batch {
        let fields =
            [Field::step(PIXELS, Dtype::U8, &[2, 2, 3]), Field::episode(GOAL, Dtype::U8, &[2, 2, 3])];
        let mut batch = Batch::new(Schema::new(fields.to_vec()).unwrap(), 1);
        batch.rows_mut().at::<u8>(0).fill(now);
        batch.rows_mut().at::<u8>(1).fill(goal);
        batch
    }

    #[test]
    fn an_environment_without_images_of_its_goal_is_told_from_one_without_images() {
        let message = |names: &[&str]| {
            let fields = names.iter().map(|name| Field::step(name, Dtype::U8, &[2, 2, 3])).collect();
            let batch = Batch::new(Schema::new(fields).unwrap(), 1);
            PlanningTable::default().push(batch.row(0)).unwrap_err().to_string()
        };
        assert!(message(&["other"]).contains("`pixels`: the environment shows no such images"));
        assert!(message(&[PIXELS]).contains("`goal`: the environment has images, and none of its goal"));
    }

    #[test]
    fn observations_are_drawn_beside_the_goal_and_the_goal_beside_the_present_one() {
        let mut table = PlanningTable::default().with_canonical(Some(Box::new(Mixer)));
        // Twice: what is left of an earlier batch must not come back.
        for _ in 0..2 {
            table.clear(2);
            for (past, now, goal) in [(1, 2, 3), (4, 5, 6)] {
                let past = [past; BYTES];
                table.push_past(|_| Slice::U8(&past)).unwrap();
                table.push(observed(now, goal).row(0)).unwrap();
            }
            table.finish().unwrap();
            let batch = table.batch();
            let values = |images: Images<'_>| -> Vec<u8> {
                images.values.chunks(BYTES).map(|image| image[0]).collect()
            };
            assert_eq!(values(batch.pixels), [13, 23, 46, 56]);
            assert_eq!(values(batch.goal_pixels), [32, 65]);
            assert_eq!((batch.pixels.steps, batch.pixels.height, batch.pixels.rows), (2, 2, 2));
            let [now, goal] = table.present_and_goals();
            assert_eq!((values(now.pixels()), values(goal.pixels())), (vec![23, 56], vec![32, 65]));
        }
    }

    #[test]
    fn without_a_canonical_look_images_stay_as_they_are() {
        let mut table = PlanningTable::default();
        table.clear(1);
        table.push(observed(7, 9).row(0)).unwrap();
        table.finish().unwrap();
        assert_eq!(
            (table.batch().pixels.values, table.batch().goal_pixels.values),
            (&[7; BYTES][..], &[9; BYTES][..])
        );
    }
}

//! What stands between the renderer and everyone who looks: transforms of images, keyed by episode and step, so that a
//! image that is shown twice is the same. Which transforms there are is not known here.

use std::fmt;
use std::sync::Arc;

use crate::batch::{Dtype, FieldKind, RowsMut, Schema};
use crate::env::ImageSize;
use crate::run::LiveEpisode;
use crate::seed::{EpisodeSeed, Stream};

/// Changes images. A pure function of the image, the episode, the step and the view.
pub trait Transform: Send + Sync {
    /// Its name with its settings: what makes it again.
    fn describe(&self) -> String;

    /// Changes one image in place.
    fn apply(&self, frame: &mut Frame<'_>);

    /// Whether goal images (fields that are constant in an episode) are changed too. The reference never does.
    fn changes_goals(&self) -> bool {
        false
    }
}

/// An image, and what its change may depend on.
#[non_exhaustive]
pub struct Frame<'a> {
    /// `[H, W, 3]`, row-major.
    pub pixels: &'a mut [u8],
    /// H.
    pub height: usize,
    /// W.
    pub width: usize,
    /// Seed of the episode.
    pub seed: EpisodeSeed,
    /// Steps taken: 0 at the start.
    pub step: u64,
    /// Which of the images of a row this is.
    pub view: u64,
    /// Memory to work in; its content has no meaning.
    pub scratch: &'a mut Scratch,
}

impl<'a> Frame<'a> {
    /// An image `[H, W, 3]` of `size`, at the start of the episode of `seed`.
    pub fn new(pixels: &'a mut [u8], size: ImageSize, seed: EpisodeSeed, scratch: &'a mut Scratch) -> Self {
        Self { pixels, height: size.height, width: size.width, seed, step: 0, view: 0, scratch }
    }

    /// The stream for `purpose`, of the whole episode.
    pub fn of_episode(&self, purpose: &str) -> Stream {
        self.seed.indexed(purpose, [u64::MAX, self.view])
    }

    /// The stream for `purpose`, of this step.
    pub fn of_step(&self, purpose: &str) -> Stream {
        self.seed.indexed(purpose, [self.step, self.view])
    }
}

/// Memory that transforms share from step to step.
#[derive(Debug, Default)]
pub struct Scratch {
    /// Bytes.
    pub bytes: Vec<u8>,
    /// Numbers.
    pub numbers: Vec<f32>,
}

/// A transform, and the fields of a table that it changes.
#[derive(Clone)]
pub(crate) struct Frames {
    transform: Arc<dyn Transform>,
    /// Position, height, width.
    views: Vec<[usize; 3]>,
    goals: Vec<[usize; 3]>,
}

impl Frames {
    pub(crate) fn new(transform: Arc<dyn Transform>, schema: &Schema) -> Self {
        let images = |kind: FieldKind| -> Vec<[usize; 3]> {
            let fields = schema.fields().iter().enumerate();
            fields
                .filter(|(_, field)| field.kind == kind && field.dtype == Dtype::U8)
                .filter_map(|(index, field)| match field.shape[..] {
                    [height, width, 3] => Some([index, height, width]),
                    _ => None,
                })
                .collect()
        };
        let goals = if transform.changes_goals() { images(FieldKind::Episode) } else { Vec::new() };
        Self { views: images(FieldKind::Step), goals, transform }
    }

    /// Changes the images of the selected row; those of the goal at the start of an episode.
    pub(crate) fn show(&self, episode: LiveEpisode, scratch: &mut Scratch, out: &mut RowsMut<'_>) {
        let goals = if episode.step == 0 { &self.goals[..] } else { &[] };
        for (view, &[index, height, width]) in (0..).zip(self.views.iter().chain(goals)) {
            let (seed, step) = (episode.seed, episode.step);
            let pixels = out.at::<u8>(index);
            self.transform.apply(&mut Frame { pixels, height, width, seed, step, view, scratch });
        }
    }
}

impl fmt::Debug for Frames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Frames").field(&self.transform.describe()).finish()
    }
}

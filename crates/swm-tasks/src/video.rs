//! A recorder that keeps the images of chosen episodes.

use std::collections::BTreeMap;

use swm_core::env::PIXELS;
use swm_core::error::BoxError;
use swm_core::{EpisodeEnd, LiveStep, Recorder, RunInfo};
use swm_media::{Clip, png};

use crate::error::TaskError;
use crate::svg::data_address;

/// Videos the first episodes of a run, one clip each.
#[derive(Debug, Default)]
pub struct Video {
    episodes: u64,
    first: u64,
    frames_per_second: f64,
    pixels: usize,
    size: [usize; 2],
    /// The clip of every recorded episode, and how it ended.
    scenes: BTreeMap<u64, Scene>,
}

/// One recorded episode.
#[derive(Debug)]
#[non_exhaustive]
pub struct Scene {
    /// Its images, first to last.
    pub clip: Clip,
    /// The goal image, if the environment shows one: `[H, W, 3]`.
    pub goal: Option<Vec<u8>>,
    /// How it ended; `None` if it was cut short.
    pub end: Option<EpisodeEnd>,
}

impl Scene {
    /// The goal image for a page, as a PNG inside of it.
    pub(crate) fn goal_address(&self) -> Result<Option<String>, TaskError> {
        let Some(goal) = &self.goal else { return Ok(None) };
        let png = png::encode(self.clip.height(), self.clip.width(), goal)?;
        Ok(Some(data_address("image/png", &png)))
    }
}

impl Video {
    /// Videos the first `episodes` episodes.
    pub fn first(episodes: u64) -> Self {
        Self { episodes, ..Self::default() }
    }

    /// The recorded episodes, by index.
    pub fn scenes(&self) -> impl Iterator<Item = (u64, &Scene)> {
        self.scenes.iter().map(|(&index, scene)| (index, scene))
    }

    /// Gives up what it holds of one episode.
    pub fn take(&mut self, episode: u64) -> Option<Scene> {
        self.scenes.remove(&episode)
    }

    fn wants(&self, episode: u64) -> bool {
        self.size[0] > 0 && episode - self.first < self.episodes
    }
}

impl Recorder for Video {
    fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        self.first = run.rollout.episodes.start;
        // Real time, but never slower than 5 images a second nor faster than 30.
        self.frames_per_second =
            (1.0 / (run.spec.time_step_s * f64::from(run.options.frame_skip))).clamp(5.0, 30.0);
        if let Some(index) = run.schema.index(PIXELS) {
            self.pixels = index;
            let shape = &run.schema.fields()[index].shape;
            self.size = [shape[0], shape[1]];
        }
        Ok(())
    }

    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        if !self.wants(row.episode.index) {
            return Ok(());
        }
        let [height, width] = self.size;
        let fps = self.frames_per_second;
        let scene = self.scenes.entry(row.episode.index).or_insert_with(|| Scene {
            clip: Clip::new(height, width, fps),
            goal: row.values.get::<u8>("goal").ok().map(<[u8]>::to_vec),
            end: None,
        });
        let pixels = row.values.at(self.pixels).get::<u8>().ok_or("the field `pixels` holds no u8")?;
        Ok(scene.clip.push(pixels)?)
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        if let Some(scene) = self.scenes.get_mut(&end.index) {
            scene.end = Some(*end);
        }
        Ok(())
    }
}

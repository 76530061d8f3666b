//! What a clip is, which goal it gets, and how clips are put into batches: the settings of a loader.

use std::path::PathBuf;

use swm_core::ImageSize;

use super::Clips;

/// What a clip is.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ClipOptions {
    /// Rows of a clip, as seen by the model.
    pub num_steps: usize,
    /// Distance in the dataset between two of them.
    pub frameskip: usize,
    /// The wanted columns; `None` or an empty list: all.
    pub keys: Option<Vec<String>>,
    /// Where clips start.
    pub clips: Clips,
    /// The order of image axes.
    pub images: Images,
    /// The size of images; `None`: as stored. Resized by an antialiased bilinear filter, as torchvision does.
    pub image: Option<ImageSize>,
    /// Adds a sampled goal to every clip.
    pub goals: Option<GoalOptions>,
    /// Which rewards a clip holds.
    pub rewards: Rewards,
    /// Gives columns of f64 as f32, which is what models are trained in.
    pub float32: bool,
    /// Threads that read; `None`: one per core. Results do not depend on it.
    pub threads: Option<usize>,
    /// Decodes images once into files, from which all clips are then read; `None`: decodes them for every clip.
    pub cache: Option<CacheOptions>,
}

setters!(ClipOptions {
    num_steps: usize,
    frameskip: usize,
    keys: Option<Vec<String>>,
    clips: Clips,
    images: Images,
    image: Option<ImageSize>,
    goals: Option<GoalOptions>,
    rewards: Rewards,
    float32: bool,
    threads: Option<usize>,
    cache: Option<CacheOptions>,
});

/// Where decoded images are kept, and how many.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct CacheOptions {
    /// The most bytes that a loader writes.
    pub limit: u64,
    /// The folder of their folder; `None`: `DATASET.decoded` beside the dataset, or, where nothing can be written there, `decoded` in the folder of caches
    /// (`SWM_CACHE`, `SWM_HOME/cache`, or that of the system).
    pub folder: Option<PathBuf>,
}

setters!(CacheOptions {
    limit: u64,
    folder: Option<PathBuf>,
});

impl Default for CacheOptions {
    /// 20 GB, beside the dataset.
    fn default() -> Self {
        Self { limit: 20_000_000_000, folder: None }
    }
}

/// Which rewards a clip holds in its column `reward`.
///
/// A recorded row holds the reward of arriving at it: that of the action of the row before, and NaN in the first. In datasets of other programs, and in
/// copies of them, it holds the reward of its own action.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Rewards {
    /// The rows of the clip as recorded, `[num_steps, …]`; with a frame skip, one of so many.
    #[default]
    Recorded,
    /// Beside every row, the sum of the rewards of the `frameskip` actions taken from it on, `[num_steps, …]`: those of the
    /// rows after it, or, in datasets of other programs, of the rows from it on. NaN where the episode ends before.
    OfActions,
}

/// The order of axes of images (u8 columns of rank 3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Images {
    /// `[num_steps, H, W, C]`, as stored.
    #[default]
    ChannelsLast,
    /// `[num_steps, C, H, W]`, as the reference's loader gives them.
    ChannelsFirst,
}

impl Default for ClipOptions {
    /// Single rows, all columns, every start, no goals, values as recorded.
    fn default() -> Self {
        Self {
            num_steps: 1,
            frameskip: 1,
            keys: None,
            clips: Clips::default(),
            images: Images::default(),
            image: None,
            goals: None,
            rewards: Rewards::default(),
            float32: false,
            threads: None,
            cache: None,
        }
    }
}

/// Which row is the goal of a clip. The clip stands at its current row, `start + (offset - 1) × frameskip`; goals of the
/// future are a whole number of frame skips after it. Where a future kind has weight, clips without a later row are
/// left out.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct GoalOptions {
    /// Weights of the four kinds, which sum to 1.
    pub weights: GoalWeights,
    /// The discount of geometric goals: k frame skips ahead, k ~ Geom(1 − γ), cut at the episode's end.
    pub gamma: f64,
    /// Which row of the clip is the current one, counted from 1; `None`: the last, `num_steps`.
    pub offset: Option<usize>,
    /// Columns of the goal row, which become `goal_<name>` of shape `[1, …]`, in place of recorded columns of that name;
    /// `None`: `pixels` and `proprio`, as far as the dataset has them.
    pub keys: Option<Vec<String>>,
    /// The seed of the choice. A clip's goal depends on it, the epoch and the clip alone.
    pub seed: u64,
}

setters!(GoalOptions {
    weights: GoalWeights,
    gamma: f64,
    offset: Option<usize>,
    keys: Option<Vec<String>>,
    seed: u64,
});

/// How often each kind of goal is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GoalWeights {
    /// Any row of any episode.
    pub random: f64,
    /// A later row of the episode, near ones more often.
    pub geometric: f64,
    /// A later row of the episode, all equally often.
    pub uniform: f64,
    /// The current row itself.
    pub current: f64,
}

impl Default for GoalWeights {
    /// The reference's: 0.3, 0.5, 0, 0.2.
    fn default() -> Self {
        Self { random: 0.3, geometric: 0.5, uniform: 0.0, current: 0.2 }
    }
}

impl Default for GoalOptions {
    /// The reference's weights, γ = 0.99, seen from the end of the clip.
    fn default() -> Self {
        Self { weights: GoalWeights::default(), gamma: 0.99, offset: None, keys: None, seed: 0 }
    }
}

impl GoalOptions {
    /// Hindsight relabeling: the goal is what the episode reached later, every later row equally often.
    pub fn hindsight(keys: &[&str], seed: u64) -> Self {
        let weights = GoalWeights { random: 0.0, geometric: 0.0, uniform: 1.0, current: 0.0 };
        let keys = Some(keys.iter().map(|&key| key.to_owned()).collect());
        Self { weights, keys, seed, ..Self::default() }
    }
}

/// How clips are put into batches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct BatchOptions {
    /// Clips of a batch.
    pub size: usize,
    /// The seed of the order, which is another in every epoch; `None`: the order of the dataset.
    pub shuffle: Option<u64>,
    /// Leave out the last batch of an epoch if it is not full.
    pub drop_last: bool,
    /// How many passes over the clips; `None`: without end.
    pub epochs: Option<u64>,
    /// Batches that each thread may have read ahead: 1 to 1,024.
    pub ahead: usize,
    /// Rank and number of the processes that divide every epoch, for distributed training. The order of an epoch is
    /// that of one process; of it, rank `r` gives the clips `r`, `r + world`, …, equally many as every other rank: the
    /// last `clips mod world` are left out.
    pub shard: (usize, usize),
}

setters!(BatchOptions {
    size: usize,
    shuffle: Option<u64>,
    drop_last: bool,
    epochs: Option<u64>,
    ahead: usize,
});

impl BatchOptions {
    /// The same for rank `rank` of `world` processes.
    #[must_use]
    pub fn shard(mut self, rank: usize, world: usize) -> Self {
        self.shard = (rank, world);
        self
    }
}

impl Default for BatchOptions {
    /// Batches of 64 in the order of the dataset, without end, two read ahead per thread.
    fn default() -> Self {
        Self { size: 64, shuffle: None, drop_last: false, epochs: None, ahead: 2, shard: (0, 1) }
    }
}

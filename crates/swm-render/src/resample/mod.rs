//! Resampling, to the byte: the two filters that stand between the reference's canvas and its frames.

mod antialias;
mod fixed;

use std::ops::Range;

pub use antialias::AntialiasBilinear;
pub use fixed::FixedBilinear;

/// Which targets of a resize look at which sources, along one axis.
#[derive(Debug, Clone)]
struct Viewers {
    /// The first target that looks at this source or a later one, and how many targets look at one before it.
    starts: Vec<u32>,
    ends: Vec<u32>,
}

impl Viewers {
    /// For so many sources, from the two counts.
    fn new(sources: usize, start: impl Fn(usize) -> usize, end: impl Fn(usize) -> usize) -> Self {
        let table =
            |count: &dyn Fn(usize) -> usize| (0..=sources).map(|source| count(source) as u32).collect();
        Self { starts: table(&start), ends: table(&end) }
    }

    /// The targets that look at any of these sources.
    fn of(&self, sources: Range<usize>) -> Range<usize> {
        if sources.is_empty() {
            return 0..0;
        }
        let start = self.starts[sources.start] as usize;
        start..(self.ends[sources.end] as usize).max(start)
    }
}

//! Pieces of pixels that show one surface, sorted by surface.

use super::lanes::LANES;
use super::samples::{NOTHING, Samples};

/// Fragments in the order of their surfaces, and of pixels for each.
#[derive(Debug, Default)]
pub(super) struct Fragments {
    /// Positions in pixels.
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) nearness: Vec<f32>,
    pub(super) facet: Vec<u32>,
    /// Index of the pixel, and the share of it that the fragment is.
    pub(super) pixel: Vec<u32>,
    pub(super) share: Vec<f32>,
    /// Where the fragments of each surface begin; one more than surfaces.
    starts: Vec<usize>,
    unsorted: Vec<Fragment>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Fragment {
    x: f32,
    y: f32,
    nearness: f32,
    facet: u32,
    pixel: u32,
    share: f32,
    owner: u16,
}

impl Fragments {
    /// Fragments of a raster of pixels, of which `edges` (ascending) are known at the four points in `fine` each.
    pub(super) fn of_raster(&mut self, raster: &Samples, edges: &[u32], fine: &Samples, surfaces: usize) {
        self.unsorted.clear();
        let mut next = edges.iter().copied().enumerate().peekable();
        for pixel in 0..raster.len() {
            match next.next_if(|&(_, edge)| edge as usize == pixel) {
                Some((index, _)) => self.split(fine, 4 * index, pixel as u32),
                None => self.unsorted.push(Fragment {
                    x: raster.x[pixel],
                    y: raster.y[pixel],
                    nearness: raster.nearness[pixel],
                    facet: raster.facet[pixel],
                    pixel: pixel as u32,
                    share: 1.0,
                    owner: raster.owner[pixel],
                }),
            }
        }
        self.sort(surfaces);
    }

    /// Fragments of a list of samples that stand for fragments `of` another set, from its `first` on.
    pub(super) fn of_list(&mut self, list: &Samples, of: &Fragments, first: usize, surfaces: usize) {
        self.unsorted.clear();
        for at in 0..list.len() {
            if list.owner[at] != NOTHING {
                self.unsorted.push(Fragment {
                    x: list.x[at],
                    y: list.y[at],
                    nearness: list.nearness[at],
                    facet: list.facet[at],
                    pixel: of.pixel[first + at],
                    share: of.share[first + at],
                    owner: list.owner[at],
                });
            }
        }
        self.sort(surfaces);
    }

    /// One pixel from four points: one fragment per surface, at the middle of its points.
    fn split(&mut self, fine: &Samples, first: usize, pixel: u32) {
        let owners = [0, 1, 2, 3].map(|k| fine.owner[first + k]);
        for k in 0..4 {
            if owners[..k].contains(&owners[k]) {
                continue;
            }
            let mut sum =
                Fragment { facet: fine.facet[first + k], pixel, owner: owners[k], ..Fragment::default() };
            let mut count = 0.0;
            for at in (first..first + 4).filter(|&at| fine.owner[at] == owners[k]) {
                sum.x += fine.x[at];
                sum.y += fine.y[at];
                sum.nearness += fine.nearness[at];
                count += 1.0;
            }
            let mean = |value: f32| value / count;
            let (x, y, nearness) = (mean(sum.x), mean(sum.y), mean(sum.nearness));
            self.unsorted.push(Fragment { x, y, nearness, share: count / 4.0, ..sum });
        }
    }

    fn sort(&mut self, surfaces: usize) {
        let slot = |owner: u16| if owner == NOTHING { surfaces } else { usize::from(owner) };
        self.starts.clear();
        self.starts.resize(surfaces + 2, 0);
        for fragment in &self.unsorted {
            self.starts[slot(fragment.owner) + 1] += 1;
        }
        for surface in 0..=surfaces {
            self.starts[surface + 1] += self.starts[surface];
        }
        let padded = self.unsorted.len() + LANES;
        for column in [&mut self.x, &mut self.y, &mut self.nearness, &mut self.share] {
            column.resize(padded, 0.0);
        }
        self.facet.resize(padded, 0);
        self.pixel.resize(padded, 0);
        for fragment in &self.unsorted {
            let start = &mut self.starts[slot(fragment.owner)];
            let at = *start;
            *start += 1;
            self.x[at] = fragment.x;
            self.y[at] = fragment.y;
            self.nearness[at] = fragment.nearness;
            self.facet[at] = fragment.facet;
            self.pixel[at] = fragment.pixel;
            self.share[at] = fragment.share;
        }
        // Every start has moved to the next one's place.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    /// The fragments of one surface; of number `surfaces`: of none.
    pub(super) fn of(&self, surface: usize) -> std::ops::Range<usize> {
        self.starts[surface]..self.starts[surface + 1]
    }
}

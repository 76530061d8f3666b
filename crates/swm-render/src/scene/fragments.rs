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
    /// What edges are split into.
    pieces: Vec<Fragment>,
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

/// Surfaces in their order, then what shows nothing.
#[inline]
fn slot(owner: u16, surfaces: usize) -> usize {
    if owner == NOTHING { surfaces } else { usize::from(owner) }
}

impl Fragments {
    /// Fragments of a raster of pixels, of which `edges` (ascending) are known at the four points in `fine` each.
    pub(super) fn of_raster(&mut self, raster: &Samples, edges: &[u32], fine: &Samples, surfaces: usize) {
        self.pieces.clear();
        for (index, &pixel) in edges.iter().enumerate() {
            self.split(fine, 4 * index, pixel);
        }
        self.begin(surfaces);
        for &owner in &raster.owner[..raster.len()] {
            self.starts[slot(owner, surfaces) + 1] += 1;
        }
        for &pixel in edges {
            self.starts[slot(raster.owner[pixel as usize], surfaces) + 1] -= 1;
        }
        for piece in &self.pieces {
            self.starts[slot(piece.owner, surfaces) + 1] += 1;
        }
        self.make_room(surfaces);
        // Whole pixels between edges, and the pieces of each edge: pixels ascend for every surface.
        let (mut pixel, mut piece) = (0, 0);
        for &edge in edges.iter().chain([&(raster.len() as u32)]) {
            while pixel < edge as usize {
                let whole = Fragment {
                    x: raster.x[pixel],
                    y: raster.y[pixel],
                    nearness: raster.nearness[pixel],
                    facet: raster.facet[pixel],
                    pixel: pixel as u32,
                    share: 1.0,
                    owner: raster.owner[pixel],
                };
                self.place(whole, surfaces);
                pixel += 1;
            }
            while let Some(&part) = self.pieces.get(piece).filter(|part| part.pixel == edge) {
                self.place(part, surfaces);
                piece += 1;
            }
            pixel += 1;
        }
        self.settle();
    }

    /// Fragments of a list of samples that stand for fragments `of` another set, from its `first` on.
    pub(super) fn of_list(&mut self, list: &Samples, of: &Fragments, first: usize, surfaces: usize) {
        self.begin(surfaces);
        for &owner in &list.owner[..list.len()] {
            self.starts[slot(owner, surfaces) + 1] += 1;
        }
        self.make_room(surfaces);
        for at in 0..list.len() {
            let fragment = Fragment {
                x: list.x[at],
                y: list.y[at],
                nearness: list.nearness[at],
                facet: list.facet[at],
                pixel: of.pixel[first + at],
                share: of.share[first + at],
                owner: list.owner[at],
            };
            self.place(fragment, surfaces);
        }
        self.settle();
    }

    /// One pixel from four points: one fragment per surface, at the middle of its points.
    fn split(&mut self, fine: &Samples, first: usize, pixel: u32) {
        let owners = [0, 1, 2, 3].map(|k| fine.owner[first + k]);
        for k in 0..4 {
            if owners[..k].contains(&owners[k]) {
                continue;
            }
            let (facet, owner) = (fine.facet[first + k], owners[k]);
            let mut sum = Fragment { facet, pixel, owner, ..Fragment::default() };
            let mut count = 0.0;
            for at in (first..first + 4).filter(|&at| fine.owner[at] == owner) {
                sum.x += fine.x[at];
                sum.y += fine.y[at];
                sum.nearness += fine.nearness[at];
                count += 1.0;
            }
            let mean = |value: f32| value / count;
            let (x, y, nearness) = (mean(sum.x), mean(sum.y), mean(sum.nearness));
            self.pieces.push(Fragment { x, y, nearness, share: count / 4.0, ..sum });
        }
    }

    fn begin(&mut self, surfaces: usize) {
        self.starts.clear();
        self.starts.resize(surfaces + 2, 0);
    }

    /// From counts to beginnings.
    fn make_room(&mut self, surfaces: usize) {
        for surface in 0..=surfaces {
            self.starts[surface + 1] += self.starts[surface];
        }
        let padded = self.starts[surfaces + 1] + LANES;
        for column in [&mut self.x, &mut self.y, &mut self.nearness, &mut self.share] {
            column.resize(padded, 0.0);
        }
        self.facet.resize(padded, 0);
        self.pixel.resize(padded, 0);
    }

    /// Writes the next fragment of its surface.
    #[inline]
    fn place(&mut self, fragment: Fragment, surfaces: usize) {
        let start = &mut self.starts[slot(fragment.owner, surfaces)];
        let at = *start;
        *start += 1;
        self.x[at] = fragment.x;
        self.y[at] = fragment.y;
        self.nearness[at] = fragment.nearness;
        self.facet[at] = fragment.facet;
        self.pixel[at] = fragment.pixel;
        self.share[at] = fragment.share;
    }

    /// Every beginning has moved to the next one's place: moves them back.
    fn settle(&mut self) {
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    /// The fragments of one surface; of number `surfaces`: of none.
    pub(super) fn of(&self, surface: usize) -> std::ops::Range<usize> {
        self.starts[surface]..self.starts[surface + 1]
    }
}

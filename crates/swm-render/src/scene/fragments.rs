//! Pieces of pixels that show one surface, sorted by surface.

use super::grid::Raster;
use super::lanes::{LANES, Lanes, splat};
use super::samples::Samples;
use super::target::{NOTHING, Target};

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
    /// Whole pixels side by side that show one surface.
    runs: Vec<Run>,
}

#[derive(Clone, Copy, Debug)]
struct Run {
    pixel: usize,
    length: usize,
    owner: u16,
}

#[derive(Clone, Copy, Debug)]
struct Fragment {
    x: f32,
    y: f32,
    nearness: f32,
    facet: u32,
    pixel: u32,
    share: f32,
    owner: u16,
}

/// How many pixels from the first on show what the first does.
#[inline]
fn alike(owners: &[u16]) -> usize {
    let first = owners[0];
    let whole = owners
        .chunks_exact(16)
        .take_while(|chunk| chunk.iter().fold(0, |bits, owner| bits | (owner ^ first)) == 0);
    let start = 16 * whole.count();
    start + owners[start..].iter().position(|&owner| owner != first).unwrap_or(owners.len() - start)
}

/// Surfaces in their order, then what shows nothing.
#[inline]
fn slot(owner: u16, surfaces: usize) -> usize {
    if owner == NOTHING { surfaces } else { usize::from(owner) }
}

impl Fragments {
    /// Makes room for so many fragments.
    pub(super) fn reserve(&mut self, count: usize) {
        for column in [&mut self.x, &mut self.y, &mut self.nearness, &mut self.share] {
            column.reserve(count);
        }
        self.facet.reserve(count);
        self.pixel.reserve(count);
        self.pieces.reserve(count / 2);
        self.runs.reserve(count / 2);
    }

    /// Fragments of a raster of pixels, of which `edges` (ascending) are known at the four points in `fine` each.
    pub(super) fn of_raster(&mut self, raster: &Raster, edges: &[u32], fine: &Samples, surfaces: usize) {
        self.pieces.clear();
        for (index, &pixel) in edges.iter().enumerate() {
            self.split(fine, 4 * index, pixel);
        }
        self.find_runs(raster, edges);
        self.begin(surfaces);
        for run in &self.runs {
            self.starts[slot(run.owner, surfaces) + 1] += run.length;
        }
        for piece in &self.pieces {
            self.starts[slot(piece.owner, surfaces) + 1] += 1;
        }
        self.make_room(surfaces);
        // Runs and pieces, in the order of their pixels.
        let mut piece = 0;
        for index in 0..self.runs.len() {
            let run = self.runs[index];
            while let Some(&part) = self.pieces.get(piece).filter(|part| (part.pixel as usize) < run.pixel) {
                self.place(part, surfaces);
                piece += 1;
            }
            self.place_run(run, raster, surfaces);
        }
        while let Some(&part) = self.pieces.get(piece) {
            self.place(part, surfaces);
            piece += 1;
        }
        self.settle();
    }

    /// What lies between edges, cut where rows end.
    fn find_runs(&mut self, raster: &Raster, edges: &[u32]) {
        self.runs.clear();
        let (width, mut pixel) = (raster.width(), 0);
        for &edge in edges.iter().chain([&(raster.len() as u32)]) {
            while pixel < edge as usize {
                let row_end = (pixel / width + 1) * width;
                let stretch = &raster.known.owner[pixel..row_end.min(edge as usize)];
                // Neighbors that are no edges show the same, unless edges were not looked for.
                let owner = stretch[0];
                let length = alike(stretch);
                self.runs.push(Run { pixel, length, owner });
                pixel += length;
            }
            pixel += 1;
        }
    }

    /// Fragments of a list of points; `whole` says of each to which pixel it belongs and which share of it is.
    pub(super) fn of_list(&mut self, list: &Samples, surfaces: usize, whole: impl Fn(usize) -> (u32, f32)) {
        self.begin(surfaces);
        for &owner in &list.owner[..list.len()] {
            self.starts[slot(owner, surfaces) + 1] += 1;
        }
        self.make_room(surfaces);
        for at in 0..list.len() {
            if list.owner[at] == NOTHING {
                continue;
            }
            let (pixel, share) = whole(at);
            let fragment = Fragment {
                x: list.x[at],
                y: list.y[at],
                nearness: list.nearness[at],
                facet: list.facet[at],
                pixel,
                share,
                owner: list.owner[at],
            };
            self.place(fragment, surfaces);
        }
        let nothing = &mut self.starts[surfaces];
        *nothing = list.len();
        self.settle();
    }

    /// Fragments of a window in an image of this width in which one surface is drawn: its pixels, row by row.
    pub(super) fn of_window(&mut self, window: &Raster, width: usize) {
        let area = window.area();
        self.starts.clear();
        self.starts.extend([0, window.len()]);
        self.make_room(0);
        let mut count = 0;
        for row in area.y0..area.y1 {
            let range = window.within(row, area.x0, area.x1);
            let owners = &window.known.owner[range.clone()];
            for (group, owners) in owners.chunks(LANES).enumerate() {
                if owners.iter().all(|&owner| owner == NOTHING) {
                    continue;
                }
                for (offset, _) in owners.iter().enumerate().filter(|(_, owner)| **owner != NOTHING) {
                    let column = LANES * group + offset;
                    let (at, x) = (range.start + column, area.x0 + column);
                    self.x[count] = x as i32 as f32 + 0.5;
                    self.y[count] = row as i32 as f32 + 0.5;
                    self.nearness[count] = window.nearness[at];
                    self.facet[count] = window.known.facet[at];
                    self.pixel[count] = (row * width + x) as u32;
                    count += 1;
                }
            }
        }
        self.starts[1] = count;
    }

    /// One pixel from four points: one fragment per surface, at the middle of its points.
    fn split(&mut self, fine: &Samples, first: usize, pixel: u32) {
        /// The points of the pixel.
        #[inline]
        fn four<T: Copy + Default>(values: &[T], first: usize) -> [T; 4] {
            values[first..].first_chunk().copied().unwrap_or_default()
        }
        let owners: [u16; 4] = four(&fine.owner, first);
        let facets: [u32; 4] = four(&fine.facet, first);
        let [x, y, nearness]: [[f32; 4]; 3] =
            [&fine.x, &fine.y, &fine.nearness].map(|column| four(column, first));
        for k in 0..4 {
            if owners[..k].contains(&owners[k]) {
                continue;
            }
            let (facet, owner) = (facets[k], owners[k]);
            // What belongs to others counts zero times: adding nothing is quicker than asking whether to add.
            let times = owners.map(|other| f32::from(u8::from(other == owner)));
            let count: f32 = times.iter().sum();
            let mean = |values: [f32; 4]| (0..4).fold(0.0, |sum, at| sum + times[at] * values[at]) / count;
            let (x, y, nearness) = (mean(x), mean(y), mean(nearness));
            self.pieces.push(Fragment { x, y, nearness, facet, pixel, share: count / 4.0, owner });
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

    /// Writes the next fragments of a surface: whole pixels of one row.
    #[inline]
    fn place_run(&mut self, run: Run, raster: &Raster, surfaces: usize) {
        let Run { pixel, length, owner } = run;
        let start = &mut self.starts[slot(owner, surfaces)];
        let to = *start..*start + length;
        *start = to.end;
        let from = pixel..pixel + length;
        self.nearness[to.clone()].copy_from_slice(&raster.nearness[from.clone()]);
        self.facet[to.clone()].copy_from_slice(&raster.known.facet[from]);
        self.share[to.clone()].fill(1.0);
        let (x, y) = (pixel % raster.width(), pixel / raster.width());
        self.y[to.clone()].fill(y as i32 as f32 + 0.5);
        for (place, column) in self.x[to.clone()].iter_mut().zip(x as i32..) {
            *place = column as f32 + 0.5;
        }
        for (place, index) in self.pixel[to].iter_mut().zip(pixel as u32..) {
            *place = index;
        }
    }

    /// Every beginning has moved to the next one's place: moves them back.
    fn settle(&mut self) {
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    /// The first of eight pixels side by side that the eight fragments from `at` on are all of; `None` if they are others. A
    /// pixel that shows one surface has no other fragment.
    #[inline]
    pub(super) fn whole_pixels(&self, at: usize) -> Option<usize> {
        let pixels = self.pixel[at..].first_chunk::<LANES>()?;
        let shares = self.share[at..].first_chunk::<LANES>()?;
        // Fragments stand in the order of their pixels, and a pixel of which there are several has parts of them.
        let is_run = pixels[LANES - 1].wrapping_sub(pixels[0]) == LANES as u32 - 1;
        (is_run && Lanes::new(*shares).simd_eq(splat(1.0)).to_bitmask() == 0xff).then_some(pixels[0] as usize)
    }

    /// The fragments of one surface; of number `surfaces`: of none.
    pub(super) fn of(&self, surface: usize) -> std::ops::Range<usize> {
        self.starts[surface]..self.starts[surface + 1]
    }
}

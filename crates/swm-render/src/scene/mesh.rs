//! Triangle meshes, with coarser versions of themselves for small images.

use std::collections::HashMap;

use super::simplify;
use super::vector::{cross, dot, wide};
use crate::error::RenderError;

/// A triangle mesh. Front faces are counter-clockwise.
#[derive(Clone, Debug)]
pub struct Mesh {
    levels: Vec<Level>,
    low: [f32; 3],
    high: [f32; 3],
}

/// One version of a mesh: the first has every triangle, the others have none of the detail below their cell.
#[derive(Clone, Debug, Default)]
pub(super) struct Level {
    /// Detail that is missing, meters; infinite for versions that only [`Mesh::rough_level`] chooses.
    pub(super) cell: f32,
    /// How far the surface has moved, measured: all but one in a hundred points of the mesh are nearer to it, meters.
    pub(super) error: f32,
    /// Whether it has an inside: what is nearest of it from outside is a front face.
    pub(super) is_closed: bool,
    pub(super) points: Vec<[f32; 3]>,
    /// How many points any version of the mesh has at most.
    pub(super) most: usize,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Outward directions at the corners of every triangle.
    pub(super) normals: Vec<[[f32; 3]; 3]>,
    /// What shading needs of every triangle.
    pub(super) facets: Vec<Facet>,
}

/// Of a triangle: a corner and the sides to the other two, the direction at the corner and how it differs at the other two; three
/// values each, one after the other, and two that mean nothing.
pub(super) type Facet = [[f32; 4]; 5];

/// How far surfaces may move in a version without detail of one cell's length.
const SHARE: f32 = 0.5;

/// Cells along the longest side of the coarse versions.
const CELLS: [u32; 15] = [512, 384, 256, 192, 128, 96, 64, 48, 32, 24, 16, 12, 8, 6, 4];

/// What the cells would be, in longest sides, of versions that are chosen by their [error](Level::error) alone: the bound
/// that a cell sets is far from what most meshes come to.
const ROUGH: [f32; 8] = [0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0];

impl Mesh {
    /// A mesh of `triangles`, indices into `points` (meters), with a direction for each corner of each triangle.
    ///
    /// # Errors
    ///
    /// [`RenderError::Mesh`]: not as many normals as triangles, a triangle of a point that does not exist, or a
    /// number that is not finite.
    pub fn new(
        points: Vec<[f32; 3]>,
        triangles: Vec<[u32; 3]>,
        normals: Vec<[[f32; 3]; 3]>,
    ) -> Result<Self, RenderError> {
        let refuse = |reason: String| Err(RenderError::Mesh { reason });
        if triangles.len() != normals.len() {
            return refuse(format!("{} triangles with {} normals", triangles.len(), normals.len()));
        }
        if let Some(index) = triangles.iter().flatten().find(|&&index| index as usize >= points.len()) {
            return refuse(format!("a triangle names point {index} of {}", points.len()));
        }
        let values = points.iter().flatten().chain(normals.iter().flatten().flatten());
        if !values.into_iter().all(|value| value.is_finite()) {
            return refuse("a point or normal is not finite".to_owned());
        }
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for point in &points {
            for axis in 0..3 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        if points.is_empty() {
            (low, high) = ([0.0; 3], [0.0; 3]);
        }
        let mut full = Level { most: points.len(), points, triangles, normals, ..Level::default() };
        full.weld();
        full.is_closed = full.encloses();
        let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f32::max);
        let cells = CELLS.map(|cells| longest / cells as f32);
        let rough = ROUGH.map(|times| times * longest);
        let tolerances: Vec<f32> = cells.into_iter().chain(rough).map(|cell| SHARE * cell).collect();
        let mut levels = vec![full];
        for (index, coarse) in simplify::levels(&levels[0], &tolerances) {
            levels.push(Level { cell: cells.get(index).copied().unwrap_or(f32::INFINITY), ..coarse });
        }
        levels.iter_mut().for_each(Level::collect_facets);
        Ok(Self { levels, low, high })
    }

    /// The coarsest version whose missing detail is shorter than `detail` meters.
    pub(super) fn level(&self, detail: f32) -> usize {
        self.levels.iter().rposition(|level| level.cell <= detail).unwrap_or(0)
    }

    /// The coarsest version whose measured error is at most `error` meters.
    pub(super) fn rough_level(&self, error: f32) -> usize {
        self.levels.iter().rposition(|level| level.error <= error).unwrap_or(0)
    }

    pub(super) fn at(&self, level: usize) -> &Level {
        &self.levels[level]
    }

    /// Lowest and highest coordinates.
    pub(super) fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        (self.low, self.high)
    }

    /// How many triangles it has, in full detail.
    pub fn triangles(&self) -> usize {
        self.levels[0].triangles.len()
    }
}

impl Level {
    /// Points at the same place become one: files often have three for every triangle.
    fn weld(&mut self) {
        let mut known: HashMap<[u32; 3], u32> = HashMap::new();
        let mut points = Vec::new();
        let place_of: Vec<u32> = self
            .points
            .iter()
            .map(|point| {
                *known.entry(point.map(f32::to_bits)).or_insert_with(|| {
                    points.push(*point);
                    points.len() as u32 - 1
                })
            })
            .collect();
        (self.most, self.points) = (points.len(), points);
        for index in self.triangles.iter_mut().flatten() {
            *index = place_of[*index as usize];
        }
    }

    fn collect_facets(&mut self) {
        let facets = self.triangles.iter().zip(&self.normals).map(|(corners, [p, q, r])| {
            let [a, b, c] = corners.map(|corner| self.points[corner as usize]);
            let less = |to: &[f32; 3], from: &[f32; 3]| [0, 1, 2].map(|axis| to[axis] - from[axis]);
            let parts = [a, less(&b, &a), less(&c, &a), *p, less(q, p), less(r, p)];
            let mut facet = Facet::default();
            for (to, from) in facet.as_flattened_mut().iter_mut().zip(parts.as_flattened()) {
                *to = *from;
            }
            facet
        });
        self.facets = facets.collect();
    }

    /// Whether every side of every triangle is the side of another one, which runs along it the other way, and the front is
    /// outside.
    pub(super) fn encloses(&self) -> bool {
        let mut open: HashMap<[u32; 2], i32> = HashMap::new();
        let mut volume = 0.0;
        for corners in &self.triangles {
            let [a, b, c] = *corners;
            for [from, to] in [[a, b], [b, c], [c, a]] {
                *open.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
            }
            let [a, b, c] = corners.map(|corner| wide(self.points[corner as usize]));
            volume += dot(a, cross(b, c));
        }
        volume > 0.0 && open.values().all(|&count| count == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A finely divided square.
    fn grid(cells: u32) -> Mesh {
        let side = cells + 1;
        let points =
            (0..side * side).map(|i| [(i % side) as f32, (i / side) as f32, 0.0].map(|x| x / cells as f32));
        let quads = (0..cells * cells).map(|i| i / cells * side + i % cells);
        let triangles: Vec<[u32; 3]> =
            quads.flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]]).collect();
        let normals = vec![[[0.0, 0.0, 1.0]; 3]; triangles.len()];
        Mesh::new(points.collect(), triangles, normals).expect("sound")
    }

    #[test]
    fn coarse_versions_keep_the_shape_and_lose_triangles() {
        let mesh = grid(60);
        assert_eq!((mesh.triangles(), mesh.level(0.0), mesh.level(1e-4)), (7200, 0, 0));
        for level in 1..mesh.levels.len() {
            let coarse = mesh.at(level);
            assert!(coarse.triangles.len() < mesh.at(level - 1).triangles.len());
            let area: f32 = coarse
                .triangles
                .iter()
                .map(|t| {
                    let [a, b, c] = t.map(|i| coarse.points[i as usize]);
                    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
                })
                .sum();
            assert!((area - 1.0).abs() < 1e-3, "level {level}: area {area}");
        }
        assert!(mesh.level(1.0) + 1 == mesh.levels.len());
        assert_eq!(mesh.levels[mesh.levels.len() - 1].triangles.len(), 2, "a square needs no more");
    }

    /// A cube, finely divided.
    fn cube() -> Mesh {
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        const CELLS: u32 = 6;
        let side = CELLS + 1;
        for face in 0..6 {
            let (axis, end) = (face / 2, (face % 2) as f32);
            let first = points.len() as u32;
            for index in 0..side * side {
                let mut point = [end; 3];
                let (u, v) = ((index % side) as f32 / CELLS as f32, (index / side) as f32 / CELLS as f32);
                (point[(axis + 1) % 3], point[(axis + 2) % 3]) = if face % 2 == 1 { (u, v) } else { (v, u) };
                points.push(point);
            }
            for cell in 0..CELLS * CELLS {
                let at = first + cell / CELLS * side + cell % CELLS;
                triangles.extend([[at, at + 1, at + side], [at + 1, at + side + 1, at + side]]);
            }
        }
        let normals = vec![[[0.0, 0.0, 1.0]; 3]; triangles.len()];
        Mesh::new(points, triangles, normals).expect("sound")
    }

    #[test]
    fn closed_surfaces_stay_closed_and_errors_are_measured() {
        let cube = cube();
        for level in &cube.levels {
            assert!(level.is_closed, "{} triangles", level.triangles.len());
        }
        assert!(cube.levels.len() > 1 && !grid(8).levels[0].is_closed);
        let mut inverted = cube.levels[0].clone();
        inverted.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        assert!(!inverted.encloses(), "its front is inside");
        // Twelve triangles show a cube exactly.
        let exact = cube.at(cube.rough_level(1e-6));
        assert!(
            exact.triangles.len() == 12 && exact.error < 1e-6,
            "{} {}",
            exact.triangles.len(),
            exact.error
        );
    }

    #[test]
    fn errors_are_measured() {
        // An arch, 0.25 m high in the middle.
        let mut arch = grid(40).levels.remove(0);
        for [x, _, z] in &mut arch.points {
            *z = *x * (1.0 - *x);
        }
        let arch = Mesh::new(arch.points, arch.triangles, arch.normals).expect("sound");
        // The first coarse version may do without points along straight lines.
        assert!(arch.rough_level(0.0) < 2);
        let mut last = 0.0;
        for level in &arch.levels[2..] {
            assert!(level.error > last && level.error < 0.5, "{} after {last}", level.error);
            last = level.error;
        }
        assert!(last > 0.02, "{last}: few triangles follow an arch badly");
        assert_eq!(arch.rough_level(1.0), arch.levels.len() - 1);
    }

    #[test]
    fn unsound_meshes_are_refused() {
        let refuse = |points: Vec<[f32; 3]>, triangles, normals| {
            Mesh::new(points, triangles, normals).expect_err("unsound").to_string()
        };
        assert!(refuse(vec![[0.0; 3]], vec![[0, 0, 1]], vec![[[0.0; 3]; 3]]).contains("point 1 of 1"));
        assert!(refuse(vec![[f32::NAN; 3]], vec![], vec![]).contains("not finite"));
        assert!(refuse(vec![[0.0; 3]], vec![[0; 3]], vec![]).contains("1 triangles with 0 normals"));
    }
}

//! Ground over a grid of heights, as a mesh: the surface, walls around it, and a floor.

use super::mesh::Mesh;
use crate::error::RenderError;

impl Mesh {
    /// Ground over a grid of `heights`, `[rows, columns]`, 2 or more of each, meters. Columns run along x from `-half[0]` to
    /// `half[0]`, rows along y; walls and a floor reach down to `-base`. Each cell is two triangles, parted along the line from
    /// its lower right to its upper left, as MuJoCo has it; the surface is smooth, walls are flat.
    ///
    /// # Errors
    ///
    /// [`RenderError::Mesh`]: the heights are no such grid, or not finite.
    pub fn height_field(
        heights: &[f32],
        [rows, columns]: [usize; 2],
        half: [f32; 2],
        base: f32,
    ) -> Result<Self, RenderError> {
        if rows < 2 || columns < 2 || rows.checked_mul(columns) != Some(heights.len()) {
            let count = heights.len();
            let reason = format!(
                "{count} heights are no grid of {rows} rows and {columns} columns, 2 or more of each"
            );
            return Err(RenderError::Mesh { reason });
        }
        let across =
            |index: usize, count: usize, half: f32| (2 * index) as f32 / (count - 1) as f32 * half - half;
        let points: Vec<[f32; 3]> = (0..rows * columns)
            .map(|at| {
                let (row, column) = (at / columns, at % columns);
                [across(column, columns, half[0]), across(row, rows, half[1]), heights[at]]
            })
            .collect();
        let mut ground = Ground { points, ..Ground::default() };
        ground.surface([rows, columns]);
        ground.walls([rows, columns], base);
        Self::new(ground.points, ground.triangles, ground.normals)
    }
}

#[derive(Default)]
struct Ground {
    points: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    normals: Vec<[[f32; 3]; 3]>,
}

impl Ground {
    /// The surface over the points of the grid. A point's normal is the mean of its triangles', by their area.
    fn surface(&mut self, [rows, columns]: [usize; 2]) {
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let at = (row * columns + column) as u32;
                let above = at + columns as u32;
                self.triangles.extend([[at, at + 1, above], [at + 1, above + 1, above]]);
            }
        }
        let mut sums = vec![[0.0; 3]; self.points.len()];
        for triangle in &self.triangles {
            let area = across(triangle.map(|index| self.points[index as usize]));
            for &index in triangle {
                (0..3).for_each(|axis| sums[index as usize][axis] += area[axis]);
            }
        }
        self.normals =
            self.triangles.iter().map(|triangle| triangle.map(|index| unit(sums[index as usize]))).collect();
    }

    /// Walls from the edges of the grid down to the floor, and the floor.
    fn walls(&mut self, [rows, columns]: [usize; 2], base: f32) {
        // Around the grid, counter-clockwise from above.
        let bottom = 0..columns - 1;
        let right = (0..rows - 1).map(|row| row * columns + columns - 1);
        let top = (1..columns).rev().map(|column| (rows - 1) * columns + column);
        let left = (1..rows).rev().map(|row| row * columns);
        let rim: Vec<usize> = bottom.chain(right).chain(top).chain(left).collect();
        for (edge, &from) in rim.iter().enumerate() {
            let to = rim[(edge + 1) % rim.len()];
            let down = |[x, y, _]: [f32; 3]| [x, y, -base];
            let (from, to) = (self.points[from], self.points[to]);
            self.quad([down(from), down(to), to, from]);
        }
        let corners = [(rows - 1) * columns, rows * columns - 1, columns - 1, 0];
        self.quad(corners.map(|corner| [self.points[corner][0], self.points[corner][1], -base]));
    }

    /// A flat face of four corners, counter-clockwise from outside.
    fn quad(&mut self, corners: [[f32; 3]; 4]) {
        let first = self.points.len() as u32;
        self.points.extend(corners);
        let normal = unit(across([corners[0], corners[1], corners[2]]));
        self.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        self.normals.extend([[normal; 3]; 2]);
    }
}

/// At a right angle to a triangle, outwards, twice as long as its area.
fn across([a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    let side = |to: [f32; 3]| [0, 1, 2].map(|k| to[k] - a[k]);
    let (u, v) = (side(b), side(c));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    // A wall without height has no direction, and shows no point.
    if length > 0.0 { v.map(|x| x / length) } else { [0.0, 0.0, 1.0] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ground_is_closed_and_looks_outwards() {
        let heights = [0.0, 0.1, 0.4, 0.2, 0.3, 0.1, 0.0, 0.5, 0.2, 0.1, 0.0, 0.3];
        let mesh = Mesh::height_field(&heights, [4, 3], [1.0, 2.0], 0.5).unwrap();
        // 12 on the surface, 10 walls and a floor of two each.
        assert_eq!((mesh.triangles(), mesh.bounds()), (34, ([-1.0, -2.0, -0.5], [1.0, 2.0, 0.5])));
        let level = mesh.at(0);
        let mut volume = 0.0;
        for (triangle, normals) in level.triangles.iter().zip(&level.normals) {
            let corners = triangle.map(|index| level.points[index as usize]);
            let area = across(corners);
            volume += (0..3).map(|k| area[k] * corners[0][k]).sum::<f32>() / 6.0;
            for normal in normals {
                assert!((0..3).map(|k| area[k] * normal[k]).sum::<f32>() > 0.0, "{corners:?} shows its back");
            }
        }
        // The mean height over each triangle, of all cells (1 × 4/3 m), above the floor at -0.5.
        let expected: f32 = (0..3)
            .flat_map(|row| (0..2).map(move |column| row * 3 + column))
            .map(|at| {
                let (a, b, c, d) = (heights[at], heights[at + 1], heights[at + 3], heights[at + 4]);
                ((a + b + c) / 3.0 + (b + c + d) / 3.0) / 2.0 * (4.0 / 3.0)
            })
            .sum::<f32>()
            + 0.5 * 8.0;
        assert!((volume - expected).abs() < 1e-4, "{volume}, not {expected}");
    }

    #[test]
    fn grids_that_are_none_are_refused() {
        for (heights, size) in [(vec![0.0; 6], [2, 2]), (vec![0.0; 3], [1, 3]), (vec![f32::NAN; 4], [2, 2])] {
            assert!(Mesh::height_field(&heights, size, [1.0; 2], 0.1).is_err());
        }
    }
}

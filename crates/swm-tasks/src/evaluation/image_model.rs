//! The world model of images that needs no training: what is seen, made coarse, and nothing ever changes. The yardstick for
//! what probes and violations tell of learned latents.

use swm_core::Row;
use swm_core::error::BoxError;
use swm_core::evaluate::quality::WorldModel;

/// A model whose latent `[C, C, 3]` is the column `pixels` `[H, W, 3]`, averaged over C × C cells, from 0 to 1.
#[derive(Clone, Debug)]
pub struct ImageModel {
    cells: usize,
}

impl ImageModel {
    /// With `cells` × `cells` cells; at least 1.
    pub fn new(cells: usize) -> Self {
        Self { cells: cells.max(1) }
    }
}

impl WorldModel for ImageModel {
    fn latent_dim(&self) -> usize {
        self.cells * self.cells * 3
    }

    fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError> {
        let pixels = row.get::<u8>("pixels")?;
        let shape = &row.schema().fields()[row.schema().require("pixels")?].shape;
        let &[height, width, 3] = shape.as_slice() else {
            return Err(format!("`pixels` has the shape {shape:?}, not [height, width, 3]").into());
        };
        if height < self.cells || width < self.cells {
            return Err(format!("images of {width} × {height} have no {0} × {0} cells", self.cells).into());
        }
        let cells = self.cells;
        for (cell, latent) in latent.chunks_exact_mut(3).enumerate() {
            let range = |index: usize, size: usize| index * size / cells..(index + 1) * size / cells;
            let (rows, columns) = (range(cell / cells, height), range(cell % cells, width));
            let mut sums = [0_u64; 3];
            for y in rows.clone() {
                for pixel in
                    pixels[3 * (y * width + columns.start)..3 * (y * width + columns.end)].chunks_exact(3)
                {
                    sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += u64::from(*value));
                }
            }
            let most = (rows.len() * columns.len() * 255) as f64;
            latent.iter_mut().zip(sums).for_each(|(latent, sum)| *latent = sum as f64 / most);
        }
        Ok(())
    }

    fn predict(&mut self, _latent: &mut [f64], _action: &[f64]) -> Result<(), BoxError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use swm_core::{Batch, Dtype, Field, Schema};

    use super::*;

    #[test]
    fn cells_are_means_of_their_pixels() {
        let fields = vec![Field::step("pixels", Dtype::U8, &[3, 2, 3])];
        let mut rows = Batch::new(Schema::new(fields).unwrap(), 1);
        let image: Vec<u8> = (0..18).collect();
        rows.rows_mut().write(0, &image);
        let (mut whole, mut cells) = (ImageModel::new(1), ImageModel::new(2));
        let mut latent = vec![0.0; whole.latent_dim()];
        whole.encode(rows.row(0), &mut latent).unwrap();
        // Red is 0, 3, …, 15.
        assert!((latent[0] * 255.0 - 7.5).abs() < 1e-12 && (latent[2] * 255.0 - 9.5).abs() < 1e-12);
        let mut latent = vec![0.0; cells.latent_dim()];
        cells.encode(rows.row(0), &mut latent).unwrap();
        // The first cell is one pixel, the last two, one below the other.
        assert!(
            (latent[1] * 255.0 - 1.0).abs() < 1e-12 && (latent[9] * 255.0 - 12.0).abs() < 1e-12,
            "{latent:?}"
        );
        let message = ImageModel::new(3).encode(rows.row(0), &mut [0.0; 27]).unwrap_err().to_string();
        assert!(message.contains("2 × 3"), "{message}");
    }
}

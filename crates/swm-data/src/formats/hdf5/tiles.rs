//! Chunks that hold a part of each row: h5py cuts rows as it cuts their number, where compression is asked for and no shape of chunks is given.

/// How rows are cut: a grid of tiles, each in a chunk of its own.
#[derive(Debug)]
pub(super) struct Tiles {
    /// Of each axis of a row: its size, and that of a tile, in elements. Axes that no tile cuts are joined with the one before them.
    axes: Vec<Axis>,
    /// Bytes of an element, with those of the axes that are not cut.
    element: usize,
    count: usize,
    bytes: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Axis {
    size: usize,
    tile: usize,
}

impl Tiles {
    /// Those of rows of `shape` in chunks of `chunk`, both without the axis of rows; `element` is in bytes. `None`: no shape of chunks, or
    /// sizes beyond what can be counted.
    pub(super) fn new(shape: &[usize], chunk: &[usize], element: usize) -> Option<Self> {
        if shape.len() != chunk.len() || chunk.contains(&0) || shape.contains(&0) {
            return None;
        }
        let cut = shape.iter().zip(chunk).rposition(|(size, tile)| size != tile).map_or(0, |last| last + 1);
        let axes: Vec<Axis> =
            shape.iter().zip(chunk).take(cut).map(|(&size, &tile)| Axis { size, tile }).collect();
        let element = shape[cut..].iter().try_fold(element, |bytes, &size| bytes.checked_mul(size))?;
        let count = axes.iter().try_fold(1_usize, |count, axis| count.checked_mul(axis.count()))?;
        let bytes = axes.iter().try_fold(element, |bytes, axis| bytes.checked_mul(axis.tile))?;
        Some(Self { axes, element, count, bytes })
    }

    /// How many there are to a row.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// The bytes of one; those behind the end of an axis are stored, too.
    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }

    /// Which one lies at these places of the axes; `None`: they are behind the end of one.
    pub(super) fn index(&self, places: &[u64]) -> Option<usize> {
        self.axes.iter().zip(places).try_fold(0, |index, (axis, &place)| {
            let place = usize::try_from(place).ok().filter(|place| *place < axis.size)?;
            Some(index * axis.count() + place / axis.tile)
        })
    }

    /// Copies tile `index` of a row to where it belongs in the row.
    pub(super) fn place(&self, index: usize, tile: &[u8], row: &mut [u8]) {
        self.copy(&self.axes, index, tile, row);
    }

    fn copy(&self, axes: &[Axis], index: usize, tile: &[u8], row: &mut [u8]) {
        let Some((axis, rest)) = axes.split_first() else { return row.copy_from_slice(tile) };
        let (row_step, tile_step) = (row.len() / axis.size, tile.len() / axis.tile);
        let below: usize = rest.iter().map(|axis| axis.count()).product();
        let (first, count) = axis.span(index / below);
        let (row, tile) =
            (&mut row[first * row_step..(first + count) * row_step], &tile[..count * tile_step]);
        let lines = row.chunks_exact_mut(row_step).zip(tile.chunks_exact(tile_step));
        match rest {
            [] => row.copy_from_slice(tile),
            [last] => {
                let (first, count) = last.span(index % below);
                let (at, run) = (first * self.element, count * self.element);
                match run {
                    1 => lines.for_each(|(row, tile)| copy_few::<1>(&mut row[at..], tile)),
                    2 => lines.for_each(|(row, tile)| copy_few::<2>(&mut row[at..], tile)),
                    3 => lines.for_each(|(row, tile)| copy_few::<3>(&mut row[at..], tile)),
                    4 => lines.for_each(|(row, tile)| copy_few::<4>(&mut row[at..], tile)),
                    8 => lines.for_each(|(row, tile)| copy_few::<8>(&mut row[at..], tile)),
                    _ => lines.for_each(|(row, tile)| row[at..at + run].copy_from_slice(&tile[..run])),
                }
            }
            _ => lines.for_each(|(row, tile)| self.copy(rest, index % below, tile, row)),
        }
    }
}

impl Axis {
    /// Its tiles.
    fn count(self) -> usize {
        self.size.div_ceil(self.tile)
    }

    /// The first element of the tile at a place, and how many there are before the end.
    fn span(self, place: usize) -> (usize, usize) {
        let first = place * self.tile;
        (first, self.tile.min(self.size - first))
    }
}

/// Copies so few bytes, as those of a color, for which a call would cost more than the copy.
fn copy_few<const N: usize>(row: &mut [u8], tile: &[u8]) {
    if let (Some(row), Some(tile)) = (row.first_chunk_mut::<N>(), tile.first_chunk::<N>()) {
        *row = *tile;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Rows that are cut and put together again are the same.
        #[test]
        fn tiles_make_up_the_row(axes in proptest::collection::vec((1_usize..7, 1_usize..7), 0..4), element in 1_usize..5) {
            let (shape, chunk): (Vec<usize>, Vec<usize>) = axes.into_iter().unzip();
            let tiles = Tiles::new(&shape, &chunk, element).unwrap();
            let total = element * shape.iter().product::<usize>();
            let row: Vec<u8> = (0..total).map(|at| (at * 7 + 1) as u8).collect();
            let mut again = vec![0; total];
            // Each tile by the definition: the element at (i, j, …) of the row is in tile (i / h, j / w, …) at (i % h, j % w, …).
            for index in 0..tiles.count() {
                let mut tile = vec![0xee; tiles.bytes()];
                for at in 0..total / element {
                    let (mut rest, mut which, mut within, mut scale, mut width) = (at, 0, 0, 1, 1);
                    for (&size, &cut) in shape.iter().zip(&chunk).rev() {
                        let place = rest % size;
                        rest /= size;
                        which += place / cut * scale;
                        within += place % cut * width;
                        scale *= size.div_ceil(cut);
                        width *= cut;
                    }
                    if which == index {
                        tile[within * element..][..element].copy_from_slice(&row[at * element..][..element]);
                    }
                }
                tiles.place(index, &tile, &mut again);
            }
            prop_assert_eq!(again, row);
        }
    }

    #[test]
    fn other_shapes_are_none() {
        assert!(Tiles::new(&[4, 4], &[2], 1).is_none());
        assert!(Tiles::new(&[4], &[0], 1).is_none());
        let tiles = Tiles::new(&[84, 84, 3], &[21, 42, 1], 1).unwrap();
        assert_eq!(tiles.index(&[42, 42, 2]), Some((2 * 2 + 1) * 3 + 2));
        // Of a forged file.
        assert_eq!((tiles.index(&[84, 0, 0]), tiles.index(&[0, 0, u64::MAX])), (None, None));
    }
}

//! The pixels of an image that are drawn or resized again: in each of some rows, one range of columns.
//!
//! A turned body fills about half of the rectangle that holds it. What lies between them would be restored, drawn and
//! resized for nothing.

use std::ops::Range;

use crate::rect::Rect;

/// For consecutive rows a half-open range of columns each, possibly empty. Keeps its memory when it is set anew.
#[derive(Debug, Clone, Default)]
pub(crate) struct Region {
    first_row: usize,
    columns: Vec<[u32; 2]>,
}

impl Region {
    /// The pixels of a rectangle, which lies in an image.
    pub(crate) fn of(rect: Rect) -> Self {
        let mut region = Self::default();
        region.set(rect);
        region
    }

    /// Becomes the pixels of a rectangle, which lies in an image.
    pub(crate) fn set(&mut self, rect: Rect) {
        let columns = rect.columns();
        self.set_rows(rect.rows(), |_| columns.clone());
    }

    /// Becomes these rows, each with its range of columns.
    pub(crate) fn set_rows(&mut self, rows: Range<usize>, columns: impl Fn(usize) -> Range<usize>) {
        self.first_row = rows.start;
        self.columns.clear();
        self.columns.extend(rows.map(|y| {
            let Range { start, end } = columns(y);
            [start as u32, end as u32]
        }));
    }

    pub(crate) fn rows(&self) -> Range<usize> {
        self.first_row..self.first_row + self.columns.len()
    }

    /// The columns of a row, none outside of [`rows`](Self::rows).
    pub(crate) fn columns(&self, y: usize) -> Range<usize> {
        let row = y.checked_sub(self.first_row).and_then(|index| self.columns.get(index));
        row.map_or(0..0, |&[start, end]| start as usize..end as usize)
    }

    /// The least range that holds the columns of all these rows; empty if they have none.
    pub(crate) fn columns_of(&self, rows: Range<usize>) -> Range<usize> {
        rows.map(|y| self.columns(y)).fold(0..0, union)
    }

    /// The least rectangle that holds all pixels.
    pub(crate) fn bounds(&self) -> Rect {
        let Range { start: y0, end: y1 } = self.rows();
        let Range { start: x0, end: x1 } = self.columns_of(y0..y1);
        Rect::new(x0 as i32, y0 as i32, x1 as i32, y1 as i32)
    }
}

fn union(a: Range<usize>, b: Range<usize>) -> Range<usize> {
    match (a.is_empty(), b.is_empty()) {
        (true, _) => b,
        (_, true) => a,
        _ => a.start.min(b.start)..a.end.max(b.end),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_their_own_columns() {
        let mut region = Region::of(Rect::new(2, 1, 5, 4));
        assert_eq!((region.rows(), region.columns(1), region.columns(0)), (1..4, 2..5, 0..0));
        region.set_rows(3..6, |y| if y == 4 { 7..7 } else { y..2 * y });
        assert_eq!(
            (region.columns(3), region.columns_of(0..5), region.columns_of(3..9)),
            (3..6, 3..6, 3..10)
        );
        assert_eq!(region.bounds(), Rect::new(3, 3, 10, 6));
        assert!(Region::default().bounds().is_empty());
    }
}

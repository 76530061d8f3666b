//! Integer rectangles: clipping and bounds.

/// A half-open rectangle of pixels: columns `x0..x1`, rows `y0..y1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rect {
    /// First column.
    pub x0: i32,
    /// First row.
    pub y0: i32,
    /// One past the last column.
    pub x1: i32,
    /// One past the last row.
    pub y1: i32,
}

impl Rect {
    /// Columns `x0..x1`, rows `y0..y1`.
    #[must_use]
    pub const fn new(x0: i32, y0: i32, x1: i32, y1: i32) -> Self {
        Self { x0, y0, x1, y1 }
    }

    /// The whole of an image.
    #[must_use]
    pub(crate) const fn of_size(height: usize, width: usize) -> Self {
        Self::new(0, 0, width as i32, height as i32)
    }

    /// Whether it holds no pixel.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.x0 >= self.x1 || self.y0 >= self.y1
    }

    /// Number of pixels.
    #[must_use]
    pub const fn area(&self) -> i64 {
        if self.is_empty() { 0 } else { (self.x1 - self.x0) as i64 * (self.y1 - self.y0) as i64 }
    }

    /// The pixels in both; possibly empty.
    #[must_use]
    pub fn intersect(&self, other: &Self) -> Self {
        Self::new(self.x0.max(other.x0), self.y0.max(other.y0), self.x1.min(other.x1), self.y1.min(other.y1))
    }

    /// The smallest rectangle that holds both (an empty one counts for nothing).
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        if self.is_empty() {
            return *other;
        }
        if other.is_empty() {
            return *self;
        }
        Self::new(self.x0.min(other.x0), self.y0.min(other.y0), self.x1.max(other.x1), self.y1.max(other.y1))
    }

    /// Whether the two share a pixel.
    #[must_use]
    pub fn meets(&self, other: &Self) -> bool {
        !self.intersect(other).is_empty()
    }

    /// The columns as indices. The rectangle must lie in an image (no negative coordinates).
    pub(crate) fn columns(&self) -> std::ops::Range<usize> {
        self.x0 as usize..self.x1 as usize
    }

    /// The rows as indices. The rectangle must lie in an image (no negative coordinates).
    pub(crate) fn rows(&self) -> std::ops::Range<usize> {
        self.y0 as usize..self.y1 as usize
    }
}

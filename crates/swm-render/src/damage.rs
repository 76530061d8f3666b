//! The set of pixels to draw again: a few rectangles that share none, merged when that is cheaper than keeping them apart.
//!
//! Where rectangles overlapped, primitives would be set up and painted once for each. Renderers draw less than all of a
//! rectangle, so that a large one costs little.

use crate::rect::Rect;

/// More rectangles than this are merged whatever the cost; scenes here move two or three bodies.
const MAX_RECTS: usize = 6;

/// Pixels that a merge may add: about what the fixed cost of one more rectangle would draw.
const SLACK: i64 = 1024;

/// Pixels to draw again, within an image of known size.
#[derive(Debug, Clone)]
pub(crate) struct Damage {
    image: Rect,
    rects: Vec<Rect>,
}

impl Damage {
    pub(crate) fn new(image: Rect) -> Self {
        Self { image, rects: Vec::with_capacity(MAX_RECTS + 1) }
    }

    pub(crate) fn clear(&mut self) {
        self.rects.clear();
    }

    pub(crate) fn rects(&self) -> &[Rect] {
        &self.rects
    }

    pub(crate) fn add_all(&mut self) {
        self.rects.clear();
        self.rects.push(self.image);
    }

    /// Adds a rectangle, clipped to the image.
    pub(crate) fn add(&mut self, rect: Rect) {
        let mut rect = rect.intersect(&self.image);
        if rect.is_empty() {
            return;
        }
        // A merge makes a larger rectangle that may now swallow others: repeat until none is worth merging.
        while let Some((index, growth)) = self.cheapest_merge(&rect) {
            if growth > SLACK && self.rects.len() < MAX_RECTS {
                break;
            }
            rect = rect.union(&self.rects.swap_remove(index));
        }
        self.rects.push(rect);
    }

    fn cheapest_merge(&self, rect: &Rect) -> Option<(usize, i64)> {
        let growth = |other: &Rect| {
            if rect.meets(other) { 0 } else { rect.union(other).area() - rect.area() - other.area() }
        };
        self.rects.iter().map(growth).enumerate().min_by_key(|&(_, growth)| growth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbors_merge_and_strangers_do_not() {
        let mut damage = Damage::new(Rect::of_size(512, 512));
        damage.add(Rect::new(10, 10, 30, 30));
        damage.add(Rect::new(12, 12, 32, 32));
        damage.add(Rect::new(400, 400, 430, 430));
        assert_eq!(damage.rects(), [Rect::new(10, 10, 32, 32), Rect::new(400, 400, 430, 430)]);
    }

    #[test]
    fn never_more_than_the_limit_and_nothing_is_lost() {
        let mut damage = Damage::new(Rect::of_size(512, 512));
        let rects: Vec<_> = (0..20)
            .map(|i| Rect::new(i * 97 % 500, i * 53 % 500, i * 97 % 500 + 5, i * 53 % 500 + 5))
            .collect();
        for rect in &rects {
            damage.add(*rect);
        }
        assert!(damage.rects().len() <= MAX_RECTS);
        for rect in &rects {
            let rect = rect.intersect(&Rect::of_size(512, 512));
            assert!(damage.rects().iter().any(|d| d.union(&rect) == *d), "{rect:?} is not covered");
        }
    }

    #[test]
    fn rectangles_share_no_pixel() {
        let mut damage = Damage::new(Rect::of_size(512, 512));
        damage.add(Rect::new(0, 0, 200, 200));
        damage.add(Rect::new(300, 300, 500, 500));
        damage.add(Rect::new(250, 100, 290, 320));
        assert_eq!(damage.rects().len(), 3);
        damage.add(Rect::new(199, 199, 251, 301));
        assert_eq!(damage.rects(), [Rect::new(300, 300, 500, 500), Rect::new(0, 0, 290, 320)]);
    }

    #[test]
    fn what_lies_outside_the_image_is_no_damage() {
        let mut damage = Damage::new(Rect::of_size(64, 64));
        damage.add(Rect::new(-30, 0, 0, 64));
        damage.add(Rect::new(64, 0, 80, 64));
        assert!(damage.rects().is_empty());
    }
}

//! Replacing colors of a finished drawing, as the reference changes the looks of environments that it did not draw.

use crate::canvas::pack;
use crate::painter::Rgb;

/// Colors to replace, in order: `(old, new)`. What one replacement makes, a later one may replace again.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Palette {
    swaps: Vec<(u32, u32)>,
}

impl Palette {
    /// Takes other colors; whether that changes anything.
    pub(crate) fn set(&mut self, swaps: &[(Rgb, Rgb)]) -> bool {
        let new = swaps.iter().filter(|(old, new)| old != new).map(|&(old, new)| (pack(old), pack(new)));
        if new.clone().eq(self.swaps.iter().copied()) {
            return false;
        }
        self.swaps.clear();
        self.swaps.extend(new);
        true
    }

    /// What a packed pixel becomes.
    pub(crate) fn apply(&self, pixel: u32) -> u32 {
        self.swaps.iter().fold(pixel, |pixel, &(old, new)| if pixel == old { new } else { pixel })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_swaps_see_what_earlier_ones_made() {
        let mut palette = Palette::default();
        assert!(palette.set(&[([1; 3], [2; 3]), ([2; 3], [3; 3]), ([9; 3], [9; 3])]));
        let becomes = |color: u8| palette.apply(pack([color; 3]));
        assert_eq!([1, 2, 3].map(becomes), [pack([3; 3]); 3]);
        assert!(!palette.clone().set(&[([1; 3], [2; 3]), ([2; 3], [3; 3])]), "a swap of equals is none");
    }
}

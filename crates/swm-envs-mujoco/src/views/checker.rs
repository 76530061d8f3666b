//! The floor's checker in other colours. Which texture that is, is not known here.

/// What becomes of the two colours of a checker, byte by byte as MuJoCo's compiler draws them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CheckerColors {
    from: [[u8; 3]; 2],
    to: [[u8; 3]; 2],
}

impl CheckerColors {
    /// From and to two colours each, six numbers in 0..1.
    pub(crate) fn new(from: &[f64], to: &[f64]) -> Self {
        let bytes = |values: &[f64], at: usize| [0, 1, 2].map(|k| (255.0 * values[at + k]) as u8);
        let both = |values: &[f64]| [bytes(values, 0), bytes(values, 3)];
        Self { from: both(from), to: both(to) }
    }

    /// What is shown in place of a colour: others, such as that of a mark on the edge, stay.
    pub(crate) fn recolor(self, color: [u8; 3]) -> [u8; 3] {
        let place = self.from.iter().position(|known| *known == color);
        place.map_or(color, |place| self.to[place])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_colours_change_and_others_stay() {
        let colors = CheckerColors::new(&[0.0, 0.2, 1.0, 0.4, 0.4, 0.4], &[1.0, 0.0, 0.0, 0.0, 0.2, 1.0]);
        assert_eq!(colors.recolor([0, 51, 255]), [255, 0, 0]);
        assert_eq!(colors.recolor([102; 3]), [0, 51, 255]);
        assert_eq!(colors.recolor([204; 3]), [204; 3]);
    }
}

//! The floor's checker in other colors. Which texture that is, is not known here.

/// What becomes of the two colors of a checker, byte by byte as MuJoCo's compiler draws them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CheckerColors {
    from: [[u8; 3]; 2],
    to: [[u8; 3]; 2],
    /// Rows and columns of a texture whose edge stays.
    edge_of: Option<[usize; 2]>,
}

impl CheckerColors {
    /// From and to two colors each, six values in 0..1.
    pub(crate) fn new(from: &[f64], to: &[f64]) -> Self {
        let bytes = |values: &[f64], at: usize| [0, 1, 2].map(|k| (255.0 * values[at + k]) as u8);
        let both = |values: &[f64]| [bytes(values, 0), bytes(values, 3)];
        Self { from: both(from), to: both(to), edge_of: None }
    }

    /// The same but for the pixels at the edge of a texture of this height and width, whatever their color.
    pub(crate) fn within_edge(self, size: [usize; 2]) -> Self {
        Self { edge_of: Some(size), ..self }
    }

    /// What is shown in place of a color at a row and column: other colors than the two stay.
    pub(crate) fn recolor(self, at: [usize; 2], color: [u8; 3]) -> [u8; 3] {
        let is_edge = |size: [usize; 2]| at.iter().zip(size).any(|(at, size)| *at == 0 || at + 1 == size);
        if self.edge_of.is_some_and(is_edge) {
            return color;
        }
        let place = self.from.iter().position(|known| *known == color);
        place.map_or(color, |place| self.to[place])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_colors_change_but_for_others_and_edges() {
        let colors = CheckerColors::new(&[0.0, 0.2, 1.0, 0.4, 0.4, 0.4], &[1.0, 0.0, 0.0, 0.0, 0.2, 1.0]);
        assert_eq!(colors.recolor([0, 5], [0, 51, 255]), [255, 0, 0]);
        assert_eq!(colors.recolor([3, 5], [102; 3]), [0, 51, 255]);
        assert_eq!(colors.recolor([3, 5], [204; 3]), [204; 3]);
        let within = colors.within_edge([10, 6]);
        assert_eq!(within.recolor([3, 4], [102; 3]), [0, 51, 255]);
        for at in [[0, 3], [9, 3], [4, 0], [4, 5]] {
            assert_eq!(within.recolor(at, [102; 3]), [102; 3], "{at:?}");
        }
    }
}

//! Slices of H.264 that OpenH264 decodes to other images in silence: those of B pictures in temporal direct mode, coded without
//! arithmetic (CAVLC). With arithmetic (CABAC) its images are near: a few values are off by a few levels.
//!
//! Source: ITU-T H.264, 7.3.2.2 (picture parameter set) and 7.3.3 (slice header).

use super::parameters::{Bits, Numbers, without_escapes};

/// What of a picture parameter set the head of a slice depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PictureSet {
    id: u64,
    is_arithmetic: bool,
    has_order: bool,
    has_redundant: bool,
}

impl PictureSet {
    /// Reads a NAL unit; `None` if it cannot be understood.
    pub(super) fn read(unit: &[u8]) -> Option<Self> {
        let bytes = without_escapes(unit);
        let mut bits = Bits::new(&bytes);
        let id = bits.exponential()?;
        bits.exponential()?;
        let (is_arithmetic, has_order) = (bits.take(1)? == 1, bits.take(1)? == 1);
        if bits.exponential()? > 0 {
            // Groups of slices, which no B picture has.
            return None;
        }
        bits.exponential()?;
        bits.exponential()?;
        bits.take(3)?;
        for _ in 0..3 {
            bits.exponential()?;
        }
        bits.take(2)?;
        Some(Self { id, is_arithmetic, has_order, has_redundant: bits.take(1)? == 1 })
    }

    pub(super) const fn is_arithmetic(&self) -> bool {
        self.is_arithmetic
    }
}

/// Whether a slice is of a B picture in temporal direct mode, without arithmetic. The slice is of a progressive picture that is no IDR
/// picture; `None` if that is not to be found out.
pub(super) fn is_misread(unit: &[u8], numbers: &Numbers, sets: &[PictureSet]) -> Option<bool> {
    // The head is far shorter.
    let bytes = without_escapes(&unit[..unit.len().min(64)]);
    let mut bits = Bits::new(&bytes);
    bits.exponential()?;
    let is_b = bits.exponential()? % 5 == 1;
    let id = bits.exponential()?;
    let set = sets.iter().rev().find(|set| set.id == id)?;
    if !is_b || set.is_arithmetic {
        return Some(false);
    }
    bits.take(numbers.frame_bits)?;
    if let Some(order_bits) = numbers.order_bits {
        bits.take(order_bits)?;
        if set.has_order {
            bits.exponential()?;
        }
    }
    for _ in 0..numbers.order_differences * if set.has_order { 2 } else { 1 } {
        bits.exponential()?;
    }
    if set.has_redundant {
        bits.exponential()?;
    }
    Some(bits.take(1)? == 0)
}

//! What the head of an H.264 stream says of its images: their size, their colors, and whether this crate decodes them. Everything
//! else in it is left to the decoder.
//!
//! Source: ITU-T H.264, 7.3.2.1.1 (sequence parameter set) and E.1.1 (VUI).

/// How luma and chroma become red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Colors {
    /// A code of ITU-T H.273, table 4: 1 is BT.709.
    pub(super) matrix: u8,
    /// 0 to 255, else studio range.
    pub(super) is_full_range: bool,
}

/// What players assume where the stream says nothing: BT.601 in studio range.
pub(super) const UNSAID: Colors = Colors { matrix: 2, is_full_range: false };

/// Luma, and two differences of colors that no weights describe.
const YCGCO: u8 = 8;

/// A sequence parameter set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ParameterSet {
    pub(super) colors: Colors,
    /// There is luma only.
    pub(super) is_gray: bool,
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) numbers: Numbers,
    /// What of it is not decoded, such as `H.264 in 4:4:4`.
    pub(super) unsupported: Option<String>,
}

/// How slices number their pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Numbers {
    /// Bits of the number in the order of decoding.
    pub(super) frame_bits: usize,
    /// Bits of the number in the order of showing, if slices have one.
    pub(super) order_bits: Option<usize>,
    /// Differences from the expected order, of a picture.
    pub(super) order_differences: usize,
}

/// Profiles whose parameter sets have fields on chroma and scaling.
const HIGH_PROFILES: [u64; 12] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134];
const EXTENDED_PROFILE: u64 = 88;
/// "The aspect ratio follows in full."
const EXTENDED_ASPECT_RATIO: u64 = 255;

impl ParameterSet {
    /// Reads a NAL unit; `None` if it cannot be understood.
    pub(super) fn read(unit: &[u8]) -> Option<Self> {
        let bytes = without_escapes(unit);
        let mut bits = Bits::new(&bytes);
        let profile = bits.take(8)?;
        bits.take(16)?;
        bits.exponential()?;
        let (mut chroma, mut depth, mut is_lossless) = (1, 8, false);
        if HIGH_PROFILES.contains(&profile) {
            chroma = bits.exponential()?;
            if chroma == 3 {
                bits.take(1)?;
            }
            depth = 8 + bits.exponential()?.max(bits.exponential()?);
            is_lossless = bits.take(1)? == 1;
            if bits.take(1)? == 1 {
                (0..if chroma == 3 { 12 } else { 8 })
                    .try_for_each(|list| skip_scaling_list(&mut bits, list))?;
            }
        }
        let numbers = numbers(&mut bits)?;
        bits.exponential()?;
        bits.take(1)?;
        let (width, height) = (bits.exponential()? + 1, bits.exponential()? + 1);
        let is_progressive = bits.take(1)? == 1;
        if !is_progressive {
            bits.take(1)?;
        }
        bits.take(1)?;
        let has_crop = bits.take(1)? == 1;
        let mut crop = [0; 4];
        if has_crop {
            for side in &mut crop {
                *side = bits.exponential()?;
            }
        }
        // A size without colors is still one.
        let colors = colors(&mut bits).unwrap_or(UNSAID);
        let fields = if is_progressive { 1 } else { 2 };
        let [across, down] = [if matches!(chroma, 1 | 2) { 2 } else { 1 }, if chroma == 1 { 2 } else { 1 }];
        let side = |blocks: u64, cut: u64| {
            let pixels = blocks.checked_mul(16)?.checked_sub(cut)?;
            usize::try_from(pixels).ok().filter(|&pixels| pixels > 0)
        };
        let unsupported = match (chroma, depth, is_lossless) {
            (2, ..) => Some("H.264 in 4:2:2".to_owned()),
            (3.., ..) => Some("H.264 in 4:4:4".to_owned()),
            (_, 9.., _) => Some(format!("H.264 in {depth} bits")),
            (_, _, true) => Some("lossless H.264".to_owned()),
            _ if !is_progressive => Some("interlaced H.264".to_owned()),
            _ if profile == EXTENDED_PROFILE => Some("H.264 in the Extended profile".to_owned()),
            _ if colors.matrix == YCGCO => Some("H.264 in YCgCo".to_owned()),
            _ => None,
        };
        Some(Self {
            colors,
            is_gray: chroma == 0,
            numbers,
            height: side(height * fields, crop[2].checked_add(crop[3])?.checked_mul(down * fields)?)?,
            width: side(width, crop[0].checked_add(crop[1])?.checked_mul(across)?)?,
            unsupported,
        })
    }
}

fn skip_scaling_list(bits: &mut Bits<'_>, list: usize) -> Option<()> {
    if bits.take(1)? == 0 {
        return Some(());
    }
    let (mut last, mut next) = (8, 8);
    for _ in 0..if list < 6 { 16 } else { 64 } {
        if next != 0 {
            next = (last + bits.signed()?).rem_euclid(256);
        }
        last = if next == 0 { last } else { next };
    }
    Some(())
}

fn numbers(bits: &mut Bits<'_>) -> Option<Numbers> {
    // As the standard bounds them.
    let length =
        |bits: &mut Bits<'_>| bits.exponential().filter(|&more| more <= 12).map(|more| 4 + more as usize);
    let mut numbers = Numbers { frame_bits: length(bits)?, order_bits: None, order_differences: 0 };
    match bits.exponential()? {
        0 => numbers.order_bits = Some(length(bits)?),
        1 => {
            numbers.order_differences = if bits.take(1)? == 1 { 0 } else { 1 };
            bits.exponential()?;
            bits.exponential()?;
            for _ in 0..bits.exponential()?.min(255) {
                bits.exponential()?;
            }
        }
        _ => {}
    }
    Some(numbers)
}

/// From the VUI, if it names any.
fn colors(bits: &mut Bits<'_>) -> Option<Colors> {
    if bits.take(1)? == 0 {
        return None;
    }
    if bits.take(1)? == 1 && bits.take(8)? == EXTENDED_ASPECT_RATIO {
        bits.take(32)?;
    }
    if bits.take(1)? == 1 {
        bits.take(1)?;
    }
    if bits.take(1)? == 0 {
        return None;
    }
    bits.take(3)?;
    let is_full_range = bits.take(1)? == 1;
    let mut matrix = UNSAID.matrix;
    if bits.take(1)? == 1 {
        bits.take(16)?;
        matrix = bits.take(8)? as u8;
    }
    Some(Colors { matrix, is_full_range })
}

/// The payload of a NAL unit: a 3 after two zeros only keeps them from looking like a start code.
pub(super) fn without_escapes(unit: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(unit.len());
    let mut zeros = 0;
    for &byte in unit {
        if byte == 3 && zeros >= 2 {
            zeros = 0;
            continue;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        bytes.push(byte);
    }
    bytes
}

pub(super) struct Bits<'a> {
    bytes: &'a [u8],
    /// In bits.
    at: usize,
}

impl<'a> Bits<'a> {
    /// What follows the first byte of a NAL unit.
    pub(super) const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 8 }
    }

    pub(super) fn take(&mut self, count: usize) -> Option<u64> {
        let mut value = 0;
        for _ in 0..count {
            let byte = self.bytes.get(self.at / 8)?;
            value = value << 1 | u64::from(byte >> (7 - self.at % 8) & 1);
            self.at += 1;
        }
        Some(value)
    }

    /// An Exp-Golomb code; signed ones take the same bits.
    pub(super) fn exponential(&mut self) -> Option<u64> {
        let mut zeros = 0;
        while self.take(1)? == 0 {
            zeros += 1;
            if zeros > 31 {
                return None;
            }
        }
        Some((1 << zeros) - 1 + self.take(zeros)?)
    }

    /// A signed Exp-Golomb code: 0, 1, -1, 2, -2, …
    fn signed(&mut self) -> Option<i64> {
        let code = self.exponential()? as i64;
        Some(if code % 2 == 1 { (code + 1) / 2 } else { -(code / 2) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonsense_is_none() {
        for bytes in [&[][..], &[0x67], &[0; 40]] {
            assert_eq!(ParameterSet::read(bytes), None);
        }
    }

    #[test]
    fn exponential_codes() {
        let mut bits = Bits { bytes: &[0b1010_0110, 0b0100_0000], at: 0 };
        assert_eq!([(); 4].map(|()| bits.exponential()), [Some(0), Some(1), Some(2), Some(3)]);
        let mut bits = Bits { bytes: &[0b1010_0110, 0b0100_0010, 0b1000_0000], at: 0 };
        assert_eq!([(); 5].map(|()| bits.signed()), [Some(0), Some(1), Some(-1), Some(2), Some(-2)]);
    }
}

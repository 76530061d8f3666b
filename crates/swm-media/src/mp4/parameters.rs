//! What the head of an H.264 stream says of its colors: which matrix, which range. Everything else in it is left to
//! the decoder.
//!
//! Source: ITU-T H.264, 7.3.2.1.1 (sequence parameter set) and E.1.1 (VUI).

/// How luma and chroma become red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Colors {
    /// ITU-R BT.709, else BT.601.
    pub(super) is_bt709: bool,
    /// 0 to 255, else studio range.
    pub(super) is_full_range: bool,
}

/// What players assume where the stream says nothing.
const UNSAID: Colors = Colors { is_bt709: false, is_full_range: false };

impl Colors {
    /// From a sequence parameter set; what players assume if it says nothing or cannot be understood.
    pub(super) fn of(parameter_set: &[u8]) -> Self {
        parse(&without_escapes(parameter_set)).unwrap_or(UNSAID)
    }
}

/// Profiles whose parameter sets have fields on chroma and scaling.
const HIGH_PROFILES: [u64; 12] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134];
/// "The aspect ratio follows in full."
const EXTENDED_ASPECT_RATIO: u64 = 255;
const BT709: u64 = 1;

fn parse(bytes: &[u8]) -> Option<Colors> {
    let mut bits = Bits { bytes, at: 8 };
    let profile = bits.take(8)?;
    bits.take(16)?;
    bits.exponential()?;
    if HIGH_PROFILES.contains(&profile) {
        if bits.exponential()? == 3 {
            bits.take(1)?;
        }
        bits.exponential()?;
        bits.exponential()?;
        bits.take(1)?;
        if bits.take(1)? == 1 {
            // Scaling lists: of no encoder that writes datasets.
            return None;
        }
    }
    bits.exponential()?;
    match bits.exponential()? {
        0 => drop(bits.exponential()?),
        1 => {
            bits.take(1)?;
            bits.exponential()?;
            bits.exponential()?;
            for _ in 0..bits.exponential()?.min(255) {
                bits.exponential()?;
            }
        }
        _ => {}
    }
    bits.exponential()?;
    bits.take(1)?;
    bits.exponential()?;
    bits.exponential()?;
    if bits.take(1)? == 0 {
        bits.take(1)?;
    }
    bits.take(1)?;
    if bits.take(1)? == 1 {
        for _ in 0..4 {
            bits.exponential()?;
        }
    }
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
    let is_bt709 = bits.take(1)? == 1 && {
        bits.take(16)?;
        bits.take(8)? == BT709
    };
    Some(Colors { is_bt709, is_full_range })
}

/// The payload of a NAL unit: a 3 after two zeros only keeps them from looking like a start code.
fn without_escapes(unit: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(unit.len());
    for &byte in unit {
        if byte != 3 || !bytes.ends_with(&[0, 0]) {
            bytes.push(byte);
        }
    }
    bytes
}

struct Bits<'a> {
    bytes: &'a [u8],
    /// In bits.
    at: usize,
}

impl Bits<'_> {
    fn take(&mut self, count: usize) -> Option<u64> {
        let mut value = 0;
        for _ in 0..count {
            let byte = self.bytes.get(self.at / 8)?;
            value = value << 1 | u64::from(byte >> (7 - self.at % 8) & 1);
            self.at += 1;
        }
        Some(value)
    }

    /// An Exp-Golomb code; signed ones take the same bits.
    fn exponential(&mut self) -> Option<u64> {
        let mut zeros = 0;
        while self.take(1)? == 0 {
            zeros += 1;
            if zeros > 32 {
                return None;
            }
        }
        Some((1 << zeros) - 1 + self.take(zeros)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonsense_gives_what_players_assume() {
        for bytes in [&[][..], &[0x67], &[0; 40]] {
            assert_eq!(Colors::of(bytes), UNSAID);
        }
    }

    #[test]
    fn exponential_codes() {
        let mut bits = Bits { bytes: &[0b1010_0110, 0b0100_0000], at: 0 };
        assert_eq!([(); 4].map(|()| bits.exponential()), [Some(0), Some(1), Some(2), Some(3)]);
    }
}

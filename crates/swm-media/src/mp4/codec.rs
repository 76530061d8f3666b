//! The two codecs: what a file says of them, how a sample becomes what their decoder takes, and whether decoding can begin at it.

use super::boxes::{Wrong, find, number};
use super::decoders::FrameDecoder;
use super::demux::Tables;
use super::parameters::{Colors, ParameterSet, UNSAID};
use super::slices::{PictureSet, is_misread};

/// What the samples are.
#[derive(Clone, Debug)]
pub(super) enum Codec {
    /// Bytes of the length before each unit of a sample, the parameter sets, each behind a start code, the first of them, and those of
    /// pictures.
    H264 { length_size: usize, head: Vec<u8>, set: Option<ParameterSet>, pictures: Vec<PictureSet> },
    #[cfg(feature = "av1")]
    Av1,
}

/// Kinds of units of H.264 (ITU-T H.264, table 7-1): a slice, parts of one, one of an IDR picture, parameter sets of a sequence and of
/// pictures.
const SLICE: u8 = 1;
const PARTITIONS: std::ops::RangeInclusive<u8> = 2..=4;
const IDR: u8 = 5;
const PARAMETERS: u8 = 7;
const PICTURE_PARAMETERS: u8 = 8;

/// The end of each reason for which a valid video is not decoded.
const FIX: &str = "encode the video again, as with `ffmpeg -i IN.mp4 -pix_fmt yuv420p OUT.mp4`";

/// The error for a valid video that is not decoded.
pub(super) fn unsupported(what: &str) -> Wrong {
    Wrong::Unsupported(format!("{what} is not decoded; {FIX}"))
}

impl Codec {
    /// From the sample description.
    pub(super) fn read(tables: &Tables) -> Result<Self, Wrong> {
        match &tables.codec {
            b"avc1" | b"avc3" => h264(find(&tables.description, b"avcC")?),
            #[cfg(feature = "av1")]
            b"av01" => av1(&tables.description),
            codec => {
                let name = match codec {
                    b"hvc1" | b"hev1" => "HEVC ",
                    b"vp08" => "VP8 ",
                    b"vp09" => "VP9 ",
                    b"av01" => "AV1 ",
                    b"mp4v" => "MPEG-4 part 2 ",
                    b"encv" => "encrypted ",
                    _ => "",
                };
                let more = if cfg!(feature = "av1") { " and AV1 (`av01`)" } else { "" };
                Err(Wrong::Unsupported(format!(
                    "its codec is {name}`{}`; only H.264 (`avc1`){more} can be decoded; {FIX}",
                    codec.escape_ascii()
                )))
            }
        }
    }

    /// What its parameter set says, if it has one.
    pub(super) const fn set(&self) -> Option<&ParameterSet> {
        match self {
            Self::H264 { set, .. } => set.as_ref(),
            #[cfg(feature = "av1")]
            Self::Av1 => None,
        }
    }

    /// The colors of images that say nothing of theirs.
    pub(super) fn colors(&self) -> Colors {
        self.set().map_or(UNSAID, |set| set.colors)
    }

    /// Whether samples have to be looked through to find out whether they are decoded.
    pub(super) fn is_in_doubt(&self) -> bool {
        match self {
            Self::H264 { pictures, .. } => pictures.iter().any(|set| !set.is_arithmetic()),
            #[cfg(feature = "av1")]
            Self::Av1 => false,
        }
    }

    /// A new decoder, for images of so many pixels at most.
    #[cfg_attr(not(feature = "av1"), expect(unused_variables, reason = "H.264 has limits of its own"))]
    pub(super) fn decoder(&self, pixels: usize) -> Result<FrameDecoder, String> {
        match self {
            Self::H264 { head, set, .. } => {
                FrameDecoder::h264(head, set.as_ref().is_some_and(|set| set.is_gray))
            }
            #[cfg(feature = "av1")]
            Self::Av1 => FrameDecoder::av1(pixels),
        }
    }

    /// Makes of a sample what the decoder takes: in H.264, start codes in the place of lengths. Whether decoding can begin at it.
    pub(super) fn prepare(&mut self, sample: &mut Vec<u8>) -> Result<bool, Wrong> {
        match self {
            Self::H264 { length_size, set, pictures, .. } => {
                if *length_size != 4 {
                    *sample = long_lengths(sample, *length_size)?;
                }
                let (mut at, mut is_start) = (0, false);
                while at < sample.len() {
                    let length = number(sample, at, 4)? as usize;
                    sample[at..at + 4].copy_from_slice(&[0, 0, 0, 1]);
                    let begin = at + 4;
                    at = begin
                        .checked_add(length)
                        .filter(|&end| end <= sample.len())
                        .ok_or("an image is cut short")?;
                    let unit = &sample[begin..at];
                    let kind = unit.first().map_or(0, |byte| byte & 0x1f);
                    is_start |= kind == IDR;
                    match (kind, &set) {
                        (PARAMETERS, _) => {
                            let found = supported(unit)?;
                            if set.is_none() {
                                *set = found;
                            }
                        }
                        (PICTURE_PARAMETERS, _) => {
                            pictures.extend(PictureSet::read(unit).filter(|set| !pictures.contains(set)));
                        }
                        (SLICE, Some(set)) if is_misread(unit, &set.numbers, pictures) == Some(true) => {
                            return Err(unsupported("H.264 in temporal direct mode without CABAC"));
                        }
                        (kind, _) if PARTITIONS.contains(&kind) => {
                            return Err(unsupported("H.264 in data partitions"));
                        }
                        _ => {}
                    }
                }
                Ok(is_start)
            }
            #[cfg(feature = "av1")]
            Self::Av1 => Ok(is_key(sample)),
        }
    }
}

/// A sample with lengths of four bytes.
fn long_lengths(sample: &[u8], length_size: usize) -> Result<Vec<u8>, String> {
    let (mut units, mut at) = (Vec::with_capacity(sample.len() + 64), 0);
    while at < sample.len() {
        let length = number(sample, at, length_size)?;
        at += length_size;
        let unit = sample.get(at..).and_then(|rest| rest.get(..length as usize));
        units.extend((length as u32).to_be_bytes());
        units.extend(unit.ok_or("an image is cut short")?);
        at += length as usize;
    }
    Ok(units)
}

/// A parameter set; `None` if it cannot be understood, which the decoder then tells.
fn supported(unit: &[u8]) -> Result<Option<ParameterSet>, Wrong> {
    let set = ParameterSet::read(unit);
    match set.as_ref().and_then(|set| set.unsupported.as_deref()) {
        Some(what) => Err(unsupported(what)),
        None => Ok(set),
    }
}

/// From `avcC`: the size of lengths, and the parameter sets.
fn h264(settings: &[u8]) -> Result<Codec, Wrong> {
    let length_size = number(settings, 4, 1)? as usize % 4 + 1;
    let (mut at, mut head, mut first, mut pictures) = (5, Vec::new(), None, Vec::new());
    for kind in 0..2 {
        let count = number(settings, at, 1)? & if kind == 0 { 0x1f } else { 0xff };
        at += 1;
        for _ in 0..count {
            let length = number(settings, at, 2)? as usize;
            let unit = settings.get(at + 2..at + 2 + length).ok_or("its parameter sets are cut short")?;
            if kind == 0 {
                let set = supported(unit)?;
                first = first.or(set);
            } else {
                pictures.extend(PictureSet::read(unit));
            }
            head.extend([0, 0, 0, 1]);
            head.extend(unit);
            at += 2 + length;
        }
    }
    Ok(Codec::H264 { length_size, head, set: first, pictures })
}

/// From `av1C`, if it is there. Source: AV1 Codec ISO Media File Format Binding, 2.3.3.
#[cfg(feature = "av1")]
fn av1(description: &[u8]) -> Result<Codec, Wrong> {
    let Ok(settings) = find(description, b"av1C") else { return Ok(Codec::Av1) };
    let bits = number(settings, 2, 1)?;
    let is = |bit: u64| bits & bit != 0;
    let (is_deep, is_12, is_gray, is_half_wide, is_half_high) = (is(0x40), is(0x20), is(0x10), is(8), is(4));
    match (is_deep, is_gray || is_half_wide && is_half_high) {
        (true, _) => Err(unsupported(if is_12 { "AV1 in 12 bits" } else { "AV1 in 10 bits" })),
        (_, false) => Err(unsupported(if is_half_wide { "AV1 in 4:2:2" } else { "AV1 in 4:4:4" })),
        _ => Ok(Codec::Av1),
    }
}

/// Whether the first frame of a sample is a key frame that is shown. One that is shown later only comes before frames that need earlier
/// ones. Source: AV1 Bitstream & Decoding Process Specification, 5.3.2 and 5.9.2.
#[cfg(feature = "av1")]
fn is_key(sample: &[u8]) -> bool {
    const SEQUENCE_HEADER: u8 = 1;
    const FRAME_HEADER: u8 = 3;
    const FRAME: u8 = 6;
    let mut rest = sample;
    while let Some((&head, mut after)) = rest.split_first() {
        if head & 4 != 0 {
            after = after.get(1..).unwrap_or_default();
        }
        let mut size = after.len();
        if head & 2 != 0 {
            size = 0;
            for place in 0..8 {
                let Some((&byte, tail)) = after.split_first() else { return false };
                after = tail;
                size |= usize::from(byte & 0x7f).checked_shl(7 * place).unwrap_or(0);
                if byte & 0x80 == 0 {
                    break;
                }
            }
        }
        let Some((unit, tail)) = after.split_at_checked(size) else { return false };
        let first = unit.first().copied().unwrap_or(0);
        match head >> 3 & 0xf {
            // A still image has neither type nor flag.
            SEQUENCE_HEADER if first & 0x08 != 0 => return true,
            FRAME_HEADER | FRAME => return first & 0xf0 == 0x10,
            _ => rest = tail,
        }
    }
    false
}

//! The decoders of films behind one shape: samples go in, pictures come out in the order in which they are shown. What a
//! sample is in a file, and which frame a picture is, is `reader`'s affair.

use openh264::OpenH264API;
use openh264::decoder::{DecodedYUV, Decoder, DecoderConfig, Flush};
use openh264::formats::YUVSource as _;

/// A decoded picture: planes of luma and of chroma at half resolution, 8 bits.
pub(super) struct Picture<'a> {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Bytes from one row of a plane to the next.
    pub(super) strides: [usize; 3],
    pub(super) planes: [&'a [u8]; 3],
}

/// What is done with a picture.
pub(super) type Take<'a> = &'a mut dyn FnMut(&Picture<'_>) -> Result<(), String>;

/// A decoder at work.
pub(super) enum FrameDecoder {
    H264(Box<Decoder>),
}

impl FrameDecoder {
    /// A decoder of H.264, that has seen the parameter sets.
    pub(super) fn h264(parameter_sets: &[u8]) -> Result<Self, String> {
        let config = DecoderConfig::new().flush_after_decode(Flush::NoFlush);
        let mut decoder = Decoder::with_api_config(OpenH264API::from_source(), config)
            .map_err(|error| error.to_string())?;
        decoder.decode(parameter_sets).map_err(|error| error.to_string())?;
        Ok(Self::H264(Box::new(decoder)))
    }

    /// Decodes a sample; hands on what can be shown now.
    pub(super) fn decode(&mut self, sample: &[u8], take: Take<'_>) -> Result<(), String> {
        match self {
            Self::H264(decoder) => match decoder.decode(sample).map_err(|error| error.to_string())? {
                Some(picture) => take(&of_h264(&picture)),
                None => Ok(()),
            },
        }
    }

    /// Hands on pictures that waited for later ones, which never come; how many there were.
    pub(super) fn finish(&mut self, take: Take<'_>) -> Result<usize, String> {
        match self {
            Self::H264(decoder) => {
                let rest = decoder.flush_remaining().map_err(|error| error.to_string())?;
                rest.iter().try_for_each(|picture| take(&of_h264(picture)))?;
                Ok(rest.len())
            }
        }
    }
}

fn of_h264<'a>(picture: &'a DecodedYUV<'_>) -> Picture<'a> {
    let ((width, height), strides) = (picture.dimensions(), picture.strides());
    Picture {
        width,
        height,
        strides: [strides.0, strides.1, strides.2],
        planes: [picture.y(), picture.u(), picture.v()],
    }
}

//! The decoders of videos behind one shape: samples go in, images come out in the order in which they are shown. What a
//! sample is in a file, and which frame an image is, is `reader`'s affair.

use openh264::OpenH264API;
use openh264::decoder::{DecodedYUV, Decoder, DecoderConfig, Flush};
use openh264::formats::YUVSource as _;
#[cfg(feature = "av1")]
use re_rav1d::dav1d::{self, PixelLayout, PlanarImageComponent};

#[cfg(feature = "av1")]
use super::parameters::Colors;

/// A decoded image: planes of luma and of chroma at half resolution, 8 bits.
pub(super) struct Image<'a> {
    /// Whether there is luma only; the other planes are then anything.
    pub(super) is_gray: bool,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Bytes from one row of a plane to the next.
    pub(super) strides: [usize; 3],
    pub(super) planes: [&'a [u8]; 3],
    /// What the image itself says of its colors.
    #[cfg(feature = "av1")]
    pub(super) colors: Option<Colors>,
}

/// What is done with an image.
pub(super) type Take<'a> = &'a mut dyn FnMut(&Image<'_>) -> Result<(), String>;

/// A decoder at work.
pub(super) enum FrameDecoder {
    /// And whether its images are gray.
    H264(Box<Decoder>, bool),
    #[cfg(feature = "av1")]
    Av1(Box<dav1d::Decoder>),
}

impl FrameDecoder {
    /// A decoder of H.264, that has seen the parameter sets.
    pub(super) fn h264(parameter_sets: &[u8], is_gray: bool) -> Result<Self, String> {
        let config = DecoderConfig::new().flush_after_decode(Flush::NoFlush);
        let mut decoder = Decoder::with_api_config(OpenH264API::from_source(), config)
            .map_err(|error| error.to_string())?;
        if !parameter_sets.is_empty() {
            decoder.decode(parameter_sets).map_err(|error| error.to_string())?;
        }
        Ok(Self::H264(Box::new(decoder), is_gray))
    }

    /// A decoder of AV1 in one thread, for images of so many pixels at most.
    #[cfg(feature = "av1")]
    pub(super) fn av1(pixels: usize) -> Result<Self, String> {
        let mut settings = dav1d::Settings::new();
        settings.set_n_threads(1);
        settings.set_max_frame_delay(1);
        // Coded sizes are whole blocks.
        settings.set_frame_size_limit(u32::try_from(pixels.saturating_mul(2)).unwrap_or(u32::MAX));
        let decoder = dav1d::Decoder::with_settings(&settings).map_err(|error| error.to_string())?;
        Ok(Self::Av1(Box::new(decoder)))
    }

    /// Decodes a sample; hands on what can be shown now.
    pub(super) fn decode(&mut self, sample: &[u8], take: Take<'_>) -> Result<(), String> {
        match self {
            Self::H264(decoder, is_gray) => {
                match decoder.decode(sample).map_err(|error| error.to_string())? {
                    Some(image) => take(&of_h264(&image, *is_gray)),
                    None => Ok(()),
                }
            }
            #[cfg(feature = "av1")]
            Self::Av1(decoder) => {
                let mut sent = decoder.send_data(sample.to_vec(), None, None, None);
                loop {
                    drain(decoder, take)?;
                    match sent {
                        Ok(()) => return Ok(()),
                        Err(dav1d::Error::Again) => sent = decoder.send_pending_data(),
                        Err(error) => return Err(error.to_string()),
                    }
                }
            }
        }
    }

    /// Hands on images that waited for later ones, which never come; how many there were.
    pub(super) fn finish(&mut self, take: Take<'_>) -> Result<usize, String> {
        match self {
            Self::H264(decoder, is_gray) => {
                let rest = decoder.flush_remaining().map_err(|error| error.to_string())?;
                rest.iter().try_for_each(|image| take(&of_h264(image, *is_gray)))?;
                Ok(rest.len())
            }
            #[cfg(feature = "av1")]
            Self::Av1(decoder) => drain(decoder, take),
        }
    }
}

fn of_h264<'a>(image: &'a DecodedYUV<'_>, is_gray: bool) -> Image<'a> {
    let ((width, height), strides) = (image.dimensions(), image.strides());
    Image {
        is_gray,
        width,
        height,
        strides: [strides.0, strides.1, strides.2],
        planes: [image.y(), image.u(), image.v()],
        #[cfg(feature = "av1")]
        colors: None,
    }
}

/// Hands on all images that are ready; how many there were.
#[cfg(feature = "av1")]
fn drain(decoder: &mut dav1d::Decoder, take: Take<'_>) -> Result<usize, String> {
    let mut shown = 0;
    loop {
        let image = match decoder.get_picture() {
            Ok(image) => image,
            Err(dav1d::Error::Again) => return Ok(shown),
            Err(error) => return Err(error.to_string()),
        };
        let is_gray = matches!(image.pixel_layout(), PixelLayout::I400);
        if image.bit_depth() != 8 || !is_gray && !matches!(image.pixel_layout(), PixelLayout::I420) {
            return Err("its images are not of 8 bits with chroma at half resolution".to_owned());
        }
        let [luma, first, second] =
            [PlanarImageComponent::Y, PlanarImageComponent::U, PlanarImageComponent::V];
        let parts = if is_gray { [luma, luma, luma] } else { [luma, first, second] };
        let strides = parts.map(|part| image.stride(part) as usize);
        let planes = parts.map(|part| image.plane(part));
        let colors = Colors {
            matrix: image.matrix_coefficients() as u8,
            is_full_range: image.color_range() as u32 == 1,
        };
        take(&Image {
            is_gray,
            width: image.width() as usize,
            height: image.height() as usize,
            strides,
            planes: planes.each_ref().map(AsRef::as_ref),
            colors: Some(colors),
        })?;
        shown += 1;
    }
}

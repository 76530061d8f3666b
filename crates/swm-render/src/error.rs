//! The one error type of the crate.

/// What can be wrong with a request to a renderer or a resampler.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// A side of an image is zero or absurdly large.
    #[error("{what} of {height} x {width} px cannot be made: each side must be from 1 to {max}")]
    Size {
        /// Which image was asked for.
        what: &'static str,
        /// Asked height.
        height: usize,
        /// Asked width.
        width: usize,
        /// Largest side allowed.
        max: usize,
    },
    /// A canvas is not of the size that a resize was made for.
    #[error(
        "a canvas of {height} x {width} px cannot be resized by tables made for {side} x {side} px; make tables for its size"
    )]
    Canvas {
        /// The canvas's height.
        height: usize,
        /// The canvas's width.
        width: usize,
        /// The side that it should have.
        side: usize,
    },
    /// A pixel slice does not hold exactly the image.
    #[error(
        "{what} holds {actual} bytes but {height} x {width} x 3 = {expected} are needed; pass a slice of that length"
    )]
    Length {
        /// Which slice.
        what: &'static str,
        /// Its length.
        actual: usize,
        /// The image's height.
        height: usize,
        /// The image's width.
        width: usize,
        /// The length that it should have.
        expected: usize,
    },
    /// A mesh contradicts itself.
    #[error("a mesh cannot be rendered: {reason}")]
    Mesh {
        /// What is wrong with it.
        reason: String,
    },
    /// A texture's bytes are not of its size.
    #[error("{what} cannot be used: width x height x 3 bytes are needed")]
    Texture {
        /// Sizes and bytes.
        what: String,
    },
    /// A scene names a mesh or texture that the assets lack, or more instances than can be told apart.
    #[error("a scene cannot be rendered: {reason}")]
    Scene {
        /// What is wrong with it.
        reason: String,
    },
}

#[cfg(feature = "env")]
impl From<RenderError> for swm_core::EnvError {
    fn from(error: RenderError) -> Self {
        Self::other(error)
    }
}

/// Largest side of any image that the crate makes.
pub(crate) const MAX_SIDE: usize = 4096;

pub(crate) fn check_size(what: &'static str, height: usize, width: usize) -> Result<(), RenderError> {
    let allowed = 1..=MAX_SIDE;
    if allowed.contains(&height) && allowed.contains(&width) {
        return Ok(());
    }
    Err(RenderError::Size { what, height, width, max: MAX_SIDE })
}

pub(crate) fn check_len(
    what: &'static str,
    actual: usize,
    height: usize,
    width: usize,
) -> Result<(), RenderError> {
    let expected = height * width * 3;
    if actual == expected {
        return Ok(());
    }
    Err(RenderError::Length { what, actual, height, width, expected })
}

#[cfg(all(test, feature = "env"))]
mod tests {
    use swm_core::EnvError;

    #[test]
    fn an_environment_passes_it_on() {
        let make = || -> Result<(), EnvError> { Ok(super::check_size("the image", 0, 4)?) };
        let error = make().unwrap_err();
        assert!(matches!(error, EnvError::Other(_)) && error.to_string().contains("0 x 4 px"), "{error}");
    }
}

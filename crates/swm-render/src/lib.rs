//! Software renderers: 2D raster, resampling, frames.

//! Software renderers: 2D raster, resampling, frames.
//!
//! An environment describes its image once, against [`Painter`], in world coordinates; a [`Renderer`] turns it into
//! `[H, W, 3]` u8 RGB frames in one of two styles:
//!
//! - [`Style::Exact`] follows the reference's image pipeline to the byte: drawn without anti-aliasing on a 512-px
//!   canvas, resized to 224 px by a fixed-point bilinear filter, then to the asked size by an antialiased one;
//! - [`Style::Fast`] renders at the asked size with analytic coverage.
//!
//! On a [`Geometry::surface`] the exact style follows Gymnasium's classic control instead: pygame's anti-aliased shapes on a
//! surface with y up, colors replaced afterwards ([`Renderer::set_palette`]), then the same last resize.
//!
//! Both keep the last frame and redraw only where the primitives differ, with the same bytes as a full redraw.
//!
//! ```
//! use swm_render::{Geometry, Painter, Renderer, Style};
//!
//! let mut renderer = Renderer::new(Style::Exact, Geometry::new(64, 64))?;
//! renderer.set_background(|p| p.fill([255, 255, 255]));
//! let mut frame = vec![0; 64 * 64 * 3];
//! for x in [100.0, 103.5, 107.0] {
//!     renderer.render(&mut frame, |p| p.disc([x, 256.0], 15.0, [65, 105, 225]))?;
//! }
//! # Ok::<(), swm_render::RenderError>(())
//! ```
//!
//! What is deliberately absent: files and codecs, text, any knowledge of an environment, threads, and any state that
//! could make a frame depend on the frames before it.

mod canvas;
mod damage;
mod display_list;
mod error;
mod exact;
mod fast;
mod geometry;
mod painter;
mod palette;
mod rect;
mod region;
mod renderer;
mod resample;
#[cfg(feature = "scene")]
pub mod scene;
mod turn_arrow;

pub use canvas::Canvas;
pub use error::RenderError;
pub use exact::ExactRenderer;
pub use fast::FastRenderer;
pub use geometry::Geometry;
pub use painter::{Painter, Rgb, light, round_half_even};
pub use rect::Rect;
pub use renderer::{Renderer, Style};
pub use resample::{AntialiasBilinear, FixedBilinear};

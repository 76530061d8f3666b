//! Which pictures an environment puts into its rows, and in which columns: cameras, depth, segmentation, quality. How a
//! picture is drawn is not known here.

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{Dtype, Field, ImageSize, RowsMut};
use swm_render::scene::Quality;

use crate::error::MujocoError;
use crate::ffi::{Model, Object, Simulation};
use crate::suite::picture::Canvas;

/// Depth of [`PIXELS`], f32 `[H, W]`, m.
const DEPTH: &str = "pixels_depth";
/// What [`PIXELS`] shows, i32 `[H, W]`: indices of geoms, -2 - index for sites, -1 for nothing.
const SEGMENTATION: &str = "pixels_segmentation";

/// What draws pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Renderer {
    /// Our own.
    #[default]
    Software,
    /// MuJoCo's.
    Gl,
}

impl Renderer {
    /// In words and with its version.
    pub(crate) fn describe(self) -> String {
        match self {
            Self::Software => format!("swm-render {} (software)", env!("CARGO_PKG_VERSION")),
            Self::Gl => format!("MuJoCo {} (OpenGL)", crate::assets::MUJOCO_VERSION),
        }
    }
}

/// A camera of the model.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum CameraName {
    Index(usize),
    Name(String),
}

/// Cameras of the model: a list, or names with commas between them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum CameraNames {
    List(Vec<CameraName>),
    Index(usize),
    Names(String),
}

impl Default for CameraNames {
    fn default() -> Self {
        Self::List(Vec::new())
    }
}

impl CameraNames {
    fn list(&self) -> Vec<CameraName> {
        match self {
            Self::List(list) => list.clone(),
            Self::Index(index) => vec![CameraName::Index(*index)],
            Self::Names(names) => {
                let names = names.split(',').map(str::trim).filter(|name| !name.is_empty());
                names
                    .map(|name| {
                        name.parse().map_or_else(|_| CameraName::Name(name.to_owned()), CameraName::Index)
                    })
                    .collect()
            }
        }
    }
}

/// What pictures there are.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Wanted {
    pub(crate) renderer: Renderer,
    /// Whose picture is the column `pixels`.
    pub(crate) camera: CameraName,
    /// Whose pictures are the columns `pixels.<camera>`.
    pub(crate) cameras: CameraNames,
    pub(crate) depth: bool,
    pub(crate) segmentation: bool,
    pub(crate) quality: Quality,
}

/// One camera and the names of what is written of it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct View {
    camera: usize,
    pixels: String,
    depth: Option<String>,
    segmentation: Option<String>,
}

/// The cameras of an environment and the columns of each.
#[derive(Clone, Debug)]
pub(crate) struct Views {
    views: Vec<View>,
    renderer: Renderer,
    quality: Quality,
    size: ImageSize,
}

impl Views {
    /// Looks up the cameras in the model.
    pub(crate) fn new(wanted: &Wanted, model: &Model, size: ImageSize) -> Result<Self, MujocoError> {
        let Wanted { renderer, quality, .. } = *wanted;
        let has_labels = wanted.depth || wanted.segmentation;
        if renderer == Renderer::Gl && (has_labels || quality != Quality::default()) {
            let reason = "depth, segmentation, antialias, shadows and reflections need `renderer=software`";
            return Err(MujocoError::Pictures { reason: reason.to_owned() });
        }
        let names = model.names(Object::Camera);
        let mut views: Vec<View> = Vec::new();
        for (number, camera) in [&wanted.camera].into_iter().chain(&wanted.cameras.list()).enumerate() {
            let index = match camera {
                CameraName::Index(index) if *index < names.len() => *index,
                CameraName::Index(index) => {
                    return Err(MujocoError::NoCamera { index: *index, count: names.len() });
                }
                CameraName::Name(name) => model.id(Object::Camera, name)?,
            };
            let suffix = match (number, names[index].as_str()) {
                (0, _) => String::new(),
                (_, "") => format!(".{index}"),
                (_, name) => format!(".{name}"),
            };
            let named = |column: &str| format!("{column}{suffix}");
            let view = View {
                camera: index,
                pixels: named(PIXELS),
                depth: wanted.depth.then(|| named(DEPTH)),
                segmentation: wanted.segmentation.then(|| named(SEGMENTATION)),
            };
            if views.contains(&view) {
                let reason = format!("the camera `{}` is named twice", &suffix[1..]);
                return Err(MujocoError::Pictures { reason });
            }
            views.push(view);
        }
        Ok(Self { views, renderer, quality, size })
    }

    /// The columns, in the order in which [`Pictures::write`] expects them.
    pub(crate) fn fields(&self) -> Vec<Field> {
        let ImageSize { height, width } = self.size;
        let mut fields = Vec::new();
        for view in &self.views {
            fields.push(self.size.field(&view.pixels));
            fields.extend(view.depth.iter().map(|name| Field::step(name, Dtype::F32, &[height, width])));
            fields
                .extend(view.segmentation.iter().map(|name| Field::step(name, Dtype::I32, &[height, width])));
        }
        fields
    }
}

/// Draws all pictures of an environment.
pub(crate) struct Pictures {
    views: Views,
    canvases: Vec<Canvas>,
}

impl Pictures {
    /// For simulations of models with the same objects as this one, which lends textures and meshes.
    pub(crate) fn new(views: Views, model: &std::sync::Arc<Model>) -> Result<Self, MujocoError> {
        let canvas = |view: &View| Canvas::new(model, views.renderer, view.camera, views.size, views.quality);
        let canvases = views.views.iter().map(canvas).collect::<Result<_, _>>()?;
        Ok(Self { views, canvases })
    }

    /// One per camera.
    pub(crate) fn canvases(&mut self) -> impl Iterator<Item = &mut Canvas> {
        self.canvases.iter_mut()
    }

    /// What draws, in words and with its version.
    pub(crate) fn renderer(&self) -> String {
        self.views.renderer.describe()
    }

    /// Writes the columns [`Views::fields`], the first of which has this index.
    pub(crate) fn write(&mut self, sim: &mut Simulation, first: usize, out: &mut RowsMut<'_>) {
        let mut column = first;
        let mut next = || {
            column += 1;
            column - 1
        };
        for (view, canvas) in self.views.views.iter().zip(&mut self.canvases) {
            canvas.draw(sim, out.at(next()));
            if view.depth.is_some() {
                canvas.write_depth(out.at(next()));
            }
            if view.segmentation.is_some() {
                canvas.write_segmentation(out.at(next()));
            }
        }
    }

    /// Why a picture is black, once.
    pub(crate) fn take_failure(&mut self) -> Option<MujocoError> {
        self.canvases.iter_mut().find_map(Canvas::take_failure)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_named_in_every_way() {
        let read = |text: &str| serde_json::from_str::<CameraNames>(text).map(|names| names.list());
        let name = |text: &str| CameraName::Name(text.to_owned());
        assert_eq!(read(r#"["back", 1]"#).unwrap(), [name("back"), CameraName::Index(1)]);
        assert_eq!(read(r#""back, 1""#).unwrap(), [name("back"), CameraName::Index(1)]);
        assert_eq!(read("2").unwrap(), [CameraName::Index(2)]);
        assert_eq!(read(r#""""#).unwrap(), []);
        assert!(read("1.5").is_err());
    }
}

//! Which images an environment puts into its rows, and in which columns: cameras, depth, segmentation, quality. How a
//! image is drawn is not known here.

mod canvas;
mod checker;
mod goal;
pub(crate) mod settings;

use std::sync::Arc;

use swm_core::env::PIXELS;
use swm_core::{Dtype, Field, ImageSize, RowsMut};
use swm_render::scene::Quality;

use canvas::{Canvas, Recolor};
pub(crate) use checker::CheckerColors;
pub(crate) use goal::GoalImage;
pub(crate) use settings::CameraName;
use settings::{ImageSettings, Renderer};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Simulation};

/// Depth of [`PIXELS`], f32 `[H, W]`, m.
const DEPTH: &str = "pixels_depth";
/// What [`PIXELS`] shows, i32 `[H, W]`: indices of geoms, -2 - index for sites, -1 for nothing.
const SEGMENTATION: &str = "pixels_segmentation";

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
    /// Looks up the cameras in the model; `camera` is the one that [`PIXELS`] shows unless another is asked for. Settings are
    /// checked where no images of a `size` are wanted, too.
    pub(crate) fn new(
        wanted: &ImageSettings,
        camera: &CameraName,
        model: &Model,
        size: Option<ImageSize>,
    ) -> Result<Option<Self>, MujocoError> {
        let (renderer, quality) = (wanted.renderer, wanted.quality());
        let has_labels = wanted.depth || wanted.segmentation;
        if renderer == Renderer::Gl && (has_labels || quality != Quality::default()) {
            let reason = "depth, segmentation, antialias, shadows and reflections need `renderer=software`";
            return Err(MujocoError::Images { reason: reason.to_owned() });
        }
        let names = model.names(Object::Camera);
        let mut views: Vec<View> = Vec::new();
        let first = wanted.camera.as_ref().unwrap_or(camera);
        for (number, camera) in [first].into_iter().chain(&wanted.cameras.list()).enumerate() {
            let index = match camera {
                CameraName::Index(index) if *index < names.len() => *index,
                CameraName::Index(index) => {
                    return Err(MujocoError::NoCamera { index: *index, count: names.len() });
                }
                CameraName::Name(name) => names.iter().position(|known| known == name).ok_or_else(|| {
                    let known: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
                    let reason = format!("unknown camera `{name}`; there are {}", known.join(", "));
                    MujocoError::Images { reason }
                })?,
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
                return Err(MujocoError::Images { reason });
            }
            views.push(view);
        }
        Ok(size.map(|size| Self { views, renderer, quality, size }))
    }

    /// The columns, in the order in which [`Images::write`] expects them.
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

/// Draws all images of an environment.
pub(crate) struct Images {
    views: Views,
    canvases: Vec<Canvas>,
}

impl Images {
    /// For simulations of models with the same objects as this one, which lends textures and meshes.
    pub(crate) fn new(views: Views, model: &Arc<Model>) -> Result<Self, MujocoError> {
        let canvas = |view: &View| Canvas::new(model, views.renderer, view.camera, views.size, views.quality);
        let canvases = views.views.iter().map(canvas).collect::<Result<_, _>>()?;
        Ok(Self { views, canvases })
    }

    /// Takes textures and meshes from another model from now on.
    pub(crate) fn set_model(&mut self, model: &Arc<Model>) -> Result<(), MujocoError> {
        self.canvases.iter_mut().try_for_each(|canvas| canvas.set_model(model))
    }

    /// Shows a texture of `model`, which lends all others, in colors that depend on its own.
    pub(crate) fn recolor(
        &mut self,
        model: &Arc<Model>,
        texture: usize,
        recolor: &Recolor<'_>,
    ) -> Result<(), MujocoError> {
        self.canvases.iter_mut().try_for_each(|canvas| canvas.recolor(model, texture, recolor))
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
            canvas.render(sim, out.at(next()));
            if view.depth.is_some() {
                canvas.write_depth(out.at(next()));
            }
            if view.segmentation.is_some() {
                canvas.write_segmentation(out.at(next()));
            }
        }
    }

    /// Renders what the column [`PIXELS`] shows, `[H, W, 3]`.
    pub(crate) fn render(&mut self, sim: &mut Simulation, pixels: &mut [u8]) {
        if let Some(first) = self.canvases.first_mut() {
            first.render(sim, pixels);
        }
    }

    /// Why an image is black, once.
    pub(crate) fn take_failure(&mut self) -> Option<MujocoError> {
        self.canvases.iter_mut().find_map(Canvas::take_failure)
    }
}

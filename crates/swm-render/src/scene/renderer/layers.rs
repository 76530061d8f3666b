//! Depth and segments of what is seen.

use super::passes::{PASSES, Passes, is_behind, is_opaque};
use super::{SceneRenderer, check};
use crate::error::{RenderError, check_len};
use crate::scene::assets::Assets;
use crate::scene::description::{Scene, Shape};
use crate::scene::grid::Raster;
use crate::scene::target::NOTHING;
use crate::scene::triangles::Sides;
use crate::scene::view::View;
use crate::scene::visibility::Drawing;

impl SceneRenderer {
    /// Writes the depth along the camera's axis, meters, `[H, W]`; the camera's `far` where nothing is.
    ///
    /// # Errors
    ///
    /// `depth` has another length, or the scene names assets that do not exist.
    pub fn render_depth(
        &mut self,
        scene: &Scene,
        assets: &Assets,
        depth: &mut [f32],
    ) -> Result<(), RenderError> {
        self.depths(scene, assets, depth, true)
    }

    /// Writes the segment of what is seen, `[H, W]`; [`crate::scene::NO_SEGMENT`] where nothing is.
    ///
    /// # Errors
    ///
    /// `segments` has another length, or the scene names assets that do not exist.
    pub fn render_segmentation(
        &mut self,
        scene: &Scene,
        assets: &Assets,
        segments: &mut [i32],
    ) -> Result<(), RenderError> {
        self.segments(scene, assets, segments, true)
    }

    /// As [`SceneRenderer::render_depth`], of the scene that was rendered last, which is looked at again only if another
    /// renderer worked on this thread in between.
    ///
    /// # Errors
    ///
    /// `depth` has another length, or the scene names assets that do not exist.
    pub fn depth_of_last(
        &mut self,
        scene: &Scene,
        assets: &Assets,
        depth: &mut [f32],
    ) -> Result<(), RenderError> {
        self.depths(scene, assets, depth, false)
    }

    /// As [`SceneRenderer::render_segmentation`], of the scene that was rendered last, which is looked at again only if another
    /// renderer worked on this thread in between.
    ///
    /// # Errors
    ///
    /// `segments` has another length, or the scene names assets that do not exist.
    pub fn segmentation_of_last(
        &mut self,
        scene: &Scene,
        assets: &Assets,
        segments: &mut [i32],
    ) -> Result<(), RenderError> {
        self.segments(scene, assets, segments, false)
    }

    fn depths(
        &self,
        scene: &Scene,
        assets: &Assets,
        depth: &mut [f32],
        is_new: bool,
    ) -> Result<(), RenderError> {
        check_len("depth", depth.len() * 3, self.frame.height, self.frame.width)?;
        let far = scene.camera.far as f32;
        self.with_raster(scene, assets, is_new, |raster| {
            let seen = raster.known.owner.iter().zip(&raster.nearness);
            for (depth, (&owner, &nearness)) in depth.iter_mut().zip(seen) {
                *depth = if owner == NOTHING { far } else { 1.0 / nearness };
            }
        })
    }

    fn segments(
        &self,
        scene: &Scene,
        assets: &Assets,
        segments: &mut [i32],
        is_new: bool,
    ) -> Result<(), RenderError> {
        check_len("segments", segments.len() * 3, self.frame.height, self.frame.width)?;
        self.with_raster(scene, assets, is_new, |raster| {
            for (segment, &owner) in segments.iter_mut().zip(&raster.known.owner) {
                let seen = scene.instances.get(usize::from(owner));
                *segment = seen.map_or(crate::scene::NO_SEGMENT, |instance| instance.segment);
            }
        })
    }

    /// Shows what is nearest, surfaces that one sees through included; `is_new`: not the scene that was rendered last.
    fn with_raster(
        &self,
        scene: &Scene,
        assets: &Assets,
        is_new: bool,
        show: impl FnOnce(&Raster),
    ) -> Result<(), RenderError> {
        check(scene, assets)?;
        PASSES.with_borrow_mut(|passes| {
            passes.begin(self.frame, self.id);
            if is_new || !passes.has_seen() {
                passes.see(
                    scene,
                    assets,
                    &View::of_camera(&scene.camera, self.frame.width, self.frame.height),
                );
            }
            passes.see_veils(scene, assets);
            show(&passes.raster);
        });
        Ok(())
    }
}

impl Passes {
    /// Depth and segments are those of the nearest surface, also where one sees through it.
    fn see_veils(&mut self, scene: &Scene, assets: &Assets) {
        if std::mem::replace(&mut self.knows_veils, true) {
            return;
        }
        let view = View::of_camera(&scene.camera, self.frame.width, self.frame.height);
        let drawing = Drawing::new(&view, assets, Sides::Front);
        for (owner, instance) in (0..).zip(&scene.instances) {
            let is_plane = matches!(instance.shape, Shape::Plane { .. });
            let is_veil = instance.material.color[3] > 0.0 && !is_opaque(instance, &view);
            if is_veil && !(is_plane && is_behind(instance, &view)) {
                drawing.draw(instance, owner, &mut self.projected, &mut self.raster);
            }
        }
    }
}

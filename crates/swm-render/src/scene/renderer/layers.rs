//! Depth and segments of what is seen.

use super::{COARSENESS, SceneRenderer, check, is_behind, is_opaque};
use crate::error::{RenderError, check_len};
use crate::scene::assets::Assets;
use crate::scene::description::{Scene, Shape};
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
        check(scene, assets)?;
        self.see(scene, assets, &View::of_camera(&scene.camera, self.width, self.height));
        self.depth_of_last(scene, assets, depth)
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
        check(scene, assets)?;
        self.see(scene, assets, &View::of_camera(&scene.camera, self.width, self.height));
        self.segmentation_of_last(scene, assets, segments)
    }

    /// As [`SceneRenderer::render_depth`], of the scene that was rendered last, which is not looked at again.
    ///
    /// # Errors
    ///
    /// `depth` has another length.
    pub fn depth_of_last(
        &mut self,
        scene: &Scene,
        assets: &Assets,
        depth: &mut [f32],
    ) -> Result<(), RenderError> {
        check_len("depth", depth.len() * 3, self.height, self.width)?;
        self.see_veils(scene, assets);
        let far = scene.camera.far as f32;
        for (depth, (&owner, &nearness)) in
            depth.iter_mut().zip(self.raster.known.owner.iter().zip(&self.raster.nearness))
        {
            *depth = if owner == NOTHING { far } else { 1.0 / nearness };
        }
        Ok(())
    }

    /// As [`SceneRenderer::render_segmentation`], of the scene that was rendered last, which is not looked at again.
    ///
    /// # Errors
    ///
    /// `segments` has another length.
    pub fn segmentation_of_last(
        &mut self,
        scene: &Scene,
        assets: &Assets,
        segments: &mut [i32],
    ) -> Result<(), RenderError> {
        check_len("segments", segments.len() * 3, self.height, self.width)?;
        self.see_veils(scene, assets);
        for (segment, &owner) in segments.iter_mut().zip(&self.raster.known.owner) {
            let seen = scene.instances.get(usize::from(owner));
            *segment = seen.map_or(crate::scene::NO_SEGMENT, |instance| instance.segment);
        }
        Ok(())
    }

    /// Depth and segments are those of the nearest surface, also where one sees through it.
    fn see_veils(&mut self, scene: &Scene, assets: &Assets) {
        if std::mem::replace(&mut self.knows_veils, true) || self.raster.len() == 0 {
            return;
        }
        let view = View::of_camera(&scene.camera, self.width, self.height);
        let drawing = Drawing { view: &view, assets, sides: Sides::Front, coarseness: COARSENESS };
        for (owner, instance) in (0..).zip(&scene.instances) {
            let is_plane = matches!(instance.shape, Shape::Plane { .. });
            let is_veil = instance.material.color[3] > 0.0 && !is_opaque(instance, &view);
            if is_veil && !(is_plane && is_behind(instance, &view)) {
                drawing.draw(instance, owner, &mut self.projected, &mut self.raster);
            }
        }
    }
}

//! The models of a maze: OGBench's body with walls around it. One for images and a light one for physics, each made once per
//! process; every environment edits its own copy of the light one.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use swm_fov::Fov;

use super::Body;
use super::factors::{controls, is_encoded};
use super::layout::{HEIGHT, Maze, TELEPORTER_RADIUS, UNIT, place_of};
use super::soccer::add_ball;
use crate::suite::{Control, edit_in_place};
use swm_mujoco::MujocoError;
use swm_mujoco::assets::maze_model;
use swm_mujoco::{Model, Object, Shape, Simulation, Spec};

/// The camera that looks down on the whole maze.
pub(super) const TOP: &str = "top";
/// The marker of the goal.
pub(super) const TARGET: &str = "target";

/// Which model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kind {
    pub(super) body: Body,
    pub(super) maze: Maze,
    /// Whether the floor's color says where one is.
    pub(super) encoded: bool,
}

/// Gives the models for an assignment of factors.
pub(super) struct Models {
    kind: Kind,
    controls: Vec<Control>,
    shared: Arc<Shared>,
}

/// The models of this process.
struct Shared {
    /// For physics, without the pixels of textures.
    light: Arc<Model>,
    /// With all textures.
    full: Arc<Model>,
}

impl Models {
    pub(super) fn new(body: Body, maze: Maze) -> Result<Self, MujocoError> {
        let kind = Kind { body, maze, encoded: false };
        Ok(Self { kind, controls: controls(body), shared: Shared::get(kind)? })
    }

    /// The model for physics with all factors at their defaults.
    pub(super) fn light(&self) -> Arc<Model> {
        Arc::clone(&self.shared.light)
    }

    /// The model with all textures, for images.
    pub(super) fn full(&self) -> Arc<Model> {
        Arc::clone(&self.shared.full)
    }

    /// Gives the simulation the model for these factors; its state stays. Whether images need another model now.
    pub(super) fn apply(&mut self, fov: &Fov, sim: &mut Simulation) -> Result<bool, MujocoError> {
        let is_other = is_encoded(fov) != self.kind.encoded;
        if is_other {
            let kind = Kind { encoded: !self.kind.encoded, ..self.kind };
            (self.shared, self.kind) = (Shared::get(kind)?, kind);
        }
        // The ball's density edits more than values.
        if is_other || self.kind.body.has_ball() || Arc::strong_count(sim.model()) > 1 {
            sim.set_model(self.light())?;
        } else {
            sim.model_mut().copy_values(&self.shared.light);
        }
        edit_in_place(&self.controls, fov, sim.model_mut())?;
        Ok(is_other)
    }
}

impl Shared {
    /// The models of this process; compiled by whoever comes first, freed with the last environment.
    fn get(kind: Kind) -> Result<Arc<Self>, MujocoError> {
        static KNOWN: Mutex<Vec<(Kind, Weak<Shared>)>> = Mutex::new(Vec::new());
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|(_, models)| models.strong_count() > 0);
        let found = known.iter().find(|(other, _)| *other == kind);
        if let Some(models) = found.and_then(|(_, models)| models.upgrade()) {
            return Ok(models);
        }
        let mut spec = description(kind)?;
        let mut full = spec.compile()?;
        if kind.encoded {
            paint_places(&mut full)?;
        }
        spec.shrink_textures();
        let models = Arc::new(Self { light: Arc::new(spec.compile()?), full: Arc::new(full) });
        known.push((kind, Arc::downgrade(&models)));
        Ok(models)
    }
}

/// The body in its maze, with what the reference's model lacks: a camera, and a floor that says where one is.
fn description(kind: Kind) -> Result<Spec, MujocoError> {
    let mut spec = composed(kind)?;
    let ([x, y], columns) = (kind.maze.center(), kind.maze.size()[1]);
    // Where the reference's free camera stands.
    let height = 5.0 * (columns as f64 - 2.0);
    spec.add_camera(TOP, [x, y, height], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0])?;
    if kind.encoded {
        spec.material("grid")?.set_uniform_texture(false);
    }
    Ok(spec)
}

/// The reference's model: walls, discs and the marker stand in its order.
fn composed(Kind { body, maze, .. }: Kind) -> Result<Spec, MujocoError> {
    let mut spec = Spec::read(&maze_model(body.file())?)?;
    for cell in maze.cells().filter(|&cell| !maze.is_free(cell)) {
        let [x, y] = place_of(cell);
        let (side, height) = (UNIT / 2.0, HEIGHT / 2.0);
        let name = format!("block_{}_{}", cell[0], cell[1]);
        spec.add_geom("world", &name, (Shape::Box, [x, y, height], [side, side, height]), "wall", true)?;
    }
    let [x, y] = maze.center();
    let [rows, columns] = maze.size().map(|count| UNIT / 2.0 * count as f64);
    spec.geom("floor")?.set_position([x, y, 0.0]).set_size([columns, rows, 0.2]);
    let mut add_disc = |name: &str, [x, y]: [f64; 2], radius: f64, material: &str| {
        const HALF_HEIGHT: f64 = 0.05;
        let disc = (Shape::Cylinder, [x, y, HALF_HEIGHT], [radius, HALF_HEIGHT, 0.0]);
        spec.add_geom("world", name, disc, material, false)
    };
    if let Some(teleporters) = maze.teleporters() {
        let [into, out] = body.teleporter_materials();
        for (cells, name, material) in
            [(teleporters.ins, "teleport_in", into), (teleporters.outs, "teleport_out", out)]
        {
            for (index, cell) in cells.iter().enumerate() {
                add_disc(&format!("{name}_{index}"), place_of(*cell), TELEPORTER_RADIUS, material)?;
            }
        }
    }
    add_disc(TARGET, [0.0, 0.0], 0.5, "target")?;
    if body.has_ball() {
        add_ball(&mut spec)?;
    }
    Ok(spec)
}

/// Lets the floor's red grow with the texture's rows and its green with the columns, to 192.
fn paint_places(model: &mut Model) -> Result<(), MujocoError> {
    let texture = model.id(Object::Texture, "grid")?;
    let texture = model.texture(texture);
    let (height, width) = (texture.height, texture.width);
    for (index, pixel) in texture.data.chunks_exact_mut(texture.channels).enumerate() {
        let (row, column) = (index / width, index % width);
        pixel[..3].copy_from_slice(&[(192 * row / height) as u8, (192 * column / width) as u8, 128]);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recorded_model::assert_is_recorded;

    #[test]
    fn composed_models_equal_the_references_in_every_array() {
        for (body, maze, file) in [
            (Body::Point, Maze::Large, "point-maze-large"),
            (Body::Point, Maze::Teleport, "point-maze-teleport"),
            (Body::Ant, Maze::Large, "ant-maze-large"),
            (Body::Ant, Maze::Giant, "ant-maze-giant"),
            (Body::Humanoid, Maze::Medium, "humanoid-maze-medium"),
            (Body::AntSoccer, Maze::Arena, "ant-soccer-arena"),
        ] {
            let kind = Kind { body, maze, encoded: false };
            assert_is_recorded(&composed(kind).unwrap().compile().unwrap(), file);
        }
    }
}

//! The reference's contacts: a disc in overlap with rectangles is pushed out by a fraction of the overlap per substep.
//!
//! The solver visits the contacts in turn and does not converge, so their order shows in corners. It is the order of a
//! search tree: from left to right when the disc's enlarged box has just been renewed, from right to left otherwise.

use serde::{Deserialize, Serialize};

use super::plan::FloorPlan;
use super::{Aabb, Vec2, vec2};
use crate::pusht::physics::{ALLOWED_OVERLAP, OVERLAP_REMOVED, SUBSTEP_SECONDS, enlarged};

/// Rectangles at most: four borders, and three doors between four wall pieces.
const MAX_RECTANGLES: usize = 11;

/// A disc that is driven by velocity and corrected by bias velocity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct SoftDisc {
    pub(super) position: Vec2,
    /// What the next substep moves the disc by to remove overlap, px/s.
    bias: Vec2,
    /// The box within which rectangles are remembered instead of searched.
    reach: Aabb,
    /// The rectangles that met `reach` when it was made: bits by place in the search order.
    near: u16,
}

/// A contact: the unit vector from the disc into the rectangle, and the bias velocity that is wanted along it.
#[derive(Clone, Copy, Default)]
struct Contact {
    normal: Vec2,
    wanted: f64,
    given: f64,
}

impl SoftDisc {
    pub(super) fn new(plan: &FloorPlan, position: Vec2, radius: f64) -> SoftDisc {
        let mut disc = SoftDisc { position, bias: Vec2::ZERO, reach: Aabb::default(), near: 0 };
        disc.renew(plan, &disc.tight(radius), Vec2::ZERO);
        disc
    }

    /// Moves by `velocity`, px/s, and by what the last contacts ask for; then finds and solves the contacts. Returns how
    /// many there are.
    pub(super) fn substep(&mut self, plan: &FloorPlan, radius: f64, velocity: Vec2, sweeps: u32) -> u32 {
        self.position = self.position + (velocity + self.bias) * SUBSTEP_SECONDS;
        self.correct(plan, radius, velocity, sweeps)
    }

    /// Finds and solves the contacts without moving.
    pub(super) fn correct(&mut self, plan: &FloorPlan, radius: f64, velocity: Vec2, sweeps: u32) -> u32 {
        self.bias = Vec2::ZERO;
        let tight = self.tight(radius);
        let is_new = !self.reach.contains(&tight);
        if is_new {
            self.renew(plan, &tight, velocity);
        }
        if self.near == 0 {
            return 0;
        }
        let mut contacts = [Contact::default(); MAX_RECTANGLES];
        let mut count = 0;
        let places = plan.search_order().len();
        for step in 0..places {
            let place = if is_new { step } else { places - 1 - step };
            let piece = &plan.search_order()[place];
            if self.near & (1 << place) == 0 || piece.is_door {
                continue;
            }
            if let Some((normal, gap)) = touch(&piece.area, self.position, radius) {
                let wanted = -OVERLAP_REMOVED * (gap + ALLOWED_OVERLAP).min(0.0) / SUBSTEP_SECONDS;
                contacts[count] = Contact { normal, wanted, given: 0.0 };
                count += 1;
            }
        }
        self.solve(&mut contacts[..count], sweeps);
        count as u32
    }

    fn solve(&mut self, contacts: &mut [Contact], sweeps: u32) {
        for _ in 0..sweeps {
            let before = self.bias;
            for contact in &mut *contacts {
                let approach = -self.bias.dot(contact.normal);
                let given = (contact.given + (contact.wanted - approach)).max(0.0);
                self.bias = self.bias - contact.normal * (given - contact.given);
                contact.given = given;
            }
            if self.bias == before {
                return;
            }
        }
    }

    fn renew(&mut self, plan: &FloorPlan, tight: &Aabb, velocity: Vec2) {
        self.reach = enlarged(tight, velocity);
        self.near = plan
            .search_order()
            .iter()
            .enumerate()
            .filter(|(_, piece)| piece.area.intersects(&self.reach))
            .fold(0, |near, (place, _)| near | 1 << place);
    }

    fn tight(&self, radius: f64) -> Aabb {
        Aabb::around(self.position, vec2(radius, radius))
    }

    /// True if a foreign state holds finite values.
    pub(super) fn is_sound(&self) -> bool {
        let Aabb { min, max } = self.reach;
        [self.position, self.bias, min, max].into_iter().all(Vec2::is_finite)
    }
}

/// The unit vector from the disc into a rectangle that it touches, and the gap between them (negative in overlap). A
/// center inside the rectangle is pushed out through the nearest face, whichever side it came from.
fn touch(area: &Aabb, center: Vec2, radius: f64) -> Option<(Vec2, f64)> {
    let nearest = area.nearest(center);
    let to_rectangle = nearest - center;
    let distance = to_rectangle.norm();
    if distance > 0.0 {
        return (distance <= radius).then(|| (to_rectangle * (1.0 / distance), distance - radius));
    }
    let (depth, inward) = area.nearest_face(center);
    Some((inward, -depth - radius))
}

impl Aabb {
    /// The point of the box that is nearest to `point`.
    pub(super) fn nearest(&self, point: Vec2) -> Vec2 {
        vec2(point.x.clamp(self.min.x, self.max.x), point.y.clamp(self.min.y, self.max.y))
    }

    /// The depth below the nearest face of a point inside, and the unit vector inwards through that face.
    pub(super) fn nearest_face(&self, point: Vec2) -> (f64, Vec2) {
        let faces = [
            (point.y - self.min.y, vec2(0.0, 1.0)),
            (self.max.x - point.x, vec2(-1.0, 0.0)),
            (self.max.y - point.y, vec2(0.0, -1.0)),
            (point.x - self.min.x, vec2(1.0, 0.0)),
        ];
        faces.into_iter().reduce(|best, face| if face.0 < best.0 { face } else { best }).expect("four faces")
    }
}

#[cfg(test)]
mod tests {
    use super::super::plan::Axis;
    use super::*;

    fn closed() -> FloorPlan {
        // A door at the very end: the rest is closed.
        FloorPlan::new(Axis::Vertical, 19, &[(480, 10)])
    }

    #[test]
    fn a_resting_disc_leaves_a_wall_by_a_fraction_of_the_overlap() {
        let plan = closed();
        let mut disc = SoftDisc::new(&plan, vec2(242.25 - 10.0, 200.0), 15.0);
        assert_eq!(disc.substep(&plan, 15.0, Vec2::ZERO, 30), 1);
        assert_eq!(disc.position.x, 232.25, "the correction acts in the next substep");
        disc.substep(&plan, 15.0, Vec2::ZERO, 30);
        let expected = 232.25 - OVERLAP_REMOVED * (5.0 - ALLOWED_OVERLAP);
        assert!((disc.position.x - expected).abs() < 1e-12, "{}", disc.position.x);
    }

    #[test]
    fn a_constant_push_settles_at_the_published_depth() {
        let plan = closed();
        let mut disc = SoftDisc::new(&plan, vec2(200.0, 200.0), 15.0);
        for _ in 0..3000 {
            disc.substep(&plan, 15.0, vec2(100.0, 0.0), 30);
        }
        let depth = disc.position.x + 15.0 - 242.25;
        assert!((depth - (1.0 / OVERLAP_REMOVED + ALLOWED_OVERLAP)).abs() < 1e-9, "{depth}");
    }

    #[test]
    fn a_center_inside_goes_out_through_the_nearest_face() {
        let area = Aabb { min: vec2(0.0, 0.0), max: vec2(10.0, 100.0) };
        let (normal, gap) = touch(&area, vec2(7.0, 50.0), 15.0).expect("it is inside");
        assert_eq!((normal, gap), (vec2(-1.0, 0.0), -18.0));
        assert!(touch(&area, vec2(25.0, 50.0), 15.0).is_some(), "equality counts");
        assert!(touch(&area, vec2(25.1, 50.0), 15.0).is_none());
    }
}

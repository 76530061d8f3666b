//! The contact solver: ten sweeps of projected Gauss-Seidel over the contacts of one substep.
//!
//! Ten sweeps are part of the dynamics: they do not reach the solution, and more or fewer give visibly different
//! trajectories. A visit sets one contact's impulse to what stops the approach of its two points, never pulling; a
//! second, separate impulse pushes overlapping bodies apart.
//!
//! Few contacts are solved in the space of impulses. There a visit needs only the other impulses and the matrix of
//! their effects on each other, which is the same arithmetic in another order. Many contacts are solved in the space
//! of body velocities, where the work grows linearly.

use super::bodies::{Body, Motion};
use super::collide::Point;
use super::math::{Vec2, positive_part};
use super::memory::MAX_TOUCHING;
use super::world::{BodyId, BodyProperties, SUBSTEP_SECONDS};

/// Gauss-Seidel sweeps per substep.
const SWEEPS: usize = 10;
/// Overlap that is left alone, pixels: 0.1 in single precision.
pub(crate) const ALLOWED_OVERLAP: f64 = 0.1_f32 as f64;
/// Fraction of the excess overlap that one substep removes: `1 - ((f32 0.9)^60)^0.01`.
pub(crate) const OVERLAP_REMOVED: f64 = 0.061_259_621_561_307_376;
/// Most contacts that are solved in the space of impulses.
const MOST_DENSE: usize = 8;
/// Most contacts at all: two per pair.
const MAX_CONTACTS: usize = 2 * MAX_TOUCHING;

/// How the approach velocity of a contact depends on one body's motion: `linear . v + angular w`.
#[derive(Clone, Copy, Debug, Default)]
struct Jacobian {
    linear: Vec2,
    angular: f64,
}

impl Jacobian {
    fn of(self, motion: &Motion) -> f64 {
        self.linear.dot(motion.linear) + self.angular * motion.angular
    }

    /// The change of this contact's velocity by a unit impulse at another one through a common body.
    fn effect(self, other: Jacobian, body: &BodyProperties) -> f64 {
        body.inv_mass * self.linear.dot(other.linear) + body.inv_inertia * (self.angular * other.angular)
    }

    fn push(self, impulse: f64, body: &BodyProperties, motion: &mut Motion) {
        motion.linear = motion.linear + self.linear * (body.inv_mass * impulse);
        motion.angular += body.inv_inertia * self.angular * impulse;
    }
}

/// The two bodies that meet at a contact, in the order in which the normal points; `None` is a wall.
pub(super) type BodyPair = [Option<BodyId>; 2];

/// One contact, ready to be solved. Velocities are those of the second point relative to the first along the normal.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    /// By [`BodyId`]; zero for a body that does not take part.
    jacobians: [Jacobian; 2],
    effective_mass: f64,
    /// Separating velocity, px/s, that removes the share of the overlap due in this substep.
    bias_velocity: f64,
    inherited: f64,
    /// The inherited impulse acts before the first sweep; if not, it only counts as already given.
    apply_inherited: bool,
    /// The solution.
    impulse: f64,
}

impl Row {
    fn effect(&self, other: &Row, properties: &[BodyProperties; 2]) -> f64 {
        self.jacobians[0].effect(other.jacobians[0], &properties[0])
            + self.jacobians[1].effect(other.jacobians[1], &properties[1])
    }

    fn velocity(&self, motions: [&Motion; 2]) -> f64 {
        self.jacobians[0].of(motions[0]) + self.jacobians[1].of(motions[1])
    }

    /// Inherited impulse that counts as given but does not act.
    fn idle_impulse(&self) -> f64 {
        if self.apply_inherited { 0.0 } else { self.inherited }
    }
}

/// The contacts of one substep, in the order in which they are solved.
#[derive(Clone, Debug)]
pub(super) struct Contacts {
    rows: [Row; MAX_CONTACTS],
    len: usize,
}

impl Contacts {
    pub(super) fn new() -> Contacts {
        Contacts { rows: [Row::default(); MAX_CONTACTS], len: 0 }
    }

    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Adds a contact between two bodies at their present poses.
    pub(super) fn push(
        &mut self,
        properties: &[BodyProperties; 2],
        bodies: &[Body; 2],
        pair: BodyPair,
        (normal, point): (Vec2, &Point),
        (inherited, apply_inherited): (f64, bool),
    ) {
        let mut row = Row { inherited, apply_inherited, ..Row::default() };
        for (body, at, sign) in [(pair[0], point.on_first, -1.0), (pair[1], point.on_second, 1.0)] {
            if let Some(id) = body {
                let arm = at - bodies[id as usize].center;
                row.jacobians[id as usize] =
                    Jacobian { linear: normal * sign, angular: arm.cross(normal) * sign };
            }
        }
        row.effective_mass = 1.0 / row.effect(&row, properties);
        let gap = (point.on_second - point.on_first).dot(normal);
        row.bias_velocity = positive_part(-(gap + ALLOWED_OVERLAP)) * (OVERLAP_REMOVED / SUBSTEP_SECONDS);
        self.rows[self.len] = row;
        self.len += 1;
    }

    /// Final impulses, in the order of the contacts.
    pub(super) fn impulses(&self) -> impl Iterator<Item = f64> + '_ {
        self.rows[..self.len].iter().map(|row| row.impulse)
    }

    /// Sets the velocities of the bodies so that the contacts hold, as far as ten sweeps bring them.
    pub(super) fn solve(&mut self, properties: &[BodyProperties; 2], bodies: &mut [Body; 2]) {
        match self.len {
            0 => {}
            1 => self.solve_dense::<1>(properties, bodies),
            2 => self.solve_dense::<2>(properties, bodies),
            3..=4 => self.solve_dense::<4>(properties, bodies),
            5..=MOST_DENSE => self.solve_dense::<MOST_DENSE>(properties, bodies),
            _ => self.solve_bodies(properties, bodies),
        }
    }

    /// Gauss-Seidel in the space of impulses, for at most `N` contacts; the others of the `N` are blank.
    ///
    /// With A the effects of impulses on contact velocities, M = 1 / A_ii and idle impulses s, a visit is
    /// `x_i = max(0, x_i - M (b_i + sum_j A_ij (x_j - s_j)))`. The terms in x_i cancel, and what is left splits into a
    /// constant and the other impulses: `x_i = max(0, c_i - sum_{j != i} M A_ij x_j)`.
    fn solve_dense<const N: usize>(&mut self, properties: &[BodyProperties; 2], bodies: &mut [Body; 2]) {
        let rows = &mut self.rows[..self.len];
        let mut effects = [[0.0; N]; N];
        let mut constants = [0.0; N];
        let mut bias_constants = [0.0; N];
        let mut impulses = [0.0; N];
        let mut bias_impulses = [0.0; N];
        let motions = [&bodies[0].motion, &bodies[1].motion];
        for (i, row) in rows.iter().enumerate() {
            let mut approach = row.velocity(motions);
            for (j, other) in rows.iter().enumerate() {
                if j != i {
                    let effect = row.effect(other, properties);
                    effects[i][j] = row.effective_mass * effect;
                    approach -= effect * other.idle_impulse();
                }
            }
            constants[i] = row.idle_impulse() - row.effective_mass * approach;
            bias_constants[i] = row.effective_mass * row.bias_velocity;
            impulses[i] = row.inherited;
        }

        sweep(&effects, &constants, &mut impulses);
        let overlapping = bias_constants.iter().any(|&constant| constant > 0.0);
        if overlapping {
            sweep(&effects, &bias_constants, &mut bias_impulses);
        }

        for (i, row) in rows.iter_mut().enumerate() {
            row.impulse = impulses[i];
            for ((jacobian, properties), body) in row.jacobians.iter().zip(properties).zip(&mut *bodies) {
                jacobian.push(impulses[i] - row.idle_impulse(), properties, &mut body.motion);
                jacobian.push(bias_impulses[i], properties, &mut body.bias);
            }
        }
    }

    /// Gauss-Seidel in the space of body velocities, for any number of contacts.
    fn solve_bodies(&mut self, properties: &[BodyProperties; 2], bodies: &mut [Body; 2]) {
        let rows = &mut self.rows[..self.len];
        let mut bias_impulses = [0.0; MAX_CONTACTS];
        for row in &mut *rows {
            row.impulse = row.inherited;
            for ((jacobian, properties), body) in row.jacobians.iter().zip(properties).zip(&mut *bodies) {
                jacobian.push(row.inherited - row.idle_impulse(), properties, &mut body.motion);
            }
        }
        for _ in 0..SWEEPS {
            for (row, bias_impulse) in rows.iter_mut().zip(&mut bias_impulses) {
                let velocity = row.velocity([&bodies[0].motion, &bodies[1].motion]);
                let bias = row.velocity([&bodies[0].bias, &bodies[1].bias]);
                let new = positive_part(row.impulse - velocity * row.effective_mass);
                let new_bias = positive_part(*bias_impulse + (row.bias_velocity - bias) * row.effective_mass);
                for ((jacobian, properties), body) in row.jacobians.iter().zip(properties).zip(&mut *bodies) {
                    jacobian.push(new - row.impulse, properties, &mut body.motion);
                    jacobian.push(new_bias - *bias_impulse, properties, &mut body.bias);
                }
                row.impulse = new;
                *bias_impulse = new_bias;
            }
        }
    }
}

/// Ten sweeps over `x_i = max(0, constants_i - sum_j effects_ij x_j)`; fewer when a sweep changes nothing, as then no
/// later one would.
fn sweep<const N: usize>(effects: &[[f64; N]; N], constants: &[f64; N], x: &mut [f64; N]) {
    for _ in 0..SWEEPS {
        let before = *x;
        for i in 0..N {
            let mut sum = constants[i];
            for j in 0..N {
                if j != i {
                    sum -= effects[i][j] * x[j];
                }
            }
            x[i] = positive_part(sum);
        }
        if *x == before {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::collide::Feature;
    use super::super::math::vec2;
    use super::super::shapes::Shape;
    use super::super::world::{BodySetup, Setup, World};
    use super::*;

    #[test]
    fn constants_are_those_of_the_reference() {
        assert_eq!(ALLOWED_OVERLAP, 0.10000000149011612);
        let base = f64::from(0.9_f32).powf(60.0);
        assert!((1.0 - base.powf(SUBSTEP_SECONDS) - OVERLAP_REMOVED).abs() < 1e-9);
    }

    #[test]
    fn both_spaces_give_the_same_velocities() {
        let agent = BodySetup { shape: Shape::L, scale: 40.0, ..Setup::default().agent };
        let world = World::new(&Setup { agent, ..Setup::default() }).unwrap();
        let mut bodies = [Body::default(); 2];
        bodies[0].motion = Motion { linear: vec2(30.0, -20.0), angular: 0.4 };
        bodies[1].motion = Motion { linear: vec2(-3.0, 2.0), angular: -0.1 };
        let mut contacts = Contacts::new();
        for i in 0..MOST_DENSE {
            let t = i as f64;
            let normal = vec2((0.9 * t).cos(), (0.9 * t).sin());
            let on_first = vec2(10.0 + 7.0 * t, 40.0 - 11.0 * t);
            let point =
                Point { on_first, on_second: on_first - normal * (0.2 * t), feature: Feature::default() };
            let pair = match i % 3 {
                0 => [Some(BodyId::Agent), Some(BodyId::Block)],
                1 => [Some(BodyId::Block), Some(BodyId::Agent)],
                _ => [None, Some(BodyId::Block)],
            };
            contacts.push(&world.bodies, &bodies, pair, (normal, &point), (2.0 * t, i % 2 == 0));
        }
        let (mut dense, mut dense_bodies) = (contacts.clone(), bodies);
        dense.solve_dense::<MOST_DENSE>(&world.bodies, &mut dense_bodies);
        contacts.solve_bodies(&world.bodies, &mut bodies);
        assert_ne!(bodies[1].bias, Motion::default());
        for (a, b) in dense_bodies.iter().zip(&bodies) {
            for (a, b) in [(a.motion, b.motion), (a.bias, b.bias)] {
                assert!((a.linear - b.linear).norm() < 1e-10 && (a.angular - b.angular).abs() < 1e-12);
            }
        }
        for (a, b) in dense.impulses().zip(contacts.impulses()) {
            assert!((a - b).abs() < 1e-9);
        }
    }
}

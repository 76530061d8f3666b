//! Rays through the pixels of an image, from an eye or from a light. Knows no surfaces.
//!
//! How near a surface is, is kept as a number that is linear across the image for flat surfaces and grows toward the
//! eye: the inverse of the depth for perspective views, the negative depth for parallel ones.

use super::description::{Camera, Instance};
use super::lanes::{Lanes, Lanes3, splat};
use super::vector::{Matrix, Vector, add, column, cross, dot, scale, sub, unrotate};

/// An image of `width` × `height` pixels; pixel (x, y) has its center at (x + 0.5, y + 0.5), y downward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct View {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) origin: Vector,
    pub(super) forward: Vector,
    /// At the corner (0, 0): a ray direction with depth 1 (perspective) or a ray origin (parallel).
    corner: Vector,
    step_x: Vector,
    step_y: Vector,
    perspective: bool,
    near: f64,
}

/// A window into the world: `left..right` × `bottom..top` at distance 1 (perspective) or at any (parallel).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    pub(super) left: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
    pub(super) top: f64,
}

/// A rectangle of pixels: `x0..x1` × `y0..y1`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Area {
    pub(super) x0: usize,
    pub(super) x1: usize,
    pub(super) y0: usize,
    pub(super) y1: usize,
}

impl View {
    pub(super) fn of_camera(camera: &Camera, width: usize, height: usize) -> Self {
        let p = camera.projection;
        let half = p.half_width.unwrap_or(0.5 * width as f64 / height as f64 * (p.top - p.bottom));
        let window = Window { left: p.center - half, right: p.center + half, bottom: p.bottom, top: p.top };
        Self::new(camera.position, camera.forward, camera.up, window, true, camera.near, (width, height))
    }

    pub(super) fn new(
        origin: Vector,
        forward: Vector,
        up: Vector,
        window: Window,
        perspective: bool,
        near: f64,
        (width, height): (usize, usize),
    ) -> Self {
        let right = cross(forward, up);
        let corner = add(scale(right, window.left), scale(up, window.top));
        Self {
            width,
            height,
            origin,
            forward,
            corner: add(corner, if perspective { forward } else { origin }),
            step_x: scale(right, (window.right - window.left) / width as f64),
            step_y: scale(up, (window.bottom - window.top) / height as f64),
            perspective,
            near,
        }
    }

    /// This view in the mirror through `point` with the normal `normal`: pixels stay where they are.
    pub(super) fn mirrored(&self, point: Vector, normal: Vector) -> Self {
        let turn = |v: Vector| sub(v, scale(normal, 2.0 * dot(v, normal)));
        let place = |v: Vector| sub(v, scale(normal, 2.0 * dot(sub(v, point), normal)));
        Self {
            origin: place(self.origin),
            forward: turn(self.forward),
            corner: if self.perspective { turn(self.corner) } else { place(self.corner) },
            step_x: turn(self.step_x),
            step_y: turn(self.step_y),
            ..*self
        }
    }

    /// The direction of one ray of a perspective view, with depth 1.
    pub(super) fn direction(&self, x: f64, y: f64) -> Vector {
        add(self.corner, add(scale(self.step_x, x), scale(self.step_y, y)))
    }

    /// How directions change from pixel to pixel, along x and along y.
    pub(super) fn steps(&self) -> (Vector, Vector) {
        (self.step_x, self.step_y)
    }

    /// Depth (distance along `forward`) from nearness and back.
    #[inline]
    pub(super) fn depth(&self, nearness: Lanes) -> Lanes {
        if self.perspective { splat(1.0) / nearness } else { -nearness }
    }

    #[inline]
    pub(super) fn nearness(&self, depth: Lanes) -> Lanes {
        if self.perspective { splat(1.0) / depth } else { -depth }
    }

    /// Depth of the near plane.
    pub(super) fn near(&self) -> f64 {
        self.near
    }

    /// The nearness of the near plane: nothing nearer is seen.
    pub(super) fn nearest(&self) -> f32 {
        (if self.perspective { 1.0 / self.near } else { -self.near }) as f32
    }

    /// Position in pixels and nearness of a point; `None` if it is not in front.
    pub(super) fn project(&self, point: Vector) -> Option<[f64; 3]> {
        let depth = dot(sub(point, self.origin), self.forward);
        if depth < self.near {
            return None;
        }
        let (flat, nearness) = if self.perspective {
            (sub(scale(sub(point, self.origin), 1.0 / depth), self.corner), 1.0 / depth)
        } else {
            (sub(point, self.corner), -depth)
        };
        let across = |step: Vector| dot(flat, step) / dot(step, step);
        Some([across(self.step_x), across(self.step_y), nearness])
    }

    /// The area that covers a box with these half lengths; everything if one of its corners is not in front; `None` if it is
    /// outside.
    pub(super) fn area(&self, center: Vector, rotation: Matrix, half: Vector) -> Option<Area> {
        // What these measure, x × w, y × w and the depth, adds up along the box's sides.
        let (axes, (from, [x, y])) = (self.axes(), self.axes_origin());
        let moved = sub(center, from);
        let middle = add(axes.map(|axis| dot(axis, moved)), [x, y, 0.0]);
        let sides: [Vector; 3] = std::array::from_fn(|k| {
            let side = scale(column(rotation, k), half[k]);
            axes.map(|axis| dot(axis, side))
        });
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let (mut seen, mut hidden) = (false, false);
        for corner in 0..8 {
            let step = |place: Vector, k: usize| {
                if corner >> k & 1 == 1 { add(place, sides[k]) } else { sub(place, sides[k]) }
            };
            let [x, y, depth] = (0..3).fold(middle, step);
            if depth < self.near {
                hidden = true;
                continue;
            }
            seen = true;
            let w = if self.perspective { 1.0 / depth } else { 1.0 };
            let (x, y) = (x * w, y * w);
            (low, high) = ([low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]);
        }
        if hidden {
            return seen.then_some(self.whole());
        }
        // A pixel of margin: the points are exact, the surfaces that they bound are computed in f32.
        let clip = |value: f64, size: usize| (value.max(0.0) as usize).min(size);
        let area = Area {
            x0: clip(low[0] - 1.0, self.width),
            x1: clip(high[0] + 2.0, self.width),
            y0: clip(low[1] - 1.0, self.height),
            y1: clip(high[1] + 2.0, self.height),
        };
        (area.x0 < area.x1 && area.y0 < area.y1).then_some(area)
    }

    pub(super) fn whole(&self) -> Area {
        Area { x0: 0, x1: self.width, y0: 0, y1: self.height }
    }

    /// The rays in the frame of `instance`.
    pub(super) fn rays(&self, instance: &Instance) -> Rays {
        let offset = sub(instance.position, self.origin);
        let depth = dot(offset, self.forward).max(self.near);
        // Counted from the pixel where the instance's center is, and from the depth of that center: differences
        // between large values are computed here, in f64.
        let [x, y, _] = self.project(instance.position).unwrap_or([
            0.5 * self.width as f64,
            0.5 * self.height as f64,
            0.0,
        ]);
        let (x, y) = (x.clamp(-1e4, 1e4).round(), y.clamp(-1e4, 1e4).round());
        let middle = add(self.corner, add(scale(self.step_x, x), scale(self.step_y, y)));
        let into = |v: Vector| narrow(unrotate(instance.rotation, v));
        let zero = [0.0; 3];
        let (place, direction) = if self.perspective {
            let place =
                [sub(scale(middle, depth), offset), scale(self.step_x, depth), scale(self.step_y, depth)];
            (place, [middle, self.step_x, self.step_y])
        } else {
            let start = add(sub(middle, instance.position), scale(self.forward, depth));
            ([start, self.step_x, self.step_y], [self.forward, zero, zero])
        };
        Rays {
            middle: [x as f32, y as f32],
            depth: depth as f32,
            place: place.map(into),
            direction: direction.map(into),
        }
    }

    /// What depth and pixels are linear in: directions along which x × w, y × w and the depth grow, where w is the depth
    /// (perspective) or 1 (parallel).
    pub(super) fn axes(&self) -> [Vector; 3] {
        let per = |step: Vector| scale(step, 1.0 / dot(step, step));
        let (by_x, by_y) = (per(self.step_x), per(self.step_y));
        if !self.perspective {
            return [by_x, by_y, self.forward];
        }
        let shifted = |by: Vector| sub(by, scale(self.forward, dot(by, self.corner)));
        [shifted(by_x), shifted(by_y), self.forward]
    }

    /// Where [`View::axes`] are counted from, and what x × w and y × w are there.
    pub(super) fn axes_origin(&self) -> (Vector, [f64; 2]) {
        if self.perspective {
            return (self.origin, [0.0; 2]);
        }
        let per = |step: Vector| dot(sub(self.origin, self.corner), step) / dot(step, step);
        (self.origin, [per(self.step_x), per(self.step_y)])
    }

    /// The nearness of what is infinitely far.
    pub(super) fn farthest(&self) -> f32 {
        if self.perspective { 0.0 } else { f32::NEG_INFINITY }
    }

    /// How long a pixel is at depth 1 (perspective) or anywhere (parallel), meters.
    pub(super) fn pixel(&self) -> f64 {
        dot(self.step_x, self.step_x).sqrt().max(dot(self.step_y, self.step_y).sqrt())
    }

    /// How long a pixel is where a ball is nearest.
    pub(super) fn pixel_at(&self, center: Vector, radius: f64) -> f64 {
        if !self.perspective {
            return self.pixel();
        }
        let depth = dot(sub(center, self.origin), self.forward) - radius;
        self.pixel() * depth.max(self.near)
    }

    /// How long a pixel is where a plane is nearest in the image, whatever hides it.
    pub(super) fn pixel_on(&self, point: Vector, normal: Vector) -> f64 {
        if !self.perspective {
            return self.pixel();
        }
        // The inverse of the depth is linear across the image, so that it is largest in a corner.
        let below = dot(sub(point, self.origin), normal);
        let (width, height) = (self.width as f64, self.height as f64);
        let nearness = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)]
            .map(|(x, y)| dot(self.direction(x, y), normal) / below)
            .into_iter()
            .fold(0.0, f64::max);
        self.pixel() / nearness.min(1.0 / self.near)
    }

    pub(super) fn is_perspective(&self) -> bool {
        self.perspective
    }
}

/// The rays of a view in the frame of an instance: at depth `depth` + t they are at place + t × direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rays {
    middle: [f32; 2],
    pub(super) depth: f32,
    place: [[f32; 3]; 3],
    direction: [[f32; 3]; 3],
}

impl Rays {
    /// Places and directions of the rays of pixels (x, y).
    #[inline]
    pub(super) fn at(&self, x: Lanes, y: Lanes) -> (Lanes3, Lanes3) {
        let (x, y) = (x - splat(self.middle[0]), y - splat(self.middle[1]));
        let linear = |[base, by_x, by_y]: &[[f32; 3]; 3]| {
            let part = |i: usize| splat(base[i]) + x * splat(by_x[i]) + y * splat(by_y[i]);
            Lanes3 { x: part(0), y: part(1), z: part(2) }
        };
        (linear(&self.place), linear(&self.direction))
    }
}

impl Rays {
    /// How far points of surfaces with the directions `outward` move from pixel to pixel, along x and along y: the rays
    /// move, and stay on the surface.
    #[inline]
    pub(super) fn gradients(&self, (x, y): (Lanes, Lanes), depth: Lanes, outward: Lanes3) -> [Lanes3; 2] {
        let (_, direction) = self.at(x, y);
        let across = outward.dot(direction);
        [1, 2].map(|step| {
            let turned = Lanes3::splat(self.direction[step].map(f64::from)).scaled(depth);
            let moved = if self.direction[1] == [0.0; 3] { self.place[step] } else { [0.0; 3] };
            let step = turned + Lanes3::splat(moved.map(f64::from));
            step - direction.scaled(outward.dot(step) / across)
        })
    }
}

pub(super) fn narrow(v: Vector) -> [f32; 3] {
    v.map(|value| value as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::vector::rotate;
    use crate::scene::{Material, Shape};

    fn view(perspective: bool) -> View {
        let window = Window { left: -0.5, right: 0.5, bottom: -0.25, top: 0.25 };
        View::new([1.0, 2.0, 3.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], window, perspective, 0.1, (40, 20))
    }

    #[test]
    fn points_on_a_ray_are_projected_to_its_pixel() {
        for perspective in [true, false] {
            let view = view(perspective);
            let instance = Instance {
                shape: Shape::Mesh(0),
                position: [1.3, 9.0, 3.2],
                rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
                material: Material::default(),
                segment: 0,
                casts_shadow: true,
            };
            let rays = view.rays(&instance);
            let (place, direction) = rays.at(splat(7.5), splat(3.5));
            let further = direction.scaled(splat(2.0)) + place;
            let local = [further.x, further.y, further.z].map(|lanes| f64::from(lanes.to_array()[0]));
            let point = add(instance.position, rotate(instance.rotation, local));
            let [x, y, nearness] = view.project(point).expect("in front");
            let depth = f64::from(rays.depth) + 2.0;
            let expected = if perspective { 1.0 / depth } else { -depth };
            assert!((x - 7.5).abs() < 1e-4 && (y - 3.5).abs() < 1e-4, "{x} {y}");
            assert!((nearness - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn an_area_covers_the_corners_of_a_box() {
        let rotation = [[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]];
        let (center, half) = ([1.13, 9.0, 3.34], [0.2, 0.5, 0.3]);
        for perspective in [true, false] {
            let view = if perspective {
                view(true)
            } else {
                let window = Window { left: -1.5, right: 1.5, bottom: -0.75, top: 0.75 };
                View::new([1.0, 2.0, 3.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], window, false, 0.1, (40, 20))
            };
            let corners = (0..8).map(|corner: usize| {
                let sign = |k: usize| if corner >> k & 1 == 1 { half[k] } else { -half[k] };
                let point = add(center, rotate(rotation, [0, 1, 2].map(sign)));
                view.project(point).expect("in front")
            });
            let corners: Vec<[f64; 3]> = corners.collect();
            let ends = |k: usize| {
                let values = corners.iter().map(|corner| corner[k]);
                values.fold((f64::INFINITY, 0.0f64), |(low, high), value| (low.min(value), high.max(value)))
            };
            let ((x0, x1), (y0, y1)) = (ends(0), ends(1));
            let expected = Area {
                x0: (x0 - 1.0) as usize,
                x1: ((x1 + 2.0) as usize).min(40),
                y0: (y0 - 1.0) as usize,
                y1: ((y1 + 2.0) as usize).min(20),
            };
            assert_eq!(view.area(center, rotation, half), Some(expected));
            assert!(expected != view.whole(), "{expected:?}");
        }
        let view = view(true);
        assert_eq!(view.area([1.0, 2.0, 3.0], rotation, half), Some(view.whole()), "around the eye");
        assert_eq!(view.area([1.0, 0.0, 3.0], rotation, half), None, "behind the eye");
        assert_eq!(view.area([90.0, 9.0, 3.0], rotation, half), None, "to the side");
    }

    #[test]
    fn a_mirror_leaves_pixels_where_they_are() {
        let (view, point, normal) = (view(true), [0.0; 3], [0.0, 0.0, 1.0]);
        let above = view.project([1.2, 8.0, 2.0]).expect("in front");
        let below = view.mirrored(point, normal).project([1.2, 8.0, -2.0]).expect("in front");
        for (a, b) in above.iter().zip(below) {
            assert!((a - b).abs() < 1e-12);
        }
    }
}

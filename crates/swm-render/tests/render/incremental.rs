//! Drawing only what changed gives the bytes of drawing everything, in both styles and at any size.

use proptest::prelude::*;
use swm_render::{AntialiasBilinear, Geometry, Painter, Rect, RenderError, Renderer, Rgb, Style};

#[derive(Debug, Clone)]
enum Command {
    Fill(Rgb),
    Polygon(Vec<[f64; 2]>, Rgb),
    Disc([f64; 2], f64, Rgb),
    FatSegment([f64; 2], [f64; 2], Rgb),
    AaLine([f64; 2], [f64; 2], Rgb),
    SmoothPolygon(Vec<[f64; 2]>, Rgb),
    SmoothDisc([f64; 2], f64, Rgb),
    SmoothLine([f64; 2], [f64; 2], Rgb),
    AxisLine([f64; 2], f64, Rgb),
    TurnArrow([f64; 2], f64, bool, Rgb),
}

impl Command {
    fn draw(&self, p: &mut dyn Painter) {
        match self {
            Self::Fill(color) => p.fill(*color),
            Self::Polygon(points, color) => p.polygon(points, *color),
            Self::Disc(center, radius, color) => p.disc(*center, *radius, *color),
            Self::FatSegment(from, to, color) => p.fat_segment(*from, *to, *color),
            Self::AaLine(from, to, color) => p.aa_line(*from, *to, *color),
            Self::SmoothPolygon(points, color) => p.smooth_polygon(points, *color),
            Self::SmoothDisc(center, radius, color) => p.smooth_disc(*center, *radius, *color),
            Self::SmoothLine(from, to, color) => p.smooth_line(*from, *to, *color),
            Self::AxisLine([x, y], length, color) => p.axis_line([*x, *y], [x + length, *y], *color),
            Self::TurnArrow(center, side, mirrored, color) => p.turn_arrow(*center, *side, *mirrored, *color),
        }
    }

    fn moved(&self, by: [f64; 2]) -> Self {
        let shift = |p: &[f64; 2]| [p[0] + by[0], p[1] + by[1]];
        match self {
            Self::Fill(color) => Self::Fill(*color),
            Self::Polygon(points, color) => Self::Polygon(points.iter().map(shift).collect(), *color),
            Self::Disc(center, radius, color) => Self::Disc(shift(center), *radius, *color),
            Self::FatSegment(from, to, color) => Self::FatSegment(shift(from), shift(to), *color),
            Self::AaLine(from, to, color) => Self::AaLine(shift(from), shift(to), *color),
            Self::SmoothPolygon(points, color) => {
                Self::SmoothPolygon(points.iter().map(shift).collect(), *color)
            }
            Self::SmoothDisc(center, radius, color) => Self::SmoothDisc(shift(center), *radius, *color),
            Self::SmoothLine(from, to, color) => Self::SmoothLine(shift(from), shift(to), *color),
            Self::AxisLine(from, length, color) => Self::AxisLine(shift(from), *length, *color),
            Self::TurnArrow(center, side, mirrored, color) => {
                Self::TurnArrow(shift(center), *side, *mirrored, *color)
            }
        }
    }
}

fn point() -> impl Strategy<Value = [f64; 2]> {
    prop::array::uniform2(-60.0..570.0)
}

fn near() -> impl Strategy<Value = [f64; 2]> {
    prop::array::uniform2(-90.0..90.0)
}

fn command() -> impl Strategy<Value = Command> {
    let color = any::<Rgb>;
    let ends = || (point(), near()).prop_map(|(a, d)| (a, [a[0] + d[0], a[1] + d[1]]));
    let polygon = || {
        (point(), prop::collection::vec(near(), 0..7)).prop_map(|(origin, offsets)| {
            offsets.iter().map(|d| [origin[0] + d[0], origin[1] + d[1]]).collect::<Vec<_>>()
        })
    };
    prop_oneof![
        1 => color().prop_map(Command::Fill),
        8 => (polygon(), color()).prop_map(|(points, color)| Command::Polygon(points, color)),
        8 => (point(), -2.0..60.0, color()).prop_map(|(c, r, color)| Command::Disc(c, r, color)),
        8 => (ends(), color()).prop_map(|((a, b), color)| Command::FatSegment(a, b, color)),
        8 => (ends(), color()).prop_map(|((a, b), color)| Command::AaLine(a, b, color)),
        8 => (polygon(), color()).prop_map(|(points, color)| Command::SmoothPolygon(points, color)),
        8 => (point(), -2.0..60.0, color()).prop_map(|(c, r, color)| Command::SmoothDisc(c, r, color)),
        4 => (ends(), color()).prop_map(|((a, b), color)| Command::SmoothLine(a, b, color)),
        4 => (point(), -90.0..90.0, color()).prop_map(|(a, l, color)| Command::AxisLine(a, l, color)),
        4 => (point(), -2.0..120.0, any::<bool>(), color())
            .prop_map(|(c, side, mirrored, color)| Command::TurnArrow(c, side, mirrored, color)),
    ]
}

/// What happens between two frames.
#[derive(Debug, Clone)]
enum Change {
    Nothing,
    Move(prop::sample::Index, [f64; 2]),
    Replace(prop::sample::Index, Command),
    Push(Command),
    Remove(prop::sample::Index),
    Background(Rgb),
}

fn change() -> impl Strategy<Value = Change> {
    let index = any::<prop::sample::Index>;
    prop_oneof![
        1 => Just(Change::Nothing),
        6 => (index(), near()).prop_map(|(i, by)| Change::Move(i, by)),
        3 => (index(), prop::array::uniform2(-1.0..1.0)).prop_map(|(i, by)| Change::Move(i, by)),
        2 => (index(), command()).prop_map(|(i, c)| Change::Replace(i, c)),
        1 => command().prop_map(Change::Push),
        1 => index().prop_map(Change::Remove),
        1 => any::<Rgb>().prop_map(Change::Background),
    ]
}

impl Change {
    fn apply(&self, scene: &mut Vec<Command>, background: &mut Rgb) {
        match self {
            Self::Nothing => {}
            Self::Push(command) => scene.push(command.clone()),
            Self::Background(color) => *background = *color,
            _ if scene.is_empty() => {}
            Self::Move(i, by) => {
                let i = i.index(scene.len());
                scene[i] = scene[i].moved(*by);
            }
            Self::Replace(i, command) => {
                let i = i.index(scene.len());
                scene[i] = command.clone();
            }
            Self::Remove(i) => {
                scene.remove(i.index(scene.len()));
            }
        }
    }
}

fn frame_of(renderer: &mut Renderer, scene: &[Command], background: Rgb) -> Vec<u8> {
    let mut frame = vec![7; renderer.geometry().frame_len()];
    renderer.set_palette(&[([144, 238, 144], [9, 9, 9]), (background, [250, 0, 0])]);
    renderer.set_background(|p| {
        p.fill(background);
        p.polygon(&[[100.0, 120.0], [300.0, 180.0], [150.0, 400.0]], [144, 238, 144]);
    });
    renderer
        .render(&mut frame, |p| scene.iter().for_each(|command| command.draw(p)))
        .expect("the length fits");
    frame
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(48) })]

    #[test]
    fn incremental_frames_equal_full_redraws(
        style in prop_oneof![3 => Just(Style::Exact), 2 => Just(Style::Fast)],
        size in prop_oneof![
            Just((224, 224)), Just((64, 64)), Just((48, 96)), Just((250, 31)), Just((60, 190)), Just((224, 100)), Just((100, 224))
        ],
        is_surface in any::<bool>(),
        mut scene in prop::collection::vec(command(), 0..7),
        changes in prop::collection::vec(change(), 1..8),
    ) {
        let geometry = match is_surface {
            true => Geometry::surface([400, 600], size.0, size.1),
            false => Geometry::new(size.0, size.1),
        };
        let mut background = [255; 3];
        let mut incremental = Renderer::new(style, geometry).expect("sizes are fine");
        frame_of(&mut incremental, &scene, background);
        for change in changes {
            change.apply(&mut scene, &mut background);
            let mut fresh = Renderer::new(style, geometry).expect("sizes are fine");
            let same = frame_of(&mut incremental, &scene, background) == frame_of(&mut fresh, &scene, background);
            prop_assert!(same, "differs after {change:?}");
        }
    }

    #[test]
    fn wild_coordinates_do_no_harm(
        style in prop_oneof![Just(Style::Exact), Just(Style::Fast)],
        values in prop::collection::vec(
            prop_oneof![any::<f64>(), -1e7..1e7, Just(f64::NAN), Just(f64::INFINITY), 0.0..512.0], 13
        ),
    ) {
        let mut renderer = Renderer::new(style, Geometry::new(32, 32)).expect("sizes are fine");
        let mut frame = vec![0; 32 * 32 * 3];
        let at = |i: usize| [values[i], values[i + 1]];
        for _ in 0..2 {
            renderer.render(&mut frame, |p| {
                p.polygon(&[at(0), at(2), at(4), at(6)], [9; 3]);
                p.disc(at(3), values[12], [8; 3]);
                p.fat_segment(at(5), at(7), [7; 3]);
                p.aa_line(at(8), at(10), [6; 3]);
                p.smooth_polygon(&[at(1), at(3), at(5), at(7)], [5; 3]);
                p.smooth_disc(at(2), values[11], [4; 3]);
                p.smooth_line(at(9), at(4), [3; 3]);
                p.axis_line(at(0), [values[0], values[9]], [2; 3]);
                p.turn_arrow(at(6), values[10], true, [1; 3]);
            }).expect("the length fits");
        }
    }
}

#[test]
fn golden_scenes_one_after_the_other_equal_fresh_ones() {
    let scenes = crate::scenes::golden_scenes();
    for (style, size) in [(Style::Exact, 224), (Style::Exact, 64), (Style::Fast, 64)] {
        let geometry = Geometry::new(size, size);
        let mut reused = Renderer::new(style, geometry).expect("sizes are fine");
        for (index, golden) in scenes.iter().enumerate() {
            let draw = |renderer: &mut Renderer| {
                let mut frame = vec![0; geometry.frame_len()];
                renderer.set_background(|p| golden.scene.draw_background(p));
                renderer.render(&mut frame, |p| golden.scene.draw_rest(p)).expect("the length fits");
                frame
            };
            let mut fresh = Renderer::new(style, geometry).expect("sizes are fine");
            assert!(draw(&mut reused) == draw(&mut fresh), "scene {index}, {style:?} at {size}");
        }
    }
}

#[test]
fn bad_sizes_are_errors_that_say_what_to_do() {
    for style in [Style::Exact, Style::Fast] {
        let error = Renderer::new(style, Geometry::new(0, 64)).expect_err("no rows");
        assert_eq!(
            error.to_string(),
            "a frame of 0 x 64 px cannot be made: each side must be from 1 to 4096"
        );
        assert!(Renderer::new(style, Geometry::new(64, usize::MAX)).is_err());
        let mut renderer = Renderer::new(style, Geometry::new(64, 64)).expect("sizes are fine");
        let error = renderer.render(&mut [0; 5], |_| ()).expect_err("too short");
        assert!(matches!(error, RenderError::Length { actual: 5, expected: 12_288, .. }), "{error}");
    }
}

proptest! {
    #[test]
    fn updating_a_resize_is_resizing(
        (height, width) in (1_usize..90, 1_usize..90),
        (x, y) in (-5_i32..60, -5_i32..60),
        (w, h) in (0_i32..40, 0_i32..40),
        pixel in any::<u8>(),
    ) {
        let (source, dirty) = ([48, 56], Rect::new(x, y, x + w, y + h));
        let mut image: Vec<u8> = (0..48 * 56 * 3_u32).map(|i| (i * i / 7) as u8).collect();
        let mut resize = AntialiasBilinear::new(source, [height, width])?;
        let (mut updated, mut anew) = (vec![0; height * width * 3], vec![0; height * width * 3]);
        resize.resize(&image, &mut updated)?;
        let inside = dirty.intersect(&Rect::new(0, 0, 56, 48));
        for (y, x) in (inside.y0..inside.y1).flat_map(|y| (inside.x0..inside.x1).map(move |x| (y, x))) {
            image[(y * 56 + x) as usize * 3..][..3].fill(pixel);
        }
        resize.update(&image, dirty, &mut updated)?;
        AntialiasBilinear::new(source, [height, width])?.resize(&image, &mut anew)?;
        prop_assert_eq!(updated, anew);
    }
}

//! What a factor of variation shows, it shows where it should and nowhere else: images before and after a change, told
//! apart by what their pixels show.
//!
//! | kind of factor | pixels that may change | also, with mirrors and shadows |
//! |---|---|---|
//! | friction, locks | none | none |
//! | masses and densities | none; all where the camera follows the center of mass | the same |
//! | color of the floor | the floor, through glass too | the same |
//! | other colors | things, neither floor nor sky | the floor, which mirrors them |
//! | brightness of the light | all but the sky | all but the sky |
//! | shape, size, what is there (hidden targets too) | where something came, went or moved | the floor and things: shadows and mirrors |
//! | slope of the floor | everything | everything |

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use serde::Deserialize;
use swm_core::env::PIXELS;
use swm_core::{
    Batch, Env, EnvConfig, EnvEntry, Episode, EpisodeSeed, FactorSpec, ImageSize, ResetOptions, Schema,
    Space, Value,
};
use swm_envs_mujoco::{ENVS, OGB_CUBE, OGB_SCENE};

const SIDE: usize = 96;
/// The segment of the sky, and of nothing.
const SKY: i32 = -1;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Motion,
    Mass,
    Floor,
    Color,
    Light,
    Shape,
    Everything,
}

/// Whose cameras follow the center of mass.
const FOLLOWED: &[&str] = &["Cheetah", "Hopper", "Humanoid", "Quadruped", "Walker"];
/// Whose targets are hidden until they are given a color.
const HIDING: &[&str] = &["Acrobot", "BallInCup"];

fn is_among(env: &str, names: &[&str]) -> bool {
    names.iter().any(|name| env == format!("swm/{name}DMControl-v0"))
}

/// The geoms that show the floor's checker.
fn floors(env: &str) -> &'static [i32] {
    // Two of them are ramps.
    if is_among(env, &["Manipulator"]) { &[0, 1, 2] } else { &[0] }
}

/// The geoms of glass, through which the floor is seen: the panes of the window.
fn glass(env: &str) -> &'static [i32] {
    if env == OGB_SCENE.id { &[117, 130] } else { &[] }
}

fn kind(env: &str, factor: &str) -> Kind {
    let ends = |ends: &[&str]| ends.iter().any(|end| factor.ends_with(end));
    match factor {
        "target.color" if is_among(env, HIDING) => Kind::Shape,
        "floor.color" => Kind::Floor,
        "light.intensity" => Kind::Light,
        "floor.rotation_y" | "camera.angle_delta" => Kind::Everything,
        _ if ends(&["friction", "locked"]) => Kind::Motion,
        _ if ends(&["density", "mass"]) && is_among(env, FOLLOWED) => Kind::Everything,
        _ if ends(&["density", "mass"]) => Kind::Mass,
        _ if ends(&[".color", "lock_color"]) => Kind::Color,
        _ => Kind::Shape,
    }
}

#[derive(Deserialize)]
struct Recorded {
    env: String,
    start: BTreeMap<String, Vec<f64>>,
}

struct Seen {
    pixels: Vec<[u8; 3]>,
    segments: Vec<i32>,
}

struct Stage {
    env: Box<dyn Env>,
    row: Batch,
    start: Option<BTreeMap<String, Value>>,
}

impl Stage {
    fn new(entry: &EnvEntry, start: Option<BTreeMap<String, Value>>, off: &[&str]) -> Self {
        let mut config =
            EnvConfig { image: Some(ImageSize { height: SIDE, width: SIDE }), ..EnvConfig::default() };
        config.settings.insert("segmentation".to_owned(), true.into());
        for name in off {
            config.settings.insert((*name).to_owned(), false.into());
        }
        let env = entry.make(&config).expect("it was set up");
        let row = Batch::new(Schema::new(env.spec().fields.clone()).expect("distinct names"), 1);
        Self { env, row, start }
    }

    fn see(&mut self, factors: &BTreeMap<String, Value>) -> Seen {
        let options = ResetOptions {
            variation: Some(Vec::new()),
            variation_values: factors.clone(),
            start: self.start.clone(),
            ..ResetOptions::default()
        };
        self.env.reset(&Episode::new(EpisodeSeed::new(0), &options)).expect("a start");
        self.env.observe(&mut self.row.rows_mut());
        let pixels = self.row.get::<u8>(PIXELS).expect("images").as_chunks::<3>().0.to_vec();
        let segments = self.row.get::<i32>("pixels_segmentation").expect("segments").to_vec();
        Seen { pixels, segments }
    }
}

/// A value far from the default.
fn other(factor: &FactorSpec) -> Value {
    let values: Vec<f64> = flat(&factor.default);
    if factor.name.ends_with("yaw") {
        // A cube looks the same after each quarter of a turn.
        return Value::vector(&[values[0] + 0.7]);
    }
    // A little inside of the bounds, which f32 rounds.
    let far = |low: f64, high: f64, value: f64| {
        let end = if value - low > high - value { low } else { high };
        end + 0.01 * (value - end)
    };
    match &factor.space {
        Space::Discrete { n, start } => {
            let value = values[0] as i64;
            Value::from_json(&factor.name, &(if value == *start { start + *n - 1 } else { *start }).into())
        }
        Space::Box { low, high, shape, .. } => {
            let values: Vec<f64> =
                values.iter().enumerate().map(|(k, &value)| far(low[k], high[k], value)).collect();
            Ok(Value { shape: shape.clone(), ..Value::vector(&values) })
        }
        space => panic!("{}: {space:?}", factor.name),
    }
    .expect("a value")
}

fn flat(json: &serde_json::Value) -> Vec<f64> {
    match json {
        serde_json::Value::Array(items) => items.iter().flat_map(flat).collect(),
        number => vec![number.as_f64().expect("a number")],
    }
}

fn cases() -> BTreeMap<String, Recorded> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/pictures/suite.json");
    let text = std::fs::read_to_string(path).expect("the cases are committed");
    serde_json::from_str(&text).expect("cases")
}

/// Checks all factors of all domains and tables under these switched-off settings; `reaches`: whether mirrors and shadows
/// count.
fn check(off: &[&str], reaches: bool) {
    let mut failures = Vec::new();
    for case in cases().values().filter(|case| case.env.ends_with("DMControl-v0")) {
        let entry = ENVS.iter().find(|entry| entry.id == case.env).expect("a domain");
        let start = case.start.iter().map(|(name, values)| (name.clone(), Value::vector(values)));
        let mut stage = Stage::new(entry, Some(start.collect()), off);
        for factor in stage.env.spec().factors.clone() {
            check_factor(entry, &mut stage, &factor, &BTreeMap::new(), reaches, &mut failures);
        }
    }
    for entry in [&OGB_CUBE, &OGB_SCENE] {
        // What is seen through something would change pixels that show the thing in front.
        let hides = |names: &[&'static str]| [off, &["pixel_transparent_arm"], names].concat();
        let mut stage = Stage::new(entry, None, &hides(&["visualize_info"]));
        let mut with_goals = Stage::new(entry, None, &hides(&[]));
        for factor in stage.env.spec().factors.clone() {
            let stage = if factor.name.contains("goal") { &mut with_goals } else { &mut stage };
            check_factor(entry, stage, &factor, &apart(), reaches, &mut failures);
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// The cube away from its goal.
fn apart() -> BTreeMap<String, Value> {
    let place = |x: f64, y: f64| Value { shape: vec![1, 2], ..Value::vector(&[x, y]) };
    [("cube.start_position", place(0.35, -0.05)), ("cube.goal_position", place(0.35, 0.1))]
        .map(|(name, value)| (name.to_owned(), value))
        .into()
}

fn check_factor(
    entry: &EnvEntry,
    stage: &mut Stage,
    factor: &FactorSpec,
    base: &BTreeMap<String, Value>,
    reaches: bool,
    failures: &mut Vec<String>,
) {
    let mut factors = base.clone();
    for (name, value) in &factor.shows_with {
        factors.insert(name.clone(), Value::from_json(name, value).expect("a value"));
    }
    let before = stage.see(&factors);
    factors.insert(factor.name.clone(), other(factor));
    let after = stage.see(&factors);
    if let Err(reason) = compare(kind(entry.id, &factor.name), entry.id, &before, &after, reaches) {
        failures.push(format!("{} {}: {reason}", entry.id, factor.name));
    }
}

fn compare(kind: Kind, env: &str, before: &Seen, after: &Seen, reaches: bool) -> Result<(), String> {
    let (floors, glass) = (floors(env), glass(env));
    let is_floor = |segment: i32| floors.contains(&segment);
    let changed: Vec<usize> =
        (0..before.pixels.len()).filter(|&at| before.pixels[at] != after.pixels[at]).collect();
    let shows = |at: usize| [before.segments[at], after.segments[at]];
    // What covers other pixels than before, the background apart.
    let moved: BTreeSet<i32> = (0..before.segments.len())
        .filter(|&at| before.segments[at] != after.segments[at])
        .flat_map(shows)
        .filter(|&segment| segment != SKY && !is_floor(segment))
        .collect();
    let allowed = |at: usize| {
        let [old, new] = shows(at);
        match kind {
            Kind::Motion | Kind::Mass => false,
            Kind::Floor => is_floor(old) || glass.contains(&old),
            Kind::Color => old != SKY && (reaches || !is_floor(old)),
            Kind::Light => old != SKY,
            Kind::Shape => moved.contains(&old) || moved.contains(&new) || (reaches && old != SKY),
            Kind::Everything => true,
        }
    };
    let astray: Vec<usize> = changed.iter().copied().filter(|&at| !allowed(at)).collect();
    if let Some(&at) = astray.first() {
        let (x, y) = (at % SIDE, at / SIDE);
        let [old, new] = shows(at);
        return Err(format!(
            "{} pixels astray, the first at ({x}, {y}), which shows {old} and {new}",
            astray.len()
        ));
    }
    if matches!(kind, Kind::Floor | Kind::Color | Kind::Light) && before.segments != after.segments {
        return Err("things moved".to_owned());
    }
    let all = || 0..before.segments.len();
    let changes = |at: usize| before.pixels[at] != after.pixels[at];
    let missed = |of: i32| all().filter(|&at| before.segments[at] == of && !changes(at)).count();
    let size = |of: i32| all().filter(|&at| before.segments[at] == of).count();
    match kind {
        Kind::Motion | Kind::Mass => Ok(()),
        Kind::Floor if floors.iter().any(|&floor| missed(floor) * 20 > size(floor)) => {
            Err("parts of the floor stay".to_owned())
        }
        // A thing of another color is so all over; where it is dark, up to rounding.
        Kind::Color => {
            let things: BTreeSet<i32> = changed
                .iter()
                .map(|&at| before.segments[at])
                .filter(|&segment| segment != SKY && !is_floor(segment))
                .collect();
            let partly = things.iter().find(|&&thing| missed(thing) * 5 > size(thing));
            match (things.is_empty(), partly) {
                (true, _) => Err("nothing has another color".to_owned()),
                (_, Some(thing)) => {
                    Err(format!("{} of {} pixels of {thing} stay", missed(*thing), size(*thing)))
                }
                _ => Ok(()),
            }
        }
        // Spots light little of their images.
        Kind::Light if changed.len() * 100 < all().filter(|&at| before.segments[at] != SKY).count() => {
            Err(format!("only {} pixels are lit otherwise", changed.len()))
        }
        _ if changed.is_empty() => Err("nothing shows it".to_owned()),
        _ => Ok(()),
    }
}

#[test]
fn factors_change_what_they_name_and_nothing_else() {
    check(&["antialias", "shadows", "reflections"], false);
}

#[test]
fn with_mirrors_and_shadows_factors_reach_what_mirrors_and_is_shaded() {
    check(&["antialias"], true);
}

//! Visual distractors: changes of images that carry no information about the task, between the renderer and everyone who
//! looks. Each is a pure function of the image, the episode, the step and the view.
//!
//! Parameters and formulas are those of the reference's wrappers of August 2026. What differs on purpose: everything random
//! is keyed (the reference samples from a generator that continues across calls and episodes), steps are counted from each
//! episode's start, and values are rounded to the nearest byte (`truncate=true`: truncated, as in the reference).

mod chroma;
mod colors;
mod filters;
mod noise;
mod patches;
mod schedule;
mod shift;

use std::sync::Arc;

use serde_json::{Map, Value as Json};
use swm_core::error::{did_you_mean, nearest};
use swm_core::settings::read;
use swm_core::view::{Frame, Transform};
use swm_core::{PolicyArgs, Setting, Settings};

use crate::error::TaskError;

pub use schedule::Schedule;

/// Every distractor.
pub const DISTRACTORS: &[DistractorEntry] = &[
    entry::<noise::Noise>(),
    entry::<colors::ColorJitter>(),
    entry::<colors::Grayscale>(),
    entry::<filters::Blur>(),
    entry::<filters::RandomConv>(),
    entry::<filters::Resolution>(),
    entry::<patches::Occlusion>(),
    entry::<patches::Cutout>(),
    entry::<patches::MovingPatch>(),
    entry::<shift::RandomShift>(),
    entry::<chroma::ChromaKey>(),
];

/// Not a distractor: makes the others change goal images too.
const ON_GOALS: &str = "on_goals";

/// One distractor of the table.
#[derive(Clone, Copy, Debug)]
pub struct DistractorEntry {
    /// Its name: `noise`.
    pub name: &'static str,
    /// What it does, in one line.
    pub summary: &'static str,
    /// What can be set.
    pub settings: &'static [Setting],
    make: Make,
}

/// Makes a distractor from its settings.
type Make = fn(Map<String, Json>) -> Result<Box<dyn Transform>, TaskError>;

/// A kind of distractor: its settings, as plain data.
trait Distractor: Settings + Send + Sync + 'static {
    const NAME: &'static str;
    const SUMMARY: &'static str;

    /// Refuses settings that cannot be meant.
    fn check(&self) -> Result<(), String>;

    /// Changes one image.
    fn apply(&self, frame: &mut Frame<'_>);
}

struct Of<D>(D);

impl<D: Distractor> Transform for Of<D> {
    fn describe(&self) -> String {
        self.0.describe_as(D::NAME)
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        self.0.apply(frame);
    }
}

const fn entry<D: Distractor>() -> DistractorEntry {
    DistractorEntry {
        name: D::NAME,
        summary: D::SUMMARY,
        settings: D::SETTINGS,
        make: |given| {
            let wrong = |reason: String| format!("distractor `{}`: {reason}", D::NAME);
            let settings: D = read(&given).map_err(|error| wrong(error.to_string()))?;
            settings.check().map_err(wrong)?;
            Ok(Box::new(Of(settings)))
        },
    }
}

/// Several distractors, one after the other.
struct Chain {
    all: Vec<Box<dyn Transform>>,
    goals: bool,
}

impl Transform for Chain {
    fn describe(&self) -> String {
        self.all.iter().map(|one| one.describe()).collect::<Vec<_>>().join(" ")
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        self.all.iter().for_each(|one| one.apply(frame));
    }

    fn changes_goals(&self) -> bool {
        self.goals
    }
}

/// Reads `NAME` or `NAME:KEY=VALUE,…`, as policies are written.
///
/// # Errors
///
/// No such distractor, or an unknown or misfit setting of it.
pub fn parse(text: &str) -> Result<Box<dyn Transform>, TaskError> {
    let PolicyArgs { name, positional, named, .. } = PolicyArgs::parse(text)?;
    let Some(entry) = DISTRACTORS.iter().find(|entry| entry.name == name) else {
        let names: Vec<&str> = DISTRACTORS.iter().map(|entry| entry.name).chain([ON_GOALS]).collect();
        let near = nearest(&name, names.iter().copied());
        let meant = did_you_mean(near.as_deref());
        return Err(format!("unknown distractor `{name}`{meant}; there are {}", names.join(", ")).into());
    };
    if let Some(value) = positional.first() {
        return Err(format!("distractor `{name}`: unexpected value `{value}`; write key=value").into());
    }
    (entry.make)(named)
}

/// All of them, to be applied in order; `on_goals` among them lets them change goal images too. `None` for none.
///
/// # Errors
///
/// The first one of [`parse`].
pub fn parse_all(texts: &[String]) -> Result<Option<Arc<dyn Transform>>, TaskError> {
    let goals = texts.iter().any(|text| text == ON_GOALS);
    let all: Vec<Box<dyn Transform>> =
        texts.iter().filter(|text| *text != ON_GOALS).map(|text| parse(text)).collect::<Result<_, _>>()?;
    if all.is_empty() {
        return Ok(None);
    }
    Ok(Some(Arc::new(Chain { all, goals })))
}

/// A byte from a number: rounded half up, or cut off.
fn byte(value: f32, truncate: bool) -> u8 {
    let clipped = value.clamp(0.0, 255.0);
    if truncate { clipped as u8 } else { (clipped + 0.5) as u8 }
}

/// Refuses values outside `low..=high`.
fn within(name: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    let inside = value.is_finite() && (low..=high).contains(&value);
    if inside { Ok(()) } else { Err(format!("{name} {value} is not between {low} and {high}")) }
}

#[cfg(test)]
mod tests {
    use swm_core::view::Scratch;
    use swm_core::{EpisodeSeed, ImageSize};

    use super::*;

    const SIDE: usize = 24;

    /// An image with an edge, a gradient and a dark corner.
    fn image() -> Vec<u8> {
        (0..SIDE * SIDE)
            .flat_map(|i| {
                let (y, x) = (i / SIDE, i % SIDE);
                if x < 12 { [240, (y * 10) as u8, 40] } else { [20, 60, (x * 10) as u8] }
            })
            .collect()
    }

    fn shown(text: &str, seed: u64, step: u64) -> Vec<u8> {
        let mut pixels = image();
        let mut scratch = Scratch::default();
        let mut frame = Frame::new(
            &mut pixels,
            ImageSize { height: SIDE, width: SIDE },
            EpisodeSeed::new(seed),
            &mut scratch,
        );
        frame.step = step;
        parse(text).unwrap().apply(&mut frame);
        pixels
    }

    #[test]
    fn every_distractor_changes_images_and_repeats_itself() {
        for entry in DISTRACTORS {
            let text = match entry.name {
                "chroma_key" => "chroma_key:red=20,green=60,blue=120,tolerance=100",
                name => name,
            };
            // A shift may happen to be by nothing: some step of some episode shows a change.
            let changes = |step| shown(text, 5, step) != image();
            assert!((0..4).any(changes), "{text} changes nothing");
            for step in 0..4 {
                assert_eq!(shown(text, 5, step), shown(text, 5, step), "{text}");
            }
        }
    }

    #[test]
    fn episode_samples_stay_and_step_samples_change() {
        for (text, stays) in [
            ("noise", false),
            ("cutout", false),
            ("random_shift", false),
            ("moving_patch", false),
            ("color_jitter", true),
            ("random_conv", true),
            ("occlusion", true),
        ] {
            let steps: Vec<Vec<u8>> = (0..5).map(|step| shown(text, 5, step)).collect();
            assert_eq!(steps.iter().all(|frame| *frame == steps[0]), stays, "{text}");
            assert!(
                (6..12).any(|seed| shown(text, seed, 0) != steps[0]),
                "{text}: every episode is the same"
            );
        }
    }

    #[test]
    fn settings_are_documented_with_their_defaults() {
        for entry in DISTRACTORS {
            let all: Vec<String> =
                entry.settings.iter().map(|s| format!("{}={}", s.name, s.default)).collect();
            let described = parse(&format!("{}:{}", entry.name, all.join(","))).unwrap().describe();
            assert_eq!(described, entry.name, "a documented default is not the default");
        }
        let text = "noise:std=3.5,truncate=true";
        assert_eq!(parse(text).unwrap().describe(), text);
    }

    #[test]
    fn wrong_requests_are_refused() {
        let message = |text: &str| parse(text).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(message("noize").contains("did you mean `noise`?"));
        assert!(message("noise:sdt=1").contains("setting `sdt`: unknown (did you mean `std`?)"));
        assert!(message("noise:std=-1").contains("not between"));
        assert!(message("noise:20").contains("key=value"));
        assert!(message("resolution:scale=0").contains("scale"));
        assert!(parse_all(&[]).unwrap().is_none());
        let chain = parse_all(&["blur".to_owned(), "on_goals".to_owned()]).unwrap().unwrap();
        assert!(chain.changes_goals());
    }

    #[test]
    fn formulas_are_those_of_the_reference() {
        // Luma 0.299 R + 0.587 G + 0.114 B.
        let gray = shown("grayscale", 0, 0);
        assert_eq!(gray[..3], [76; 3], "240, 0, 40");
        // A blur of a constant row stays: the first 10 columns are constant along x in red.
        assert_eq!(shown("blur:kernel=3", 0, 0)[0], 240);
        // Half the resolution: blocks of 2 × 2 are equal.
        let coarse = shown("resolution:scale=0.5", 0, 0);
        let pixel = |y: usize, x: usize| &coarse[(y * SIDE + x) * 3..][..3];
        assert!((0..SIDE).all(|y| (0..SIDE).all(|x| pixel(y, x) == pixel(y & !1, x & !1))));
        // Noise of std 10 has about that std where nothing is clipped.
        let (noisy, plain) = (shown("noise:std=10", 3, 1), image());
        let differences: Vec<f64> = plain
            .iter()
            .zip(&noisy)
            .filter(|(plain, _)| (60..190).contains(*plain))
            .map(|(&a, &b)| f64::from(b) - f64::from(a))
            .collect();
        let (mean, std) = swm_core::evaluate::stats::mean_and_std(&differences);
        assert!(mean.abs() < 1.5 && (std.unwrap() - 10.0).abs() < 1.5, "{mean} {std:?}");
    }
}

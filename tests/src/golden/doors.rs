//! TwoRoom's doors, read off an image: most recordings of the reference draw them and do not say which they drew.

use anyhow::{Context as _, Result};
use serde_json::{Map, Value as Json, json};
use swm::core::Value;
use swm::core::env::PIXELS;

use super::file::{GoldenFile, Image};
use super::replay::Run;
use super::rules::Rules;

/// The environment that has doors.
pub(super) const ENV: &str = "swm/TwoRoom-v1";

/// Canvas pixels per image pixel, the border before the wall, and where the wall stands.
const SCALE: f64 = 512.0 / 224.0;
const BORDER: i64 = 9;
const WALL: f64 = 247.0;
/// Length of the wall, and of the longest door, canvas pixels.
const WALL_LENGTH: i64 = 494;
const LONGEST: i64 = 99;
/// How far a door's ends may be from where the image shows them, canvas pixels.
const SEARCH: i64 = 4;

/// Adds `door.position` and `door.size` to the factors of a file that has one door and does not say where: the values
/// whose image after reset is the recorded one.
pub(super) fn add_unrecorded(
    run: &mut Run,
    rules: &Rules,
    file: &GoldenFile,
    factors: &mut Map<String, Json>,
) -> Result<()> {
    let Some(image) = file.images.get(&0) else { return Ok(()) };
    if factors.keys().any(|name| name.starts_with("door.")) {
        return Ok(());
    }
    let mut options = run.start(rules, file, factors)?;
    run.reset(&options)?;
    if unequal(run, image)? == 0 {
        return Ok(());
    }
    let vertical = factors.get("wall.axis") != Some(&json!(0));
    let (first, last) = gap(image, vertical).with_context(|| format!("{}: no door is seen", file.name))?;
    let mut best: Option<(usize, i64, i64)> = None;
    for start in (first - SEARCH).max(0)..=first + SEARCH {
        // Of a door that reaches beyond the wall's end, all lengths that do look and act alike.
        let beyond = (last + 3 * SEARCH >= WALL_LENGTH).then_some(start + LONGEST);
        for end in (last - SEARCH..=last + SEARCH).chain(beyond) {
            // The other doors do not exist; they keep the first one's values.
            let door = [("door.position", start), ("door.size", end - start)];
            for (name, value) in door {
                options.variation_values.insert(name.to_owned(), Value::vector(&[value; 3]));
            }
            if run.reset(&options).is_err() {
                continue;
            }
            let differ = unequal(run, image)?;
            if best.is_none_or(|(fewest, ..)| differ < fewest) {
                best = Some((differ, start, end - start));
            }
        }
    }
    let (_, start, size) = best.with_context(|| format!("{}: no door fits the image", file.name))?;
    factors.insert("door.position".to_owned(), json!([start, start, start]));
    factors.insert("door.size".to_owned(), json!([size, size, size]));
    Ok(())
}

fn unequal(run: &Run, image: &Image) -> Result<usize> {
    let ours: &[u8] = run.row.get(PIXELS)?;
    Ok(ours.chunks_exact(3).zip(image.rgb.chunks_exact(3)).filter(|(a, b)| a != b).count())
}

/// Where the door seems to begin and end along the wall, canvas pixels from the wall's beginning: the longest stretch on
/// the wall's line that is not of the wall's color.
fn gap(image: &Image, vertical: bool) -> Option<(i64, i64)> {
    let across = (WALL / SCALE) as usize;
    let pixel = |along: usize| {
        let (row, column) = if vertical { (along, across) } else { (across, along) };
        let start = (row * image.width + column) * 3;
        &image.rgb[start..start + 3]
    };
    // The borders and what lies before the wall end within the first and last pixels.
    let inside = 5..image.height - 5;
    let mut counts = std::collections::BTreeMap::new();
    inside.clone().for_each(|along| *counts.entry(pixel(along)).or_insert(0) += 1);
    let wall = counts.into_iter().max_by_key(|&(_, count)| count)?.0;
    let other: Vec<usize> = inside.filter(|&along| pixel(along) != wall).collect();
    let stretches = other.chunk_by(|a, b| a + 1 == *b);
    let longest = stretches.max_by_key(|stretch| stretch.len())?;
    let canvas = |along: usize| (along as f64 * SCALE) as i64 - BORDER;
    // Next to a door, the wall ends in 4 px of its plain color.
    Some((canvas(*longest.first()?) + 4, canvas(*longest.last()?) - 2))
}

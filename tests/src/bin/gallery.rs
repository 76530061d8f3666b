//! `gallery DIR`: an image of every environment, as it is by default and with all factors varied, next to MuJoCo's own
//! image of the same state where there is one; and the page that shows them, `DIR/gallery.md`. For `cargo xtask gallery`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use swm::core::env::PIXELS;
use swm::core::{Batch, EnvConfig, EnvEntry, Episode, EpisodeSeed, ImageSize, ResetOptions, Schema};

/// Side of an image, pixels.
const SIDE: usize = 112;
/// Between images.
const GAP: usize = 4;

const HEAD: &str = "\
# Gallery

Every environment at the start of an episode, with default factors and with all factors of variation sampled. Of two images side by side,
the left one is by this renderer (no OpenGL), the right one by MuJoCo's, of the same state. `cargo xtask gallery` makes this page; all images
use seed 1 and 112 px.

| environment | default | all factors varied |
|---|---|---|
";

fn main() -> Result<()> {
    let dir = std::env::args_os().nth(1).context("usage: gallery DIR")?;
    let dir = Path::new(&dir);
    fs::create_dir_all(dir.join("gallery"))?;
    let mut page = HEAD.to_owned();
    // Environments that differ in rewards or columns alone show one image.
    let mut drawn: BTreeMap<Vec<Vec<u8>>, String> = BTreeMap::new();
    for entry in swm::registry().envs() {
        let name = entry.id.trim_start_matches("swm/");
        write!(page, "| `{}` |", entry.id)?;
        for (kind, vary) in [("default", Vec::new()), ("varied", vec!["all".to_owned()])] {
            let mut images = vec![image(entry, &vary, &[])?];
            if entry.settings.iter().any(|setting| setting.name == "renderer") {
                match image(entry, &vary, &[("renderer", "gl")]) {
                    Ok(theirs) => images.push(theirs),
                    Err(error) => println!("{name}: no image of MuJoCo's: {error}"),
                }
            }
            let file = match drawn.get(&images) {
                Some(file) => file.clone(),
                None => {
                    let file = format!("gallery/{name}-{kind}.png");
                    write_png(&dir.join(&file), &images)?;
                    drawn.insert(images, file.clone());
                    file
                }
            };
            write!(page, " ![{name}, {kind}]({file}) |")?;
        }
        page.push('\n');
        println!("{name}");
    }
    fs::write(dir.join("gallery.md"), page)?;
    Ok(())
}

/// The first image of an episode, `[SIDE, SIDE, 3]`.
fn image(entry: &EnvEntry, vary: &[String], settings: &[(&str, &str)]) -> Result<Vec<u8>> {
    let mut config =
        EnvConfig { image: Some(ImageSize { height: SIDE, width: SIDE }), ..EnvConfig::default() };
    for (name, value) in settings {
        config.settings.insert((*name).to_owned(), (*value).into());
    }
    let mut env = entry.make(&config)?;
    let mut row = Batch::new(Schema::new(env.spec().fields.clone())?, 1);
    let options = ResetOptions { variation: Some(vary.to_vec()), ..ResetOptions::default() };
    env.reset(&Episode::new(EpisodeSeed::new(1), &options))?;
    env.observe(&mut row.rows_mut());
    Ok(row.get::<u8>(PIXELS)?.to_vec())
}

/// Images side by side.
fn write_png(path: &Path, images: &[Vec<u8>]) -> Result<()> {
    let width = images.len() * (SIDE + GAP) - GAP;
    let mut pixels = vec![255; width * SIDE * 3];
    for (index, image) in images.iter().enumerate() {
        for (row, line) in image.chunks_exact(SIDE * 3).enumerate() {
            pixels[(row * width + index * (SIDE + GAP)) * 3..][..SIDE * 3].copy_from_slice(line);
        }
    }
    let mut encoder = png::Encoder::new(fs::File::create(path)?, width as u32, SIDE as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.set_filter(png::Filter::Adaptive);
    encoder.write_header()?.write_image_data(&pixels)?;
    Ok(())
}

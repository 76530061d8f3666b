//! `load-rates FILE NUM_STEPS [--keys A,B] [--threads 1,2] [--seconds S] [--first] [--draw SIDE] [--cache]`: shuffled clips per
//! second out of a dataset, in batches of 64, as JSON. For `peers/data.py`. With `--draw`, images are not read but drawn. With `--cache`,
//! they are decoded once into files beside the dataset, before the clock starts.

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use serde::Serialize;
use swm_benches::{Clock, Elapsed};
use swm_core::{ImageSize, Registry};
use swm_data::loader::{BatchOptions, CacheOptions, ClipOptions, Images, Loader};
use swm_data::{Dataset, RenderOptions, Rendered};
use swm_envs_2d::ENVS;

/// Clips of a batch.
const SIZE: usize = 64;

/// One measurement.
#[derive(Serialize)]
struct Measurement {
    threads: usize,
    clips: u64,
    #[serde(flatten)]
    elapsed: Elapsed,
}

/// The dataset, with images of side `draw` that are drawn.
fn open(path: &Path, draw: Option<usize>) -> Result<Box<dyn Dataset>> {
    let registry = Registry::new().with(swm_data::FORMATS).with(swm_data_lerobot::FORMATS);
    let dataset = swm_data::open_in(&registry.with(swm_data_foreign::LAYOUTS), path)?;
    let Some(side) = draw else { return Ok(dataset) };
    let image = ImageSize { height: side, width: side };
    let options = RenderOptions::default().image(image);
    Ok(Box::new(Rendered::new(dataset, &Registry::new().with(ENVS), &options)?))
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let usage = "usage: load-rates FILE NUM_STEPS [--keys A,B] [--threads 1,2] [--seconds S] [--first] [--draw SIDE] [--cache]";
    let file = arguments.next().context(usage)?;
    let num_steps: usize = arguments.next().context(usage)?.parse().context("NUM_STEPS must be a number")?;
    let (mut keys, mut threads, mut seconds) = (vec!["pixels".to_owned()], vec![1], 1.0);
    let (mut images, mut draw, mut cache) = (Images::ChannelsLast, None, None);
    while let Some(option) = arguments.next() {
        let mut value = || arguments.next().context(usage);
        match option.as_str() {
            "--keys" => keys = value()?.split(',').map(str::to_owned).collect(),
            "--threads" => threads = value()?.split(',').map(str::parse).collect::<Result<_, _>>()?,
            "--seconds" => seconds = value()?.parse()?,
            "--draw" => draw = Some(value()?.parse()?),
            "--cache" => cache = Some(CacheOptions::default()),
            "--first" => images = Images::ChannelsFirst,
            _ => bail!(usage),
        }
    }
    let mut measurements = Vec::new();
    for threads in threads {
        let options = ClipOptions::default()
            .num_steps(num_steps)
            .keys(Some(keys.clone()))
            .images(images)
            .threads(Some(threads))
            .cache(cache.clone());
        let loader = Loader::new(open(Path::new(&file), draw)?, &options)?;
        let stream = BatchOptions::default().size(SIZE).shuffle(Some(1));
        let mut batches = loader.batches(&stream)?;
        let mut batch = batches.new_batch();
        // The first ones fill caches and allocate the tables.
        for _ in 0..4 * threads {
            batches.next_batch(&mut batch)?;
        }
        let (mut clock, mut clips) = (Clock::new(), 0);
        while clock.elapsed().wall_s < seconds {
            clock.time(|| -> Result<()> {
                for _ in 0..8 {
                    if batches.next_batch(&mut batch)? {
                        clips += batch.rows() as u64;
                    }
                }
                Ok(())
            })?;
        }
        measurements.push(Measurement { threads, clips, elapsed: clock.elapsed() });
    }
    println!("{}", serde_json::to_string_pretty(&measurements)?);
    Ok(())
}

//! One golden `.npz` file in memory.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Cursor;
use std::path::Path;

use anyhow::{Context as _, Result, anyhow, bail};
use ndarray::{ArrayD, OwnedRepr};
use ndarray_npy::NpzReader;
use serde_json::{Map, Value as Json};

use super::simple;

/// A recorded trajectory: arrays by name, and what its `meta` says.
#[derive(Debug)]
pub struct GoldenFile {
    /// File name without folder.
    pub name: String,
    /// The reference's environment id.
    pub env_id: String,
    /// The factors that were set, by name.
    pub factors: Map<String, Json>,
    /// Numeric arrays, as `f64`, `[T, …]` or `[T + 1, …]`.
    pub numbers: BTreeMap<String, ArrayD<f64>>,
    /// Images after some steps, `[H, W, 3]`.
    pub images: BTreeMap<usize, Image>,
    /// The goal image.
    pub goal_image: Option<Image>,
}

/// A decoded image.
#[derive(Debug)]
pub struct Image {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// `[H, W, 3]`.
    pub rgb: Vec<u8>,
}

impl GoldenFile {
    /// Reads a file of one run.
    ///
    /// # Errors
    ///
    /// As of [`Self::read_all`]; or it holds several runs.
    pub fn read(path: &Path) -> Result<Self> {
        let mut runs = Self::read_all(path)?;
        match (runs.pop(), runs.is_empty()) {
            (Some(run), true) => Ok(run),
            _ => bail!("{} does not hold one run", path.display()),
        }
    }

    /// Reads every run of a file: the one whose arrays have plain names, or those of `RUN/actions`, `RUN/state` and so on.
    ///
    /// # Errors
    ///
    /// It cannot be read, or lacks an array that every recording has.
    pub fn read_all(path: &Path) -> Result<Vec<Self>> {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let Arrays { mut bytes, mut numbers } = Arrays::read(path)?;
        let meta = bytes.get("meta").ok_or_else(|| anyhow!("{name} has no `meta`"))?;
        // Python writes numbers that are none in a way that JSON has not.
        let meta: Json = serde_json::from_str(&String::from_utf8_lossy(meta).replace(": NaN", ": null"))?;
        if let Some(like) = meta["like"].as_str() {
            let (env, _) = name.split_once("__").ok_or_else(|| anyhow!("{name} is like no other file"))?;
            let other = Arrays::read(&path.with_file_name(format!("{env}__{like}.npz")))?;
            // Its own come last, and stay.
            bytes = other.bytes.into_iter().chain(bytes).collect();
            numbers = other.numbers.into_iter().chain(numbers).collect();
        }
        if let Some(id) = meta["env_id"].as_str() {
            let factors = meta["options"]["variation_values"].as_object().cloned().unwrap_or_default();
            return Ok(vec![Self::from_arrays(name, id.to_owned(), factors, numbers, &bytes)?]);
        }
        let id = meta["env"].as_str().ok_or_else(|| anyhow!("{name}: `meta` has no env_id and no env"))?;
        let runs: Vec<String> =
            numbers.keys().filter_map(|key| key.strip_suffix("/actions").map(str::to_owned)).collect();
        let run_of = |run: String| {
            let prefix = format!("{run}/");
            let own = |key: &String| key.strip_prefix(&prefix).map(str::to_owned);
            let arrays: BTreeMap<_, _> =
                numbers.iter().filter_map(|(key, array)| Some((own(key)?, array.clone()))).collect();
            let pngs = bytes.iter().filter_map(|(key, png)| Some((own(key)?, png.clone()))).collect();
            let factors = factors_in_force(&run, &arrays);
            // By the names of the columns here.
            let arrays = arrays.into_iter().map(|(key, array)| match key.as_str() {
                "state" if simple::records_state(id) => ("state_state".to_owned(), array),
                "state" => ("state_simulator_state".to_owned(), array),
                "walls" => ("state_walls".to_owned(), array.insert_axis(ndarray::Axis(0))),
                "observation" => ("info_proprio".to_owned(), array),
                "distance" => ("info_distance_to_target".to_owned(), array),
                "reward_sparse" => ("reward".to_owned(), array),
                _ => (key, array),
            });
            let mut arrays: BTreeMap<_, _> = arrays.collect();
            // A goal of the whole run, which its start takes over.
            if let Some(goal) = arrays.remove("desired_goal") {
                arrays.insert("state_desired_goal".to_owned(), goal.clone().insert_axis(ndarray::Axis(0)));
                arrays.insert("goal_state".to_owned(), goal);
            }
            Self::from_arrays(format!("{name} {run}"), format!("swm/{id}"), factors, arrays, &pngs)
        };
        runs.into_iter().map(run_of).collect()
    }

    fn from_arrays(
        name: String,
        env_id: String,
        factors: Map<String, Json>,
        numbers: BTreeMap<String, ArrayD<f64>>,
        bytes: &BTreeMap<String, Vec<u8>>,
    ) -> Result<Self> {
        let mut images = BTreeMap::new();
        for (key, png) in bytes {
            if let Some(step) = key.strip_prefix("img_").and_then(|rest| rest.strip_suffix("_png")) {
                images.insert(step.parse()?, decode(png)?);
            }
        }
        let goal_image = bytes.get("goal_png").map(|png| decode(png)).transpose()?;
        Ok(Self { name, env_id, factors, numbers, images, goal_image })
    }

    /// The array `key`, flattened per row: `[T, width]`.
    pub fn rows(&self, key: &str) -> Option<Vec<Vec<f64>>> {
        let array = self.numbers.get(key)?;
        Some(array.outer_iter().map(|row| row.iter().copied().collect()).collect())
    }
}

/// What a file holds, by name.
struct Arrays {
    /// JSON and images.
    bytes: BTreeMap<String, Vec<u8>>,
    numbers: BTreeMap<String, ArrayD<f64>>,
}

impl Arrays {
    fn read(path: &Path) -> Result<Self> {
        let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
        let mut npz = NpzReader::new(file).with_context(|| format!("{} is no npz file", path.display()))?;
        let (mut bytes, mut numbers) = (BTreeMap::new(), BTreeMap::new());
        for entry in npz.names()? {
            let key = entry.trim_end_matches(".npy").to_owned();
            if key == "meta" || key.ends_with("_png") {
                let array: ArrayD<u8> = npz.by_name(&entry)?;
                bytes.insert(key, array.into_raw_vec_and_offset().0);
            } else if let Some(array) = number_array(&mut npz, &entry) {
                numbers.insert(key, array);
            }
        }
        Ok(Self { bytes, numbers })
    }
}

/// The factors of a run: arrays `fov.NAME`, or `fov_value` (of Fetch `value`) of the factor that the run `fov/NAME/…` is about.
fn factors_in_force(run: &str, arrays: &BTreeMap<String, ArrayD<f64>>) -> Map<String, Json> {
    let one = run.strip_prefix("fov/").and_then(|run| run.split('/').next());
    let named = arrays.iter().filter_map(|(key, array)| match key.strip_prefix("fov.") {
        Some(factor) => Some((factor, array)),
        None => one.filter(|_| ["fov_value", "value"].contains(&key.as_str())).map(|factor| (factor, array)),
    });
    let list = |array: &ArrayD<f64>| array.iter().copied().collect::<Vec<f64>>();
    named.map(|(factor, array)| (factor.to_owned(), list(array).into())).collect()
}

/// An array of any numeric type as `f64`.
fn number_array(npz: &mut NpzReader<File>, name: &str) -> Option<ArrayD<f64>> {
    macro_rules! first_of {
        ($($type:ty => $convert:expr),*) => {
            $(if let Ok(array) = npz.by_name::<OwnedRepr<$type>, ndarray::IxDyn>(name) {
                return Some(array.mapv($convert));
            })*
        };
    }
    first_of!(f64 => |v| v, f32 => f64::from, bool => |v| f64::from(u8::from(v)), i64 => |v| v as f64,
              i32 => f64::from, u8 => f64::from);
    None
}

fn decode(png: &[u8]) -> Result<Image> {
    let mut reader = png::Decoder::new(Cursor::new(png)).read_info()?;
    let mut rgb = vec![0; reader.output_buffer_size().ok_or_else(|| anyhow!("an image of absurd size"))?];
    let info = reader.next_frame(&mut rgb)?;
    if info.color_type != png::ColorType::Rgb {
        bail!("an image is {:?}, not RGB", info.color_type);
    }
    rgb.truncate(info.buffer_size());
    Ok(Image { height: info.height as usize, width: info.width as usize, rgb })
}

//! Images without OpenGL against those of the reference, at recorded cases of all domains: how alike they look, that
//! they are the same everywhere, and what else the renderer can show.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::PathBuf;
use std::sync::Arc;

use serde::Deserialize;
use swm_core::env::PIXELS;
use swm_core::{Batch, Env, EnvConfig, Episode, EpisodeSeed, ImageSize, ResetOptions, Schema, Value};
use swm_envs_mujoco::ENVS;
use swm_envs_mujoco::software::SoftwareRenderer;
use swm_mujoco::{Model, Object, Simulation, Spec};

/// A case in `tests/golden/pictures/suite.json` or `metaworld.json`; its image, drawn by MuJoCo's own renderer, has the same name.
#[derive(Deserialize)]
struct Recorded {
    env: String,
    #[serde(default = "usual_side")]
    side: usize,
    #[serde(default)]
    factors: BTreeMap<String, Vec<f64>>,
    start: BTreeMap<String, Vec<f64>>,
    #[serde(default)]
    settings: serde_json::Map<String, serde_json::Value>,
}

fn usual_side() -> usize {
    224
}

fn golden(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/pictures").join(name)
}

fn cases() -> BTreeMap<String, Recorded> {
    let read = |name| {
        let text = std::fs::read_to_string(golden(name)).expect("the cases are committed");
        serde_json::from_str::<BTreeMap<String, Recorded>>(&text).expect("cases")
    };
    ["suite.json", "metaworld.json"].into_iter().flat_map(read).collect()
}

fn make(case: &Recorded) -> (Box<dyn Env>, Batch) {
    let entry = ENVS.iter().find(|entry| entry.id == case.env).expect("an environment");
    let image = Some(ImageSize { height: case.side, width: case.side });
    let env = entry.make(&EnvConfig { image, settings: case.settings.clone() });
    let env = env.expect("it needs no OpenGL");
    let row = Batch::new(Schema::new(env.spec().fields.clone()).expect("distinct names"), 1);
    (env, row)
}

fn render((env, row): &mut (Box<dyn Env>, Batch), case: &Recorded) -> Vec<u8> {
    let start = case.start.iter().map(|(name, values)| (name.clone(), Value::vector(values)));
    let factors = case.factors.iter().map(|(name, values)| (name.clone(), Value::vector(values)));
    let options = ResetOptions {
        variation: Some(Vec::new()),
        variation_values: factors.collect(),
        start: Some(start.collect()),
        ..ResetOptions::default()
    };
    env.reset(&Episode::new(EpisodeSeed::new(0), &options)).expect("a start");
    env.observe(&mut row.rows_mut());
    row.get::<u8>(PIXELS).expect("images were asked for").to_vec()
}

fn recorded(name: &str) -> Vec<u8> {
    let png = std::fs::read(golden(&format!("{name}.png"))).expect("the image is committed");
    let mut reader = png::Decoder::new(Cursor::new(png)).read_info().expect("a PNG header");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    reader.next_frame(&mut pixels).expect("a PNG");
    pixels
}

/// Structural similarity (Wang et al. 2004) over windows of 7 × 7 pixels of each channel, as scikit-image computes it.
fn similarity(a: &[u8], b: &[u8], side: usize) -> f64 {
    const WINDOW: usize = 7;
    let count = (WINDOW * WINDOW) as f64;
    let (c1, c2) = ((0.01f64 * 255.0).powi(2), (0.03f64 * 255.0).powi(2));
    let (mut sum, mut windows) = (0.0, 0.0);
    for channel in 0..3 {
        for y in 0..=side - WINDOW {
            for x in 0..=side - WINDOW {
                let mut cases = [0.0; 5];
                for dy in 0..WINDOW {
                    for dx in 0..WINDOW {
                        let at = ((y + dy) * side + x + dx) * 3 + channel;
                        let (p, q) = (f64::from(a[at]), f64::from(b[at]));
                        let terms = [p, q, p * p, q * q, p * q];
                        cases.iter_mut().zip(terms).for_each(|(case, term)| *case += term);
                    }
                }
                let [p, q, pp, qq, pq] = cases.map(|case| case / count);
                let unbiased = count / (count - 1.0);
                let (vp, vq, cov) =
                    ((pp - p * p) * unbiased, (qq - q * q) * unbiased, (pq - p * q) * unbiased);
                sum += (2.0 * p * q + c1) * (2.0 * cov + c2) / ((p * p + q * q + c1) * (vp + vq + c2));
                windows += 1.0;
            }
        }
    }
    sum / windows
}

#[test]
fn images_look_like_those_of_the_reference() {
    for (name, case) in &cases() {
        let (ours, theirs) = (render(&mut make(case), case), recorded(name));
        let difference: f64 = ours.iter().zip(&theirs).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
        let (difference, likeness) = (difference / ours.len() as f64, similarity(&ours, &theirs, case.side));
        println!("{name}: SSIM {likeness:.4}, mean difference {difference:.2} of 255");
        // Meshes have fewer facets here, and the metal of the scene's buttons reflects less.
        // MuJoCo's images of 64 pixels have edges of four samples.
        let (least, most) = match (case.side, case.env.starts_with("swm/OGB")) {
            (64, _) => (0.93, 3.5),
            (_, true) => (0.95, 3.0),
            (_, false) => (0.97, 3.0),
        };
        assert!(likeness > least, "{name}: SSIM {likeness}");
        assert!(difference < most, "{name}: mean difference {difference}");
    }
}

#[test]
fn images_do_not_depend_on_what_was_drawn_before() {
    let cases = cases();
    let case = &cases["humanoid-50"];
    let mut env = make(case);
    let first = render(&mut env, case);
    env.0.reset(&Episode::new(EpisodeSeed::new(7), &ResetOptions::default().vary(["all"]))).expect("a reset");
    env.0.observe(&mut env.1.rows_mut());
    assert!(render(&mut env, case) == first, "another image after another episode");
    assert!(render(&mut make(case), case) == first, "another image in another environment");
}

#[test]
fn segments_and_depths_belong_to_the_image() {
    let spec = Spec::read(&swm_mujoco::assets::suite_model("reacher.xml").expect("it was set up"));
    let model = Arc::new(spec.and_then(|mut spec| spec.compile()).expect("a model"));
    let geom = |name: &str| Model::id(&model, Object::Geom, name).expect("a geom") as i32;
    let mut sim = Simulation::new(Arc::clone(&model)).expect("a simulation");
    sim.forward().expect("computed");
    let mut renderer = SoftwareRenderer::new(&model, 0, [64, 64]).expect("a renderer");
    let (mut segments, mut depths) = (vec![0; 64 * 64], vec![0.0; 64 * 64]);
    renderer.render_segmentation(&mut sim, &mut segments).expect("segments");
    renderer.render_depth(&mut sim, &mut depths).expect("depths");
    // Seen from 0.75 m above: the arm lies along x from the middle, the floor is around it.
    let at = |x: usize, y: usize| y * 64 + x;
    assert_eq!(segments[at(38, 32)], geom("arm"));
    assert_eq!(segments[at(32, 50)], geom("ground"));
    assert!((depths[at(32, 50)] - 0.75).abs() < 1e-3, "{}", depths[at(32, 50)]);
    assert!((depths[at(38, 32)] - 0.73).abs() < 2e-3, "{}", depths[at(38, 32)]);
}

#[test]
fn height_fields_are_ground() {
    // Heights rise along x, from 0 to 0.4 m over 2 m, and are equal along y.
    let xml = r#"<mujoco>
        <asset><hfield name="slope" nrow="2" ncol="5" size="1 1 0.4 0.1"
            elevation="0 0.25 0.5 0.75 1  0 0.25 0.5 0.75 1"/></asset>
        <worldbody>
            <light pos="0 0 3" dir="0 0 -1"/>
            <camera name="above" pos="0 0 3" xyaxes="1 0 0 0 1 0"/>
            <geom name="ground" type="hfield" hfield="slope"/>
        </worldbody>
    </mujoco>"#;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("slope.xml");
    std::fs::write(&path, xml).expect("written");
    let model = Arc::new(Spec::read(&path).and_then(|mut spec| spec.compile()).expect("a model"));
    let mut sim = Simulation::new(Arc::clone(&model)).expect("a simulation");
    sim.forward().expect("computed");
    let side = 65;
    let mut renderer = SoftwareRenderer::new(&model, 0, [side, side]).expect("a renderer");
    let (mut segments, mut depths) = (vec![0; side * side], vec![0.0; side * side]);
    renderer.render_segmentation(&mut sim, &mut segments).expect("segments");
    renderer.render_depth(&mut sim, &mut depths).expect("depths");
    let middle = side / 2;
    for x in middle - 10..=middle + 10 {
        let (segment, depth) = (segments[middle * side + x], f64::from(depths[middle * side + x]));
        assert_eq!(segment, 0, "column {x}");
        // The view is 45 degrees wide: at this depth the column stands over this x, m, where the ground is this high.
        let at = depth * (x as f64 - middle as f64) / side as f64 * 2.0 * 22.5_f64.to_radians().tan();
        let height = 0.2 + 0.2 * at;
        assert!((3.0 - depth - height).abs() < 1e-3, "column {x}: {depth} m, not {}", 3.0 - height);
    }
    assert_eq!(segments[middle * side], -1, "the ground ends");
}

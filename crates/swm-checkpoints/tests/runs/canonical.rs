//! Images drawn in one canonical look: learned from pairs that a recording without images renders, and in front of other models.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::json;
use swm_baselines::Device;
use swm_baselines::train::{ImageLooks, NewRun, RunFolder, State, Training};
use swm_core::{Registry, Value};
use swm_data::{Dataset, Looks};

use super::dot::SHADE;
use super::{BreakAt, IMAGE, SHADED, SIDE, made_for, new_run, paths_in, record_in};

fn registry() -> Registry {
    Registry::new().with(swm_data::FORMATS).with(&[SHADED])
}

fn dark() -> BTreeMap<String, Value> {
    BTreeMap::from([(SHADE.to_owned(), Value::scalar(20.0))])
}

fn pairs() -> ImageLooks {
    let vary = Looks::default().vary(vec!["visual".to_owned()]).seed(3);
    ImageLooks::new().vary(Some(vary)).canonical(Some(&dark()))
}

fn drawing() -> NewRun<'static> {
    let model = json!({ "image": SIDE, "channels": [4, 4, 4], "clip": 2, "frameskip": 2 });
    NewRun { changes: json!({ "model": model }), looks: pairs(), ..new_run("canonical") }
}

fn train(folder: &Path, dataset: &dyn Dataset, new: &NewRun<'_>) -> Result<State, String> {
    let training = Training::create(&registry(), folder, dataset, new);
    training.and_then(|mut training| training.run(Vec::new())).map_err(|error| error.to_string())
}

#[test]
fn it_learns_from_pairs_and_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = record_in(&SHADED, &at("data.h5"), None, 1);
    let whole = train(&at("whole"), dataset.as_ref(), &drawing()).unwrap();
    assert!(whole.step == 9 && whole.validation.iter().all(|(_, value)| value.is_finite()), "{whole:?}");
    let mut training = Training::create(&registry(), &at("broken"), dataset.as_ref(), &drawing()).unwrap();
    training.run(vec![Box::new(BreakAt(4))]).unwrap_err();
    drop(training);
    let resumed = Training::resume(&registry(), &at("broken"), Device::Cpu, None, |_| ());
    assert_eq!(resumed.unwrap().run(Vec::new()).unwrap(), whole);
    let weights = |name: &str| fs::read(RunFolder::open(&at(name)).unwrap().weights(9)).unwrap();
    assert!(weights("whole") == weights("broken"), "the weights differ");
    // The looks are part of the run, and of what it learns.
    let config = fs::read_to_string(at("whole").join("config.json")).unwrap();
    assert!(
        config.contains("\"canonical\"") && config.contains(SHADE) && config.contains("visual"),
        "{config}"
    );
    let one_look = NewRun { looks: ImageLooks::new().canonical(Some(&dark())), ..drawing() };
    assert_ne!(train(&at("one"), dataset.as_ref(), &one_look).unwrap().train, whole.train);
}

#[test]
fn models_and_policies_see_what_it_draws() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = record_in(&SHADED, &at("data.h5"), None, 1);
    train(&at("drawing"), dataset.as_ref(), &drawing()).unwrap();
    let look = ImageLooks::new().set(&dark());
    for baseline in ["lewm", "gcbc"] {
        let new = NewRun { looks: look.clone(), ..new_run(baseline) };
        train(&at(baseline), dataset.as_ref(), &new).unwrap();
    }
    let canonical = format!("canonical={}", at("drawing").display());
    let mpc =
        format!("mpc:{},samples=8,elites=2,iterations=2,horizon=2,receding_horizon=1", at("lewm").display());
    for policy in [mpc.clone(), format!("gcbc:{}", at("gcbc").display())] {
        let drawn = format!("{policy},{canonical}");
        let alone = paths_in(&SHADED, &drawn, 1, Some(IMAGE)).unwrap().0;
        assert_eq!(alone, paths_in(&SHADED, &drawn, 3, Some(IMAGE)).unwrap().0, "{policy}");
        assert_ne!(alone, paths_in(&SHADED, &policy, 1, Some(IMAGE)).unwrap().0, "{policy}");
        let described = made_for(&SHADED, &drawn).unwrap().describe();
        assert!(described.contains("canonical=canonical@9#"), "{described}");
    }
    // With a history, too.
    let seeing = format!("{mpc},history_len=2,{canonical}");
    assert_eq!(
        paths_in(&SHADED, &seeing, 1, Some(IMAGE)).unwrap().0,
        paths_in(&SHADED, &seeing, 3, Some(IMAGE)).unwrap().0
    );
    let refused = |text: String| made_for(&SHADED, &text).err().expect("it is refused");
    let wrong = refused(format!("{mpc},canonical={}", at("lewm").display()));
    assert!(
        wrong.contains("setting `canonical`") && wrong.contains("draws no images in a canonical look"),
        "{wrong}"
    );
    let none = refused(format!("{mpc},canonical={}", at("none").display()));
    assert!(none.contains("setting `canonical`") && none.contains("there is no such folder"), "{none}");
}

#[test]
fn looks_that_nothing_learns_from_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = record_in(&SHADED, &at("data.h5"), None, 1);
    let refused = |new: &NewRun<'_>| train(&at("run"), dataset.as_ref(), new).unwrap_err();
    let none = refused(&NewRun { looks: ImageLooks::default(), ..drawing() });
    assert!(none.contains("`canonical`") && none.contains("the second look is not named"), "{none}");
    let extra = refused(&NewRun { looks: pairs(), ..new_run("lewm") });
    assert!(extra.contains("it learns from no images of a canonical look"), "{extra}");
    let unknown = Looks::default().vary(vec!["table.shape".to_owned()]);
    let looks = ImageLooks::new().vary(Some(unknown));
    let unknown = refused(&NewRun { looks, ..new_run("lewm") });
    assert!(
        unknown.contains("cannot be rendered in these looks")
            && unknown.contains("did you mean `table.shade`"),
        "{unknown}"
    );
    assert!(!at("run").exists(), "nothing was written");
}

#[test]
fn an_encoder_learns_by_drawing_alone_for_a_world_model() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = record_in(&SHADED, &at("data.h5"), None, 1);
    let encoder = json!({ "channels": [4, 8], "count": 4 });
    let places = NewRun {
        changes: json!({ "model": { "image": 32, "encoder": encoder } }),
        looks: ImageLooks::new().set(&dark()),
        ..new_run("keypoints")
    };
    let state = train(&at("places"), dataset.as_ref(), &places).unwrap();
    assert!(state.validation.iter().all(|(_, value)| value.is_finite()), "{state:?}");
    let run = at("places");
    let world = NewRun {
        changes: json!({ "model": { "image": 32, "encoder": encoder, "hidden": 16 } }),
        encoder: Some(&run),
        looks: ImageLooks::new().set(&dark()),
        ..new_run("keypoint-wm")
    };
    assert_eq!(train(&at("world"), dataset.as_ref(), &world).unwrap().step, 9);
}

//! Published checkpoints as policies, without a run: they act as an imported run does, and what they lack is asked for.

use std::path::{Path, PathBuf};

use swm_checkpoints::export::Export;
use swm_checkpoints::import::Import;
use swm_checkpoints::{MODELS, POLICIES};
use swm_core::{EnvConfig, PolicyArgs, PolicyContext, Registry};
use swm_tasks::request::Request as _;

use super::dot::{DOT, SIDE, TWIN};
use super::{IMAGE, made, made_for, paths, record, trained};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/checkpoints").join(name)
}

const SEARCH: &str = "horizon=2,receding_horizon=1,samples=8,elites=2,iterations=2";

#[test]
fn a_published_checkpoint_plans_as_its_import_does() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    for (family, name) in [("lewm", "lewm_transformers4"), ("pldm", "pldm")] {
        let from = golden(name);
        let request = Import {
            from: from.display().to_string(),
            env: Some(DOT.id.to_owned()),
            action_mean: Some(vec![0.1, -0.2]),
            action_std: Some(vec![0.5, 0.75]),
            out: run.join(name),
            ..Import::default()
        };
        request.run(&Registry::new().with(&[DOT]), &mut ()).unwrap();
        let direct = format!("{family}:{},action_mean=0.1:-0.2,action_std=0.5:0.75,{SEARCH}", from.display());
        let imported = format!("mpc:{},{SEARCH}", run.join(name).display());
        let (one, other) =
            (paths(&direct, 1, Some(IMAGE)).unwrap(), paths(&imported, 2, Some(IMAGE)).unwrap());
        assert!(one.0 == other.0, "{name}");
        // A run of the family is one, too.
        let of_run = format!("{family}:{},{SEARCH}", run.join(name).display());
        assert!(paths(&of_run, 1, Some(IMAGE)).unwrap().0 == one.0, "{name}");
        let entry = POLICIES.iter().find(|entry| entry.name == family).unwrap();
        let args = PolicyArgs::parse(&direct).unwrap();
        assert_eq!(entry.image_size(&args), Some(IMAGE));
        let files = entry.model_files(&args).unwrap();
        assert!(files.len() == 2 && files.iter().all(|file| file.starts_with(&from)), "{files:?}");
        let (registry, config) = (Registry::new().with(&[DOT]), EnvConfig::default());
        // On a dataset, it takes what no file says from there, once; a run has it.
        let data = folder.path().join("data.h5");
        let bare = PolicyArgs::parse(&format!("{family}:{},{SEARCH}", from.display())).unwrap();
        let with = entry.args_on_dataset(&bare, &data).unwrap();
        assert_eq!(with.named["dataset"], data.display().to_string());
        let of_run = PolicyArgs::parse(&of_run).unwrap();
        for said in [&with, &args, &of_run] {
            assert_eq!(entry.args_on_dataset(said, &data), None);
        }
        let oracle = entry.oracle_args(&PolicyContext::new(&DOT, &config).within(&registry), &args).unwrap();
        assert_eq!(oracle.named["action_block"], 2);
    }
}

#[test]
fn what_a_checkpoint_lacks_is_asked_for_by_the_names_of_settings() {
    let from = golden("lewm_transformers4").display().to_string();
    let fails = |settings: &str| made(&format!("lewm:{from}{settings}")).err().unwrap();
    let message = fails("");
    for part in ["how the column `action` was scaled", "dataset=", "stats=", "action_mean=", "action_std="] {
        assert!(message.contains(part), "{message}");
    }
    assert!(!message.contains("--"), "{message}");
    for (settings, part) in [
        (",action_mean=0:0", "action_mean alone scales nothing"),
        (",action_mean=0:x,action_std=1:1", "use numbers with colons"),
        (",action_mean=0:0:0,action_std=1:1:1", "are not 2 finite numbers each"),
        (",action_mean=0:0,action_std=1:1,image=big", "a whole number of pixels"),
        (",action_mean=0:0,action_std=1:1,device=cuda", "are for runs"),
        (",action_mean=0:0,action_std=1:1,sample=3", "did you mean `samples`"),
        (",action_mean=0:0,action_std=1:1,model.depth=3", "`model.depth`: unknown"),
    ] {
        let message = fails(settings);
        assert!(message.contains(part), "{settings}: {message}");
    }
    assert!(made(&format!("mpc:{from}")).err().unwrap().contains("import it first"));
    let agent = made(&format!("tdmpc2:{}", golden("tdmpc2_state").display())).err().unwrap();
    assert!(agent.contains("a checkpoint of others") && agent.contains("import it first"), "{agent}");
    let other = made(&format!("pldm:{from},action_mean=0:0,action_std=1:1")).err().unwrap();
    assert!(other.contains("which is lewm; give lewm:FOLDER"), "{other}");
    assert!(made("lewm:no/such/folder").err().unwrap().contains("there is no such folder"));

    // A run contains all of it, and is of one family.
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "run");
    let run = folder.path().join("run").display().to_string();
    assert!(made(&format!("lewm:{run}")).is_ok());
    assert!(
        made(&format!("pldm:{run}")).err().unwrap().contains("it trained lewm, not pldm; use `lewm:RUN`")
    );
    let message = made(&format!("lewm:{run},action_mean=0:0")).err().unwrap();
    assert!(message.contains("setting `action_mean`") && message.contains("leave it out"), "{message}");
}

#[test]
fn an_export_needs_nothing_and_knows_its_environment() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let from = golden("lewm_transformers4").display().to_string();
    let request = Import {
        from,
        env: Some(DOT.id.to_owned()),
        action_mean: Some(vec![0.0; 2]),
        action_std: Some(vec![1.0; 2]),
        out: at("run"),
        ..Import::default()
    };
    request.run(&Registry::new().with(&[DOT]), &mut ()).unwrap();
    let export = Export { run: at("run"), out: at("published"), ..Export::default() };
    export.run(&Registry::new(), &mut ()).unwrap();
    let published = at("published").display().to_string();
    assert!(paths(&format!("lewm:{published},{SEARCH}"), 1, Some(IMAGE)).is_ok());
    let message = made_for(&TWIN, &format!("lewm:{published}")).err().unwrap();
    assert!(message.contains("it was trained in swm/Dot-v0, and this is swm/Dot-v1"), "{message}");
    assert!(made_for(&TWIN, &format!("lewm:{published},transfer=true")).is_ok());
    let args = PolicyArgs::parse(&format!("lewm:{published}")).unwrap();
    let entry = POLICIES.iter().find(|entry| entry.name == "lewm").unwrap();
    assert_eq!(entry.trained_in(&args).map(|trained| trained.env), Some(DOT.id.to_owned()));
    assert_eq!(entry.model_files(&args).unwrap().len(), 3);

    // Its quality is measured as that of a run.
    let (registry, config) = (Registry::new().with(&[DOT]), EnvConfig::default());
    let model = MODELS.iter().find(|entry| entry.name == "lewm").unwrap();
    let context = PolicyContext::new(&DOT, &config).within(&registry);
    let measured = model.make(&context, &args).unwrap();
    assert_eq!((measured.stride(), SIDE), (2, 16));
}

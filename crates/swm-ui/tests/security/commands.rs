//! What the page writes and reads for others: manifests are written into the named folder, jobs are read below the given paths.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use swm_core::error::BoxError;
use swm_core::testing::TOY;
use swm_core::{Registry, Rollout, World, WorldOptions, policies};
use swm_data::WriteMode;
use swm_ui::Options;

use crate::server::{Running, registry};
use crate::status;

/// The command line, as far as these tests need it.
#[derive(Debug)]
struct Commands;

impl swm_ui::Commands for Commands {
    fn job(&self, _: &Registry, dir: &Path) -> Result<serde_json::Value, BoxError> {
        Ok(fs::read_to_string(dir.join("logs/0001.log"))?.into())
    }
}

/// A dataset of the toy environment.
fn record(path: &Path) {
    let mut world = World::new(&TOY, WorldOptions::new(1).max_episode_steps(5)).unwrap();
    world.set_policy(policies::random()).unwrap();
    let mut writer = swm_data::create(path, WriteMode::Error, None).unwrap();
    world.record_dataset(&Rollout::new(0..2), writer.as_mut()).unwrap();
}

#[test]
fn manifests_are_written_by_this_page_alone_and_into_the_named_folder() {
    let folder = tempfile::tempdir().unwrap();
    let (shown, save) = (folder.path().join("shown"), folder.path().join("save"));
    fs::create_dir(&shown).unwrap();
    record(&shown.join("a.h5"));
    record(&folder.path().join("hidden.h5"));
    let options = |save: Option<&Path>| {
        let mut options = Options::new(registry());
        options.paths = vec![shown.clone()];
        options.save = save.map(Path::to_owned);
        options.commands = Some(Arc::new(Commands));
        options
    };
    let body = |id: &str, file: &str| {
        format!(r#"{{"id": "{id}", "pairs": ["0:0-3"], "tier": "historic", "budget": 5, "file": "{file}"}}"#)
    };
    let good = body("0/a.h5", "pairs.toml");
    let (server, cookie) = Running::entered(options(Some(&save)));
    let own = format!("Origin: http://{}", server.host());
    let send = |headers: &[String], body: &str| server.request("POST", "/api/manifest", headers, body);
    let origin = |origin: &str| status(&send(&[format!("Origin: {origin}"), cookie.clone()], &good));
    assert_eq!([origin("http://evil.example"), origin("null")], [403, 403]);
    assert_eq!(status(&send(std::slice::from_ref(&cookie), &good)), 403, "no origin");
    assert_eq!(status(&send(std::slice::from_ref(&own), &good)), 401, "no session");
    let foreign = ["Host: evil.example".to_owned(), own.clone(), cookie.clone()];
    assert_eq!(status(&send(&foreign, &good)), 403, "another host");
    let both = [own, cookie];
    assert_eq!(status(&server.ask("/api/manifest", &both)), 405, "a link writes nothing");
    for id in ["0/../hidden.h5", "0/none.h5", "7", "/etc/passwd"] {
        assert!(matches!(status(&send(&both, &body(id, "pairs.toml"))), 400 | 403), "{id}");
    }
    for file in ["../a.toml", "/tmp/a.toml", "b/a.toml", ".a.toml", "", "a\\b.toml"] {
        assert!(send(&both, &body("0/a.h5", file)).contains("is no file name"), "{file}");
    }
    assert!(send(&both, &body("0/a.h5", "a.h5")).contains("end it in .json or .toml"));
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(folder.path().join("outside.toml"), save.join("link.toml")).unwrap();
        assert!(send(&both, &body("0/a.h5", "link.toml")).contains("is a link"));
        fs::remove_file(save.join("link.toml")).unwrap();
    }
    assert_eq!(status(&send(&both, &good.replace("0:0-3", "--overwrite"))), 400);
    assert_eq!(status(&send(&both, &" ".repeat((256 << 10) + 1))), 413);
    assert_eq!(fs::read_dir(&save).unwrap().count(), 0, "nothing is written yet");
    assert_eq!(status(&send(&both, &good)), 200);
    let made = swm_tasks::evaluation::read_manifest(&save.join("pairs.toml")).unwrap();
    assert_eq!((made.env.as_str(), made.pairs[0].from, made.budget), (TOY.id, Some([0, 0, 3]), 5));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    drop(server);

    let (server, cookie) = Running::entered(options(None));
    let own = format!("Origin: http://{}", server.host());
    assert!(server.request("POST", "/api/manifest", &[own, cookie], &good).contains("`save`"));
}

#[test]
fn jobs_are_read_below_the_given_paths_and_without_links() {
    let folder = tempfile::tempdir().unwrap();
    let (shown, hidden) = (folder.path().join("shown"), folder.path().join("hidden"));
    for job in [&shown, &hidden].map(|folder| folder.join("job")) {
        fs::create_dir_all(job.join("logs")).unwrap();
        fs::write(job.join("job.json"), "{}").unwrap();
        fs::write(job.join("logs/0001.log"), "episodes").unwrap();
    }
    let mut options = Options::new(registry());
    options.paths = vec![shown.clone()];
    options.commands = Some(Arc::new(Commands));
    let (server, cookie) = Running::entered(options);
    let ask = |id: &str| server.ask(&format!("/api/job?id={id}"), std::slice::from_ref(&cookie));
    assert!(ask("0/job").ends_with("\r\n\r\n\"episodes\""));
    assert!(server.ask("/api/files", std::slice::from_ref(&cookie)).contains(r#""kind":"job""#));
    for id in ["0/../hidden/job", "1", "0//etc"] {
        assert_eq!(status(&ask(id)), 403, "{id}");
    }
    assert_eq!(status(&server.ask("/api/job?id=0/job", &[])), 401);
    #[cfg(unix)]
    {
        fs::remove_file(shown.join("job/logs/0001.log")).unwrap();
        std::os::unix::fs::symlink(hidden.join("job/logs/0001.log"), shown.join("job/logs/0001.log"))
            .unwrap();
        let answer = ask("0/job");
        assert!(status(&answer) == 403 && answer.contains("is a link"), "{answer}");
        std::os::unix::fs::symlink(hidden.join("job"), shown.join("other")).unwrap();
        assert_eq!(status(&ask("0/other")), 403);
    }
}

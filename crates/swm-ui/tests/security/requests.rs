//! Requests that the page begins: what they may read and write, and how they end.

use std::fs;
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};
use swm_core::testing::TOY;
use swm_ui::Options;

use crate::server::{Running, registry};
use crate::status;

struct Page {
    server: Running,
    headers: [String; 2],
    folder: tempfile::TempDir,
}

impl Page {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("shown")).unwrap();
        let mut options = Options::new(registry());
        options.paths = vec![folder.path().join("shown")];
        options.save = Some(folder.path().join("save"));
        let (server, cookie) = Running::entered(options);
        let own = format!("Origin: http://{}", server.host());
        Self { server, headers: [own, cookie], folder }
    }

    fn post(&self, path: &str, body: &Json) -> (u16, Json) {
        let answer = self.server.request("POST", path, &self.headers, &body.to_string());
        let (_, content) = answer.split_once("\r\n\r\n").unwrap();
        (status(&answer), serde_json::from_str(content).unwrap())
    }

    fn all(&self) -> Vec<Json> {
        let answer = self.server.ask("/api/requests", &self.headers);
        let found: Json = serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap();
        found["requests"].as_array().unwrap().clone()
    }

    fn until(&self, what: impl Fn(&[Json]) -> bool) -> Vec<Json> {
        let begin = Instant::now();
        loop {
            let all = self.all();
            if what(&all) {
                return all;
            }
            assert!(begin.elapsed() < Duration::from_secs(30), "{all:?}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

fn toy(episodes: u64) -> Json {
    json!({ "record": { "env": TOY.id, "image_size": null, "episodes": episodes } })
}

#[test]
fn requests_read_below_the_paths_and_write_into_the_named_folder_alone() {
    let page = Page::new();
    let outside = page.folder.path().join("outside.toml");
    fs::write(&outside, "samples = 3").unwrap();
    let outside = outside.display().to_string();
    let beneath = page.folder.path().join("shown/../outside.toml").display().to_string();
    let asked = |request: Json, name: &str| json!({ "request": request, "name": name });
    let env = TOY.id;
    for (wrong, code, reason) in [
        (asked(toy(1), "../a.h5"), 400, "is no file name"),
        (asked(toy(1), "a/b.h5"), 400, "is no file name"),
        (asked(json!({ "record": { "env": env, "out": "a.h5" } }), "a.h5"), 400, "out: the page gives it"),
        (
            asked(json!({ "record": { "env": env, "mode": "append" } }), "a.h5"),
            400,
            "mode: the page gives it",
        ),
        (
            asked(json!({ "record": { "env": env, "policy": format!("random:@{outside}") } }), "a.h5"),
            403,
            "outside",
        ),
        (
            asked(json!({ "record": { "env": env, "policy": format!("mpc:{outside}") } }), "a.h5"),
            403,
            "outside",
        ),
        (asked(json!({ "evaluate": { "manifest": outside, "policy": "random" } }), "a"), 403, "outside"),
        (asked(json!({ "evaluate": { "manifest": beneath, "policy": "random" } }), "a"), 403, "outside"),
        (asked(json!({ "sweep": { "manifest": "/etc/hostname", "policy": "random" } }), "a"), 403, "outside"),
        (
            asked(
                json!({ "evaluate": { "reference": [format!("mpc:{outside}")], "policy": "random" } }),
                "a",
            ),
            403,
            "outside",
        ),
        (asked(json!({ "train": { "baseline": "lewm", "dataset": outside } }), "a"), 403, "outside"),
        (
            asked(json!({ "train": { "baseline": "lewm", "resume": "a" } }), "a"),
            400,
            "resume: the page gives it",
        ),
        (asked(json!({ "record": { "env": env, "epsodes": 3 } }), "a.h5"), 422, "did you mean `episodes`?"),
        (asked(json!({ "verify": { "source": "a" } }), "a"), 422, "no request that can be divided"),
        (asked(json!({}), "a"), 422, "one request by its name"),
        (json!({ "request": toy(1) }), 400, "missing field `name`"),
    ] {
        for path in ["/api/requests", "/api/requests/check"] {
            let (found, answer) = page.post(path, &wrong);
            let message = answer["error"].as_str().unwrap_or_default();
            assert!(found == code && message.contains(reason), "{wrong}: {found} {answer}");
        }
    }
    assert!(page.all().is_empty() && fs::read_dir(page.folder.path().join("save")).unwrap().next().is_none());
    let good = asked(toy(2), "a.h5").to_string();
    let cookie = std::slice::from_ref(&page.headers[1]);
    assert_eq!(status(&page.server.request("POST", "/api/requests", cookie, &good)), 403, "no origin");
    let (found, checked) = page.post("/api/requests/check", &asked(toy(2), "a.h5"));
    assert!(found == 200 && checked["number"].is_null() && page.all().is_empty(), "{checked}");
    let out = page.folder.path().join("save/a.h5").canonicalize().unwrap_err();
    assert_eq!(out.kind(), std::io::ErrorKind::NotFound, "a check writes nothing");
}

#[test]
fn a_request_reports_and_ends_and_its_result_is_not_overwritten() {
    let page = Page::new();
    let asked = json!({ "request": toy(3), "name": "a.h5" });
    let (code, begun) = page.post("/api/requests", &asked);
    assert_eq!((code, &begun["number"]), (200, &json!(1)));
    let done = page.until(|all| all[0]["state"] == "done");
    assert_eq!(
        (&done[0]["done"], &done[0]["total"], &done[0]["name"]),
        (&json!(3), &json!(3), &json!("a.h5"))
    );
    let bytes = fs::read(page.folder.path().join("save/a.h5")).unwrap();
    let (code, answer) = page.post("/api/requests", &asked);
    assert!(code == 422 && answer["error"].as_str().unwrap().contains("exists"), "{code} {answer}");
    assert_eq!(page.all().len(), 1);
    assert_eq!(fs::read(page.folder.path().join("save/a.h5")).unwrap(), bytes);
}

#[test]
fn few_requests_run_at_once_and_a_stopped_one_keeps_what_it_wrote() {
    let page = Page::new();
    let long = |name: &str| json!({ "request": toy(10_000_000), "name": name });
    assert_eq!(page.post("/api/requests", &long("a.h5")).0, 200);
    let (code, answer) = page.post("/api/requests", &long("a.h5"));
    assert!(code == 409 && answer["error"].as_str().unwrap().contains("is being made"), "{answer}");
    assert_eq!(page.post("/api/requests/check", &long("a.h5")).0, 409);
    assert_eq!(page.post("/api/requests", &long("b.h5")).0, 200);
    let (code, answer) = page.post("/api/requests", &long("c.h5"));
    assert!(code == 409 && answer["error"].as_str().unwrap().contains("2 requests run already"), "{answer}");
    page.until(|all| all.iter().all(|one| one["done"].as_u64() > Some(2)));
    assert_eq!(page.post("/api/requests/stop", &json!({ "number": 9 })).0, 400);
    assert_eq!(page.post("/api/requests/stop", &json!({ "number": 1 })).0, 200);
    let all = page.until(|all| all[1]["state"] == "stopped");
    assert_eq!(all[0]["state"], "running");
    let kept = swm_data::open(&page.folder.path().join("save/a.h5")).unwrap();
    assert!(kept.num_episodes() > 2);
    // The end of the server stops the other one.
    let Page { server, folder, .. } = page;
    drop(server);
    assert!(swm_data::open(&folder.path().join("save/b.h5")).unwrap().num_episodes() > 2);
}

//! Live environments as the page drives them: frames at the page's pace, pairs, videos, and what a planner's model predicts.

#![expect(clippy::unwrap_used, reason = "what a helper cannot do ends its test")]

#[path = "security/server.rs"]
mod server;

use std::io::Write as _;
use std::net::TcpStream;
use std::time::Duration;

use serde_json::{Value as Json, json};
use swm_core::PolicyEntry;
use swm_solvers::models::{Dynamics, GoalMse, Part, Reduction, ShootingCost, Steps};
use swm_solvers::{Candidates, LearnedCost, PlanError, PlanningContext, plan_on};
use swm_ui::Options;

use server::{Running, message, receive, registry};

/// A model of the toy whose point goes half as far as in truth.
static POLICIES: [PolicyEntry; 1] =
    [PolicyEntry::new("half-model", "plans on a wrong model", |context, args| {
        let objective = GoalMse::new(&["state"], Steps::Last, Reduction::Mean);
        let cost = ShootingCost::new(Half::default(), Box::new(objective), Vec::new())
            .map_err(|error| args.wrong(error.to_string()))?;
        let learned = LearnedCost::new(Box::new(cost), 1);
        Ok(Box::new(
            plan_on(context, learned, args.named.clone()).map_err(|error| args.wrong(error.to_string()))?,
        ))
    })];

const GAIN: f64 = 0.5;

struct Half {
    parts: [Part; 1],
    starts: Vec<f64>,
    goals: Vec<[f32; 1]>,
}

impl Default for Half {
    fn default() -> Self {
        let parts = [Part { name: "state".to_owned(), range: 0..1 }];
        Self { parts, starts: Vec::new(), goals: Vec::new() }
    }
}

impl Dynamics for Half {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        let rows = (0..context.len()).map(|index| context.env(index).row);
        let value = |row: &swm_core::Row<'_>, name: &str| row.get::<f64>(name).unwrap()[0];
        (self.starts, self.goals) =
            rows.map(|row| (value(&row, "state"), [value(&row, "goal_state") as f32])).unzip();
        Ok(())
    }

    fn parts(&self) -> &[Part] {
        &self.parts
    }

    fn goal(&self, episode: usize) -> &[f32] {
        &self.goals[episode]
    }

    fn roll_out(&mut self, candidates: &Candidates<'_>, states: &mut [f32]) -> Result<(), PlanError> {
        let paths = states.chunks_exact_mut(candidates.horizon);
        for (index, (plan, path)) in candidates.plans().zip(paths).enumerate() {
            let mut state = self.starts[index / candidates.samples];
            for (action, out) in plan.iter().zip(path) {
                state += GAIN * f64::from(*action);
                *out = state as f32;
            }
        }
        Ok(())
    }
}

/// A live environment.
struct Live(TcpStream);

impl Live {
    fn open(server: &Running, cookie: &str, with: &Json) -> Self {
        let mut live = Self(server.connect(cookie));
        let mut open = json!({ "type": "open", "env": "swm/Toy-v0", "image": 32, "max_steps": 40 });
        open.as_object_mut().unwrap().extend(with.as_object().unwrap().clone());
        live.send(&open);
        live
    }

    fn send(&mut self, command: &Json) {
        self.0.write_all(&message(command.to_string().as_bytes())).unwrap();
    }

    /// The next message: a text, or the head of a binary one with its content.
    fn next(&mut self) -> (Json, Vec<u8>) {
        match receive(&mut self.0).expect("the connection is open") {
            (1, text) => (serde_json::from_slice(&text).unwrap(), Vec::new()),
            (2, bytes) => {
                let size = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
                (serde_json::from_slice(&bytes[4..4 + size]).unwrap(), bytes[4 + size..].to_vec())
            }
            (kind, _) => panic!("a message of kind {kind}"),
        }
    }

    /// The first message that is so; an error ends the test.
    fn until(&mut self, fits: impl Fn(&Json) -> bool) -> (Json, Vec<u8>) {
        loop {
            let (head, content) = self.next();
            if fits(&head) {
                return (head, content);
            }
            assert_ne!(head["kind"], "error", "{head}");
        }
    }

    fn frame(&mut self, step: u64) -> Json {
        self.until(|head| head["step"] == step && head.get("playing").is_some()).0
    }
}

fn options() -> Options {
    Options::new(registry().with(&POLICIES).with(swm_solvers::SOLVERS))
}

#[test]
fn what_a_learned_model_predicts_stands_beside_the_true_cost() {
    let (server, cookie) = Running::entered(options());
    let mut live = Live::open(&server, &cookie, &json!({}));
    let mut far = |seed: u64| {
        live.send(&json!({ "type": "reset", "seed": seed }));
        live.until(|head| head["kind"] == "episode" && head["seed"] == seed);
        live.frame(0)["points"][0]["cost"].as_f64().filter(|&distance| distance > 4.0)
    };
    // Plans go 3 far, and the goal is reached within 0.5.
    let distance = (1..).find_map(&mut far).unwrap();
    let policy = "half-model:samples=64,elites=8,iterations=4,horizon=3,receding_horizon=3";
    live.send(&json!({ "type": "policy", "text": policy }));
    live.send(&json!({ "type": "step" }));
    let (plan, _) = live.until(|head| head["kind"] == "plan");
    assert_eq!(plan["costs"].as_array().unwrap().len(), 4);
    let paths = plan["paths"].as_array().unwrap();
    assert!(paths.len() > 30, "{}", paths.len());
    for path in paths {
        let (predicted, found) = (path["cost"].as_f64().unwrap(), path["true_cost"].as_f64().unwrap());
        // The model's error at its end, squared; it went half as far.
        let went = (distance - predicted.sqrt()) / GAIN;
        assert!((found - (distance - went).abs()).abs() < 1e-3, "{predicted} and {found} of {distance}");
    }
    assert_eq!(paths.last().unwrap()["of"], "plan");
    assert_eq!(
        [&plan["cost"], &plan["true_cost"]],
        [&paths.last().unwrap()["cost"], &paths.last().unwrap()["true_cost"]]
    );
    assert!((0.9..=1.0).contains(&plan["agreement"].as_f64().unwrap()), "{}", plan["agreement"]);
}

#[test]
fn an_episode_is_given_as_a_video() {
    let (server, cookie) = Running::entered(options());
    let mut live = Live::open(&server, &cookie, &json!({}));
    live.frame(0);
    live.send(&json!({ "type": "video" }));
    assert!(live.next().0["text"].as_str().unwrap().contains("no step yet"));
    live.send(&json!({ "type": "action", "values": [0.5] }));
    for step in 1..=3 {
        live.send(&json!({ "type": "step" }));
        live.frame(step);
    }
    live.send(&json!({ "type": "video" }));
    let (head, content) = live.until(|head| head.get("video").is_some());
    let is_whole = match head["video"].as_str().unwrap() {
        "gif" => content.starts_with(b"GIF8"),
        _ => content[4..8] == *b"ftyp",
    };
    assert!(is_whole, "{head}");
    // The episode goes on where it was.
    live.send(&json!({ "type": "step" }));
    live.frame(4);
}

#[test]
fn a_page_that_shows_nothing_is_sent_no_more_frames() {
    let (server, cookie) = Running::entered(options());
    let mut live = Live::open(&server, &cookie, &json!({ "seed": 2, "max_steps": null }));
    live.frame(0);
    live.send(&json!({ "type": "rate", "hz": 60 }));
    live.send(&json!({ "type": "play", "on": true }));
    std::thread::sleep(Duration::from_millis(600));
    live.send(&json!({ "type": "watch", "columns": [] }));
    let mut unseen = 1;
    while live.next().0["kind"] != "plotted" {
        unseen += 1;
    }
    assert_eq!(unseen, 1, "frames that were sent");
    // The page has shown it: the latest one is sent, which is many steps later.
    live.send(&json!({ "type": "shown" }));
    let (later, _) = live.until(|head| head.get("playing").is_some());
    assert!(later["step"].as_u64().unwrap() > 20, "{later}");
}

#[test]
fn a_pair_is_played_by_whom_the_page_names() {
    let folder = tempfile::tempdir().unwrap();
    let pair = json!({ "seed": 7, "start": { "state": [1.0] }, "goal": { "state": [5.0] }, "witness": "" });
    let manifest = json!({
        "version": 1, "env": "swm/Toy-v0", "tier": "historic", "budget": 3, "frame_skip": 1, "seed": 1,
        "success": { "hold": 1, "all": [] }, "source": { "kind": "online" }, "excluded": {}, "solved_at_start": 0, "pairs": [pair],
    });
    let policy =
        |name: &str, value: f64| json!({ "policy": { "name": name, "positional": [value] }, "seed": 0 });
    let summary = json!({
        "episodes": 0, "successes": 0, "success_rate": 0.0, "ci95": [0.0, 100.0], "solved_at_start": 0, "mean_success_steps": null,
    });
    let test = json!({
        "pairs": 0, "both": 0, "only_first": 0, "only_second": 0, "difference": 0.0, "interval95": [0.0, 0.0], "p_value": 1.0,
    });
    let receipt = json!({
        "receipt": 2, "manifest_hash": "", "policy": "constant:1", "episodes": [], "summary": summary, "plan_steps": 1,
        "fingerprints": { "tables": "", "physics": "", "noise": "" }, "code": { "version": "", "target": "" },
        "manifest": manifest, "candidate": policy("constant", 1.0), "wall_time_s": 0.0, "references": [{
            "role": "no_op", "candidate": policy("constant", 0.0), "summary": summary, "test": test, "episodes": [],
        }],
    });
    std::fs::write(folder.path().join("receipt.json"), receipt.to_string()).unwrap();
    let mut options = options();
    options.paths = vec![folder.path().to_owned()];
    let (server, cookie) = Running::entered(options);
    let run = |run: Json| {
        let mut live = Live::open(
            &server,
            &cookie,
            &json!({ "pair": { "id": "0/receipt.json", "index": 0, "run": run } }),
        );
        live.frame(0);
        for step in 1..=3 {
            live.send(&json!({ "type": "step" }));
            live.frame(step)["points"][0]["cost"].as_f64().unwrap();
        }
        live.send(&json!({ "type": "rewind", "step": 3 }));
        live.frame(3)
    };
    let costs = |head: &Json| head["over"].as_str().map(str::to_owned);
    let (policy, reference) = (run("policy".into()), run(json!({ "reference": 0 })));
    assert_eq!((costs(&policy), costs(&reference)), (Some("truncated".into()), Some("truncated".into())));
    let reward = |head: &Json| head["total_reward"].as_f64().unwrap();
    assert_eq!((reward(&policy), reward(&reference)), (-3.0 - 2.0 - 1.0, -4.0 * 3.0));
    // The oracle of a policy that does not plan is `cem`, which this registry has not.
    let mut live = Live::open(
        &server,
        &cookie,
        &json!({ "pair": { "id": "0/receipt.json", "index": 0, "run": "oracle" } }),
    );
    let message = live.next().0;
    assert!(message["text"].as_str().unwrap().contains("unknown policy `cem`"), "{message}");
}

//! The page of `swm ui` from outside: what it does is what other commands do. What it refuses is tested in `swm-ui`.

#![expect(clippy::unwrap_used, reason = "what a helper cannot do ends its test")]

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};

use crate::evaluation::{QUICK, read};
use crate::support::{Folder, PUSHT, swm, swm_json, swm_ok};

/// A running server and its session.
pub(crate) struct Page {
    child: Child,
    host: String,
    cookie: String,
}

impl Page {
    pub(crate) fn open(paths: &[&str], save: &str) -> Self {
        Self::of(swm(&[&["ui", "--no-open", "--save", save], paths].concat()))
    }

    /// The page of this command `swm ui`.
    fn of(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let (host, token) = line.trim().split_once("http://").unwrap().1.split_once("/?").unwrap();
        let mut page = Self { child, host: host.to_owned(), cookie: String::new() };
        let answer = page.request(&format!("GET /?{token}"), "");
        let cookie = answer.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
        page.cookie = cookie.split(';').next().unwrap().to_owned();
        page
    }

    fn request(&self, what: &str, body: &str) -> String {
        let Self { host, cookie, .. } = self;
        let mut stream = TcpStream::connect(host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        write!(
            stream,
            "{what} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nCookie: {cookie}\r\nConnection: close\r\nContent-Length: {}\r\n\r\n{body}",
            body.len()
        )
        .unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    #[track_caller]
    pub(crate) fn json(&self, what: &str, body: &str) -> Json {
        let answer = self.request(what, body);
        serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap_or_else(|_| panic!("{answer}"))
    }

    /// Runs a request whose result has this name; how it was at its end.
    pub(crate) fn run(&self, request: &Json, name: &str) -> Json {
        let asked = json!({ "request": request, "name": name }).to_string();
        let begun = self.json("POST /api/requests", &asked);
        let begin = Instant::now();
        loop {
            let found = self.json("GET /api/requests", "");
            let all = found["requests"].as_array().unwrap();
            let one = all.iter().find(|one| one["number"] == begun["number"]);
            let one = one.unwrap_or_else(|| panic!("{begun}: {request}"));
            if one["state"] != "running" {
                assert_eq!(one["state"], "done", "{one}");
                return one.clone();
            }
            assert!(begin.elapsed() < Duration::from_secs(120), "{one}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// The id of the file of this kind.
    pub(crate) fn id(&self, kind: &str) -> String {
        let files = self.json("GET /api/files", "");
        let file = files["files"].as_array().unwrap().iter().find(|file| file["kind"] == kind);
        file.unwrap_or_else(|| panic!("no {kind}: {files}"))["id"].as_str().unwrap().to_owned()
    }

    /// Opens a live environment; the messages that are texts, until one is of this kind.
    fn live(&self, open: &Json, kind: &str) -> Json {
        let Self { host, cookie, .. } = self;
        let mut stream = TcpStream::connect(host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        write!(
            stream,
            "GET /api/play HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nCookie: {cookie}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        .unwrap();
        let mut byte = [0];
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            stream.read_exact(&mut byte).unwrap();
            head.push(byte[0]);
        }
        let text = open.to_string();
        let mut message = vec![0x81, 0x80 | 126];
        message.extend((text.len() as u16).to_be_bytes());
        message.extend([0; 4]);
        message.extend(text.as_bytes());
        stream.write_all(&message).unwrap();
        loop {
            let mut head = [0; 2];
            stream.read_exact(&mut head).unwrap();
            let mut len = [0; 8];
            let len = match head[1] {
                126 => {
                    stream.read_exact(&mut len[6..]).unwrap();
                    u64::from_be_bytes(len)
                }
                127 => {
                    stream.read_exact(&mut len).unwrap();
                    u64::from_be_bytes(len)
                }
                len => u64::from(len),
            };
            let mut content = vec![0; len as usize];
            stream.read_exact(&mut content).unwrap();
            if head[0] == 0x81 {
                let message: Json = serde_json::from_slice(&content).unwrap();
                if message["kind"] == kind || message["kind"] == "error" {
                    return message;
                }
            }
        }
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(unix)]
#[test]
fn the_owner_is_answered_where_strangers_take_all_files() {
    let folder = Folder::new();
    let page = swm(&["ui", "--no-open", "--save", &folder.path("save"), &folder.path("")]);
    let mut limited = Command::new("sh");
    limited.args(["-c", r#"ulimit -n 64 && exec "$0" "$@""#]).arg(page.get_program()).args(page.get_args());
    let page = Page::of(limited);
    let strangers: Vec<TcpStream> = (0..80).map(|_| TcpStream::connect(&page.host).unwrap()).collect();
    let asked = Instant::now();
    assert!(page.json("GET /api/about", "").is_object());
    let took = asked.elapsed();
    assert!(took < Duration::from_secs(1), "{took:?}");
    drop(strangers);
}

#[test]
fn picked_pairs_become_the_manifest_of_the_command() {
    let folder = Folder::new();
    let (data, save) = (folder.path("a.h5"), folder.path("save"));
    let collect = ["collect", PUSHT, "--policy", "weak", "--episodes", "3", "--max-steps", "30", "--quiet"];
    swm_ok(&[&collect[..], &["--image-size", "none", "--seed", "3", "--out", &data]].concat());
    let page = Page::open(&[&data], &save);
    let id = page.id("dataset");
    let ask = |pairs: &[&str], tier: &str, file: &str| {
        let body = json!({ "id": id, "pairs": pairs, "tier": tier, "budget": 20, "file": file });
        page.json("POST /api/manifest", &body.to_string())
    };
    let made = ask(&["0:3-20", "1:0-2:9"], "historic", "pairs.toml");
    assert_eq!((&made["pairs"], &made["hash"].as_str().map(str::len)), (&2.into(), &Some(64)), "{made}");
    // The command that the page names makes the same.
    let out = folder.path("again.toml");
    let mut words: Vec<&str> =
        made["words"].as_array().unwrap().iter().map(|word| word.as_str().unwrap()).collect();
    *words.last_mut().unwrap() = &out;
    swm_ok(&[&["manifest", "make"], &words[..]].concat());
    let bytes = |path: &str| std::fs::read(path).unwrap();
    assert_eq!(bytes(&format!("{save}/pairs.toml")), bytes(&out));
    // It is listed, and refused what the command refuses.
    assert_eq!(page.id("manifest"), made["id"].as_str().unwrap());
    for (pairs, tier, file, word) in [
        (&["0:1-1"][..], "moderate", "b.toml", "is a success at its start"),
        (&["0:1-9999"], "historic", "b.toml", "step 9999"),
        (&["9:0-1"], "historic", "b.toml", "names episode 9"),
        (&["0:1"], "historic", "b.toml", "EPISODE:START-GOAL"),
        (&[], "historic", "b.toml", "EPISODE:START-GOAL"),
        (&["0:1-5"], "historic", "pairs.toml", "holds another manifest"),
        (&["0:1-5"], "historic", "b.h5", "end it in .json or .toml"),
        (&["0:1-5"], "lenient", "b.toml", "lenient"),
    ] {
        let answer = ask(pairs, tier, file);
        assert!(answer["error"].as_str().is_some_and(|text| text.contains(word)), "{word}: {answer}");
    }
    let entries: Vec<_> = std::fs::read_dir(&save).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(entries, ["pairs.toml"]);
}

/// A text in the query of a request.
fn encoded(text: &str) -> String {
    text.bytes().map(|byte| format!("%{byte:02X}")).collect()
}

#[test]
fn datasets_of_other_programs_are_opened_with_options() {
    let folder = Folder::new();
    let field = crate::support::root().join("tests/golden/field");
    let [can, noise] =
        ["robomimic_can.hdf5", "dinowm_pusht_noise"].map(|name| field.join(name).display().to_string());
    let page = Page::open(&[&can, &noise], &folder.path("save"));
    let files = page.json("GET /api/files", "");
    let ids: Vec<&str> =
        files["files"].as_array().unwrap().iter().map(|file| file["id"].as_str().unwrap()).collect();
    // By name.
    let [noise, can] = [ids[0], ids[1]];
    let ask = |what: &str, id: &str, opening: &Json| {
        let opening = encoded(&opening.to_string());
        page.json(&format!("GET /api/{what}id={}&opening={opening}", encoded(id)), "")
    };
    let wrist = json!({ "camera": "robot0_eye_in_hand", "map": { "proprio": "obs.robot0_eef_pos" }, "image_size": { "height": 10, "width": 10 } });
    let about = ask("data?", can, &wrist);
    let pixels = json!(["pixels", "obs/robot0_eye_in_hand_image"]);
    assert!(about["mapping"].as_array().is_some_and(|mapping| mapping.contains(&pixels)), "{about}");
    assert_eq!(about["opening"], wrist);
    let columns = about["columns"].as_array().unwrap();
    let shape =
        |name: &str| columns.iter().find(|column| column["name"] == name).map(|column| &column["shape"]);
    assert_eq!((shape("pixels"), shape("proprio")), (Some(&json!([10, 10, 3])), Some(&json!([3]))));
    let plain = page.json(&format!("GET /api/data?id={}", encoded(can)), "");
    assert_ne!(plain["mapping"], about["mapping"], "the same file, opened in another way");
    let values = ask("data/values?episode=0&", can, &wrist);
    assert!(values["columns"]["proprio"].is_array(), "{values}");
    for (opening, word) in [
        (json!({ "camera": "left" }), "no camera is called `left`"),
        (json!({ "lens": 3 }), "lens"),
        (json!({ "fit": "crop" }), "no image is resized"),
        (json!({ "storage": "/" }), "the page decodes nothing into a folder"),
    ] {
        let refused = ask("data?", can, &opening);
        assert!(refused["error"].as_str().is_some_and(|text| text.contains(word)), "{word}: {refused}");
    }
    // A manifest of a part, and the command that makes the same.
    let body = json!({
        "id": noise, "opening": "{\"split\": \"train\"}", "pairs": ["0:0-3"], "tier": "historic", "budget": 5, "file": "part.toml",
    });
    let made = page.json("POST /api/manifest", &body.to_string());
    let words: Vec<&str> = made["words"]
        .as_array()
        .unwrap_or_else(|| panic!("{made}"))
        .iter()
        .map(|word| word.as_str().unwrap())
        .collect();
    assert!(words.windows(2).any(|pair| pair == ["--split", "train"]), "{words:?}");
}

#[test]
fn jobs_are_shown_as_the_command_shows_them() {
    let folder = Folder::new();
    let job = folder.path("job");
    let collect =
        ["collect", "swm/TwoRoom-v2", "--policy", "expert", "--max-steps", "6", "--image-size", "none"];
    let submit = ["submit", "--job", &job, "--shards", "3", "--no-copy", "--on", "script", "--"];
    swm_ok(&[&submit[..], &collect, &["--episodes", "7", "--seed", "3"]].concat());
    swm_ok(&["task", &job, "--index", "2"]);
    let page = Page::open(&[&folder.path("")], &folder.path("save"));
    let id = page.id("job");
    let show = || {
        let mut shown = page.json(&format!("GET /api/job?id={id}"), "");
        assert_eq!(shown.as_object_mut().unwrap().shift_remove("note"), Some(Json::Null));
        shown
    };
    let first = show();
    assert_eq!(first, swm_json(&["jobs", &job]));
    let state = |shown: &Json, shard: usize| shown["each"][shard - 1]["state"].as_str().unwrap().to_owned();
    assert_eq!([1, 2, 3].map(|shard| state(&first, shard)), ["not started", "done", "not started"]);
    assert_eq!([&first["each"][0]["of"], &first["each"][1]["episodes"]], [&Json::from(2), &2.into()]);
    swm_ok(&["task", &job, "--index", "1"]);
    let next = show();
    assert_eq!((state(&next, 1), &next["episodes"]), ("done".to_owned(), &4.into()));
    // What is done is within the job, to be looked at.
    let files = page.json("GET /api/files", "");
    let kinds =
        |kind: &str| files["files"].as_array().unwrap().iter().filter(|file| file["kind"] == kind).count();
    assert!(kinds("job") == 1 && kinds("dataset") >= 1, "{files}");
}

#[test]
fn a_pair_is_replayed_by_every_policy_of_its_receipt_and_by_the_oracle() {
    let folder = Folder::new();
    let (task, out) = (folder.path("task.toml"), folder.path("result"));
    swm_ok(&[
        "manifest",
        "make",
        PUSHT,
        "--tier",
        "moderate",
        "--episodes",
        "2",
        "--budget",
        "5",
        "--out",
        &task,
    ]);
    let eval = ["eval", "--manifest", &task, "--policy", "expert", "--reference", "random", "--out", &out];
    swm_ok(&[&eval[..], &["--oracle", QUICK, "--quiet"]].concat());
    let receipt = read(&format!("{out}/receipt.json"));
    assert_eq!(receipt["references"].as_array().unwrap().len(), 1);
    let page = Page::open(&[&folder.path("")], &folder.path("save"));
    let open = |id: String, run: Json| {
        let pair = json!({ "id": id, "index": 1, "run": run });
        page.live(
            &json!({ "type": "open", "env": PUSHT, "image": 64, "max_steps": null, "pair": pair }),
            "opened",
        )
    };
    let acts = |run: Json| open(page.id("receipt"), run)["policy"].as_str().unwrap().to_owned();
    assert!(acts("policy".into()).starts_with("expert"));
    assert_eq!(acts(json!({ "reference": 0 })), "random");
    // Success is judged by the manifest: the oracle looks past the environment's own.
    let oracle = acts("oracle".into());
    assert!(oracle.contains("stop_at_success=false"), "{oracle}");
    assert!(open(page.id("manifest"), "oracle".into())["policy"].as_str().unwrap().starts_with("cem"));
    assert_eq!(open(page.id("manifest"), "policy".into())["policy"], Json::Null);
    let refused = open(page.id("receipt"), json!({ "reference": 4 }));
    assert!(refused["text"].as_str().unwrap().contains("holds no reference 4"), "{refused}");
}

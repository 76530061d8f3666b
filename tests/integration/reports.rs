//! `swm report`: one page with everything, looked at in a browser where there is one.

use serde_json::Value as Json;

use crate::evaluation::{QUICK, manifest, read};
use crate::support::{Folder, swm, swm_fails, swm_json, swm_ok};

/// Where a browser is on this machine, if any.
fn browser() -> Option<&'static str> {
    ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"]
        .into_iter()
        .find(|path| std::path::Path::new(path).exists())
}

#[test]
fn a_report_is_one_page_that_a_browser_shows() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "moderate", "m.toml", &["--held-out", "1"]);
    let (a, b, sweep, page) =
        (folder.path("a"), folder.path("b"), folder.path("sweep"), folder.path("report.html"));
    swm_ok(&["eval", "--manifest", &manifest, "--policy", QUICK, "--out", &a, "--quiet"]);
    swm_ok(&["eval", "--manifest", &manifest, "--policy", "weak", "--out", &b, "--quiet"]);
    let factors = ["--factors", "agent", "--values", "extremes"];
    swm_ok(
        &[&["sweep", "--manifest", &manifest, "--policy", "weak", "--out", &sweep, "--quiet"][..], &factors]
            .concat(),
    );
    let made = swm_json(&[
        "report",
        &a,
        &b,
        &sweep,
        "--videos",
        "1",
        "--video-format",
        "gif",
        "--out",
        &page,
        "--quiet",
    ]);
    assert_eq!(made["notes"].as_array().unwrap().len(), 0, "{made}");
    let html = std::fs::read_to_string(&page).unwrap();
    for address in ["src=\"http", "href=\"http", "url(http", "@import"] {
        assert!(!html.contains(address), "the page asks for something from elsewhere: {address}");
    }
    let charts = html.matches("<figure><svg").count();
    assert!(charts >= 6, "{charts} charts");
    assert!(html.matches("As a table").count() >= 5, "every chart of results is also a table");
    // Results are named by their folders, then by the settings in which they differ.
    assert!(html.contains("<span class=\"name\">a</span> <small>cem</small>"), "no label of the planner");
    assert!(
        html.contains("<span class=\"name\">b</span> <small>weak</small>"),
        "no label of the other policy"
    );
    assert!(html.contains("class=\"bars\"") && html.matches("title=\"pair 0: ").count() >= 5, "bars and map");
    // The letters of videos may spell anything.
    let mut parts = html.split("base64,");
    let words: String =
        parts.next().into_iter().chain(parts.filter_map(|part| Some(part.split_once('"')?.1))).collect();
    assert!(!words.contains("NaN") && html.contains("data:image/gif;base64,"));
    let receipt: Json = serde_json::from_str(
        &html
            .split_once("id=\"receipt-0\">")
            .unwrap()
            .1
            .split_once("</script>")
            .unwrap()
            .0
            .replace("<\\/", "</"),
    )
    .unwrap();
    assert_eq!(receipt, read(&format!("{a}/receipt.json")));

    let Some(browser) = browser() else {
        println!("skipped: no browser on this machine, the page was not opened");
        return;
    };
    let open = |address: &str| {
        let profile = format!("--user-data-dir={}", folder.path("profile"));
        let output = std::process::Command::new(browser)
            .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=500,900"])
            .args([
                "--virtual-time-budget=60000",
                "--enable-logging=stderr",
                "--v=0",
                "--dump-dom",
                &profile,
                address,
            ])
            .output()
            .unwrap();
        let log = String::from_utf8_lossy(&output.stderr);
        assert!(!log.contains("CONSOLE"), "the page says something on the console:\n{log}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    // The tab of videos is chosen by the address; the page says what it shows through `hidden`.
    let dom = open(&format!("file://{page}#videos"));
    let tag = |id: &str| {
        let (_, rest) =
            dom.split_once(&format!("id=\"{id}\"")).unwrap_or_else(|| panic!("no {id} in the page"));
        rest.split_once('>').unwrap().0.to_owned()
    };
    assert!(tag("overview").contains("hidden") && !tag("videos").contains("hidden"), "tabs do not work");
    assert!(tag("tab-videos").contains("aria-selected=\"true\""));

    // What a visitor does: every tab is clicked, and what is found there is written into the page.
    let recorded = folder.path("recorded.html");
    let format = if cfg!(feature = "mp4") { "mp4" } else { "gif" };
    swm_ok(&["report", &a, "--videos", "1", "--video-format", format, "--out", &recorded, "--quiet"]);
    let (visited, html) = (folder.path("visited.html"), std::fs::read_to_string(&recorded).unwrap());
    std::fs::write(&visited, html.replace("</body>", &format!("{VISIT}</body>"))).unwrap();
    let dom = open(&format!("file://{visited}"));
    let (_, found) = dom.split_once("<pre id=\"visit\">").expect("the page ran to the end");
    let found: Json = serde_json::from_str(found.split_once("</pre>").unwrap().0).unwrap();
    let tabs = found.as_object().unwrap();
    assert!(tabs.len() >= 4, "{found}");
    for (tab, seen) in tabs {
        assert_eq!(seen["shown"], true, "{tab}");
        assert_eq!(seen["wide"], false, "{tab} is wider than the window");
        assert_eq!(
            seen["cropped"],
            Json::Array(Vec::new()),
            "{tab}: figures that scroll sideways, or cropped labels"
        );
        for video in seen["videos"].as_array().unwrap() {
            assert!(video["error"].is_null() && video["seconds"].as_f64() > Some(0.0), "{tab}: {video}");
        }
    }
    let videos = tabs["tab-videos"]["videos"].as_array().unwrap().len();
    assert!(videos > 0 || !cfg!(feature = "mp4"), "{found}");
}

#[test]
fn a_report_is_written_anew_and_other_files_are_kept() {
    let folder = Folder::new();
    let manifest = manifest(&folder, "moderate", "m.toml", &["--held-out", "1"]);
    let (result, page) = (folder.path("random"), folder.path("page.html"));
    let none = ["--reference", "none", "--quiet"];
    let eval = ["eval", "--manifest", &manifest, "--policy", "random", "--out", &result];
    let both = ["--reference", "none,random"];
    assert!(swm_fails(2, &[&eval[..], &both].concat()).contains("`none`"));
    swm_ok(&[&eval[..], &none].concat());
    let report = ["report", result.as_str(), "--videos", "0", "--out", page.as_str()];
    std::fs::write(&page, "<p>My own page.</p>").unwrap();
    let message = swm_fails(2, &report);
    for word in ["page.html exists and is no report", "--overwrite"] {
        assert!(message.contains(word), "{message}");
    }
    assert_eq!(std::fs::read_to_string(&page).unwrap(), "<p>My own page.</p>");
    swm_ok(&[&report[..], &["--overwrite"]].concat());
    // Now it is a report, which a newer one replaces.
    std::fs::write(&page, std::fs::read_to_string(&page).unwrap().replace("</body>", "<p>old</p></body>"))
        .unwrap();
    swm_ok(&report);
    assert!(!std::fs::read_to_string(&page).unwrap().contains("<p>old</p>"));
    // A policy that was an object of another program cannot be run again for its videos.
    let receipt = format!("{result}/receipt.json");
    let mut object: serde_json::Value = serde_json::from_slice(&std::fs::read(&receipt).unwrap()).unwrap();
    object["candidate"]["policy"]["name"] = "MyPolicy".into();
    std::fs::write(&receipt, object.to_string()).unwrap();
    let told = swm(&["report", &result, "--videos", "1", "--out", &page]).output().unwrap();
    let told = String::from_utf8_lossy(&told.stderr);
    assert!(told.contains("no videos: the policy `MyPolicy` was an object of the program"), "{told}");
    let taken = folder.path("folder.html");
    std::fs::create_dir(&taken).unwrap();
    let message = swm_fails(2, &["report", &result, "--videos", "0", "--out", &taken]);
    assert!(message.contains("is a folder"), "{message}");
}

/// Clicks every tab, and says whether it shows, how far its videos have played, whether the page is wider than the window, and
/// which figures scroll sideways or crop their text.
const VISIT: &str = r#"<script>
addEventListener("load", async () => {
  const seen = {};
  for (const tab of document.querySelectorAll("[role=tab]")) {
    tab.click();
    const panel = document.getElementById(tab.getAttribute("aria-controls"));
    const waiting = () => [...panel.querySelectorAll("video")].some((video) => !video.error && video.currentTime === 0);
    // The page's clock is ahead of the decoder's, which is real: each round takes some real work, too.
    for (let round = 0; round < 300 && (round < 1 || waiting()); round++) {
      for (let index = 0; index < 2e7; index++) seen.spent = Math.sqrt(index);
      await new Promise((done) => setTimeout(done, 100));
    }
    delete seen.spent;
    const videos = [...panel.querySelectorAll("video")].map((video) => ({
      seconds: video.currentTime, error: video.error && video.error.message }));
    const wide = document.documentElement.scrollWidth > innerWidth;
    const outside = (text, box) => text.left < box.left - 1 || text.right > box.right + 1;
    const cropped = [...panel.querySelectorAll("figure")].filter((figure) => figure.scrollWidth > figure.clientWidth + 1)
      .map((figure) => figure.className);
    for (const svg of panel.querySelectorAll("figure svg"))
      for (const text of svg.querySelectorAll("text"))
        if (outside(text.getBoundingClientRect(), svg.getBoundingClientRect())) cropped.push(text.textContent);
    seen[tab.id] = { shown: !panel.hidden, videos, wide, cropped };
  }
  const note = document.createElement("pre");
  note.id = "visit";
  note.textContent = JSON.stringify(seen);
  document.body.append(note);
});
</script>"#;

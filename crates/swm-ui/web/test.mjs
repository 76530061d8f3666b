// The page in a headless Chromium: `node test.mjs SWM DATA [SHOTS]`. SWM is the program, DATA a folder with `demo.h5`, `result`,
// `run` and `job`; screenshots go to SHOTS. Every view is opened with that data, an episode of PushT is steered by the pointer to
// success, recorded and loaded back, and any message on the console is a failure. `cargo xtask ui` makes DATA and calls this.
import { spawn, spawnSync } from "node:child_process";
import { existsSync, mkdirSync, readFileSync, mkdtempSync, renameSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { chromium } from "playwright-core";

const [program, data, shots] = process.argv.slice(2);
const browserPath = process.env.CHROMIUM ?? ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"].find(existsSync);
const profile = mkdtempSync(join(tmpdir(), "swm-ui-"));
const save = join(profile, "save");
if (shots) mkdirSync(shots, { recursive: true });

function check(truth, words) {
  if (!truth) throw new Error(words);
}

/** Starts the server; its address with the token. */
async function serve(args) {
  const server = spawn(program, ["ui", "--no-open", ...args], { stdio: ["ignore", "pipe", "inherit"] });
  const url = await new Promise((resolve, reject) => {
    let text = "";
    server.stdout.on("data", (piece) => {
      text += piece;
      const found = text.match(/http:\/\/\S+/);
      if (found) resolve(found[0]);
    });
    server.on("exit", (code) => reject(new Error(`swm ui ended with ${code}`)));
  });
  return { server, url, origin: new URL(url).origin };
}

const { server, url, origin } = await serve([data, "--save", save]);
const context = await chromium.launchPersistentContext(join(profile, "profile"), {
  executablePath: browserPath,
  headless: true,
  viewport: { width: 1440, height: 900 },
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"],
});
const page = await context.newPage();
// While the page is worked on: its files from `dist`, so that a change needs no build of the program.
if (process.env.SWM_UI_DIST) await page.route("**/assets/app.*", (route) => route.fulfill({ path: join(process.env.SWM_UI_DIST, new URL(route.request().url()).pathname.split("/").pop()) }));
const said = [];
page.on("console", (message) => said.push(`${message.type()}: ${message.text()}`));
page.on("pageerror", (error) => said.push(`error: ${error.message}`));
page.on("requestfailed", (request) => { if (!request.failure()?.errorText.includes("ABORTED")) said.push(`failed: ${request.url()} ${request.failure()?.errorText}`); });

// What the server sends, as the page gets it.
const live = {};
page.on("websocket", (socket) => socket.on("framereceived", ({ payload }) => {
  if (typeof payload === "string") {
    const message = JSON.parse(payload);
    live[message.kind] = message;
    // The frames of another episode say nothing of this one.
    if (message.kind === "episode") live.head = undefined;
  } else {
    const head = JSON.parse(payload.subarray(4, 4 + payload.readUInt32LE(0)).toString());
    if (!head.goal && !head.video) live.head = head;
  }
}));

const shot = async (name) => { if (shots) await page.screenshot({ path: join(shots, `${name}.png`) }); };
const quiet = (where) => { check(said.length === 0, `${where}: the console says\n${said.join("\n")}`); };
const text = (selector) => page.locator(selector).first().innerText();
const step = async () => Number(await text(".steps"));
// A copy is read: reading the canvas itself would change how the browser keeps it.
const pixels = () => page.evaluate(() => {
  const canvas = document.querySelector(".screen > canvas");
  const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
  copy.drawImage(canvas, 0, 0);
  return copy.getImageData(0, 0, canvas.width, canvas.height).data.reduce((a, b) => (a * 31 + b) | 0, 7);
});
async function until(words, truth, seconds = 20) {
  const end = Date.now() + 1000 * seconds;
  while (!(await truth())) {
    check(Date.now() < end, `waited ${seconds} s in vain: ${words}`);
    await new Promise((resolve) => setTimeout(resolve, 15));
  }
}

const parts = {
  async play() {
    await page.goto(url);
    await page.waitForSelector("canvas");
    await until("the first image", async () => (await pixels()) !== 0 && (await text(".readout")).includes("human"));
    check(!(await page.evaluate(() => location.search)), "the token stays in the address");
    await shot("play-light");
    const start = await pixels();
    await page.keyboard.press(".");
    await until("a step", async () => (await step()) === 1);
    await page.keyboard.press(",");
    await until("back", async () => (await step()) === 0);
    check((await pixels()) === start, "the image after a step back is another one");
    quiet("play");
  },

  async factors() {
    const before = await pixels();
    const color = page.locator('input[type="color"]').first();
    const began = Date.now();
    for (let change = 0; change < 300; change += 1) {
      await color.evaluate((input, value) => {
        input.value = value;
        input.dispatchEvent(new Event("input", { bubbles: true }));
      }, `#${(change % 256).toString(16).padStart(2, "0")}4080`);
    }
    await until("the last color", async () => (await page.locator(".factor.set code").first().innerText()).startsWith(`${299 % 256} 64 128`));
    console.log(`300 factor changes: ${Date.now() - began} ms`);
    check((await pixels()) !== before, "another color is not seen");
    check((await page.locator(".factor.set").count()) >= 1, "what is set is not marked");
    await page.getByRole("button", { name: "default", exact: true }).first().click();
    await until("the defaults", async () => (await page.locator(".factor.set").count()) === 0);
    quiet("factors");
  },

  async steering() {
    await page.getByLabel("File").fill("steered.h5");
    await page.getByRole("button", { name: "Record", exact: true }).click();
    await page.waitForSelector(".rec");
    const box = await page.locator(".screen > canvas").boundingBox();
    check(await steerToSuccess(box), "the episode was not steered to success");
    await until("the kept episode", async () => (await text(".recording")).includes("success"));
    await shot("play-recorded");
    await page.getByRole("button", { name: "Finish" }).click();
    await page.waitForSelector("text=look at the recording");
    await page.click("text=look at the recording");
    await page.waitForSelector(".thumb");
    check((await text(".thumb")).includes("success"), "the recorded episode is no success");
    await page.locator(".thumb").first().click();
    await page.waitForSelector(".player .screen img");
    await until("the recorded image", () => page.evaluate(() => document.querySelector(".player .screen img").naturalWidth === 96));
    await shot("recorded-player");
    quiet("steering");
  },

  /** A dataset grows while another tab shows it, also by the episode that waits when the page of the recording is gone. */
  async growing() {
    const other = await context.newPage();
    await other.goto(`${origin}/#data?id=${encodeURIComponent(live.recorded.id)}`);
    await until("one episode", async () => (await other.locator(".thumb").count()) === 1);
    await page.goto(`${origin}/#play`);
    await page.getByLabel("File").fill("steered.h5");
    await page.getByRole("button", { name: "Record", exact: true }).click();
    await page.waitForSelector(".rec");
    for (const wanted of [1, 2]) {
      await page.keyboard.press(".");
      await until("a step", async () => (await step()) === 1);
      await page.getByRole("button", { name: "Keep now" }).click();
      await until("the kept episode", async () => live.head?.recording?.in_file === wanted && live.head.recording.waiting?.steps === 1);
      await until("the next episode", async () => (await step()) === 0);
    }
    await until("two episodes", async () => (await other.locator(".thumb").count()) === 2);
    await page.getByRole("button", { name: "Undo last" }).click();
    await until("nothing to confirm", async () => live.head?.recording.waiting === null);
    await page.keyboard.press(".");
    await until("a step", async () => (await step()) === 1);
    await page.getByRole("button", { name: "Keep now" }).click();
    await until("the kept episode", async () => live.head?.recording.waiting !== null);
    await page.goto("about:blank");
    await until("three episodes", async () => (await other.locator(".thumb").count()) === 3);
    await other.close();
    quiet("growing");
  },

  /** A planner's search lies over the image, with its costs. */
  async planning() {
    await page.goto(`${origin}/#play`);
    await page.waitForSelector("canvas");
    await page.getByLabel("Who acts").selectOption("cem");
    await page.locator("summary", { hasText: "Settings" }).click();
    for (const [name, value] of [["samples", "64"], ["iterations", "5"], ["elites", "8"]]) await page.getByLabel(name, { exact: true }).fill(value);
    await page.getByRole("button", { name: "Apply" }).click();
    await until("the planner", async () => (await text(".readout")).includes("samples=64"));
    await page.locator("summary", { hasText: "Settings" }).click();
    await page.keyboard.press(".");
    await until("a plan", async () => (await page.locator("polyline.plan").count()) > 0);
    check(live.plan.paths.every((path) => path.cost !== null && path.true_cost !== null) && live.plan.agreement > 0.5, "the costs of the candidates are not compared");
    check((await page.locator(".scatter line").count()) === live.plan.paths.length, "the costs are not drawn");
    check(live.plan.costs.length === 5 && live.plan.cost !== null && live.plan.true_cost !== null, "the plan has no costs");
    for (const kind of ["candidate", "first-elite", "last-elite"]) check((await page.locator(`polyline.${kind}`).count()) > 3, `no path of a ${kind}`);
    const [over, below] = await Promise.all([".paths", ".screen > canvas"].map((one) => page.locator(one).boundingBox()));
    check(Math.abs(over.x - below.x) < 1.5 && Math.abs(over.width - below.width) < 1.5, "the paths do not lie on the image");
    await shot("play-planner");
    await page.getByLabel("over the image").uncheck();
    check((await page.locator(".paths").count()) === 0, "the paths stay");
    await page.getByLabel("over the image").check();
    await page.keyboard.press(",");
    await until("no plan before its step", async () => (await page.locator(".paths").count()) === 0);
    quiet("planning");
  },

  /** A browser that is killed loses nothing: what was kept is committed, and the environment closes. */
  async killed() {
    const browser = await chromium.launchServer({ executablePath: browserPath, headless: true, args: ["--no-sandbox", "--disable-gpu"] });
    const client = await chromium.connect(browser.wsEndpoint());
    const other = await client.newContext();
    await other.addCookies(await context.cookies());
    const tab = await other.newPage();
    await tab.goto(`${origin}/#play`);
    await tab.waitForSelector("canvas");
    await tab.getByLabel("File").fill("killed.h5");
    await tab.getByRole("button", { name: "Record", exact: true }).click();
    await tab.waitForSelector(".rec");
    await tab.keyboard.press(".");
    await until("a step", async () => (await tab.locator(".steps").first().innerText()) === "1");
    await tab.getByRole("button", { name: "Keep now" }).click();
    await until("the kept episode", async () => (await tab.locator(".recording").innerText()).includes("to confirm"));
    browser.process().kill("SIGKILL");
    const inspect = () => spawnSync(program, ["inspect", join(save, "killed.h5"), "--json"], { encoding: "utf8" });
    await until("the committed episode", () => { const { status, stdout } = inspect(); return status === 0 && JSON.parse(stdout).episodes === 1; });
    quiet("killed");
  },

  async data() {
    await page.goto(`${origin}/#data`);
    await page.waitForSelector(".thumb img");
    await until("thumbnails", () => page.evaluate(() => [...document.querySelectorAll(".thumb img")].slice(0, 6).every((image) => image.complete && image.naturalWidth > 0)));
    await shot("data-grid");
    const all = await page.locator(".thumb").count();
    await page.getByLabel("min_length min").fill("100000");
    await page.keyboard.press("Tab");
    await until("the filter", async () => (await page.locator(".thumb").count()) === 0);
    await page.getByLabel("min_length min").fill("");
    await page.keyboard.press("Tab");
    await until("all again", async () => (await page.locator(".thumb").count()) === all);
    await page.locator(".thumb").nth(1).click();
    await page.waitForSelector(".player .u-wrap");
    await page.getByLabel("Step", { exact: true }).fill("5");
    await until("the step", async () => (await text(".steps")).startsWith("5/"));
    await shot("data-player");
    for (const [name, ending] of [["Columns as CSV", "episode_1.csv"], ["Image as PNG", "episode_1_step_5.png"], ["Episode as MP4", "episode_1.mp4"]]) {
      const waiting = page.waitForEvent("download");
      await page.getByText(name).click();
      const given = await waiting;
      check(given.suggestedFilename() === ending, `${name} gives another file`);
      check(readFileSync(await given.path()).length > 200, `${name} gives an empty file`);
    }
    await page.getByRole("tab", { name: "distributions" }).click();
    await page.waitForSelector(".histograms svg");
    await shot("data-distributions");
    await page.getByRole("tab", { name: "about" }).click();
    await page.waitForSelector("table");
    quiet("data");
  },

  /** Steps that are picked as starts and goals become a manifest, which the command that is shown makes, too. */
  async picks() {
    const id = await demo();
    await page.goto("about:blank");
    await page.goto(`${origin}/#data?id=${encodeURIComponent(id)}`);
    await page.locator(".thumb").nth(1).click();
    await page.waitForSelector(".player .u-wrap");
    const pick = async (at, what) => {
      await page.getByLabel("Step", { exact: true }).fill(String(at));
      await until("the step", async () => (await text(".steps")).startsWith(`${at}/`));
      await page.getByRole("button", { name: what }).click();
    };
    check(await page.getByRole("button", { name: "Goal here" }).isDisabled(), "a goal without a start");
    await pick(2, "Start here");
    await pick(20, "Goal here");
    await pick(4, "Start here");
    await page.getByRole("button", { name: "Next episode" }).click();
    await until("the next episode", async () => (await page.locator(".player b").first().innerText()) === "Episode 2");
    await until("its values", async () => (await text(".steps")).startsWith("0/"));
    await pick(9, "Goal here");
    check((await page.locator(".picked li").count()) === 2, "two pairs are picked");
    await page.getByLabel("Tier").selectOption("historic");
    await page.getByLabel("Manifest", { exact: true }).fill("picked.toml");
    await until("the images of the pairs", () => page.evaluate(() => [...document.querySelectorAll(".picked img")].filter((image) => image.complete && image.naturalWidth > 0).length === 4));
    await page.locator(".picks").scrollIntoViewIfNeeded();
    await shot("data-picks");
    const command = await text(".picks .command code");
    check(command.includes("--pairs 1:2-20,1:4-2:9 "), `the command is another one: ${command}`);
    await page.getByRole("button", { name: "Save the manifest" }).click();
    await page.waitForSelector("text=2 pairs saved");
    const made = spawnSync(program, [...command.split(" ").slice(1, -1), join(profile, "again.toml"), "--quiet"], { encoding: "utf8" });
    check(made.status === 0, made.stderr);
    check(readFileSync(join(save, "picked.toml"), "utf8") === readFileSync(join(profile, "again.toml"), "utf8"), "the command makes another manifest");
    await page.getByLabel("Tier").selectOption("moderate");
    await page.getByLabel("Manifest", { exact: true }).fill("other.h5");
    said.length = 0;
    await page.getByRole("button", { name: "Save the manifest" }).click();
    await page.waitForSelector(".picks .notice");
    check((await text(".picks .notice")).includes("end it in .json or .toml"), "a wrong name is not refused in words");
    // The browser says of itself that the answer was a refusal.
    check(said.every((line) => line.includes("status of 400")), said.join("\n"));
    said.length = 0;
    await page.getByLabel("Manifest", { exact: true }).fill("picked.toml");
    await page.getByRole("button", { name: "Remove the pair 1:2-20" }).click();
    check((await page.locator(".picked li").count()) === 1, "a pair is removed");
    quiet("picks");
  },

  async results() {
    await page.goto(`${origin}/#results`);
    await page.waitForSelector(".strip a");
    await shot("results-receipt");
    await downloaded("CSV", "receipt.csv", (text) => text.split("\n").length > 20);
    const run = page.locator(".files a", { hasText: "run" }).last();
    await run.click();
    await page.waitForSelector(".curves .u-wrap");
    await shot("results-training");
    await downloaded("Curves as PNG", "curves.png", (text) => text.startsWith("\x89PNG"));
    await downloaded("CSV", "curves.csv", (text) => text.startsWith("part,name,step,value\n"));
    quiet("results");
  },

  /** A pair is replayed live by the policy of the receipt and by a reference policy, step for step, as the receipt says. */
  async pair() {
    await page.goto("about:blank");
    await page.goto(`${origin}/#results`);
    await page.waitForSelector(".strip a");
    await page.locator(".strip a").nth(1).click();
    await page.waitForSelector(".pair canvas");
    // The demo's receipt holds no oracle: its reference policies are the same wherever they run.
    check((await page.getByLabel("Right").inputValue()) === "oracle", "the oracle does not stand beside");
    await page.getByLabel("Right").selectOption({ label: "random" });
    const sides = () => page.evaluate(() => [...document.querySelectorAll(".pair .readout")].map((one) => one.querySelector("dd").innerText));
    await until("both starts", async () => (await sides()).join() === "0,0");
    for (const at of ["1", "2", "3"]) {
      await page.keyboard.press(".");
      await until("a step of both", async () => (await sides()).join() === `${at},${at}`);
    }
    await page.keyboard.press(",");
    await until("a step back of both", async () => (await sides()).join() === "2,2");
    await page.getByLabel("Steps per second").selectOption("60");
    await page.getByRole("button", { name: "Play", exact: true }).click();
    await until("the ends", async () => (await page.locator(".pair .outcome").count()) === 2, 60);
    check((await page.locator(".pair .same").count()) === 2, `the runs are others than in the receipt: ${await page.locator(".pair .both").innerText()}`);
    await shot("results-pair");
    await downloaded("Steps as CSV", /pair_1\.csv$/, (text) => text.startsWith("step,left_reward,left_task_cost,right_reward,right_task_cost\n0,"));
    await downloaded("Images as PNG", /pair_1_step_\d+\.png$/, (text) => text.startsWith("\x89PNG"));
    await downloaded("Run as MP4", /pair_1_left\.mp4$/, (text) => text.slice(4, 8) === "ftyp");
    await page.getByRole("button", { name: "Start", exact: true }).click();
    await until("both at the start", async () => (await sides()).join() === "0,0");
    await page.getByRole("button", { name: "Next pair" }).click();
    await until("the next pair", async () => (await text(".pair h2")).startsWith("Pair 2 of"));
    // The oracle, which the receipt does not hold, is made as `swm eval` makes it.
    await until("its planner", async () => (await page.locator(".pair .actor").nth(1).innerText()).includes("cem"), 40);
    await page.keyboard.press(".");
    await until("a step of both", async () => (await sides()).join() === "1,1", 60);
    await page.getByText("Open in Play").first().click();
    await page.waitForSelector(".live canvas");
    await until("the policy of the receipt", async () => !(await text(".readout")).includes("human"));
    await page.getByRole("button", { name: "Play", exact: true }).click();
    await until("the pair plays", async () => (await step()) > 3);
    await downloaded("Episode as MP4", "PushT-v1.mp4", (text) => text.slice(4, 8) === "ftyp");
    await downloaded("Plots as PNG", /plots\.png$/, (text) => text.startsWith("\x89PNG"));
    quiet("pair");
  },

  /** A recording and an evaluation that the page begins; the command that it shows makes the same. */
  async run() {
    await page.goto(`${origin}/#run`);
    await page.getByRole("button", { name: "Record", exact: true }).click();
    for (const [label, value] of [["env", "swm/PushT-v1"], ["policy", "weak"], ["episodes", "3"], ["seed", "5"], ["image size", "none"], ["Result", "ran.h5"]]) await page.getByLabel(label, { exact: true }).fill(value);
    await page.getByLabel("More settings").selectOption("max_steps");
    await page.getByLabel("max steps", { exact: true }).fill("12");
    await page.getByRole("button", { name: "Check, and show the command" }).click();
    await page.waitForSelector(".panel .command");
    const command = await text(".panel .command code");
    check(command.startsWith("swm collect swm/PushT-v1 --policy weak --episodes 3 ") && command.includes("--max-steps 12"), command);
    await page.getByRole("button", { name: "Run", exact: true }).click();
    await page.waitForSelector("text=Record: ran.h5");
    await until("the end", async () => (await page.locator(".facts .good", { hasText: "done" }).count()) === 1, 60);
    await shot("run");
    const made = spawnSync(program, [...command.split(" ").slice(1, -1), join(profile, "ran.h5"), "--quiet"], { encoding: "utf8" });
    check(made.status === 0, made.stderr);
    check(readFileSync(join(save, "ran.h5")).equals(readFileSync(join(profile, "ran.h5"))), "the command makes another recording");
    await page.click("text=look at it");
    await page.waitForSelector(".thumb");
    await page.goto(`${origin}/#run`);
    said.length = 0;
    await page.getByRole("button", { name: "Evaluate", exact: true }).click();
    await page.getByLabel("policy", { exact: true }).fill("wek");
    await page.getByRole("button", { name: "Run", exact: true }).click();
    await page.waitForSelector(".notice");
    // The browser says of itself that the answer was a refusal.
    check(said.every((line) => line.includes("status of 4")), said.join("\n"));
    said.length = 0;
    quiet("run");
  },

  /** The shards of a job, while one of them is done. */
  async jobs() {
    await page.goto(`${origin}/#results`);
    await page.locator(".files a", { hasText: "job" }).last().click();
    const states = () => page.evaluate(() => [...document.querySelectorAll(".result td:nth-child(2)")].map((cell) => cell.innerText).join());
    await until("its shards", async () => (await states()) === "not started,done,not started");
    await shot("results-job");
    const task = (...rest) => {
      const ran = spawnSync(program, ["task", join(data, "job"), ...rest], { encoding: "utf8" });
      check(ran.status === 0, ran.stderr);
    };
    const facts = (part) => async () => (await text(".result .facts")).includes(part);
    task("--index", "3");
    await until("the third one", async () => (await states()) === "not started,done,done");
    check(await facts("2 done")(), "the sum is another one");
    await downloaded("CSV", "job.csv", (text) => text.startsWith("shard,state,episodes,of,seconds\n"));
    task("--all");
    await until("how to join them", facts("not joined yet: swm task"));
    task("--finish");
    await until("the result", facts("result.h5 ("));
    renameSync(join(data, "job/result.h5"), join(data, "job/moved.h5"));
    await until("that it is lost", facts("result.h5 is missing"));
    await shot("results-job-lost");
    renameSync(join(data, "job/moved.h5"), join(data, "job/result.h5"));
    quiet("jobs");
  },

  /** A gamepad: the left stick is the first two dimensions of the action. */
  async gamepad() {
    await page.goto("about:blank");
    await page.goto(`${origin}/#play`);
    await page.waitForSelector("canvas");
    await until("the first image", async () => live.head?.step === 0);
    await page.evaluate(() => {
      const pad = { axes: [0, 0, 0, 0], buttons: [], connected: true, index: 0, id: "pad" };
      navigator.getGamepads = () => [pad];
      globalThis.pad = pad;
    });
    await page.getByRole("button", { name: "Play", exact: true }).click();
    const moved = async (axes, fits) => {
      await page.evaluate((axes) => { globalThis.pad.axes = axes; }, axes);
      const [x, y] = live.head.agent;
      await until(`the agent follows ${axes}`, () => fits(live.head.agent[0] - x, live.head.agent[1] - y));
    };
    await moved([1, 0, 0, 0], (x) => x > 0.03);
    await moved([-1, 0, 0, 0], (x) => x < -0.03);
    await moved([0, -1, 0, 0], (_, y) => y < -0.03);
    await moved([0, 1, 0, 0], (_, y) => y > 0.03);
    quiet("gamepad");
  },

  async looks() {
    const demoId = await demo();
    for (const [name, width, height, scheme] of [["dark", 1440, 900, "dark"], ["narrow", 380, 800, "light"], ["narrow-dark", 380, 800, "dark"], ["wide", 2560, 1300, "light"]]) {
      await page.emulateMedia({ colorScheme: scheme });
      await page.setViewportSize({ width, height });
      for (const view of ["play", "data", "run", "results", "pair", "job", "player"]) {
        await page.goto("about:blank");
        await page.goto(`${origin}/#${{ pair: "results", job: "results", player: `data?id=${encodeURIComponent(demoId)}` }[view] ?? view}`);
        await page.waitForSelector({ play: "canvas", data: ".thumb img", run: ".filters input", player: ".thumb img" }[view] ?? ".strip a");
        if (view === "pair") await page.locator(".strip a").nth(1).click();
        if (view === "job") await page.locator(".files a", { hasText: "job" }).last().click();
        if (view === "player") {
          await page.locator(".thumb").nth(1).click();
          await page.getByRole("button", { name: "Start here" }).click();
          await page.getByLabel("Step", { exact: true }).fill("9");
          await page.getByRole("button", { name: "Goal here" }).click();
        }
        await page.waitForTimeout(600);
        const over = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
        check(over <= 0, `${view} at ${width} px is ${over} px too wide`);
        await shot(`${view}-${name}`);
      }
    }
    await page.emulateMedia({ colorScheme: "light" });
    await page.setViewportSize({ width: 1440, height: 900 });
    quiet("looks");
  },

  /** Figures, for docs/ui.md. */
  async speed() {
    await page.goto("about:blank");
    await page.goto(`${origin}/#play`);
    await page.waitForSelector("canvas");
    await page.getByRole("slider", { name: /Speed/ }).fill("3");
    await page.getByRole("button", { name: "Play", exact: true }).click();
    await page.waitForTimeout(3500);
    console.log(`PushT at 256 px: ${(await page.locator("dd").nth(2).innerText())} frames a second`);
    await page.getByRole("button", { name: "Pause" }).click();
    await page.getByLabel("Ends after").selectOption("0");
    await page.getByRole("slider", { name: /Speed/ }).fill("2.5");
    await page.getByRole("slider", { name: /Speed/ }).fill("3");
    await page.getByRole("button", { name: "Play", exact: true }).click();
    // From the event of the pointer to the frame of the browser that shows another image. Before each move the agent has come to rest.
    await page.evaluate(() => {
      const canvas = document.querySelector(".screen > canvas");
      const put = CanvasRenderingContext2D.prototype.putImageData;
      let last = new Uint32Array(0), moved = null;
      globalThis.waits = [];
      CanvasRenderingContext2D.prototype.putImageData = function (image, ...rest) {
        put.call(this, image, ...rest);
        if (this.canvas !== canvas) return;
        const now = new Uint32Array(image.data.buffer);
        const isOther = now.length !== last.length || now.some((pixel, at) => pixel !== last[at]);
        last = now;
        if (!isOther || moved === null) return;
        const since = moved;
        moved = null;
        requestAnimationFrame(() => globalThis.waits.push(performance.now() - since));
      };
      canvas.addEventListener("pointermove", (event) => { moved ??= event.timeStamp; }, { capture: true });
    });
    const box = await page.locator(".screen > canvas").boundingBox();
    for (let turn = 0; turn < 21; turn += 1) {
      await page.waitForTimeout(800);
      await page.mouse.move(box.x + box.width * (0.3 + 0.4 * (turn % 2)), box.y + box.height * 0.25);
    }
    await page.waitForTimeout(500);
    const waits = (await page.evaluate(() => globalThis.waits)).sort((a, b) => a - b);
    check(waits.length > 15, `the image followed ${waits.length} of 21 moves`);
    console.log(`pointer to image: median ${waits[waits.length >> 1].toFixed(0)} ms, 90 % within ${waits[Math.floor(0.9 * waits.length)].toFixed(0)} ms`);
    quiet("speed");
  },

  /** Last: Ctrl-C commits the episode that waits, however long that takes, and the page says that the server is gone. */
  async ending() {
    // A fresh page: the one before plays on.
    await page.goto("about:blank");
    await page.goto(`${origin}/#play`);
    await page.waitForSelector("canvas");
    await page.getByLabel("File").fill("interrupted.h5");
    await page.getByLabel("Images").selectOption("256");
    await page.getByRole("button", { name: "Record", exact: true }).click();
    await page.waitForSelector(".rec");
    await page.getByRole("slider", { name: /Speed/ }).fill("3");
    await page.getByRole("button", { name: "Play", exact: true }).click();
    await until("many steps", async () => (await step()) > 150, 40);
    await page.getByRole("button", { name: "Keep now" }).click();
    await until("the kept episode", async () => live.head?.recording.waiting !== null);
    const ended = new Promise((resolve) => server.once("exit", resolve));
    server.kill("SIGINT");
    check((await ended) === 130, "Ctrl-C has another exit status");
    const { stdout } = spawnSync(program, ["inspect", join(save, "interrupted.h5"), "--json"], { encoding: "utf8" });
    check(JSON.parse(stdout).episodes === 1, `the episode is lost: ${stdout}`);
    await page.waitForSelector(".notice");
    check((await text(".notice")).includes("the server has ended"), "the end of the server is not said");
    await shot("gone");
  },
};

/** Waits for the file that a button gives, and checks its content. */
async function downloaded(button, name, fits) {
  const waiting = page.waitForEvent("download", { timeout: 60000 });
  await page.getByRole("button", { name: button, exact: true }).first().click();
  const given = await waiting;
  const found = given.suggestedFilename();
  check(name instanceof RegExp ? name.test(found) : name === found, `${button} gives ${found}`);
  check(fits(readFileSync(await given.path(), "latin1")), `${button} gives another content`);
}

/** The id of the recording of the demo. */
function demo() {
  return page.evaluate(async () => (await (await fetch("/api/files")).json()).files.find((file) => file.name.endsWith("demo.h5")).id);
}

/** Points where the agent must be led so that it acts as the expert of the first recorded episode did, until success. */
async function steerToSuccess(box) {
  const values = await page.evaluate(async (id) => (await fetch(`/api/data/values?id=${id}&episode=0`)).json(), await demo());
  check(values.columns.action, "the demo has no actions");
  await page.getByLabel("Seed").fill("1");
  // Frames and files go on arriving.
  await page.waitForTimeout(500);
  check((await page.getByLabel("Seed").inputValue()) === "1", "what was typed is gone before it was confirmed");
  await page.getByLabel("Seed").press("Enter");
  await until("the seed", async () => live.episode?.seed === 1 && live.head?.step === 0);
  const [[a, b], [c, d]] = live.opened.steer.follow.action_from_image;
  const determinant = a * d - b * c;
  const [across, down] = values.columns.action;
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.mouse.down();
  for (let at = 0; at < across.length && across[at] !== null; at += 1) {
    const [x, y] = live.head.agent;
    const way = [(d * across[at] - b * down[at]) / determinant, (a * down[at] - c * across[at]) / determinant];
    await page.mouse.move(box.x + (x + way[0]) * box.width, box.y + (y + way[1]) * box.height);
    await page.keyboard.press(".");
    await until("a step", async () => live.head?.step > at);
    if (live.head.success) break;
  }
  await page.mouse.up();
  return live.head.success;
}

try {
  for (const [name, part] of Object.entries(parts)) {
    const began = Date.now();
    await part().catch(async (error) => {
      await shot(`failed-${name}`);
      throw new Error(`${name}: ${error.message}\nconsole: ${said.join("\n")}`);
    });
    console.log(`${name}: ${((Date.now() - began) / 1000).toFixed(1)} s`);
  }
} finally {
  await context.close();
  server.kill("SIGKILL");
  rmSync(profile, { recursive: true, force: true });
}

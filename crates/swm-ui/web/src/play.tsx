// Play: a live environment. The page sends what it wants, and shows what comes.

import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { type About, type Env } from "./api";
import { Actor, Hand } from "./actor";
import { Factors, type Scenario } from "./factors";
import { Button, CommandLine, Field, Notice, NumberInput, Panel, csv, download, draw, number, quoted, savePlots, useGet } from "./kit";
import { Paths, Thoughts } from "./planner";
import { Plot } from "./plot";
import { Recorder } from "./recorder";
import { type Head, type Plan, type Run, Socket } from "./socket";
import { useSteering } from "./steering";

const START = "swm/PushT-v1";
/** Plots of a running episode are drawn so often, in milliseconds. */
const PLOT_PERIOD = 150;
const PLAIN: Scenario = { set: {}, vary: null };

export function Play({ about, query }: { about: About; query: URLSearchParams }) {
  const id = query.get("env") ?? (about.envs.some((env) => env.id === START) ? START : about.envs[0]?.id);
  const env = useGet<Env>("env", { id });
  const pair = query.get("receipt") ? { id: query.get("receipt")!, index: Number(query.get("pair") ?? 0), run: runOf(query.get("run")) } : null;
  return (
    <div class="play">
      <Notice text={env.error} />
      <EnvChoice about={about} id={id} />
      {env.value && <Live key={id + JSON.stringify(pair)} about={about} env={env.value} pair={pair} />}
    </div>
  );
}

function runOf(text: string | null): Run {
  try {
    return JSON.parse(text ?? '"policy"');
  } catch {
    return "policy";
  }
}

function EnvChoice({ about, id }: { about: About; id: string }) {
  const families = useMemo(() => {
    const families = new Map<string, About["envs"]>();
    for (const env of about.envs) {
      const family = env.family || "Others";
      families.set(family, [...(families.get(family) ?? []), env]);
    }
    return [...families];
  }, [about]);
  const chosen = about.envs.find((env) => env.id === id);
  return (
    <div class="choice">
      <select aria-label="Environment" value={id} onChange={(event) => { location.hash = `#play?env=${encodeURIComponent(event.currentTarget.value)}`; }}>
        {families.map(([family, list]) => (
          <optgroup key={family} label={family}>{list.map((env) => <option key={env.id} value={env.id}>{env.id}</option>)}</optgroup>
        ))}
      </select>
      <p class="muted">{chosen?.summary}{chosen?.success && `; success: ${chosen.success}`}</p>
    </div>
  );
}

interface Series { names: string[]; rows: (number | null)[][] }

export interface Pair { id: string; index: number; run: Run }

function Live({ about, env, pair }: { about: About; env: Env; pair: Pair | null }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const goal = useRef<HTMLCanvasElement>(null);
  const plots = useRef<HTMLDivElement>(null);
  const [hasGoal, setHasGoal] = useState(false);
  const socket = useRef<Socket | null>(null);
  const [head, setHead] = useState<Head | null>(null);
  const [error, setError] = useState<string | null>(null);
  const [gone, setGone] = useState<string | null>(null);
  const [factors, setFactors] = useState<Record<string, unknown>>({});
  const [scenario, setScenario] = useState<Scenario>(PLAIN);
  const [seed, setSeed] = useState(0);
  const [episode, setEpisode] = useState(0);
  const [rate, setRate] = useState(10);
  const [speed, setSpeed] = useState(1);
  const [side, setSide] = useState(256);
  const [limit, setLimit] = useState<number | null>(300);
  const [steers, setSteers] = useState(false);
  const [policy, setPolicy] = useState<string | null>(null);
  const [hand, setHand] = useState(() => env.action.low.map((low, index) => Math.min(Math.max(0, low), env.action.high[index])));
  const [watched, setWatched] = useState<string[]>([]);
  const [fps, setFps] = useState(0);
  const [plotted, setPlotted] = useState<string[]>([]);
  const [series, setSeries] = useState<Series>({ names: [], rows: [] });
  const [saved, setSaved] = useState<string | null>(null);
  const [plan, setPlan] = useState<Plan | null>(null);
  const [showsPlan, setShowsPlan] = useState(true);
  const shown = useRef({ frames: 0, since: performance.now(), head: null as Head | null, rows: [] as (number | null)[][], queued: false });
  const send = (message: object) => socket.current?.send(message);

  // One connection per environment and image size.
  useEffect(() => {
    const state = shown.current;
    let plottedAt = 0;
    const update = () => {
      state.queued = false;
      setHead(state.head);
      // Plots take longer to draw than images.
      const now = performance.now();
      if (now - plottedAt < PLOT_PERIOD && state.head?.playing && !state.head.over) return;
      plottedAt = now;
      setSeries((old) => ({ ...old, rows: [...state.rows] }));
    };
    const connection = new Socket({
      opened: () => setGone(null),
      closed: setGone,
      message: (message) => {
        switch (message.kind) {
          case "error": setError(message.text); break;
          case "opened":
            setSteers(message.steer !== null);
            setRate(message.hz);
            if (pair) setPolicy(message.policy);
            break;
          case "episode":
            setFactors(message.factors);
            setSeed(message.seed);
            setEpisode(message.episode);
            setPlan(null);
            state.rows = [];
            break;
          case "plotted":
            setPlotted(message.names);
            state.rows = [];
            break;
          case "recorded": setSaved(message.id); break;
          case "plan": setPlan(message); break;
        }
      },
      goal: (size, rgb) => {
        setHasGoal(true);
        draw(goal.current, size, rgb);
      },
      video: (extension, content) => download(`${env.id.split("/").pop()}.${extension}`, content),
      frame: (next, rgb) => {
        draw(canvas.current, next, rgb);
        state.head = next;
        state.frames += 1;
        // After a step back the rows of the future go.
        while (state.rows.length && (state.rows.at(-1)![0] ?? 0) > next.step) state.rows.pop();
        for (const point of next.points) {
          if (state.rows.length && (state.rows.at(-1)![0] ?? 0) >= point.step) continue;
          state.rows.push([point.step, point.reward, point.cost, ...point.values]);
        }
        const now = performance.now();
        if (now - state.since > 1000) {
          setFps((1000 * state.frames) / (now - state.since));
          state.frames = 0;
          state.since = now;
        }
        if (!state.queued) {
          state.queued = true;
          requestAnimationFrame(update);
        }
      },
    });
    socket.current = connection;
    connection.send({ type: "open", env: env.id, image: side, max_steps: limit, seed, episode, vary: scenario.vary, set: scenario.set, pair });
    if (watched.length) connection.send({ type: "watch", columns: watched });
    if (policy) connection.send({ type: "policy", text: policy });
    return () => connection.close();
  }, [env.id, side, limit]);

  useEffect(() => { send({ type: "rate", hz: Math.min(60, Math.max(0.25, rate * speed)) }); }, [rate, speed]);

  const act = useSteering({ canvas, env, steers, hand, head, enabled: policy === null, send, setHand });
  const reset = (next: { seed?: number; episode?: number; scenario?: Scenario }) => {
    setError(null);
    const to = next.scenario ?? scenario;
    send({ type: "reset", seed: next.seed ?? seed, episode: next.episode ?? episode, vary: to.vary, set: to.set });
  };
  const change = (next: Scenario) => {
    setScenario(next);
    reset({ scenario: next });
  };
  const play = () => send({ type: "play", on: !head?.playing });
  const choosePolicy = (text: string | null) => {
    setError(null);
    setPolicy(text);
    setPlan(null);
    send({ type: "policy", text });
  };
  const watch = (columns: string[]) => {
    setWatched(columns);
    send({ type: "watch", columns });
  };

  useEffect(() => {
    const pressed = (event: KeyboardEvent) => {
      const target = event.target as HTMLElement;
      if (target.matches("input:not([type=checkbox]), select, textarea") || event.metaKey || event.ctrlKey || event.altKey) return;
      const step = shown.current.head?.step ?? 0;
      if (event.key === " " && !target.matches("button, summary, input")) play();
      else if (event.key === ".") send({ type: "step" });
      else if (event.key === ",") send({ type: "rewind", step: Math.max(0, step - 1) });
      else if (event.key === "r") reset({});
      else if (event.key === "n") reset({ episode: episode + 1 });
      else return;
      event.preventDefault();
    };
    addEventListener("keydown", pressed);
    return () => removeEventListener("keydown", pressed);
  });

  const data = useMemo(() => columns(series.rows, 3 + plotted.length), [series, plotted]);
  const steps = head?.step ?? 0;
  // A plan holds from its step on, until the next one.
  const current = plan && policy !== null && steps > plan.step ? plan : null;
  const furthest = Math.max(steps, ...(series.rows.length ? [series.rows.at(-1)![0] ?? 0] : [0]));
  const name = `${env.id.split("/").pop()}_seed_${seed}_episode_${episode}`;
  // The lines of the plot stay from episode to episode.
  const hadCost = useRef(false);
  const hasCost = (hadCost.current ||= series.rows.some((row) => row[2] !== null));
  // What does not change from frame to frame is not made again: an image must not wait for it.
  const latest = { change, choosePolicy, watch };
  const calls = useRef(latest);
  calls.current = latest;
  const factorsPanel = useMemo(() => (
    <Panel title="Factors of variation" class="factors-panel">
      {env.factors.length === 0 ? <p class="muted">This environment has none.</p>
        : <Factors factors={env.factors} values={factors} scenario={scenario} onChange={(next) => calls.current.change(next)} />}
    </Panel>
  ), [env, factors, scenario]);
  const actor = head?.actor ?? "";
  const actorForm = useMemo(() => <Actor env={env} actor={actor} onPolicy={(text) => calls.current.choosePolicy(text)} />, [env, actor]);
  const recording = JSON.stringify(head?.recording ?? null);
  const recorder = useMemo(() => (
    <Recorder about={about} status={JSON.parse(recording)} canKeep={steps > 0} saved={saved} env={env.id} send={(message) => socket.current?.send(message)} />
  ), [about, recording, steps > 0, saved, env.id]);
  const planCommand = policy === null ? "" : `swm plan ${quoted(env.id)} --policy ${quoted(policy)} --seed ${seed} --trace plan`;
  const thoughts = useMemo(() => current && <Thoughts plan={current} shown={showsPlan} command={planCommand} onShow={setShowsPlan} />, [current, showsPlan, planCommand]);
  const plotPanel = useMemo(() => (
    <Panel title="Plots" aside={
      <select aria-label="Add a column" value="" onChange={(event) => event.currentTarget.value && calls.current.watch([...watched, event.currentTarget.value])}>
        <option value="">+ column</option>
        {env.columns.filter((column) => column.shape.reduce((a, b) => a * b, 1) <= 32 && !watched.includes(column.name) && column.kind === "step")
          .map((column) => <option key={column.name} value={column.name}>{column.name}</option>)}
      </select>
    }>
      <div class="stack" ref={plots}>
        <Plot names={hasCost ? ["reward", "task cost"] : ["reward"]} data={hasCost ? data.slice(0, 3) : data.slice(0, 2)} height={140} />
        {plotted.length > 0 && <Plot names={plotted} data={[data[0], ...data.slice(3)]} height={160} />}
      </div>
      {watched.length > 0 && (
        <div class="chips">{watched.map((name) => <button type="button" key={name} onClick={() => calls.current.watch(watched.filter((other) => other !== name))} aria-label={`Remove ${name}`}>{name} ×</button>)}</div>
      )}
    </Panel>
  ), [env, watched, plotted, data, hasCost]);
  return (
    <div class="live">
      <div class="scene">
        <Notice text={gone} />
        <Notice text={error} onClose={() => setError(null)} />
        <Panel class="stage">
          <div class={`screen ${steers && policy === null ? "steers" : ""}`}>
            <canvas ref={canvas} width={side} height={side} tabIndex={0} aria-label={`Image of ${env.id}`} {...act} />
            {current && showsPlan && <Paths plan={current} />}
            <figure class="goal" hidden={!hasGoal}><canvas ref={goal} aria-label="Goal" /><figcaption>goal</figcaption></figure>
            {head?.over && <div class={`outcome ${head.success ? "good" : ""}`}>{head.success ? "success" : head.over}</div>}
          </div>
          <div class="transport" role="toolbar" aria-label="Time">
            <Button onClick={() => reset({})} title="Same episode from its start (R)" aria-label="Reset">|◂</Button>
            <Button onClick={() => send({ type: "rewind", step: Math.max(0, steps - 1) })} title="A step back (,)" aria-label="Step back" disabled={steps === 0}>−1</Button>
            <Button primary onClick={play} title="Space" class="wide">{head?.playing ? "Pause" : "Play"}</Button>
            <Button onClick={() => send({ type: "step" })} title="One step (.)" aria-label="Step">+1</Button>
            <Button onClick={() => reset({ episode: episode + 1 })} title="Next episode (N)" aria-label="Next episode">▸|</Button>
            <input
              type="range" class="time" aria-label="Step of the episode; drag to rewind" min={0} max={Math.max(furthest, 1)} value={steps}
              onInput={(event) => send({ type: "rewind", step: event.currentTarget.valueAsNumber })}
            />
            <output class="steps">{steps}</output>
          </div>
          <dl class="readout">
            <div><dt>reward</dt><dd>{number(head?.total_reward)}</dd></div>
            <div><dt>success</dt><dd class={head?.success ? "good" : ""}>{head?.success === null || head === null ? "–" : head.success ? "yes" : "no"}</dd></div>
            <div><dt>frames/s</dt><dd>{head?.playing ? fps.toFixed(0) : "–"}</dd></div>
            <div class="grow"><dt>actor</dt><dd><code>{head?.actor ?? ""}</code></dd></div>
          </dl>
        </Panel>
        {thoughts}
        {plotPanel}
      </div>
      <div class="side">
        <Panel title="Control">
          {actorForm}
          {policy === null && (steers
            ? <p class="muted">The agent follows the pointer over the image, the arrow keys, or a gamepad.</p>
            : <Hand space={env.action} values={hand} onInput={(values) => { setHand(values); send({ type: "action", values }); }} />)}
          <Field label={`Speed: ${number(Math.min(60, rate * speed), 3)} steps/s`}>
            <input type="range" min={-3} max={3} step={0.5} value={Math.log2(speed)} onInput={(event) => setSpeed(2 ** event.currentTarget.valueAsNumber)} />
          </Field>
        </Panel>
        <Panel title="Episode">
          <div class="grid2">
            <Field label="Seed"><NumberInput min={0} step={1} value={seed} onCommit={(next) => reset({ seed: Math.max(0, Math.floor(next)), episode: 0 })} /></Field>
            <Field label="Episode"><NumberInput min={0} step={1} value={episode} onCommit={(next) => reset({ episode: Math.max(0, Math.floor(next)) })} /></Field>
            <Field label="Image"><select value={side} onChange={(event) => setSide(Number(event.currentTarget.value))}>{[64, 96, 128, 224, 256, 384, 512].map((size) => <option key={size} value={size}>{size} px</option>)}</select></Field>
            <Field label="Ends after"><select value={limit ?? 0} onChange={(event) => setLimit(Number(event.currentTarget.value) || null)}>{[50, 100, 200, 300, 500, 1000].map((steps) => <option key={steps} value={steps}>{steps} steps</option>)}<option value={0}>never</option></select></Field>
          </div>
        </Panel>
        {recorder}
        <Panel title="The same on the command line">
          <CommandLine text={command(env, policy, seed, scenario, limit)} />
          <div class="row">
            <Button onClick={() => canvas.current?.toBlob((image) => image && download(`${name}_step_${steps}.png`, image))}>Image as PNG</Button>
            <Button disabled={steps === 0} onClick={() => send({ type: "video" })}>Episode as MP4</Button>
            <Button onClick={() => savePlots(`${name}_plots.png`, plots.current)}>Plots as PNG</Button>
            <Button disabled={series.rows.length === 0} onClick={() => download(`${name}.csv`, csv(["step", "reward", "task_cost", ...plotted], data))}>Plots as CSV</Button>
          </div>
        </Panel>
      </div>
      {factorsPanel}
    </div>
  );
}

function columns(rows: (number | null)[][], count: number): (number | null)[][] {
  return Array.from({ length: count }, (_, column) => rows.map((row) => row[column] ?? null));
}

/** The command that renders this episode. */
function command(env: Env, policy: string | null, seed: number, scenario: Scenario, limit: number | null): string {
  const words = ["swm", policy === null ? "render" : "collect", quoted(env.id)];
  if (policy !== null) words.push("--policy", quoted(policy), "--episodes", "1", "--max-steps", String(limit ?? 1000));
  else words.push("--steps", "0");
  words.push("--seed", String(seed));
  if (scenario.vary) words.push("--vary", scenario.vary.length ? scenario.vary.join(",") : "none");
  for (const [name, value] of Object.entries(scenario.set)) {
    words.push("--set", quoted(`${name}=${Array.isArray(value) ? value.map((v) => number(Number(v))).join(",") : String(value)}`));
  }
  words.push("--out", policy === null ? "start.png" : "episodes.h5");
  return words.join(" ");
}

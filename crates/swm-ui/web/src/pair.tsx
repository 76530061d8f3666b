// A pair of a receipt or a manifest replayed live: two runs side by side, step for step.

import { type RefObject } from "preact";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { type Env } from "./api";
import { Button, CommandLine, Notice, Panel, csv, download, draw, number, useGet } from "./kit";
import { Plot } from "./plot";
import type { Manifest, PairResult, Receipt } from "./results";
import { type Head, type Run, Socket } from "./socket";

/** An environment is asked for so often, where as many are open as the server allows. */
const ATTEMPTS = 5;

interface Choice { key: string; label: string; run: Run; policy?: string; result?: PairResult }
interface Frame { head: Head; rgb: Uint8Array; cost: number | null }

/** What a run was so far: a frame for every step. */
class Replay {
  frames: Frame[] = [];
  isWaiting = true;
  hasFailed = false;
  socket: Socket | null = null;

  get over(): boolean { return this.hasFailed || !!this.frames.at(-1)?.head.over; }
  has(step: number): boolean { return this.frames.length > step || this.over; }
  at(step: number): Frame | undefined { return this.frames[Math.min(step, this.frames.length - 1)]; }

  /** Asks for the next step, unless one is on its way. */
  advance() {
    if (this.isWaiting || this.over || !this.socket) return;
    this.isWaiting = true;
    this.socket.send({ type: "step" });
  }
}

interface Props { id: string; path: string; manifest: Manifest; receipt: Receipt | null; index: number; onMove: (index: number | null) => void }

export function PairView({ id, path, manifest, receipt, index, onMove }: Props) {
  const env = useGet<Env>("env", { id: manifest.env });
  const choices = useMemo(() => choicesOf(receipt, index, env.value), [receipt, index, env.value]);
  const first = receipt ? "policy" : choices.find(({ key }) => key !== "oracle")?.key ?? "oracle";
  const [chosen, setChosen] = useState<[string | null, string | null]>([null, null]);
  const keys = [chosen[0] ?? first, chosen[1] ?? beside(choices)];
  const replays = useRef([new Replay(), new Replay()]);
  const [step, setStep] = useState(0);
  const [playing, setPlaying] = useState(false);
  const [rate, setRate] = useState(10);
  const [, redraw] = useState(0);
  const clock = useRef({ step: 0, playing: false, single: false });
  clock.current.playing = playing;

  // Time passes for both at once: the next step is shown when both have it.
  useEffect(() => {
    let due = 0, frame = 0;
    const pass = (now: number) => {
      frame = requestAnimationFrame(pass);
      const state = clock.current, all = replays.current;
      if (!state.playing && !state.single) return;
      if (all.every((replay) => replay.over && replay.frames.length <= state.step + 1)) {
        state.single = false;
        setPlaying(false);
        return;
      }
      all.forEach((replay) => { if (!replay.has(state.step + 1)) replay.advance(); });
      if (now < due || !all.every((replay) => replay.has(state.step + 1))) return;
      due = now + 1000 / rate - 4;
      state.step += 1;
      state.single = false;
      setStep(state.step);
    };
    frame = requestAnimationFrame(pass);
    return () => cancelAnimationFrame(frame);
  }, [rate]);

  const go = (to: number) => { clock.current.step = Math.max(0, to); setStep(clock.current.step); };
  const once = () => { setPlaying(false); clock.current.single = true; };
  const furthest = Math.max(1, ...replays.current.map((replay) => replay.frames.length - 1));
  const play = () => {
    if (replays.current.every((replay) => replay.over) && clock.current.step >= furthest) go(0);
    setPlaying(!playing);
  };
  useEffect(() => {
    const pressed = (event: KeyboardEvent) => {
      const target = event.target as HTMLElement;
      if (target.matches("input, select, textarea") || event.metaKey || event.ctrlKey || event.altKey) return;
      if (event.key === " " && !target.matches("button, summary")) play();
      else if (event.key === ".") once();
      else if (event.key === ",") { setPlaying(false); go(clock.current.step - 1); }
      else if (event.key === "r") go(0);
      else return;
      event.preventDefault();
    };
    addEventListener("keydown", pressed);
    return () => removeEventListener("keydown", pressed);
  });

  const choose = (side: 0 | 1, key: string) => {
    setPlaying(false);
    go(0);
    setChosen(side === 0 ? [key, chosen[1]] : [chosen[0], key]);
  };
  const costs = replays.current.map((replay) => replay.frames.map((frame) => frame.cost));
  const rewards = replays.current.map((replay) => replay.frames.map((frame) => frame.head.points.at(-1)?.reward ?? null));
  const x = Array.from({ length: Math.max(...costs.map((list) => list.length)) }, (_, at) => at);
  const whole = (list: (number | null)[]) => x.map((at) => list[at] ?? null);
  const hasCost = costs.flat().some((cost) => cost !== null);
  const labels = keys.map((key) => choices.find((choice) => choice.key === key)?.label ?? key);
  const plotted = [x, ...(hasCost ? costs : rewards).map(whole)];
  const name = `${manifest.env.split("/").pop()}_pair_${index}`;
  const both = useRef<HTMLDivElement>(null);
  useEffect(() => both.current?.closest(".pair")?.scrollIntoView({ block: "start" }), [!env.value]);
  const png = () => {
    const images = [...both.current!.querySelectorAll("canvas.image")] as HTMLCanvasElement[];
    const canvas = document.createElement("canvas");
    canvas.width = images.reduce((width, image) => width + image.width, 0);
    canvas.height = Math.max(...images.map((image) => image.height));
    let left = 0;
    for (const image of images) { canvas.getContext("2d")!.drawImage(image, left, 0); left += image.width; }
    canvas.toBlob((blob) => blob && download(`${name}_step_${step}.png`, blob));
  };
  const pairs = manifest.pairs.length;
  return (
    <Panel title={`Pair ${index} of 0–${pairs - 1}`} class="pair" aside={
      <span class="row">
        <Button onClick={() => onMove(index - 1)} disabled={index <= 0} aria-label="Previous pair">◂</Button>
        <Button onClick={() => onMove(index + 1)} disabled={index + 1 >= pairs} aria-label="Next pair">▸</Button>
        <Button onClick={() => onMove(null)}>Close</Button>
      </span>
    }>
      <Notice text={env.error} />
      <div class="both" ref={both}>
        {env.value && ([0, 1] as const).map((side) => {
          const choice = choices.find(({ key }) => key === keys[side]);
          return (
            <div class="stack" key={side}>
              <select aria-label={side === 0 ? "Left" : "Right"} value={keys[side]} onChange={(event) => choose(side, event.currentTarget.value)}>
                {choices.map(({ key, label }) => <option key={key} value={key}>{label}</option>)}
              </select>
              {choice && <Side key={choice.key} id={id} index={index} manifest={manifest} choice={choice} name={`${name}_${side === 0 ? "left" : "right"}`} place={replays} side={side} step={step} onFrame={() => redraw((turn) => turn + 1)} />}
            </div>
          );
        })}
      </div>
      <div class="transport" role="toolbar" aria-label="Time">
        <Button onClick={() => go(0)} title="From the start (R)" aria-label="Start">|◂</Button>
        <Button onClick={() => { setPlaying(false); go(clock.current.step - 1); }} disabled={step === 0} title="A step back (,)" aria-label="Step back">−1</Button>
        <Button primary class="wide" onClick={play} title="Space">{playing ? "Pause" : "Play"}</Button>
        <Button onClick={once} title="One step (.)" aria-label="Step">+1</Button>
        <input type="range" class="time" aria-label="Step of both" min={0} max={furthest} value={step} onInput={(event) => { setPlaying(false); go(event.currentTarget.valueAsNumber); }} />
        <output class="steps">{step}</output>
        <select class="rate" aria-label="Steps per second" value={rate} onChange={(event) => setRate(Number(event.currentTarget.value))}>
          {[2, 5, 10, 20, 60].map((hz) => <option key={hz} value={hz}>{hz}/s</option>)}
        </select>
      </div>
      <figure>
        <figcaption>{hasCost ? "task cost" : "reward"}</figcaption>
        <Plot names={labels.map((label, at) => (at > 0 && labels[0] === label ? `${label} ` : label))} data={plotted} height={150} cursor={step} onPick={(at) => { setPlaying(false); go(Math.min(Math.round(at), furthest)); }} />
      </figure>
      <div class="row">
        <Button onClick={png}>Images as PNG</Button>
        <Button onClick={() => download(`${name}.csv`, csv(["step", "left_reward", "left_task_cost", "right_reward", "right_task_cost"], [x, rewards[0], costs[0], rewards[1], costs[1]].map((list) => (list === x ? x : whole(list)))))}>Steps as CSV</Button>
      </div>
      <CommandLine text={receipt ? `swm report ${path} --videos 10 --out report.html` : `swm eval --manifest ${path} --policy expert --reference oracle --out results`} />
    </Panel>
  );
}

/** The runs of a receipt, the oracle, and the policies of the environment. */
function choicesOf(receipt: Receipt | null, index: number, env: Env | null): Choice[] {
  const choices: Choice[] = [];
  if (receipt) choices.push({ key: "policy", label: receipt.policy, run: "policy", result: receipt.episodes[index] });
  receipt?.references.forEach((reference, at) => choices.push({
    key: `reference ${at}`, label: labelOf(reference.role.replace("_", "-"), reference.candidate.policy.name), run: { reference: at }, result: reference.episodes[index],
  }));
  if (!receipt?.references.some(({ role }) => role === "oracle")) choices.push({ key: "oracle", label: "oracle: run now", run: "oracle" });
  for (const { name, summary } of env?.policies ?? []) {
    if (!summary.includes("RUN") && !summary.includes("FILE") && !summary.includes("DIR")) choices.push({ key: `now ${name}`, label: `${name}: run now`, run: "policy", policy: name });
  }
  return choices;
}

function labelOf(role: string, name: string): string {
  return role === name ? name : `${role}: ${name}`;
}

/** The oracle, whether the receipt holds it or not. */
function beside(choices: Choice[]): string {
  return choices.find(({ label }) => label.startsWith("oracle"))?.key ?? choices.at(-1)?.key ?? "oracle";
}

interface SideProps {
  id: string; index: number; manifest: Manifest; choice: Choice; name: string;
  place: RefObject<Replay[]>; side: 0 | 1; step: number; onFrame: () => void;
}

/** One run: its image, and how it goes. */
function Side({ id, index, manifest, choice, name, place, side, step, onFrame }: SideProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const goal = useRef<HTMLCanvasElement>(null);
  const [hasGoal, setHasGoal] = useState(false);
  const [error, setError] = useState<string | null>(null);
  const [attempt, setAttempt] = useState(0);
  const latest = useRef(onFrame);
  latest.current = onFrame;
  useEffect(() => {
    const replay = (place.current![side] = new Replay());
    const socket = new Socket({
      opened: () => {},
      // The environments of the pair before may still be at their last step.
      closed: (reason) => {
        if (replay.frames.length > 0 || attempt >= ATTEMPTS) setError(reason);
        else setTimeout(() => setAttempt(attempt + 1), 1000);
      },
      goal: (size, rgb) => { setHasGoal(true); draw(goal.current, size, rgb); },
      video: (extension, content) => download(`${name}.${extension}`, content),
      message: (message) => {
        if (message.kind !== "error") return;
        replay.hasFailed = true;
        setError(message.text);
      },
      frame: (head, rgb) => {
        // Another policy may have been chosen after the start was shown.
        replay.frames.length = Math.min(replay.frames.length, head.step);
        replay.frames[head.step] = { head, rgb, cost: head.points.at(-1)?.cost ?? null };
        replay.isWaiting = false;
        latest.current();
      },
    });
    replay.socket = socket;
    // A frame is kept for every step.
    const image = manifest.budget > 400 ? 128 : 256;
    socket.send({ type: "open", env: manifest.env, image, max_steps: null, pair: { id, index, run: choice.run } });
    if (choice.policy) socket.send({ type: "policy", text: choice.policy });
    return () => socket.close();
  }, [id, index, choice.key, attempt]);
  const replay = place.current![side];
  const frame = replay.at(step);
  useEffect(() => { if (frame) draw(canvas.current, frame.head, frame.rgb); }, [frame]);
  const head = frame?.head;
  const last = replay.frames.at(-1)?.head;
  const { result } = choice;
  const isSame = result && last?.over ? last.success === result.success && last.step === result.steps : null;
  return (
    <>
      <Notice text={error} onClose={() => setError(null)} />
      <div class="screen">
        <canvas ref={canvas} class="image" width={256} height={256} aria-label={`${choice.label}, step ${head?.step ?? 0}`} />
        <figure class="goal" hidden={!hasGoal}><canvas ref={goal} aria-label="Goal" /><figcaption>goal</figcaption></figure>
        {head?.over && <div class={`outcome ${head.success ? "good" : ""}`}>{head.success ? "success" : "no success"}</div>}
      </div>
      <dl class="readout">
        <div><dt>step</dt><dd>{head?.step ?? "–"}</dd></div>
        <div><dt>success</dt><dd class={head?.success ? "good" : ""}>{!head || head.success === null ? "–" : head.success ? "yes" : "no"}</dd></div>
        <div><dt>reward</dt><dd>{number(head?.total_reward, 3)}</dd></div>
        <div><dt>task cost</dt><dd>{number(frame?.cost, 3)}</dd></div>
      </dl>
      {result && (
        <p class="muted">Receipt: {result.success ? "success" : "no success"}, {result.steps} steps
          {isSame !== null && (isSame ? <b class="good same"> · the same now</b> : <b class="bad differs"> · another result now: other code or another machine</b>)}
        </p>
      )}
      <p class="muted actor"><code>{head?.actor ?? ""}</code></p>
      <div class="row">
        <Button disabled={!last?.step} onClick={() => replay.socket?.send({ type: "video" })}>Run as MP4</Button>
        <a class="button" href={`#play?env=${encodeURIComponent(manifest.env)}&receipt=${encodeURIComponent(id)}&pair=${index}&run=${encodeURIComponent(JSON.stringify(choice.run))}`}>Open in Play</a>
      </div>
    </>
  );
}

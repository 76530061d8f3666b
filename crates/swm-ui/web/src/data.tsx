// Data: a dataset, or two side by side: episodes, player, distributions.

import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { type About, type Chosen, chosen, type Dataset, type Env, type Episodes, type File, url, type Values } from "./api";
import { Coverage, Histograms } from "./distribution";
import { Factors, type Scenario } from "./factors";
import { Button, CommandLine, Field, Notice, Panel, Save, csv, download, number, quoted, savePlots, useGet } from "./kit";
import { PickedPairs, type Picks, type Step } from "./picks";
import { Plot } from "./plot";

export function Data({ about, query }: { about: About; query: URLSearchParams }) {
  const files = useGet<{ files: File[] }>("files", {}, 5000);
  const datasets = files.value?.files.filter((file) => file.kind === "dataset") ?? [];
  const id = query.get("id") ?? datasets[0]?.id ?? null;
  const other = query.get("beside");
  const [opening, otherOpening] = [query.get("opening"), query.get("beside_opening")];
  const go = (next: Record<string, string | null>) => {
    const to = new URLSearchParams(Object.entries({ id, beside: other, opening, beside_opening: otherOpening, ...next }).filter((pair): pair is [string, string] => !!pair[1]));
    location.hash = `#data?${to}`;
  };
  if (files.value && datasets.length === 0) {
    return <Panel title="No datasets"><p>Start <code>swm ui PATH</code> with a dataset, or a folder that holds some. To record one: <code>swm collect swm/PushT-v1 --policy expert --episodes 20 --out pusht.h5</code>.</p></Panel>;
  }
  const choice = (value: string | null, label: string, key: string, none?: string) => (
    <Field label={label}>
      <select value={value ?? ""} onChange={(event) => go({ [key]: event.currentTarget.value, [key === "id" ? "opening" : "beside_opening"]: null })}>
        {none && <option value="">{none}</option>}
        {datasets.map((file) => <option key={file.id} value={file.id}>{short(file.name)} ({file.format})</option>)}
      </select>
    </Field>
  );
  return (
    <div class="data">
      <Notice text={files.error} />
      <div class="choice wide">{choice(id, "Dataset", "id")}{choice(other, "Side by side with", "beside", "–")}</div>
      <div class={other ? "panes two" : "panes"}>
        {id && <Pane key={id + opening} of={{ id, opening }} about={about} onOpen={(next) => go({ opening: next })} />}
        {other && <Pane key={"b" + other + otherOpening} of={{ id: other, opening: otherOpening }} about={about} onOpen={(next) => go({ beside_opening: next })} />}
      </div>
    </div>
  );
}

function short(name: string): string {
  return name.split("/").slice(-2).join("/");
}

function Pane({ of, about, onOpen }: { of: Chosen; about: About; onOpen: (opening: string | null) => void }) {
  // A dataset that is being recorded grows.
  const found = useGet<Dataset>("data", chosen(of), 2000);
  const [picks, setPicks] = useState<Picks>({ start: null, pairs: [] });
  const [tab, setTab] = useState<"episodes" | "distributions" | "about">("episodes");
  const [episode, setEpisode] = useState<number | null>(null);
  const data = found.value;
  const options = <Opening given={of.opening} shown={!data && !!found.error} onOpen={onOpen} />;
  if (!data) return <div><Notice text={found.error} />{options}</div>;
  return (
    <div class="pane">
      <Notice text={found.error} />
      <div class="facts">
        <b title={data.path}>{short(data.path)}</b>
        <span>{data.format}</span><span>{number(data.episodes)} episodes</span><span>{number(data.steps)} steps</span>
        <span>{data.shortest}–{data.longest} per episode</span>
        {data.runs[0] && <span>{data.runs[0].run.env}</span>}
      </div>
      <div class="tabs" role="tablist">
        {(["episodes", "distributions", "about"] as const).map((name) => (
          <button key={name} type="button" role="tab" aria-selected={tab === name} onClick={() => setTab(name)}>{name}</button>
        ))}
      </div>
      {tab === "episodes" && (episode === null
        ? <Grid of={of} data={data} onOpen={setEpisode} />
        : <Player of={of} data={data} episode={episode} picks={picks} onPick={setPicks} onMove={setEpisode} onClose={() => setEpisode(null)} />)}
      {tab === "episodes" && (episode !== null || picks.start !== null || picks.pairs.length > 0) && (
        <PickedPairs about={about} of={of} data={data} picks={picks} onChange={setPicks} image={([episode, step]) => imageUrl(of, data, episode, step, 96)} />
      )}
      {tab === "distributions" && <Distributions of={of} data={data} />}
      {tab === "about" && <AboutData data={data} />}
      {tab === "about" && options}
    </div>
  );
}

/** How a dataset of another program is opened: what its files do not say, or say in several forms. */
function Opening({ given, shown, onOpen }: { given: string | null; shown: boolean; onOpen: (opening: string | null) => void }) {
  const known = useMemo(() => {
    try { return JSON.parse(given ?? "{}") as Record<string, unknown>; } catch { return {}; }
  }, [given]);
  const sized = known.image_size as { height: number; width: number } | undefined;
  const [form, setForm] = useState<Record<string, string>>({
    camera: String(known.camera ?? ""), split: String(known.split ?? ""), flip: String(known.flip ?? ""), channels: String(known.channels ?? ""), fit: String(known.fit ?? ""),
    image_size: sized ? `${sized.height}x${sized.width}` : "",
    map: Object.entries((known.map ?? {}) as Record<string, string>).map(([to, from]) => `${to}=${from}`).join(","),
  });
  const field = (name: string, label: string, hint: string) => (
    <Field label={label}><input value={form[name]} placeholder={hint} onInput={(event) => setForm({ ...form, [name]: event.currentTarget.value })} /></Field>
  );
  const choice = (name: string, label: string, values: string[]) => (
    <Field label={label}><select value={form[name]} onChange={(event) => setForm({ ...form, [name]: event.currentTarget.value })}>
      <option value="">–</option>{values.map((value) => <option key={value}>{value}</option>)}
    </select></Field>
  );
  const open = () => {
    const next: Record<string, unknown> = { ...known };
    for (const name of ["camera", "split", "flip", "channels", "fit"]) next[name] = form[name] || undefined;
    const pairs = (form.map ?? "").split(",").map((pair) => pair.split("=").map((part) => part.trim())).filter(([to, from]) => to && from);
    next.map = pairs.length ? Object.fromEntries(pairs) : undefined;
    const [height, width] = (form.image_size ?? "").split("x").map(Number);
    next.image_size = height ? { height, width: width || height } : undefined;
    const text = JSON.stringify(next);
    onOpen(text === "{}" ? null : text);
  };
  return (
    <details open={shown}><summary><b>How it is opened</b>{given && <span class="badge">changed</span>}</summary>
      <p class="muted">For datasets of other programs: what their files do not say, or say in several forms.</p>
      <form class="filters" onSubmit={(event) => { event.preventDefault(); open(); }}>
        {field("camera", "Camera", "top")}{field("split", "Part", "val")}{field("map", "Names of columns", "new=old,…")}
        {choice("flip", "Turn images", ["vertical", "180"])}{choice("channels", "Channels given to OpenCV", ["rgb", "bgr"])}{field("image_size", "Size of images", "64x64")}{choice("fit", "Fit", ["stretch", "crop", "pad"])}
        <Button primary type="submit">Open</Button>
        {given && <Button onClick={() => onOpen(null)}>Without options</Button>}
      </form>
    </details>
  );
}

function imageUrl(of: Chosen, data: Dataset, episode: number, step: number, side: number, set?: Record<string, unknown>): string | null {
  const isChanged = set && Object.keys(set).length > 0;
  if (data.images.length > 0 && !isChanged) return url("data/image", { ...chosen(of), episode, step });
  if (!data.can_render) return null;
  return url("data/image", { ...chosen(of), episode, step, render: side, set: isChanged ? JSON.stringify(set) : null });
}

const PAGE = 48;

function Grid({ of, data, onOpen }: { of: Chosen; data: Dataset; onOpen: (episode: number) => void }) {
  const [filter, setFilter] = useState<Record<string, string>>({});
  const [first, setFirst] = useState(0);
  const [pending, setPending] = useState(false);
  const found = useGet<Episodes>("data/episodes", { ...chosen(of), first, count: PAGE, grown: data.episodes, ...filter }, pending ? 300 : 0);
  const list = found.value;
  useEffect(() => setPending(!!list && list.known < list.of), [list]);
  const change = (next: Record<string, string>) => {
    setFirst(0);
    setFilter(Object.fromEntries(Object.entries({ ...filter, ...next }).filter(([, value]) => value !== "")));
  };
  const constants = data.columns.filter((column) => column.kind === "episode" && column.dtype !== "string" && column.shape.length < 2);
  const bound = (name: string, label: string) => (
    <input type="number" step="any" placeholder={label} aria-label={`${name} ${label}`} value={filter[name] ?? ""} onInput={(event) => change({ [name]: event.currentTarget.value })} />
  );
  return (
    <>
      <div class="filters">
        <Field label="Success"><select value={filter.success ?? ""} onChange={(event) => change({ success: event.currentTarget.value })}><option value="">any</option><option value="true">yes</option><option value="false">no</option></select></Field>
        <Field label="Length"><span class="range">{bound("min_length", "min")}{bound("max_length", "max")}</span></Field>
        <Field label="Return"><span class="range">{bound("min_return", "min")}{bound("max_return", "max")}</span></Field>
        <Field label="Factor">
          <select value={filter.factor ?? ""} onChange={(event) => change({ factor: event.currentTarget.value })}>
            <option value="">–</option>
            {constants.flatMap((column) => {
              const size = column.shape[0] ?? 1;
              return Array.from({ length: Math.min(size, 8) }, (_, i) => (size === 1 ? column.name : `${column.name}[${i}]`));
            }).map((name) => <option key={name} value={name}>{name.replace("variation.", "")}</option>)}
          </select>
        </Field>
        {filter.factor && <Field label="between"><span class="range">{bound("min_factor", "min")}{bound("max_factor", "max")}</span></Field>}
        <Field label="Order">
          <select value={filter.sort ?? ""} onChange={(event) => change({ sort: event.currentTarget.value })}>
            <option value="">as recorded</option><option value="length">shortest</option><option value="-length">longest</option>
            <option value="-return">highest return</option><option value="return">lowest return</option>
          </select>
        </Field>
      </div>
      <Notice text={found.error} />
      {list && (
        <>
          <div class="row between">
            <p class="muted">{number(list.matching)} of {number(list.of)} episodes{list.known < list.of ? `; ${number(list.known)} read so far` : ""}</p>
            <Save name="episodes.csv" columns={["episode", "length", "return", "success"]} rows={list.episodes.map((one) => [one.episode, one.length, one.total_reward, one.success])} />
          </div>
          <div class="thumbs">
            {list.episodes.map((episode) => {
              const src = imageUrl(of, data, episode.episode, Math.max(0, Math.floor((episode.length - 1) * 0.75)), 96);
              return (
                <button type="button" key={episode.episode} onClick={() => onOpen(episode.episode)} class="thumb">
                  {src ? <img src={src} loading="lazy" alt={`Episode ${episode.episode}`} width="96" height="96" /> : <span class="blank">no image</span>}
                  <span><b>{episode.episode}</b>{episode.success !== null && <i class={episode.success ? "ok" : "no"}>{episode.success ? "success" : "no success"}</i>}</span>
                  <small>{episode.length} steps{episode.total_reward !== null && ` · ${number(episode.total_reward, 3)}`}</small>
                </button>
              );
            })}
          </div>
          {list.matching > PAGE && (
            <div class="row pages">
              <Button disabled={first === 0} onClick={() => setFirst(Math.max(0, first - PAGE))}>◂ earlier</Button>
              <span>{first + 1}–{Math.min(first + PAGE, list.matching)}</span>
              <Button disabled={first + PAGE >= list.matching} onClick={() => setFirst(first + PAGE)}>later ▸</Button>
            </div>
          )}
          {list.episodes.length > 0 && <CommandLine text={`swm preview ${quoted(data.path)} --episodes ${list.episodes.slice(0, 16).map((one) => one.episode).join(",")} --out episodes.png`} />}
        </>
      )}
    </>
  );
}

interface PlayerProps {
  of: Chosen; data: Dataset; episode: number; picks: Picks; onPick: (picks: Picks) => void;
  onMove: (episode: number) => void; onClose: () => void;
}

function Player({ of, data, episode, picks, onPick, onMove, onClose }: PlayerProps) {
  const values = useGet<Values>("data/values", { ...chosen(of), episode });
  const env = useGet<Env>(data.can_render && data.runs[0] ? "env" : null, { id: data.runs[0]?.run.env });
  const [step, setStep] = useState(0);
  const [playing, setPlaying] = useState(false);
  const [scenario, setScenario] = useState<Scenario>({ set: {}, vary: [] });
  const [failed, setFailed] = useState<string | null>(null);
  const length = values.value?.length ?? 1;
  const last = length - 1;
  useEffect(() => { setStep(0); setPlaying(false); }, [episode]);
  useEffect(() => setFailed(null), [episode, scenario]);
  useEffect(() => {
    if (!playing) return;
    const timer = setInterval(() => setStep((at) => {
      if (at >= last) setPlaying(false);
      return Math.min(at + 1, last);
    }), 66);
    return () => clearInterval(timer);
  }, [playing, last]);
  const numeric = useMemo(() => Object.entries(values.value?.columns ?? {}).filter(([name]) => !["ep_idx", "checkpoint"].includes(name)), [values.value]);
  const x = useMemo(() => Array.from({ length: numeric[0]?.[1][0]?.length ?? 0 }, (_, row) => row * (values.value?.stride ?? 1)), [numeric]);
  const src = imageUrl(of, data, episode, step, 256, scenario.set);
  const plots = useRef<HTMLDivElement>(null);
  const here: Step = [episode, step];
  const pickGoal = () => {
    if (!picks.start) return;
    const pair = { start: picks.start, goal: here };
    const isKnown = picks.pairs.some((other) => JSON.stringify(other) === JSON.stringify(pair));
    onPick({ start: null, pairs: isKnown ? picks.pairs : [...picks.pairs, pair] });
  };
  const explain = async () => {
    if (!src) return;
    const answer = await fetch(src).then((response) => (response.ok ? null : response.json())).catch(() => null);
    if (answer) setFailed(answer.error);
  };
  return (
    <div class="player">
      <div class="row between">
        <Button onClick={onClose}>◂ all episodes</Button>
        <b>Episode {episode}</b>
        <span class="row">
          <Button disabled={episode === 0} onClick={() => onMove(episode - 1)} aria-label="Previous episode">◂</Button>
          <Button disabled={episode + 1 >= data.episodes} onClick={() => onMove(episode + 1)} aria-label="Next episode">▸</Button>
        </span>
      </div>
      <Notice text={values.error ?? failed} />
      <div class="player-body">
        <div>
          {src ? <Steady src={src} alt={`Step ${step} of episode ${episode}`} onError={explain} /> : <p class="muted">The dataset holds no images, and does not say how they could be rendered.</p>}
          <div class="transport">
            <Button primary class="wide" onClick={() => { if (step >= last) setStep(0); setPlaying(!playing); }}>{playing ? "Pause" : "Play"}</Button>
            <input type="range" class="time" aria-label="Step" min={0} max={Math.max(last, 1)} value={step} onInput={(event) => { setPlaying(false); setStep(Math.min(event.currentTarget.valueAsNumber, last)); }} />
            <output class="steps">{step}/{last}</output>
          </div>
          {data.runs[0] && (
            <div class="row">
              <Button on={picks.start?.join() === here.join()} onClick={() => onPick({ ...picks, start: here })} title="This step is the start of a pair">Start here</Button>
              <Button disabled={!picks.start} onClick={pickGoal} title="This step is the goal: the pair is listed below">Goal here</Button>
              {picks.start && <small>start: step {picks.start[1]} of episode {picks.start[0]}</small>}
            </div>
          )}
          {env.value && env.value.factors.length > 0 && (
            <details><summary><b>Other factors</b>{Object.keys(scenario.set).length > 0 && <span class="badge">{Object.keys(scenario.set).length} set</span>}</summary>
              <p class="muted">The episode is rendered again with these. A factor that would change what happens is refused.</p>
              <Factors factors={env.value.factors} values={recorded(values.value, scenario)} scenario={scenario} onChange={(next) => setScenario({ ...next, vary: [] })} />
            </details>
          )}
          <div class="row">
            {src && <a class="button" href={src} download={`episode_${episode}_step_${step}.png`}>Image as PNG</a>}
            {src && <a class="button" href={src.replace("data/image?", "data/video?")} download={`episode_${episode}.mp4`}>Episode as MP4</a>}
            <Button disabled={numeric.length === 0} onClick={() => {
              const named = numeric.flatMap(([name, list]) => list.map((column, i) => [list.length > 1 ? `${name}[${i}]` : name, column] as const));
              download(`episode_${episode}.csv`, csv(["step", ...named.map(([name]) => name)], [x, ...named.map(([, column]) => column)]));
            }}>Columns as CSV</Button>
            <Button disabled={numeric.length === 0} onClick={() => savePlots(`episode_${episode}_plots.png`, plots.current)}>Plots as PNG</Button>
          </div>
          <CommandLine text={`swm preview ${quoted(data.path)} --episodes ${episode} --out episode_${episode}.mp4`} />
        </div>
        <div class="plots" ref={plots}>
          {numeric.map(([name, series]) => (
            <figure key={name}>
              <figcaption>{name}</figcaption>
              <Plot names={series.slice(0, 8).map((_, i) => (series.length > 1 ? `[${i}]` : name))} data={[x, ...series.slice(0, 8)]} height={110} cursor={step} onPick={(at) => setStep(Math.min(Math.max(0, Math.round(at)), last))} />
            </figure>
          ))}
        </div>
      </div>
      <details><summary><b>Constants of the episode</b></summary>
        <table class="small"><tbody>
          {Object.entries(values.value?.constants ?? {}).map(([name, list]) => <tr key={name}><th>{name}</th><td><code>{list.map((v) => number(v)).join(", ")}</code></td></tr>)}
        </tbody></table>
      </details>
    </div>
  );
}

/** An image that keeps the last one until the next is there. */
function Steady({ src, alt, onError }: { src: string; alt: string; onError: () => void }) {
  const [shown, setShown] = useState(src);
  const wanted = useRef(src);
  useEffect(() => {
    wanted.current = src;
    const image = new Image();
    image.onload = () => { if (wanted.current === src) setShown(src); };
    image.onerror = onError;
    image.src = src;
  }, [src]);
  return <div class="screen"><img src={shown} alt={alt} onError={() => {}} /></div>;
}

function recorded(values: Values | null, scenario: Scenario): Record<string, unknown> {
  const stored = Object.entries(values?.constants ?? {}).filter(([name]) => name.startsWith("variation."));
  return { ...Object.fromEntries(stored.map(([name, list]) => [name.slice("variation.".length), list.length === 1 ? list[0] : list])), ...scenario.set };
}

function Distributions({ of, data }: { of: Chosen; data: Dataset }) {
  const names = data.columns
    .filter((column) => column.dtype !== "string" && column.shape.reduce((a, b) => a * b, 1) <= 32 && column.name !== "ep_idx")
    .map((column) => column.name);
  const [name, setName] = useState(names.includes("state") ? "state" : names[0] ?? "");
  const sample = useGet<{ name: string; values: (number | null)[][] }>(name ? "data/sample" : null, { ...chosen(of), column: name, grown: data.episodes });
  const groups = [["Columns", names.filter((known) => !known.startsWith("variation."))], ["Factors", names.filter((known) => known.startsWith("variation."))]] as const;
  return (
    <div class="distributions">
      <Field label="Column"><select value={name} onChange={(event) => setName(event.currentTarget.value)}>
        {groups.map(([label, list]) => list.length > 0 && <optgroup key={label} label={label}>{list.map((known) => <option key={known}>{known}</option>)}</optgroup>)}
      </select></Field>
      <Notice text={sample.error} />
      {sample.value && <p class="muted">{number(sample.value.values[0]?.length ?? 0)} values, spread evenly over the episodes.</p>}
      {sample.value && <Histograms values={sample.value.values} />}
      {sample.value && sample.value.values.length > 1 && <Coverage key={name} values={sample.value.values} name={name} />}
      {sample.value && <div class="row"><Button onClick={() => download(`${name}.csv`, csv(sample.value!.values.map((_, i) => (sample.value!.values.length > 1 ? `${name}[${i}]` : name)), sample.value!.values))}>Values as CSV</Button></div>}
      <CommandLine text={`swm stats ${quoted(data.path)}`} />
    </div>
  );
}

function AboutData({ data }: { data: Dataset }) {
  return (
    <div class="stack">
      <div class="scroll"><table class="small">
        <thead><tr><th>column</th><th>type</th><th>shape</th><th>per</th></tr></thead>
        <tbody>{data.columns.map((column) => <tr key={column.name}><td><code>{column.name}</code></td><td>{column.dtype}</td><td>{column.shape.length ? column.shape.join(" × ") : "–"}</td><td>{column.kind}</td></tr>)}</tbody>
      </table></div>
      {data.skipped.map((column) => <p key={column.name} class="muted">Left out <code>{column.name}</code>: {column.reason}</p>)}
      {data.runs.map(({ first_episode, run }) => (
        <p key={first_episode}>From episode {first_episode}: <code>{run.env}</code>, policy <code>{run.policy}</code>, seed {run.seed}{run.variation?.length ? `, sampled ${run.variation.join(", ")}` : ""}</p>
      ))}
      {data.mapping.length > 0 && <p>Columns in the files: {data.mapping.map(([to, from]) => <span key={to}><code>{to}</code> ← <code>{from}</code>{" "}</span>)}</p>}
      {data.notes.map((note) => <p key={note} class="muted">{note}</p>)}
      {data.runs.length === 0 && <p class="muted">The dataset does not say how it was recorded.</p>}
      <CommandLine text={`swm inspect ${quoted(data.path)}`} />
    </div>
  );
}

// Results: receipts side by side, sweeps as heat maps, manifests, evaluations, curves of training runs, jobs.

import { useMemo, useRef, useState } from "preact/hooks";
import type { File } from "./api";
import { JobView } from "./job";
import { Button, CommandLine, Field, Notice, Panel, Save, csv, download, number, quoted, savePlots, useGet } from "./kit";
import { PairView } from "./pair";
import { Plot } from "./plot";

interface Summary { episodes: number; successes: number; success_rate: number; ci95: [number, number]; mean_success_steps: number | null }
export interface PairResult { success: boolean; solved_at_start: boolean; steps: number; total_reward?: number; final_cost?: number }
export interface Receipt {
  manifest_hash: string; policy: string; summary: Summary; episodes: PairResult[]; manifest: Manifest; wall_time_s: number;
  references: { role: string; candidate: { policy: { name: string } }; summary: Summary; episodes: PairResult[] }[];
}
export interface Manifest { env: string; tier: string; budget: number; pairs: unknown[]; seed: number; frame_skip: number }
interface Sweep { env: string; policy: string; tier: string; cells: { name: string; scope: string; value: string; summary: Summary | null }[] }
interface Result<T> { kind: string; path: string; content: T }

export function Results({ query }: { query: URLSearchParams }) {
  const files = useGet<{ files: File[] }>("files", {}, 5000);
  const list = files.value?.files.filter((file) => file.kind !== "dataset") ?? [];
  const id = query.get("id") ?? list.find((file) => file.kind === "receipt")?.id ?? list[0]?.id ?? null;
  const file = list.find((known) => known.id === id);
  const pair = query.has("pair") ? Number(query.get("pair")) : null;
  if (files.value && list.length === 0) {
    return <Panel title="No results"><p>Start <code>swm ui PATH</code> with a folder of results: what <code>swm eval --manifest … --out DIR</code>, <code>swm sweep</code>, <code>swm train</code> and <code>swm submit</code> write.</p></Panel>;
  }
  const kinds = [...new Set(list.map((known) => known.kind))];
  return (
    <div class="results">
      <Notice text={files.error} />
      <nav class="files" aria-label="Results">
        {kinds.map((kind) => (
          <div key={kind}>
            <h3>{kind === "training" ? "training runs" : `${kind}s`}</h3>
            {list.filter((known) => known.kind === kind).map((known) => (
              <a key={known.id} href={`#results?id=${encodeURIComponent(known.id)}`} aria-current={known.id === id ? "true" : undefined} title={known.name}>{label(known)}</a>
            ))}
          </div>
        ))}
      </nav>
      <div class="result">
        {file?.kind === "receipt" && <Receipts key={file.id} first={file} pair={pair} all={list.filter((known) => known.kind === "receipt")} />}
        {file?.kind === "sweep" && <SweepView id={file.id} />}
        {file?.kind === "manifest" && <ManifestView key={file.id} id={file.id} pair={pair} />}
        {file?.kind === "evaluation" && <EvaluationView id={file.id} />}
        {file?.kind === "training" && <Training id={file.id} />}
        {file?.kind === "job" && <JobView key={file.id} id={file.id} />}
      </div>
    </div>
  );
}


/** Shows a pair, or none. */
function showPair(id: string, index: number | null) {
  location.hash = `#results?id=${encodeURIComponent(id)}${index === null ? "" : `&pair=${index}`}`;
}

function label(file: File): string {
  const parts = file.name.split("/");
  return ["receipt.json", "sweep.json", "result.json"].includes(parts.at(-1)!) ? parts.slice(-2, -1)[0] : parts.at(-1)!;
}

function Interval({ summary }: { summary: Summary }) {
  const { success_rate: rate, ci95 } = summary;
  return (
    <svg class="interval" viewBox="0 0 100 10" preserveAspectRatio="none" role="img" aria-label={`${number(rate)} %, 95 % interval ${number(ci95[0])} to ${number(ci95[1])}`}>
      <rect x="0" y="4.5" width="100" height="1" class="rail" />
      <rect x={ci95[0]} y="2" width={Math.max(ci95[1] - ci95[0], 0.5)} height="6" class="band" />
      <rect x={Math.min(rate, 99)} y="0" width="1" height="10" class="at" />
    </svg>
  );
}

/** The chosen receipt, and others on the same manifest beside it. */
function Receipts({ first, all, pair }: { first: File; all: File[]; pair: number | null }) {
  const main = useGet<Result<Receipt>>("result", { id: first.id });
  return (
    <>
      <Notice text={main.error} />
      {main.value && <Panel title={main.value.content.policy}>
        <ReceiptTable main={main.value.content} id={first.id} others={all.filter((file) => file.id !== first.id)} />
        <CommandLine text={`swm verify-result ${quoted(main.value.path)}`} />
      </Panel>}
      {main.value && pair !== null && main.value.content.manifest.pairs[pair] !== undefined && (
        <PairView key={pair} id={first.id} path={quoted(main.value.path)} manifest={main.value.content.manifest} receipt={main.value.content} index={pair} onMove={(index) => showPair(first.id, index)} />
      )}
    </>
  );
}

function ReceiptTable({ main, id, others }: { main: Receipt; id: string; others: File[] }) {
  const { manifest } = main;
  return (
    <>
      <div class="row between">
        <div class="facts"><span>{manifest.env}</span><span>tier {manifest.tier}</span><span>{manifest.pairs.length} pairs</span><span>budget {manifest.budget}</span><span title={main.manifest_hash}>manifest {main.manifest_hash.slice(0, 10)}</span></div>
        <Save name="receipt.csv" columns={["policy", "pair", "success", "steps", "reward", "final_cost"]} rows={
          [{ name: main.policy, episodes: main.episodes }, ...main.references.map(({ role, episodes }) => ({ name: role, episodes }))]
            .flatMap(({ name, episodes }) => episodes.map((one, pair) => [name, pair, one.success, one.steps, one.total_reward, one.final_cost]))
        } />
      </div>
      <div class="scroll"><table class="outcomes">
        <thead><tr><th>policy</th><th class="num">success</th><th>95 % interval</th><th class="num">steps</th><th>pairs: a click replays one beside the oracle</th></tr></thead>
        <tbody>
          <ReceiptRow name={main.policy} summary={main.summary} episodes={main.episodes} id={id} />
          {main.references.map((reference, index) => (
            <ReceiptRow key={index} name={`${reference.candidate.policy.name} (${reference.role})`} summary={reference.summary} episodes={reference.episodes} id={id} />
          ))}
          {others.map((file) => <OtherRow key={file.id} file={file} hash={main.manifest_hash} />)}
        </tbody>
      </table></div>
    </>
  );
}

function OtherRow({ file, hash }: { file: File; hash: string }) {
  const other = useGet<Result<Receipt>>("result", { id: file.id });
  const receipt = other.value?.content;
  if (!receipt || receipt.manifest_hash !== hash) return null;
  return <ReceiptRow name={receipt.policy} summary={receipt.summary} episodes={receipt.episodes} id={file.id} />;
}

function ReceiptRow({ name, summary, episodes, id }: { name: string; summary: Summary; episodes: PairResult[]; id: string }) {
  return (
    <tr>
      <td><code>{name}</code></td>
      <td class="num">{number(summary.success_rate, 3)} %</td>
      <td><Interval summary={summary} /><small>{number(summary.ci95[0], 3)}–{number(summary.ci95[1], 3)}</small></td>
      <td class="num">{number(summary.mean_success_steps, 3)}</td>
      <td>
        <div class="strip">
          {episodes.map((episode, index) => {
            const text = `pair ${index}: ${episode.success ? "success" : "no success"}, ${episode.steps} steps`;
            return <a key={index} class={episode.success ? "ok" : "no"} title={text} aria-label={text} href={`#results?id=${encodeURIComponent(id)}&pair=${index}`} />;
          })}
        </div>
      </td>
    </tr>
  );
}

function SweepView({ id }: { id: string }) {
  const sweep = useGet<Result<Sweep>>("result", { id });
  const cells = sweep.value?.content.cells ?? [];
  return (
    <>
      <Notice text={sweep.error} />
      {sweep.value && <Panel title={sweep.value.content.policy}>
        <div class="row between">
          <div class="facts"><span>{sweep.value.content.env}</span><span>tier {sweep.value.content.tier}</span><span>{cells.length} cells</span></div>
          <Save name="sweep.csv" columns={["changed", "value", "success_rate", "ci95_low", "ci95_high"]} rows={cells.map(({ name, value, summary }) => [name, value, summary?.success_rate, summary?.ci95[0], summary?.ci95[1]])} />
        </div>
        <div class="scroll"><table class="outcomes">
          <thead><tr><th>changed</th><th class="num">success</th><th>95 % interval</th></tr></thead>
          <tbody>{cells.map((cell, index) => cell.summary && (
            <tr key={index}>
              <td>{cell.name} <small>{cell.value}</small></td>
              <td class="num heat" style={{ "--level": cell.summary.success_rate / 100 }}>{number(cell.summary.success_rate, 3)} %</td>
              <td><Interval summary={cell.summary} /><small>{number(cell.summary.ci95[0], 3)}–{number(cell.summary.ci95[1], 3)}</small></td>
            </tr>
          ))}</tbody>
        </table></div>
        <CommandLine text={`swm report ${quoted(sweep.value.path)}`} />
      </Panel>}
    </>
  );
}

function ManifestView({ id, pair }: { id: string; pair: number | null }) {
  const manifest = useGet<Result<Manifest>>("result", { id });
  const content = manifest.value?.content;
  return (
    <>
      <Notice text={manifest.error} />
      {content && <Panel title={content.env}>
        <div class="facts"><span>tier {content.tier}</span><span>{content.pairs.length} pairs</span><span>budget {content.budget}</span><span>seed {content.seed}</span><span>frame skip {content.frame_skip}</span></div>
        <div class="strip large">{content.pairs.map((_, index) => (
          <a key={index} class="plain" href={`#results?id=${encodeURIComponent(id)}&pair=${index}`} title={`play pair ${index} beside the oracle`}>{index}</a>
        ))}</div>
        <CommandLine text={`swm eval --manifest ${quoted(manifest.value!.path)} --policy expert --out results`} />
      </Panel>}
      {content && pair !== null && content.pairs[pair] !== undefined && (
        <PairView key={pair} id={id} path={quoted(manifest.value!.path)} manifest={content} receipt={null} index={pair} onMove={(index) => showPair(id, index)} />
      )}
    </>
  );
}

interface Evaluation { success_rate: number; ci95: [number, number]; episodes: number; episode_successes?: boolean[]; episode_returns?: number[]; episode_lengths?: number[]; setup?: { env: string; policy: string; seed: number } }

function EvaluationView({ id }: { id: string }) {
  const evaluation = useGet<Result<Evaluation>>("result", { id });
  const content = evaluation.value?.content;
  const x = content?.episode_returns?.map((_, index) => index) ?? [];
  return (
    <>
      <Notice text={evaluation.error} />
      {content && <Panel title={content.setup?.policy ?? "Evaluation"}>
        <div class="facts"><span>{content.setup?.env}</span><span>{content.episodes} episodes</span><span>{number(content.success_rate, 3)} % successful</span><span>95 % interval {number(content.ci95?.[0], 3)}–{number(content.ci95?.[1], 3)}</span></div>
        {content.episode_successes && <div class="strip">{content.episode_successes.map((ok, index) => <i key={index} class={ok ? "ok" : "no"} title={`episode ${index}`} />)}</div>}
        <div class="row"><Button onClick={() => download("episodes.csv", csv(["episode", "success", "return", "length"], [x, content.episode_successes ?? [], content.episode_returns ?? [], content.episode_lengths ?? []]))}>Episodes as CSV</Button></div>
        {content.episode_returns && <figure><figcaption>return by episode</figcaption><Plot names={["return"]} data={[x, content.episode_returns]} xLabel="episode" /></figure>}
        {content.setup && <CommandLine text={`swm eval ${quoted(content.setup.env)} --policy ${quoted(content.setup.policy)} --seed ${content.setup.seed} --episodes ${content.episodes} --out results`} />}
      </Panel>}
    </>
  );
}

interface Curves { path: string; config: unknown; series: Record<string, Record<string, [number, number | null][]>> }

function Training({ id }: { id: string }) {
  const run = useGet<Curves>("training", { id }, 3000);
  const [log, setLog] = useState(false);
  const curves = useRef<HTMLDivElement>(null);
  const names = useMemo(() => [...new Set(Object.values(run.value?.series ?? {}).flatMap((part) => Object.keys(part)))].filter((name) => name !== "epoch"), [run.value]);
  return (
    <>
      <Notice text={run.error} />
      {run.value && <Panel title={run.value.path.split("/").at(-1)} aside={<Field label="log"><input type="checkbox" checked={log} onChange={(event) => setLog(event.currentTarget.checked)} /></Field>}>
        <div class="row">
          <Button onClick={() => savePlots("curves.png", curves.current)}>Curves as PNG</Button>
          <Save name="curves.csv" columns={["part", "name", "step", "value"]} rows={Object.entries(run.value.series).flatMap(([part, all]) => Object.entries(all).flatMap(([name, points]) => points.map(([step, value]) => [part, name, step, value])))} />
        </div>
        <div class="curves" ref={curves}>{names.map((name) => <Curve key={name} name={name} series={run.value!.series} log={log} />)}</div>
        <CommandLine text={`swm train --resume ${quoted(run.value.path)}`} />
        <details><summary><b>Settings</b></summary><pre>{JSON.stringify(run.value.config, null, 2)}</pre></details>
      </Panel>}
    </>
  );
}

function Curve({ name, series, log }: { name: string; series: Curves["series"]; log: boolean }) {
  const parts = Object.keys(series).filter((part) => series[part][name]);
  const data = useMemo(() => {
    const steps = [...new Set(parts.flatMap((part) => series[part][name].map(([step]) => step)))].sort((a, b) => a - b);
    return [steps, ...parts.map((part) => {
      const known = new Map(series[part][name]);
      return steps.map((step) => known.get(step) ?? null);
    })];
  }, [series, name]);
  const isPositive = data.slice(1).flat().every((value) => value === null || value > 0);
  return <figure><figcaption>{name}</figcaption><Plot names={parts} data={data} height={140} log={log && isPositive} /></figure>;
}

// Factors of variation as controls, made from the environment's table.

import { useMemo, useState } from "preact/hooks";
import type { Factor } from "./api";
import { Button, NumberInput, number } from "./kit";

/** What an episode is asked for: factors to set, and those to sample; none: the environment's default list. */
export interface Scenario { set: Record<string, unknown>; vary: string[] | null }

interface Props {
  factors: Factor[];
  /** The factors of the running episode. */
  values: Record<string, unknown>;
  scenario: Scenario;
  onChange: (scenario: Scenario) => void;
}

export function Factors({ factors, values, scenario, onChange }: Props) {
  const [filter, setFilter] = useState("");
  const groups = useMemo(() => {
    const groups = new Map<string, Factor[]>();
    for (const factor of factors) {
      const dot = factor.name.lastIndexOf(".");
      const group = dot < 0 ? "" : factor.name.slice(0, dot);
      groups.set(group, [...(groups.get(group) ?? []), factor]);
    }
    return [...groups];
  }, [factors]);
  const asked = scenario.vary ?? factors.filter((factor) => factor.sampled).map((factor) => factor.name);
  const samples = (name: string) => asked.some((known) => known === "all" || name === known || name.startsWith(known + "."));
  const set = (name: string, value: unknown) => onChange({ ...scenario, set: { ...scenario.set, [name]: value } });
  const clear = (names: string[]) => {
    const rest = Object.fromEntries(Object.entries(scenario.set).filter(([name]) => !names.includes(name)));
    onChange({ set: rest, vary: asked.filter((name) => !names.includes(name)) });
  };
  const sample = (names: string[]) => {
    const rest = Object.fromEntries(Object.entries(scenario.set).filter(([name]) => !names.includes(name)));
    onChange({ set: rest, vary: [...new Set([...asked, ...names])] });
  };
  const all = factors.map((factor) => factor.name);
  const shown = (factor: Factor) => !filter || `${factor.name} ${factor.doc}`.toLowerCase().includes(filter.toLowerCase());
  return (
    <div class="factors">
      <div class="row">
        <input type="search" placeholder="Find a factor" aria-label="Find a factor" value={filter} onInput={(event) => setFilter(event.currentTarget.value)} />
        <Button onClick={() => sample(all)} title="Sample every factor">sample all</Button>
        <Button onClick={() => onChange({ set: {}, vary: null })} title="As the environment resets by itself">default</Button>
      </div>
      {groups.map(([group, list]) => {
        const visible = list.filter(shown);
        const names = list.map((factor) => factor.name);
        const changed = names.filter((name) => name in scenario.set).length;
        return visible.length > 0 && (
          <details key={group} open={!!filter || groups.length < 4 || changed > 0 || group === groups[0][0]}>
            <summary>
              <b>{group || "other"}</b>
              {changed > 0 && <span class="badge">{changed} set</span>}
              <span class="actions">
                <button type="button" onClick={(event) => { event.preventDefault(); sample(names); }}>sample</button>
                <button type="button" onClick={(event) => { event.preventDefault(); clear(names); }}>default</button>
              </span>
            </summary>
            {visible.map((factor) => (
              <Control
                key={factor.name} factor={factor} value={values[factor.name]}
                state={factor.name in scenario.set ? "set" : samples(factor.name) ? "sampled" : "default"}
                onInput={(value) => set(factor.name, value)}
                onSample={() => sample([factor.name])}
                onDefault={() => clear([factor.name])}
              />
            ))}
          </details>
        );
      })}
    </div>
  );
}

interface ControlProps {
  factor: Factor; value: unknown; state: "set" | "sampled" | "default";
  onInput: (value: unknown) => void; onSample: () => void; onDefault: () => void;
}

function Control({ factor, value, state, onInput, onSample, onDefault }: ControlProps) {
  const { name, doc, constraint } = factor;
  const leaf = name.slice(name.lastIndexOf(".") + 1);
  const current = value ?? factor.default;
  const isChanged = JSON.stringify(rounded(current)) !== JSON.stringify(rounded(factor.default));
  return (
    <div class={`factor ${state}`} title={`${name}: ${doc}`}>
      <div class="head">
        <span class="name">{leaf}{isChanged && <i class="dot" title="differs from the default" />}</span>
        <span class="state">{state === "default" ? "" : state}</span>
        <button type="button" class="quiet" onClick={onSample} aria-label={`Sample ${name}`} title="sample">⚄</button>
        <button type="button" class="quiet" onClick={onDefault} aria-label={`Default of ${name}`} title="default">↺</button>
      </div>
      <Value factor={factor} value={current} onInput={onInput} />
      {constraint && <small>must be {constraint}</small>}
    </div>
  );
}

function Value({ factor, value, onInput }: { factor: Factor; value: unknown; onInput: (value: unknown) => void }) {
  const { name, space, choices: names } = factor;
  const values = (Array.isArray(value) ? value.flat(3) : [value]).map(Number);
  const { low, high } = space;
  const isUnit = low.every((v) => v === 0) && high.every((v) => v === 1);
  const isBytes = low.every((v) => v === 0) && high.every((v) => v === 255);
  const isColor = space.kind === "rgb" || (values.length % 3 === 0 && values.length > 0 && /colou?r/.test(name) && (isUnit || isBytes));
  if (isColor) {
    const scale = isUnit && space.kind !== "rgb" ? 255 : 1;
    const colors = Array.from({ length: values.length / 3 }, (_, index) => values.slice(3 * index, 3 * index + 3));
    return (
      <div class="colors">
        {colors.map((rgb, index) => (
          <input
            key={index} type="color" aria-label={name} value={hex(rgb.map((v) => v * scale))}
            onInput={(event) => {
              const next = [...values];
              channels(event.currentTarget.value).forEach((v, i) => { next[3 * index + i] = v / scale; });
              onInput(next);
            }}
          />
        ))}
        <code>{colors.map((rgb) => rgb.map((v) => number(v, 3)).join(" ")).join(" · ")}</code>
      </div>
    );
  }
  const isInteger = space.dtype?.startsWith("int") || space.dtype === "uint8" || space.dtype === "bool";
  const replace = (index: number, next: number) => {
    if (!Number.isFinite(next)) return;
    onInput(space.shape.length === 0 ? next : values.map((v, i) => (i === index ? next : v)));
  };
  return (
    <div>
      {values.slice(0, 12).map((v, index) => {
        const [from, to] = [low[index] ?? 0, high[index] ?? 1];
        if (isInteger && to - from < 12 && values.length === 1) {
          return (
            <div class="choices" key={index} role="group" aria-label={name}>
              {Array.from({ length: to - from + 1 }, (_, i) => from + i).map((choice) => (
                <button key={choice} type="button" class={choice === v ? "on" : ""} aria-pressed={choice === v} onClick={() => replace(index, choice)}>{names[choice - from] ?? choice}</button>
              ))}
            </div>
          );
        }
        const step = isInteger ? 1 : (to - from) / 500;
        return (
          <div class="slider" key={index}>
            <input type="range" aria-label={values.length > 1 ? `${name} ${index}` : name} min={from} max={to} step={step} value={v} onInput={(event) => replace(index, event.currentTarget.valueAsNumber)} />
            <NumberInput aria-label={`${name} as a number`} min={from} max={to} step="any" value={number(v).replaceAll(",", "")} onCommit={(next) => replace(index, next)} />
          </div>
        );
      })}
      {values.length > 12 && <small>and {values.length - 12} more values</small>}
    </div>
  );
}

function rounded(value: unknown): unknown {
  const round = (v: unknown) => (typeof v === "boolean" ? Number(v) : Number(Number(v).toPrecision(6)));
  return Array.isArray(value) ? value.flat(3).map(round) : [round(value)];
}

function hex(rgb: number[]): string {
  return "#" + rgb.map((v) => Math.round(Math.min(Math.max(v, 0), 255)).toString(16).padStart(2, "0")).join("");
}

function channels(text: string): number[] {
  return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16));
}

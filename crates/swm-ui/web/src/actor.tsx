// Who acts: a person, or a policy with its settings as a form.

import { useState } from "preact/hooks";
import type { Env, Space } from "./api";
import { Button, Field, number } from "./kit";

interface Props { env: Env; actor: string; onPolicy: (text: string | null) => void }

export function Actor({ env, actor, onPolicy }: Props) {
  const [name, setName] = useState<string | null>(null);
  const [values, setValues] = useState<Record<string, string>>({});
  const [free, setFree] = useState("");
  const policy = env.policies.find((known) => known.name === name);
  const changed = Object.entries(values).filter(([, value]) => value.trim() !== "");
  const text = policy ? policy.name + (free ? `:${free}` : changed.length ? ":" + changed.map(([key, value]) => `${key}=${value.trim()}`).join(",") : "") : "";
  const choose = (next: string) => {
    setName(next || null);
    setValues({});
    setFree("");
    onPolicy(next && !env.policies.find((known) => known.name === next)?.summary.includes("RUN") ? next : null);
  };
  return (
    <div class="stack">
      <Field label="Who acts">
        <select value={name ?? ""} onChange={(event) => choose(event.currentTarget.value)}>
          <option value="">you: pointer, keys, gamepad</option>
          <optgroup label="policies">
            {env.policies.filter((known) => !known.is_planner).map((known) => <option key={known.name} value={known.name}>{known.name}</option>)}
          </optgroup>
          <optgroup label="planners on the true dynamics">
            {env.policies.filter((known) => known.is_planner).map((known) => <option key={known.name} value={known.name}>{known.name}</option>)}
          </optgroup>
        </select>
      </Field>
      {policy && <p class="muted">{policy.summary}</p>}
      {policy && (
        <details>
          <summary><b>Settings</b>{changed.length > 0 && <span class="badge">{changed.length} set</span>}</summary>
          {policy.settings.map((setting) => (
            <Field key={setting.name} label={setting.name} hint={setting.doc}>
              <input
                value={values[setting.name] ?? ""} placeholder={setting.default}
                onInput={(event) => setValues({ ...values, [setting.name]: event.currentTarget.value })}
              />
            </Field>
          ))}
          <Field label="as text" hint="What follows the name on a command line: a run's folder, an ONNX model">
            <input value={free} placeholder="key=value,… or a path" onInput={(event) => setFree(event.currentTarget.value)} />
          </Field>
          <div class="row"><Button primary onClick={() => onPolicy(text)}>Apply</Button></div>
        </details>
      )}
      <p class="muted">Acting now: <code>{actor}</code></p>
    </div>
  );
}

/** Sliders for actions by hand, where the pointer cannot steer. */
export function Hand({ space, values, onInput }: { space: Space; values: number[]; onInput: (values: number[]) => void }) {
  const isDiscrete = space.kind !== "box";
  const replace = (index: number, value: number) => onInput(values.map((v, i) => (i === index ? value : v)));
  return (
    <div class="stack hand">
      {values.map((value, index) => {
        const [low, high] = [space.low[index], space.high[index]];
        if (isDiscrete && high - low < 24) {
          return (
            <div class="choices" key={index} role="group" aria-label={`Action ${index}`}>
              {Array.from({ length: high - low + 1 }, (_, i) => low + i).map((choice) => (
                <button key={choice} type="button" class={choice === value ? "on" : ""} aria-pressed={choice === value} onClick={() => replace(index, choice)}>{choice}</button>
              ))}
            </div>
          );
        }
        return (
          <div class="slider" key={index}>
            <input type="range" aria-label={`Action ${index}`} min={low} max={high} step={isDiscrete ? 1 : (high - low) / 200} value={value} onInput={(event) => replace(index, event.currentTarget.valueAsNumber)} onDblClick={() => replace(index, 0)} />
            <output>{number(value, 3)}</output>
          </div>
        );
      })}
    </div>
  );
}

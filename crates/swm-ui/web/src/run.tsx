// Requests that run within the server: a recording, an evaluation, a sweep, a training.

import { useEffect, useState } from "preact/hooks";
import { type About, type File, type Kind, type Setting, post } from "./api";
import { Button, CommandLine, Field, Notice, Panel, number, quoted, useGet } from "./kit";

interface RequestKind { name: string; settings: Setting[] }
interface Running {
  number: number; request: string; name: string; id: string; words: string[]; state: string; error: string | null;
  stage: string; unit: string; done: number; total: number; line: string; notes: string[];
}
type Given = Record<string, string>;

const TITLES: Record<string, string> = { record: "Record", evaluate: "Evaluate", sweep: "Sweep factors", train: "Train" };
/** What is shown at first: what a kind needs, and what is changed most. */
const FIRST: Record<string, string[]> = {
  record: ["env", "policy", "episodes", "seed", "image_size"],
  evaluate: ["manifest", "policy", "reference"],
  sweep: ["manifest", "policy", "factors", "values"],
  train: ["baseline", "dataset", "preset", "steps", "seed"],
};
const FILES: Record<string, Kind> = { manifest: "manifest", dataset: "dataset", encoder: "training" };
const RESULTS: Record<string, string> = { record: "recording.h5", evaluate: "evaluation", sweep: "sweep", train: "run" };

/** What is typed, as a value: JSON where it is some, else a text; a list with commas where its default or place is a list. */
function value(name: string, text: string): unknown {
  if (name === "image_size") {
    const size = /^(\d+)(?:x(\d+))?$/.exec(text);
    return size ? { height: Number(size[1]), width: Number(size[2] ?? size[1]) } : text === "none" ? null : text;
  }
  if (["factors", "vary", "reference", "without", "observe", "distractor"].includes(name)) return text.split(",").map((part) => part.trim());
  if (["policy", "env", "baseline", "manifest", "dataset", "preset", "oracle"].includes(name)) return text;
  if (["set", "env_option", "look", "canonical"].includes(name) && !text.startsWith("{")) {
    return Object.fromEntries(text.split(/[\s;]+/).filter(Boolean).map((part) => {
      const [key, ...rest] = part.split("=");
      return [key, value("", rest.join("="))];
    }));
  }
  try { return JSON.parse(text); } catch { return text; }
}

/** The file's view, once it is there. */
function link({ request, id }: Running): string {
  const place = { record: `#data?id=${encodeURIComponent(id)}`, evaluate: `#results?id=${encodeURIComponent(id + "/receipt.json")}`, sweep: `#results?id=${encodeURIComponent(id + "/sweep.json")}` };
  return place[request as keyof typeof place] ?? `#results?id=${encodeURIComponent(id)}`;
}

export function Run({ about }: { about: About }) {
  const kinds = useGet<{ kinds: RequestKind[] }>("requests/kinds");
  const files = useGet<{ files: File[] }>("files", {}, 5000);
  const running = useGet<{ requests: Running[] }>("requests", {}, 1000);
  const [chosen, setChosen] = useState("evaluate");
  const [given, setGiven] = useState<Record<string, Given>>({});
  const [more, setMore] = useState<Record<string, string[]>>({});
  const [name, setName] = useState<Record<string, string>>({});
  const [error, setError] = useState<string | null>(null);
  const [words, setWords] = useState<string[] | null>(null);
  const kind = kinds.value?.kinds.find((kind) => kind.name === chosen);
  const set = given[chosen] ?? {};
  const shown = [...FIRST[chosen], ...(more[chosen] ?? [])];
  const content = () => ({
    request: { [chosen]: Object.fromEntries(Object.entries(set).filter(([, text]) => text !== "").map(([name, text]) => [name, value(name, text)])) },
    name: name[chosen] ?? RESULTS[chosen],
  });
  // What was checked is no longer what is typed.
  useEffect(() => { setError(null); setWords(null); }, [chosen, given, name]);
  const ask = async (path: string) => {
    setError(null);
    try {
      setWords((await post<{ words: string[] }>(path, content())).words);
      running.reload();
    } catch (error) {
      setWords(null);
      setError((error as Error).message);
    }
  };
  const stop = (number: number) => post("requests/stop", { number }).then(running.reload, (error: Error) => setError(error.message));
  const control = (setting: Setting) => {
    const text = set[setting.name] ?? "";
    const onText = (next: string) => setGiven({ ...given, [chosen]: { ...set, [setting.name]: next } });
    const wanted = FILES[setting.name];
    if (wanted) {
      const found = files.value?.files.filter((file) => file.kind === wanted) ?? [];
      return <select value={text} onChange={(event) => onText(event.currentTarget.value)}><option value="">–</option>{found.map((file) => <option key={file.id} value={file.name}>{file.name}</option>)}</select>;
    }
    const list = setting.name === "env" ? "environments" : undefined;
    return <input value={text} list={list} placeholder={setting.default} onInput={(event) => onText(event.currentTarget.value)} />;
  };
  if (!about.save) return <Panel title="Run"><p class="muted">Start <code>swm ui --save FOLDER</code> to record, evaluate, sweep and train from here: results go into that folder.</p></Panel>;
  return (
    <div class="result">
      <Notice text={kinds.error ?? running.error} />
      <Panel title="Task" aside={<div class="row" role="group" aria-label="Task">{kinds.value?.kinds.map(({ name }) => <Button key={name} on={name === chosen} onClick={() => setChosen(name)}>{TITLES[name] ?? name}</Button>)}</div>}>
        <datalist id="environments">{about.envs.map(({ id }) => <option key={id} value={id} />)}</datalist>
        {kind && (
          <div class="filters">
            {shown.map((name) => kind.settings.find((setting) => setting.name === name)).filter((setting) => !!setting).map((setting) => (
              <Field key={setting.name} label={setting.name.replaceAll("_", " ")} hint={`${setting.doc}\nDefault: ${setting.default}`}>{control(setting)}</Field>
            ))}
            <Field label="More settings" hint="All settings of the command">
              <select value="" onChange={(event) => setMore({ ...more, [chosen]: [...(more[chosen] ?? []), event.currentTarget.value] })}>
                <option value="">add one</option>
                {kind.settings.filter(({ name }) => !shown.includes(name)).map(({ name, doc }) => <option key={name} value={name} title={doc}>{name.replaceAll("_", " ")}</option>)}
              </select>
            </Field>
            <Field label="Result" hint={`A name in ${about.save}`}><input value={name[chosen] ?? RESULTS[chosen]} onInput={(event) => setName({ ...name, [chosen]: event.currentTarget.value })} /></Field>
          </div>
        )}
        <Notice text={error} onClose={() => setError(null)} />
        <div class="row">
          <Button primary onClick={() => ask("requests")}>Run</Button>
          <Button onClick={() => ask("requests/check")}>Check, and show the command</Button>
        </div>
        {words && <CommandLine text={["swm", ...words.map(quoted)].join(" ")} />}
      </Panel>
      {running.value?.requests.map((one) => (
        <Panel key={one.number} title={`${TITLES[one.request] ?? one.request}: ${one.name}`} aside={one.state === "running" ? <Button onClick={() => stop(one.number)}>Stop</Button> : <a href={link(one)}>look at it</a>}>
          <div class="facts">
            <span class={one.state === "done" ? "good" : one.state === "failed" ? "bad" : ""}>{one.state}</span>
            {one.total > 0 && <span>{one.stage} {number(one.done)} of {number(one.total)} {one.unit}</span>}
            {one.line && <span>{one.line}</span>}
          </div>
          {one.state === "running" && one.total > 0 && <progress max={one.total} value={one.done} aria-label={`Progress of ${one.name}`} />}
          <Notice text={one.error} />
          {one.notes.map((note) => <p key={note} class="muted">{note}</p>)}
          <CommandLine text={["swm", ...one.words.map(quoted)].join(" ")} />
        </Panel>
      ))}
    </div>
  );
}

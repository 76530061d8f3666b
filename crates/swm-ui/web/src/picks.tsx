// Steps of a dataset picked as starts and goals: a list of pairs that becomes a manifest.

import { useState } from "preact/hooks";
import { type About, type Chosen, type Dataset, post } from "./api";
import { Button, CommandLine, Field, Notice, NumberInput, Panel, quoted } from "./kit";

/** Episode and step, counted from 0. */
export type Step = [episode: number, step: number];
export interface Pick { start: Step; goal: Step }
export interface Picks { start: Step | null; pairs: Pick[] }

/** As `swm manifest make --pairs` takes it. */
export function text({ start, goal }: Pick): string {
  return `${start.join(":")}-${goal[0] === start[0] ? goal[1] : goal.join(":")}`;
}

interface Props {
  about: About; of: Chosen; data: Dataset; picks: Picks; onChange: (picks: Picks) => void; image: (step: Step) => string | null;
}

export function PickedPairs({ about, of, data, picks, onChange, image }: Props) {
  const [tier, setTier] = useState("moderate");
  const [budget, setBudget] = useState(50);
  const [file, setFile] = useState("pairs.toml");
  const [error, setError] = useState<string | null>(null);
  const [saved, setSaved] = useState<{ id: string; path: string; pairs: number } | null>(null);
  const { pairs } = picks;
  const env = data.runs[0]?.run.env;
  const words = ["swm manifest make", quoted(env ?? "ENV"), "--dataset", quoted(data.path), "--pairs", pairs.map(text).join(","), "--tier", tier, "--budget", budget, "--out", quoted(about.save ? `${about.save}/${file}` : file)];
  const save = async () => {
    setError(null);
    setSaved(null);
    try {
      setSaved(await post("manifest", { ...of, pairs: pairs.map(text), tier, budget, file }));
    } catch (error) {
      setError((error as Error).message);
    }
  };
  const shown = (step: Step, what: string) => {
    const src = image(step);
    return <figure>{src ? <img src={src} alt={`${what}: step ${step[1]} of episode ${step[0]}`} width="72" height="72" /> : <span class="blank">–</span>}<figcaption>{what} {step.join(":")}</figcaption></figure>;
  };
  return (
    <Panel title="Pairs for a manifest" class="picks">
      <Notice text={error} onClose={() => setError(null)} />
      {pairs.length === 0
        ? <p class="muted">{picks.start ? `Start: step ${picks.start[1]} of episode ${picks.start[0]}. Go to the goal, in this or another episode, and press “Goal here”.` : "Open an episode, go to a step and press “Start here”; then to another one and press “Goal here”."}</p>
        : <ol class="picked">{pairs.map((pair, at) => (
          <li key={text(pair)}>
            {shown(pair.start, "start")}{shown(pair.goal, "goal")}
            <Button onClick={() => onChange({ ...picks, pairs: pairs.filter((_, other) => other !== at) })} aria-label={`Remove the pair ${text(pair)}`}>×</Button>
          </li>
        ))}</ol>}
      {pairs.length > 0 && (
        <>
          <div class="filters">
            <Field label="Tier" hint="What counts as success. Moderate and strict refuse pairs that are solved at the start or have little motion.">
              <select value={tier} onChange={(event) => setTier(event.currentTarget.value)}>{["historic", "moderate", "strict"].map((name) => <option key={name}>{name}</option>)}</select>
            </Field>
            <Field label="Actions allowed"><NumberInput min={1} step={1} value={budget} onCommit={(next) => setBudget(Math.max(1, Math.floor(next)))} /></Field>
            {about.save && <Field label="Manifest" hint={`In ${about.save}`}><input value={file} onInput={(event) => setFile(event.currentTarget.value)} /></Field>}
          </div>
          <div class="row">
            {about.save && <Button primary onClick={save}>Save the manifest</Button>}
            <Button onClick={() => onChange({ start: null, pairs: [] })}>Remove all</Button>
            {saved && <span class="good">{saved.pairs} {saved.pairs === 1 ? "pair" : "pairs"} saved: <a href={`#results?id=${encodeURIComponent(saved.id)}`}>look at the manifest</a></span>}
          </div>
          {!about.save && <p class="muted">Start <code>swm ui --save FOLDER</code> to save manifests from here, or run:</p>}
          <CommandLine text={words.join(" ")} />
        </>
      )}
    </Panel>
  );
}

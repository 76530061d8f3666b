// Recording episodes into a dataset.

import { useState } from "preact/hooks";
import type { About } from "./api";
import { Button, Field, Panel, number } from "./kit";
import type { Recording } from "./socket";

interface Props {
  about: About; status: Recording | null; canKeep: boolean; saved: string | null; env: string; send: (message: object) => void;
}

export function Recorder({ about, status, canKeep, saved, env, send }: Props) {
  const [file, setFile] = useState(`${env.split("/").pop()!.toLowerCase()}-human.h5`);
  const [format, setFormat] = useState("");
  const [image, setImage] = useState(96);
  if (!about.save) {
    return <Panel title="Record"><p class="muted">Start <code>swm ui --save FOLDER</code> to record what you steer into a dataset.</p></Panel>;
  }
  const view = (id: string) => `#data?id=${encodeURIComponent(id)}`;
  if (status) {
    const { waiting } = status;
    return (
      <Panel title="Record" aside={<span class="rec">● recording</span>} class="recording">
        <p><code>{status.file}</code>: {status.in_file} in the file{waiting ? ", 1 to confirm" : ""}.</p>
        {waiting && <p class="muted">Last: {waiting.steps} steps, {waiting.success === null ? "no success test" : waiting.success ? "success" : "no success"}, reward {number(waiting.total_reward)}. It is written when the next one is kept.</p>}
        <div class="row">
          <Button onClick={() => send({ type: "keep" })} disabled={!canKeep} title="End the episode here and keep it">Keep now</Button>
          <Button onClick={() => send({ type: "undo" })} disabled={!waiting}>Undo last</Button>
          <Button primary onClick={() => send({ type: "stop_recording" })}>Finish</Button>
        </div>
      </Panel>
    );
  }
  const byFormat = (name: string) => {
    setFormat(name);
    const extension = about.formats.find((known) => known.name === name)?.extension;
    if (extension) setFile(file.replace(/\.[^.]*$/, "") + "." + extension);
  };
  return (
    <Panel title="Record">
      <Field label="File" hint={`In ${about.save}. An existing one is continued.`}><input value={file} onInput={(event) => setFile(event.currentTarget.value)} /></Field>
      <div class="grid2">
        <Field label="Format"><select value={format} onChange={(event) => byFormat(event.currentTarget.value)}><option value="">by the name</option>{about.formats.filter((known) => known.extension).map((known) => <option key={known.name} value={known.name}>{known.name}</option>)}</select></Field>
        <Field label="Images"><select value={image} onChange={(event) => setImage(Number(event.currentTarget.value))}>{[64, 96, 128, 224, 256].map((size) => <option key={size} value={size}>{size} px</option>)}</select></Field>
      </div>
      <div class="row">
        <Button primary onClick={() => send({ type: "record", file, format: format || null, image })}>Record</Button>
        {saved && <a href={view(saved)}>look at the recording</a>}
      </div>
    </Panel>
  );
}

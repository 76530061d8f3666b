// Small parts that all views share.

import type { ButtonHTMLAttributes, ComponentChildren, TargetedEvent } from "preact";
import { useEffect, useState } from "preact/hooks";
import { get, type Query } from "./api";

export function Panel(props: { title?: string; aside?: ComponentChildren; class?: string; children: ComponentChildren }) {
  return (
    <section class={`panel ${props.class ?? ""}`}>
      {props.title && <header><h2>{props.title}</h2>{props.aside}</header>}
      {props.children}
    </section>
  );
}

export function Field(props: { label: string; hint?: string; children: ComponentChildren }) {
  return <label class="field" title={props.hint}><span>{props.label}</span>{props.children}</label>;
}

export function Button(props: ButtonHTMLAttributes<HTMLButtonElement> & { primary?: boolean; on?: boolean }) {
  const { primary, on, ...rest } = props;
  return <button type="button" aria-pressed={on} {...rest} class={`${primary ? "primary" : ""} ${on ? "on" : ""}`} />;
}

/** A number that counts once it is left or confirmed; what is typed until then survives when the page loads its data again. */
export function NumberInput(props: {
  value: number | string; onCommit: (value: number) => void; min?: number; max?: number; step: number | "any"; "aria-label"?: string;
}) {
  const { value, onCommit, ...rest } = props;
  const [typed, setTyped] = useState<string | null>(null);
  const commit = (event: TargetedEvent<HTMLInputElement>) => {
    const next = event.currentTarget.valueAsNumber;
    setTyped(null);
    if (Number.isFinite(next)) onCommit(next);
  };
  return (
    <input
      {...rest} type="number" value={typed ?? value}
      onInput={(event) => setTyped(event.currentTarget.value)} onChange={commit} onBlur={() => setTyped(null)}
    />
  );
}

/** A command line that makes the same thing, to be copied. */
export function CommandLine({ text }: { text: string }) {
  const [copied, setCopied] = useState(false);
  const copy = () => {
    navigator.clipboard?.writeText(text).then(() => {
      setCopied(true);
      setTimeout(() => setCopied(false), 1200);
    }, () => {});
  };
  return (
    <div class="command">
      <code>{text}</code>
      <button type="button" onClick={copy} aria-label="Copy the command">{copied ? "copied" : "copy"}</button>
    </div>
  );
}

export function Notice({ text, onClose }: { text: string | null; onClose?: () => void }) {
  if (!text) return null;
  return (
    <div class="notice" role="alert">
      <span>{text}</span>
      {onClose && <button type="button" onClick={onClose} aria-label="Dismiss">×</button>}
    </div>
  );
}

export interface Loaded<T> { value: T | null; error: string | null; reload: () => void }

/** Asks the server, again whenever the question changes, and every `period` milliseconds. */
export function useGet<T>(path: string | null, query: Query = {}, period = 0): Loaded<T> {
  const [state, setState] = useState<{ key: string | null; value: T | null; error: string | null }>({ key: null, value: null, error: null });
  const [turn, setTurn] = useState(0);
  const key = path === null ? null : path + JSON.stringify(query);
  useEffect(() => {
    if (path === null) return;
    let current = true;
    get<T>(path, query).then(
      (value) => current && setState({ key, value, error: null }),
      (error: Error) => current && setState((old) => ({ key, value: old.key === key ? old.value : null, error: error.message })),
    );
    const timer = period > 0 ? setTimeout(() => setTurn((turn) => turn + 1), period) : undefined;
    return () => { current = false; clearTimeout(timer); };
  }, [key, turn, period]);
  // The answer to another question is none.
  const { value, error } = state.key === key ? state : { value: null, error: null };
  return { value, error, reload: () => setTurn((turn) => turn + 1) };
}

/** As few digits as tell values apart. */
export function number(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (Number.isInteger(value)) return value.toLocaleString("en");
  return Math.abs(value) >= 1e6 || Math.abs(value) < 1e-4 ? value.toExponential(2) : String(Number(value.toPrecision(digits)));
}

/** A word for a shell. */
export function quoted(text: string): string {
  return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
}

/** Shows an image `[H, W, 3]`. */
export function draw(canvas: HTMLCanvasElement | null, { height, width }: { height: number; width: number }, rgb: Uint8Array) {
  if (!canvas || height === 0) return;
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
  const image = new ImageData(width, height);
  const out = new Uint32Array(image.data.buffer);
  for (let pixel = 0, at = 0; pixel < out.length; pixel += 1, at += 3) {
    out[pixel] = 0xff000000 | (rgb[at + 2] << 16) | (rgb[at + 1] << 8) | rgb[at];
  }
  canvas.getContext("2d")!.putImageData(image, 0, 0);
}

/** Hands a file to the browser. */
export function download(name: string, content: Blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export type Cell = string | number | boolean | null | undefined;

/** Columns as CSV, with full precision; missing values are empty. */
export function csv(names: string[], columns: Cell[][]): Blob {
  const length = Math.max(0, ...columns.map((column) => column.length));
  return rowsCsv(names, Array.from({ length }, (_, row) => columns.map((column) => column[row])));
}

function rowsCsv(names: string[], rows: Cell[][]): Blob {
  const cell = (value: Cell) => {
    const text = String(value ?? "");
    return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  return new Blob([[names, ...rows].map((row) => row.map(cell).join(",") + "\n").join("")], { type: "text/csv" });
}

/** A table as CSV. */
export function Save({ name, columns, rows }: { name: string; columns: string[]; rows: Cell[][] }) {
  return <Button disabled={rows.length === 0} onClick={() => download(name, rowsCsv(columns, rows))}>CSV</Button>;
}

/** The plots within an element, one below the other, as PNG. */
export function savePlots(name: string, within: Element | null) {
  const plots = [...(within?.querySelectorAll(".u-wrap canvas") ?? [])] as HTMLCanvasElement[];
  if (plots.length === 0) return;
  const scale = devicePixelRatio, line = 20 * scale;
  const style = getComputedStyle(document.documentElement);
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(...plots.map((plot) => plot.width));
  canvas.height = plots.reduce((height, plot) => height + plot.height + line, 0);
  const context = canvas.getContext("2d")!;
  context.fillStyle = style.getPropertyValue("--panel");
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.font = `${12 * scale}px system-ui, sans-serif`;
  let top = 0;
  for (const plot of plots) {
    let left = 6 * scale;
    const write = (text: string, color: string) => {
      context.fillStyle = color;
      context.fillText(text, left, top + 14 * scale);
      left += context.measureText(text).width + 12 * scale;
    };
    const caption = plot.closest("figure")?.querySelector("figcaption")?.textContent;
    if (caption) write(caption, style.getPropertyValue("--text"));
    plot.closest(".uplot")?.querySelectorAll(".u-series").forEach((series, at) => {
      const marker = series.querySelector<HTMLElement>(".u-marker");
      if (at > 0) write(series.querySelector(".u-label")?.textContent ?? "", marker?.style.borderColor || marker?.style.borderTopColor || style.getPropertyValue("--text"));
    });
    context.drawImage(plot, 0, top + line);
    top += plot.height + line;
  }
  canvas.toBlob((blob) => blob && download(name, blob));
}

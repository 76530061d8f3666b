// Small parts that all views share.

import type { ButtonHTMLAttributes, ComponentChildren } from "preact";
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

/** Hands a file to the browser. */
export function download(name: string, content: Blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** Columns as CSV, with full precision; missing values are empty. */
export function csv(names: string[], columns: (number | null)[][]): Blob {
  const rows = (columns[0] ?? []).map((_, row) => columns.map((column) => column[row] ?? "").join(","));
  return new Blob([[names.map((name) => (name.includes(",") ? `"${name}"` : name)).join(","), ...rows].join("\n") + "\n"], { type: "text/csv" });
}

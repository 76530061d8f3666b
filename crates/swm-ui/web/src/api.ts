// What the server answers, and how it is asked.

export interface Space { kind: string; shape: number[]; dtype: string | null; low: number[]; high: number[] }
export interface Setting { name: string; doc: string; default: string }
export interface Policy { name: string; summary: string; settings: Setting[]; is_planner: boolean }
export interface Factor {
  name: string; doc: string; space: Space; default: unknown; sampled: boolean; constraint: string | null; choices: string[];
}
export interface Column { name: string; dtype: string; shape: number[]; kind: "step" | "episode" }
export interface Env {
  id: string; summary: string; settings: Setting[]; policies: Policy[]; planner: string | null; factors: Factor[];
  action: Space; columns: Column[]; time_step_s: number;
}
export interface About {
  version: string; envs: { id: string; summary: string; family: string; success: string }[];
  formats: { name: string; extension: string | null; about: string }[]; save: string | null;
}
export type Kind = "dataset" | "manifest" | "receipt" | "sweep" | "evaluation" | "training" | "job";
export interface File { id: string; name: string; kind: Kind; format?: string; bytes: number }
export interface Run { env: string; policy: string; seed: number; variation: string[] | null; variation_values: Record<string, unknown> }
export interface Dataset {
  path: string; format: string; episodes: number; steps: number; shortest: number | null; longest: number | null;
  columns: Column[]; images: string[]; can_render: boolean; runs: { first_episode: number; run: Run }[];
  skipped: { name: string; reason: string }[];
  mapping: [string, string][]; notes: string[]; opening: Record<string, unknown>;
}
export interface Episode { episode: number; length: number; total_reward: number | null; success: boolean | null }
export interface Episodes { matching: number; known: number; of: number; episodes: Episode[] }
export interface Values {
  length: number; stride: number; columns: Record<string, (number | null)[][]>; constants: Record<string, (number | null)[]>;
}

/** A dataset: its id, and how one of another program is opened, as JSON. */
export interface Chosen { id: string; opening: string | null }

export type Query = Record<string, string | number | boolean | null | undefined>;

/** The query of a dataset. */
export function chosen({ id, opening }: Chosen): Query {
  return { id, opening };
}

export function url(path: string, query: Query = {}): string {
  const pairs = Object.entries(query).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const text = new URLSearchParams(pairs.map(([name, value]) => [name, String(value)])).toString();
  return `/api/${path}${text ? "?" + text : ""}`;
}

export async function get<T>(path: string, query: Query = {}): Promise<T> {
  return ask(url(path, query));
}

/** Sends what is to be written. */
export async function post<T>(path: string, content: object): Promise<T> {
  return ask(url(path), { method: "POST", body: JSON.stringify(content) });
}

async function ask<T>(address: string, how?: RequestInit): Promise<T> {
  let response: Response;
  try {
    response = await fetch(address, how);
  } catch {
    throw new Error("The server does not answer: it has ended, or the connection is gone. Start `swm ui` again.");
  }
  const body = await response.json().catch(() => null);
  if (!response.ok) throw new Error(body?.error ?? `The server answered ${response.status}.`);
  return body as T;
}

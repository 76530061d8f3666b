// The pointer, the arrow keys and a gamepad, as actions.

import type { RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";
import type { Env } from "./api";
import type { Head } from "./socket";

interface Props {
  canvas: RefObject<HTMLCanvasElement | null>;
  env: Env;
  /** The agent can follow the pointer. */
  steers: boolean;
  hand: number[];
  head: Head | null;
  enabled: boolean;
  send: (message: object) => void;
  setHand: (values: number[]) => void;
}

/** Keys, as the element of the action and its direction; the first two are also left–right and up–down of the image. */
const KEYS: Record<string, [number, number]> = {
  ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1], a: [2, -1], d: [2, 1], s: [3, -1], w: [3, 1],
};
/** How far before the agent the keys put the pointer, as a fraction of the image. */
const REACH = 0.18;

export function useSteering({ canvas, env, steers, hand, head, enabled, send, setHand }: Props) {
  const keys = useRef(new Set<string>());
  const isSteered = useRef(false);
  const agent = head?.agent ?? null;

  const directions = () => {
    const axes = [0, 0, 0, 0];
    for (const key of keys.current) axes[KEYS[key][0]] += KEYS[key][1];
    for (const pad of navigator.getGamepads?.() ?? []) {
      pad?.axes.slice(0, 4).forEach((value, index) => {
        if (Math.abs(value) > 0.15) axes[index] += index % 2 === 1 ? -value : value;
      });
    }
    return axes;
  };
  const apply = () => {
    if (!enabled) return;
    const axes = directions();
    const isActive = axes.some((value) => value !== 0);
    if (!isActive && !isSteered.current) return;
    if (steers) {
      if (isActive && agent) send({ type: "pointer", at: [agent[0] + REACH * axes[0], agent[1] - REACH * axes[1]] });
      else send({ type: "pointer", at: null });
    } else {
      const { low, high, kind } = env.action;
      const values = hand.map((value, index) => {
        const axis = axes[index] ?? 0;
        if (kind !== "box") return index === 0 && axis !== 0 ? (axis < 0 ? low[0] : high[0]) : value;
        return axis === 0 ? Math.min(Math.max(0, low[index]), high[index]) : axis * (axis < 0 ? -low[index] : high[index]);
      });
      setHand(values);
      send({ type: "action", values });
    }
    isSteered.current = isActive;
  };
  const latest = useRef(apply);
  latest.current = apply;

  // The agent moves on, and the keys' pointer with it.
  useEffect(() => { latest.current(); }, [head?.step]);
  useEffect(() => {
    const change = (event: KeyboardEvent, isDown: boolean) => {
      const target = event.target as HTMLElement;
      if (!(event.key in KEYS) || /^(INPUT|SELECT|TEXTAREA)$/.test(target.tagName)) return;
      if (isDown) keys.current.add(event.key);
      else keys.current.delete(event.key);
      latest.current();
      event.preventDefault();
    };
    const down = (event: KeyboardEvent) => change(event, true), up = (event: KeyboardEvent) => change(event, false);
    const blur = () => { keys.current.clear(); latest.current(); };
    addEventListener("keydown", down);
    addEventListener("keyup", up);
    addEventListener("blur", blur);
    return () => { removeEventListener("keydown", down); removeEventListener("keyup", up); removeEventListener("blur", blur); };
  }, []);

  const point = (event: PointerEvent) => {
    if (!steers || !enabled || !canvas.current) return;
    const box = canvas.current.getBoundingClientRect();
    send({ type: "pointer", at: [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height] });
    if (event.type === "pointerdown") canvas.current.setPointerCapture(event.pointerId);
  };
  const leave = () => { if (steers && enabled) send({ type: "pointer", at: null }); };
  return { onPointerMove: point, onPointerDown: point, onPointerLeave: leave };
}

// Histograms of values, and how two of them cover their plane.

import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { Button, Field, download, number } from "./kit";
import { color } from "./plot";

const BINS = 40;

export function Histograms({ values }: { values: (number | null)[][] }) {
  return <div class="histograms">{values.slice(0, 16).map((list, index) => <Histogram key={index} list={list} index={index} isOne={values.length === 1} />)}</div>;
}

function finite(list: (number | null)[]): number[] {
  return list.filter((value): value is number => value !== null && Number.isFinite(value));
}

function range(list: number[]): [number, number] {
  return list.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
}

function Histogram({ list, index, isOne }: { list: (number | null)[]; index: number; isOne: boolean }) {
  const { counts, low, high, mean, missing } = useMemo(() => {
    const known = finite(list);
    const [low, high] = range(known);
    const counts = new Array<number>(BINS).fill(0);
    for (const value of known) counts[Math.min(BINS - 1, Math.floor(((value - low) / (high - low || 1)) * BINS))] += 1;
    return { counts, low, high, mean: known.reduce((a, b) => a + b, 0) / known.length, missing: list.length - known.length };
  }, [list]);
  const top = Math.max(...counts, 1);
  if (!Number.isFinite(low)) return <figure><figcaption>{isOne ? "" : `[${index}]`} no values</figcaption></figure>;
  return (
    <figure>
      <svg viewBox={`0 0 ${BINS} 24`} preserveAspectRatio="none" role="img" aria-label={`Histogram from ${number(low)} to ${number(high)}`}>
        {counts.map((count, bin) => count > 0 && <rect key={bin} x={bin + 0.08} width={0.84} y={24 - (23 * count) / top} height={(23 * count) / top} fill={color(index)} />)}
      </svg>
      <div class="ends"><span>{number(low)}</span><span>{isOne ? "" : `[${index}] `}mean {number(mean)}{missing > 0 && ` · ${missing} missing`}</span><span>{number(high)}</span></div>
    </figure>
  );
}

/** A heat map of two values of a column. */
export function Coverage({ values, name }: { values: (number | null)[][]; name: string }) {
  const [x, setX] = useState(0);
  const [y, setY] = useState(1);
  const canvas = useRef<HTMLCanvasElement>(null);
  const size = 48;
  const { counts, covered, ends } = useMemo(() => {
    const pairs = values[x].map((a, row) => [a, values[y][row]]).filter((pair): pair is [number, number] => pair.every((v) => v !== null && Number.isFinite(v)));
    const [lowX, highX] = range(pairs.map(([a]) => a)), [lowY, highY] = range(pairs.map(([, b]) => b));
    const counts = new Float64Array(size * size);
    const at = (v: number, low: number, high: number) => Math.min(size - 1, Math.floor(((v - low) / (high - low || 1)) * size));
    for (const [a, b] of pairs) counts[at(b, lowY, highY) * size + at(a, lowX, highX)] += 1;
    return { counts, covered: counts.filter((count) => count > 0).length / counts.length, ends: [lowX, highX, lowY, highY] };
  }, [values, x, y]);
  useEffect(() => {
    const context = canvas.current?.getContext("2d");
    if (!context) return;
    const image = context.createImageData(size, size);
    const top = Math.log1p(counts.reduce((a, b) => Math.max(a, b), 1));
    counts.forEach((count, cell) => {
      const level = Math.log1p(count) / top;
      image.data.set([59, 111, 214, count > 0 ? 70 + 185 * level : 0], 4 * cell);
    });
    context.putImageData(image, 0, 0);
  }, [counts]);
  const choice = (label: string, value: number, set: (value: number) => void) => (
    <Field label={label}><select value={value} onChange={(event) => set(Number(event.currentTarget.value))}>{values.map((_, index) => <option key={index} value={index}>{name}[{index}]</option>)}</select></Field>
  );
  return (
    <div class="coverage">
      <canvas ref={canvas} width={size} height={size} aria-label={`Coverage of ${name}[${x}] and ${name}[${y}]`} />
      <div class="stack">
        {choice("Across", x, setX)}{choice("Down", y, setY)}
        <div class="row"><Button onClick={() => canvas.current?.toBlob((image) => image && download(`${name}_coverage.png`, image))}>Coverage as PNG</Button></div>
        <p class="muted">{number(100 * covered, 3)} % of {size} × {size} cells hold a value.<br />Across {number(ends[0])} to {number(ends[1])}, down {number(ends[2])} to {number(ends[3])}.</p>
      </div>
    </div>
  );
}

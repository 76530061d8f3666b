// Line plots, by uPlot, in the colors of the page.

import uPlot from "uplot";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { number } from "./kit";

export const COLORS = ["#3b6fd6", "#d9772f", "#2f9e77", "#c2478f", "#8a63d2", "#8b8a2c", "#2b9fb8", "#b5483f"];

export function color(index: number): string {
  return COLORS[index % COLORS.length];
}

function style(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

interface Props {
  names: string[];
  /** The first row is x. */
  data: (number | null)[][];
  height?: number;
  /** A vertical line, at a value of x. */
  cursor?: number;
  onPick?: (x: number) => void;
  xLabel?: string;
  log?: boolean;
}

/** A row for every line: those that are not there yet are empty. */
function aligned({ names, data }: Props): uPlot.AlignedData {
  const x = data[0] ?? [];
  return [x, ...names.map((_, line) => data[line + 1] ?? x.map(() => null))] as uPlot.AlignedData;
}

export function Plot(props: Props) {
  const { names, data, height = 150 } = props;
  const place = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const latest = useRef(props);
  latest.current = props;
  const key = names.join("\n") + (props.log ? "log" : "");

  useLayoutEffect(() => {
    const element = place.current!;
    const make = () => {
      plot.current?.destroy();
      const line = style("--line"), text = style("--muted"), font = "11px system-ui, sans-serif";
      const axis = { stroke: text, font, grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1, size: 4 } };
      plot.current = new uPlot({
        width: Math.max(element.clientWidth, 120),
        height,
        cursor: { y: false, points: { size: 6 } },
        legend: { show: names.length > 0, live: true },
        scales: { x: { time: false }, y: { distr: props.log ? 3 : 1 } },
        axes: [{ ...axis, size: 26, space: 60 }, { ...axis, size: 52, space: 28, values: (_, ticks) => ticks.map((tick) => (tick === null ? "" : number(tick))) }],
        series: [
          { label: props.xLabel ?? "step" },
          ...names.map((label, index) => ({ label, stroke: color(index), width: 1.5, points: { show: false }, spanGaps: false })),
        ],
        hooks: {
          draw: [(self) => {
            const at = latest.current.cursor;
            if (at === undefined) return;
            const x = self.valToPos(at, "x", true);
            const { top, height: tall } = self.bbox;
            self.ctx.save();
            self.ctx.strokeStyle = style("--accent");
            self.ctx.lineWidth = devicePixelRatio;
            self.ctx.beginPath();
            self.ctx.moveTo(x, top);
            self.ctx.lineTo(x, top + tall);
            self.ctx.stroke();
            self.ctx.restore();
          }],
        },
      }, aligned(latest.current), element);
      plot.current.over.addEventListener("click", (event) => {
        latest.current.onPick?.(plot.current!.posToVal(event.offsetX, "x"));
      });
    };
    make();
    const resized = new ResizeObserver(() => plot.current?.setSize({ width: Math.max(element.clientWidth, 120), height }));
    resized.observe(element);
    const scheme = matchMedia("(prefers-color-scheme: dark)");
    scheme.addEventListener("change", make);
    document.addEventListener("swm-theme", make);
    return () => {
      resized.disconnect();
      scheme.removeEventListener("change", make);
      document.removeEventListener("swm-theme", make);
      plot.current?.destroy();
      plot.current = null;
    };
  }, [key, height]);

  useEffect(() => { plot.current?.setData(aligned(props)); }, [data]);
  useEffect(() => { plot.current?.redraw(false, false); }, [props.cursor]);
  return <div class="plot" ref={place} />;
}

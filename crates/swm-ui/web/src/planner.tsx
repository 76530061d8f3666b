// What a planner thought: its paths over the image, and its costs.

import { Panel, number } from "./kit";
import { Plot } from "./plot";
import type { Plan } from "./socket";

const DASHES = ["", "4 3", "1 3", "6 2 1 2"];

/** Candidates, elites and the plan as lines over the image; a kind of line for every object. */
export function Paths({ plan }: { plan: Plan }) {
  return (
    <svg class="paths" viewBox="0 0 1 1" preserveAspectRatio="none" aria-label={`Paths of the plan of step ${plan.step}`} role="img">
      {plan.paths.map((path, index) => path.objects.map((points, object) => (
        <polyline
          key={`${index}-${object}`} class={path.of.replace(" ", "-")} stroke-dasharray={DASHES[object % DASHES.length]}
          points={points.map((point) => point.map((part) => Math.min(1, Math.max(0, part)).toFixed(4)).join(",")).join(" ")}
        />
      )))}
    </svg>
  );
}

/** Costs of the latest plan by iteration, and what it costs by the model and in the environment. */
export function Thoughts({ plan, shown, onShow }: { plan: Plan; shown: boolean; onShow: (shown: boolean) => void }) {
  const lines = [0, 1, 2].map((line) => plan.costs.map((costs) => costs[line]));
  const kinds = [["candidate", "candidate"], ["first-elite", "elite, first iteration"], ["last-elite", "elite, last iteration"], ["plan", "plan"]];
  return (
    <Panel title={`Plan of step ${plan.step}`} aside={
      <label><input type="checkbox" checked={shown} onChange={(event) => onShow(event.currentTarget.checked)} /> over the image</label>
    }>
      {shown && plan.paths.length > 0 && (
        <p class="kinds">{kinds.map(([kind, name]) => <span key={kind}><svg viewBox="0 0 20 4"><line x1="0" y1="2" x2="20" y2="2" class={kind} /></svg>{name}</span>)}</p>
      )}
      {plan.paths.length === 0 && <p class="muted">This environment does not say where its objects are in the image.</p>}
      {plan.costs.length > 1 && (
        <Plot names={["best candidate", "mean of the elites", "mean of all candidates"]} data={[plan.costs.map((_, index) => index + 1), ...lines]} height={140} xLabel="iteration" />
      )}
      <dl class="readout">
        <div><dt>cost by the planner's model</dt><dd>{number(plan.cost)}</dd></div>
        <div><dt>task cost where the plan ends</dt><dd>{number(plan.true_cost)}</dd></div>
      </dl>
    </Panel>
  );
}

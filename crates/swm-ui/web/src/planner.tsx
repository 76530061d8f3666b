// What a planner thought: its paths over the image, and its costs.

import { Button, CommandLine, Panel, csv, download, number } from "./kit";
import { Plot } from "./plot";
import type { Path, Plan } from "./socket";

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
export function Thoughts({ plan, shown, command, onShow }: { plan: Plan; shown: boolean; command: string; onShow: (shown: boolean) => void }) {
  const lines = [0, 1, 2].map((line) => plan.costs.map((costs) => costs[line]));
  const hasPaths = plan.paths.some((path) => path.objects.length > 0);
  const kinds = [["candidate", "candidate"], ["first-elite", "elite, first iteration"], ["last-elite", "elite, last iteration"], ["plan", "plan"]];
  return (
    <Panel title={`Plan of step ${plan.step}`} aside={
      <label><input type="checkbox" checked={shown} onChange={(event) => onShow(event.currentTarget.checked)} /> over the image</label>
    }>
      {shown && hasPaths && (
        <p class="kinds">{kinds.map(([kind, name]) => <span key={kind}><svg viewBox="0 0 20 4"><line x1="0" y1="2" x2="20" y2="2" class={kind} /></svg>{name}</span>)}</p>
      )}
      {!hasPaths && <p class="muted">This environment does not say where its objects are in the image.</p>}
      {plan.costs.length > 1 && (
        <Plot names={["best candidate", "mean of the elites", "mean of all candidates"]} data={[plan.costs.map((_, index) => index + 1), ...lines]} height={140} xLabel="iteration" />
      )}
      <dl class="readout">
        <div><dt>cost by the planner's model</dt><dd>{number(plan.cost)}</dd></div>
        <div><dt>task cost where the plan ends</dt><dd>{number(plan.true_cost)}</dd></div>
        <div title="Spearman's rank correlation of both costs over the candidates and elites shown; 1: the model ranks them as the environment does"><dt>rank correlation of both</dt><dd>{number(plan.agreement, 3)}</dd></div>
      </dl>
      <Scatter paths={plan.paths} />
      <div class="row">
        <Button onClick={() => download(`plan_step_${plan.step}_iterations.csv`, csv(["iteration", "best", "elite_mean", "sample_mean"], [plan.costs.map((_, index) => index + 1), ...lines]))}>Iterations as CSV</Button>
        <Button onClick={() => download(`plan_step_${plan.step}_costs.csv`, csv(["of", "cost_by_model", "true_cost"], [plan.paths.map((path) => path.of), plan.paths.map((path) => path.cost), plan.paths.map((path) => path.true_cost)]))}>Costs as CSV</Button>
      </div>
      <CommandLine text={command} />
    </Panel>
  );
}

/** What the planner's model says that plans cost, across, and the task cost where they end, up. */
function Scatter({ paths }: { paths: Path[] }) {
  const known = paths.filter((path): path is Path & { cost: number; true_cost: number } => path.cost !== null && path.true_cost !== null);
  if (known.length < 3) return null;
  const ends = (values: number[]) => [Math.min(...values), Math.max(...values)];
  const [x, y] = [ends(known.map((path) => path.cost)), ends(known.map((path) => path.true_cost))];
  const at = (value: number, [low, high]: number[]) => 3 + (94 * (value - low)) / (high - low || 1);
  return (
    <figure class="scatter">
      <figcaption>predicted and true cost of {known.length} plans</figcaption>
      <svg viewBox="0 0 100 60" preserveAspectRatio="none" role="img" aria-label={`Cost by the model from ${number(x[0])} to ${number(x[1])}, task cost from ${number(y[0])} to ${number(y[1])}`}>
        {known.map((path, index) => <line key={index} class={path.of.replace(" ", "-")} x1={at(path.cost, x)} x2={at(path.cost, x)} y1={60 - 0.6 * at(path.true_cost, y)} y2={60 - 0.6 * at(path.true_cost, y)} />)}
      </svg>
      <div class="ends"><span>{number(x[0])}</span><span>across: cost by the model · up: task cost {number(y[0])} to {number(y[1])}</span><span>{number(x[1])}</span></div>
    </figure>
  );
}

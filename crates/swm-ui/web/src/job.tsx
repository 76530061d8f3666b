// A job of `swm submit`: how far its shards are.

import { useRef } from "preact/hooks";
import { CommandLine, Notice, Panel, Save, number, quoted, useGet } from "./kit";

interface Shard { shard: number; state: string; running?: boolean; episodes: number; of: number; seconds?: number; message?: string }
interface Job {
  job: string; name: string; command: string[]; shards: number; done: number; progress: string; episodes: number; total_episodes: number; result: { result: string; bytes: number } | null; lost_result: string | null; result_line: string | null; each: Shard[]; note: string | null;
}

export function JobView({ id }: { id: string }) {
  const job = useGet<Job>("job", { id }, 2000);
  const seen = useRef(new Map<number, { time: number; episodes: number }>());
  const value = job.value;
  const now = performance.now() / 1000;
  const rates = value?.each.map((shard) => rate(shard, now, seen.current)) ?? [];
  const total = rates.reduce<number>((sum, one, at) => sum + (value!.each[at].state === "done" ? 0 : one ?? 0), 0);
  const part = value && (value.total_episodes ? value.episodes / value.total_episodes : value.done / value.shards);
  return (
    <>
      <Notice text={job.error} />
      {value && <Panel title={value.job.split("/").at(-1)} aside={<Save name={`${value.job.split("/").at(-1)}.csv`} columns={["shard", "state", "episodes", "of", "seconds"]} rows={value.each.map((one) => [one.shard, one.state, one.episodes, one.of, one.seconds ?? null])} />}>
        <p class="muted"><code>swm {value.command.join(" ")}</code></p>
        <div class="facts">
          <span>{value.progress}</span>
          {value.total_episodes > 0 && <span>{number(value.episodes)} of {number(value.total_episodes)} episodes</span>}
          {total > 0 && <span>{number(total, 3)} episodes/s now</span>}
          {value.result_line && <span class={value.lost_result ? "bad" : value.result ? "good" : ""}>result: {value.result_line}</span>}
        </div>
        <progress max={1} value={part ?? 0} aria-label="Progress of the job" />
        <Notice text={value.note} />
        <div class="scroll"><table class="small">
          <thead><tr><th class="num">shard</th><th>state</th><th class="num">episodes</th><th class="num">per second</th><th /></tr></thead>
          <tbody>{value.each.map((shard, at) => (
            <tr key={shard.shard}>
              <td class="num">{shard.shard}</td>
              <td class={shard.state === "done" ? "good" : shard.state.startsWith("failed") ? "bad" : ""}>{shard.state}</td>
              <td class="num">{shard.of > 0 ? `${shard.episodes} of ${shard.of}` : "–"}</td>
              <td class="num">{number(rates[at], 3)}</td>
              <td>{shard.message}</td>
            </tr>
          ))}</tbody>
        </table></div>
        <CommandLine text={`swm jobs ${quoted(value.job)} --watch`} />
      </Panel>}
    </>
  );
}

/** Episodes a second: of all that a shard took, or since the page watches. */
function rate(shard: Shard, time: number, seen: Map<number, { time: number; episodes: number }>): number | null {
  if (shard.state === "done") return shard.seconds && shard.of ? shard.episodes / shard.seconds : null;
  const before = seen.get(shard.shard);
  if (!before || before.episodes > shard.episodes) {
    seen.set(shard.shard, { time, episodes: shard.episodes });
    return null;
  }
  return shard.episodes > before.episodes ? (shard.episodes - before.episodes) / (time - before.time) : null;
}

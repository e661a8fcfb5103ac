import { useSignal } from "@preact/signals";
import type { Job } from "../api/client";
import { jobs } from "./jobs";
import { href } from "./route";
import { titleOf } from "./send";
import { time } from "./words";

/** Chooses a job to see this one beside. */
export function CompareWith({ job }: { job: Job }) {
  const chosen = useSignal("");
  const others = jobs.value.filter(
    ({ id, state, results_erased }) => id !== job.id && state === "succeeded" && !results_erased,
  );
  const other = others.find(({ id }) => id === chosen.value) ?? others[0];
  if (other === undefined) return <p class="hint">There is no other job with a result yet.</p>;
  return (
    <div class="row">
      <select
        aria-label="Job to compare with"
        value={other.id}
        onChange={(event) => {
          chosen.value = event.currentTarget.value;
        }}
      >
        {others.map((job) => (
          <option key={job.id} value={job.id}>
            {titleOf(job)}, {time(job.created_at)}
          </option>
        ))}
      </select>
      <a class="button" href={href({ at: "compare", ids: [job.id, other.id] })}>
        Compare
      </a>
    </div>
  );
}

import { useSignal } from "@preact/signals";
import type { Job } from "../api/client";
import { hasEnded } from "../api/follow";
import { JobActions } from "./job-actions";
import { act, hasList, jobs, listProblem, loadOlder, olderCursor } from "./jobs";
import { ProblemNote } from "./problem";
import { href, route } from "./route";
import { titleOf } from "./send";
import { stage, stateOf, time } from "./words";

/** All jobs, newest first. */
export function JobList() {
  const isLoading = useSignal(false);
  const more = async () => {
    isLoading.value = true;
    await act("The older jobs could not be loaded", loadOlder);
    isLoading.value = false;
  };
  return (
    <section class="jobs" aria-labelledby="jobs-title">
      <h2 id="jobs-title">Jobs</h2>
      {listProblem.value && <ProblemNote title="The jobs could not be listed" problem={listProblem.value} />}
      {hasList.value && jobs.value.length === 0 && (
        <p class="hint">None yet. Send a mask, or a sample to begin with.</p>
      )}
      <ul>
        {jobs.value.map((job) => (
          <JobItem key={job.id} job={job} />
        ))}
      </ul>
      {olderCursor.value !== null && (
        <button type="button" disabled={isLoading.value} onClick={more}>
          Older jobs
        </button>
      )}
    </section>
  );
}

function JobItem({ job }: { job: Job }) {
  const at = route.value;
  const isShown = at.at === "job" && at.id === job.id;
  return (
    <li class={isShown ? "job shown" : "job"} data-job={job.id} data-state={job.state}>
      <a class="job-link" href={href({ at: "job", id: job.id })} aria-current={isShown ? "page" : undefined}>
        <span class="name">{titleOf(job)}</span>
        <span class={`state ${job.state}`}>{stateOf(job)}</span>
        <span class="hint">{time(job.created_at)}</span>
      </a>
      {!hasEnded(job) && <JobProgress job={job} />}
      <JobActions job={job} />
    </li>
  );
}

/** Share of a job that is done; none while that is not known. */
function shareOf({ progress, state }: Job): number | undefined {
  if (progress === null) return state === "queued" ? 0 : undefined;
  return progress.fraction < 1 ? progress.fraction : undefined;
}

/** How far a job is, by stage. */
export function JobProgress({ job }: { job: Job }) {
  const { progress } = job;
  return (
    <label class="progress">
      <span class="stage">{progress === null ? (job.state === "queued" ? "waiting" : "begins") : stage(progress)}</span>
      <progress value={shareOf(job)} max={1} />
    </label>
  );
}

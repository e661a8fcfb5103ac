import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { type Job, type Problem, problemOf, token } from "../api/client";
import { hasEnded } from "../api/follow";
import { JobActions } from "./job-actions";
import { JobProgress } from "./job-list";
import { jobOf, load } from "./jobs";
import { ProblemNote } from "./problem";
import { ResultView } from "./result-view";
import { titleOf } from "./send";
import { duration, runSeconds, stateOf, time } from "./words";

/** One job: what it does, what went wrong, or what came out. */
export function JobView({ id }: { id: string }) {
  const { job, problem } = useJob(id);
  if (problem !== null) return <ProblemNote title="This job cannot be shown" problem={problem} />;
  if (job === undefined) return <p class="hint">Loading …</p>;
  return (
    <article class="job-view" aria-labelledby="job-title" data-state={job.state}>
      <header class="row">
        <h2 id="job-title">{titleOf(job)}</h2>
        <span class={`state ${job.state}`} role="status">
          {stateOf(job)}
        </span>
        <span class="hint">{about(job)}</span>
        <JobActions job={job} canShare />
      </header>
      {!hasEnded(job) && <JobProgress job={job} />}
      {job.error && <ProblemNote title="There is no result" problem={job.error} />}
      {job.state === "canceled" && <p>It was stopped before it had a result.</p>}
      {job.state === "succeeded" && job.results_erased && <p>Its results were erased: their time was over.</p>}
      {job.state === "succeeded" && !job.results_erased && <ResultView key={job.id} job={job} />}
    </article>
  );
}

/** A job that a link names, loaded when it is not known yet. */
export function useJob(id: string): { job: Job | undefined; problem: Problem | null } {
  const problem = useSignal<Problem | null>(null);
  const job = jobOf(id);
  const isKnown = job !== undefined;
  const allowed = token.value;
  // With another token the job may be there.
  useEffect(() => {
    let isLeft = false;
    problem.value = null;
    if (!isKnown) {
      load(id).catch((error) => {
        if (!isLeft) problem.value = problemOf(error);
      });
    }
    return () => {
      isLeft = true;
    };
  }, [id, isKnown, allowed, problem]);
  return { job, problem: isKnown ? null : problem.value };
}

function about(job: Job): string {
  const seconds = runSeconds(job);
  const took = seconds === null ? "" : job.reused ? " · computed before" : ` · took ${duration(seconds)}`;
  return `${time(job.created_at)}${took}`;
}

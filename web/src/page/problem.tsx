import type { Problem } from "../api/client";

interface Props {
  problem: Problem;
  /** What could not be done. */
  title: string;
}

/** What went wrong, where, and what to do, in the service's words. */
export function ProblemNote({ problem, title }: Props) {
  return (
    <div class="problem" role="alert">
      <strong>{title}</strong>
      <p>
        {sentence(problem.detail)}
        {problem.location && ` (${problem.location})`}
      </p>
      {problem.hint && problem.hint !== problem.detail && <p>What to do: {problem.hint}.</p>}
      <p class="hint">
        <code>{problem.code}</code>
        {problem.retryable && " · trying again may help"}
        {problem.trace_id && ` · trace ${problem.trace_id}`}
      </p>
    </div>
  );
}

function sentence(text: string): string {
  const ended = /[.!?]$/.test(text) ? text : `${text}.`;
  // Names of parameters and fields keep their case.
  return /^[a-z]+ /.test(ended) ? ended.charAt(0).toUpperCase() + ended.slice(1) : ended;
}

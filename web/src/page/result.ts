/** The files of a job as the page shows them. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { fetchResult, type Job, type Problem, problemOf, token } from "../api/client";
import { fromThickness, type Result } from "../model/result";
import type { Thickness } from "../model/thickness";

export interface Loaded {
  glb: ArrayBuffer;
  numbers: Thickness;
  result: Result;
}

async function loadResult(job: Job, signal: AbortSignal): Promise<Loaded> {
  const [model, thickness] = await Promise.all([
    fetchResult(job, "model.glb", signal),
    fetchResult(job, "thickness.json", signal),
  ]);
  const [glb, numbers] = await Promise.all([model.arrayBuffer(), thickness.json() as Promise<Thickness>]);
  return { glb, numbers, result: fromThickness(numbers) };
}

/** The result of a job that has succeeded, and what went wrong on the way. */
export function useResult(job: Job | undefined): { loaded: Loaded | null; problem: Problem | null } {
  const loaded = useSignal<Loaded | null>(null);
  const problem = useSignal<Problem | null>(null);
  const shown = job?.state === "succeeded" && !job.results_erased ? job : null;
  const id = shown?.id;
  const allowed = token.value;
  // Results never change, but may be refused to a token.
  useEffect(() => {
    if (shown === null) return;
    const loading = new AbortController();
    loaded.value = null;
    problem.value = null;
    loadResult(shown, loading.signal).then(
      (found) => {
        if (!loading.signal.aborted) loaded.value = found;
      },
      (error) => {
        if (!loading.signal.aborted) problem.value = problemOf(error);
      },
    );
    return () => loading.abort();
  }, [id, allowed]);
  return { loaded: loaded.value, problem: problem.value };
}

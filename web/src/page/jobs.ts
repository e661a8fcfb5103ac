/** The jobs that the page knows, kept up to date. */

import { computed, effect, signal, untracked } from "@preact/signals";
import {
  cancelJob,
  deleteJob,
  fetchJob,
  fetchJobs,
  type Job,
  type Problem,
  Refused,
  retryJob,
  token,
} from "../api/client";
import { follow, hasEnded } from "../api/follow";
import { route } from "./route";

/** Jobs asked for at once. */
const PAGE = 30;
/** Jobs followed by their events. Browsers open six connections to a server; the rest is for requests. */
const FOLLOWED = 3;
/** How often the list is asked for while jobs are at work that are not followed, and otherwise, ms. */
const BUSY_MS = 2000;
const IDLE_MS = 20_000;

const known = signal<ReadonlyMap<string, Job>>(new Map());
/** Where the next page of older jobs begins; null when all are known. */
export const olderCursor = signal<string | null>(null);
/** Why the list could not be had. */
export const listProblem = signal<Problem | null>(null);
export const hasList = signal(false);

/** Newest first: ids ascend in order of arrival. */
export const jobs = computed(() => [...known.value.values()].sort((a, b) => (a.id < b.id ? 1 : -1)));

export function jobOf(id: string): Job | undefined {
  return known.value.get(id);
}

function keep(...news: Job[]): void {
  const next = new Map(known.peek());
  for (const job of news) next.set(job.id, job);
  known.value = next;
}

export function forget(id: string): void {
  const next = new Map(known.peek());
  next.delete(id);
  known.value = next;
}

export const add = (job: Job) => keep(job);

/** The newest jobs anew: others may have sent or erased some. */
export async function refresh(): Promise<void> {
  // What is sent meanwhile may not be in the answer.
  const before = [...known.peek().keys()];
  try {
    const { jobs: newest, next_cursor } = await fetchJobs(PAGE);
    const last = newest.at(-1)?.id ?? "";
    const there = new Set(newest.map((job) => job.id));
    for (const id of before) {
      const isInReach = next_cursor === null || id >= last;
      if (isInReach && !there.has(id)) forget(id);
    }
    keep(...newest);
    if (!hasList.peek()) olderCursor.value = next_cursor;
    hasList.value = true;
    listProblem.value = null;
  } catch (error) {
    if (error instanceof Refused) listProblem.value = error.problem;
  }
}

export async function loadOlder(): Promise<void> {
  if (olderCursor.value === null) return;
  const { jobs: older, next_cursor } = await fetchJobs(PAGE, olderCursor.value);
  keep(...older);
  olderCursor.value = next_cursor;
}

/** Loads a job that a link names. */
export async function load(id: string): Promise<void> {
  if (jobOf(id) === undefined) keep(await fetchJob(id));
}

export async function cancel(job: Job): Promise<void> {
  keep(await cancelJob(job));
}

export async function retry(job: Job): Promise<void> {
  keep(await retryJob(job));
}

export async function erase(job: Job): Promise<void> {
  await deleteJob(job);
  forget(job.id);
}

/** Jobs at work, the shown ones first. */
const active = computed(() => {
  const shown: string[] = route.value.at === "job" ? [route.value.id] : [];
  const ids = jobs.value.filter((job) => !hasEnded(job)).map((job) => job.id);
  // The oldest are the next to run.
  return [...ids.filter((id) => shown.includes(id)), ...ids.filter((id) => !shown.includes(id)).reverse()];
});

const streams = new Map<string, AbortController>();

function followFirst(ids: string[]): void {
  for (const [id, stream] of streams) {
    if (!ids.includes(id)) {
      stream.abort();
      streams.delete(id);
    }
  }
  for (const id of ids.filter((id) => !streams.has(id))) {
    const stream = new AbortController();
    streams.set(id, stream);
    const listener = {
      onJob: keep,
      onProgress: (progress: Job["progress"]) => {
        const job = known.peek().get(id);
        if (job !== undefined && !hasEnded(job)) keep({ ...job, state: "running", queue_position: null, progress });
      },
      onGone: () => forget(id),
    };
    void follow(id, listener, stream.signal);
  }
}

/** Begins to keep the list up to date. */
export function keepUpToDate(): void {
  const ids = computed(() => active.value.slice(0, FOLLOWED).join());
  effect(() => {
    const first = ids.value === "" ? [] : ids.value.split(",");
    untracked(() => followFirst(first));
  });
  let timer = 0;
  const again = () => {
    clearTimeout(timer);
    timer = window.setTimeout(tick, active.peek().length > FOLLOWED ? BUSY_MS : IDLE_MS);
  };
  const tick = async () => {
    if (document.visibilityState === "visible") await refresh();
    again();
  };
  effect(() => {
    // With another token there are other jobs.
    token.value;
    untracked(() => {
      for (const stream of streams.values()) stream.abort();
      streams.clear();
      followFirst(active.value.slice(0, FOLLOWED));
      void tick();
    });
  });
  const isBusy = computed(() => active.value.length > FOLLOWED);
  effect(() => {
    isBusy.value;
    again();
  });
  document.addEventListener("visibilitychange", () => document.visibilityState === "visible" && void tick());
}

/** What could not be done, to be told to the user. */
export const actProblem = signal<{ title: string; problem: Problem } | null>(null);

/** Does something that the service may refuse, and tells of the refusal. */
export async function act(title: string, what: () => Promise<void>): Promise<void> {
  try {
    actProblem.value = null;
    await what();
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    actProblem.value = { title, problem: error.problem };
  }
}

/** The jobs that the page knows, kept up to date. */

import { computed, effect, signal, untracked } from "@preact/signals";
import {
  cancelJob,
  deleteJob,
  fetchJob,
  fetchJobs,
  type Job,
  type Problem,
  type Progress,
  problemOf,
  retryJob,
  token,
} from "../api/client";
import { follow, hasEnded } from "../api/follow";
import { route } from "./route";

/** Jobs asked for at once. */
const PAGE = 30;
/** Jobs followed by their events. Browsers open six connections to a server, for all their tabs. */
const FOLLOWED = 2;
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

export function keep(...news: Job[]): void {
  const next = new Map(known.peek());
  for (const job of news) next.set(job.id, job);
  known.value = next;
}

function forget(...ids: string[]): void {
  const next = new Map(known.peek());
  for (const id of ids) next.delete(id);
  known.value = next;
}

/** What was asked for with the token that is still used; else the answer is somebody else's. */
export async function own<T>(answer: Promise<T>): Promise<T> {
  const asked = token.peek();
  const given = await answer;
  if (token.peek() !== asked) throw new Error("the token was changed meanwhile");
  return given;
}

/** The newest jobs anew: others may have sent or erased some. As far back as jobs are at work. */
async function refresh(): Promise<void> {
  const [before, asked] = [known.peek(), token.peek()];
  const oldest = active.peek().reduce((least, id) => (id < least ? id : least), "~");
  try {
    let page = await own(fetchJobs(PAGE));
    const newest = page.jobs;
    while (page.next_cursor !== null && (newest.at(-1)?.id ?? "") > oldest) {
      page = await own(fetchJobs(PAGE, page.next_cursor));
      newest.push(...page.jobs);
    }
    takeList(newest, page.next_cursor, before);
    listProblem.value = null;
  } catch (error) {
    if (token.peek() === asked) listProblem.value = problemOf(error);
  }
}

/** Takes a list that was asked for when the jobs `before` were known: what was heard since then is newer. */
function takeList(newest: Job[], next: string | null, before: ReadonlyMap<string, Job>): void {
  const last = newest.at(-1)?.id ?? "";
  const listed = new Set(newest.map(({ id }) => id));
  forget(...[...before.keys()].filter((id) => !listed.has(id) && (next === null || id >= last)));
  keepUnchanged(newest, before);
  // What is between these and those known before is with the older ones.
  if (!hasList.peek() || next === null || !before.has(last)) olderCursor.value = next;
  hasList.value = true;
}

/** Keeps jobs of which nothing was heard since `before`. */
function keepUnchanged(news: Job[], before: ReadonlyMap<string, Job>): void {
  const now = known.peek();
  keep(...news.filter(({ id }) => now.get(id) === before.get(id)));
}

export async function loadOlder(): Promise<void> {
  if (olderCursor.value === null) return;
  const before = known.peek();
  const { jobs: older, next_cursor } = await own(fetchJobs(PAGE, olderCursor.value));
  keepUnchanged(older, before);
  olderCursor.value = next_cursor;
}

/** Loads a job that a link names. */
export async function load(id: string): Promise<void> {
  if (jobOf(id) === undefined) keep(await own(fetchJob(id)));
}

export async function cancel(job: Job): Promise<void> {
  keep(await own(cancelJob(job)));
}

export async function retry(job: Job): Promise<void> {
  keep(await own(retryJob(job)));
}

/** Erases a job; `leave` is called before the page forgets it. */
export async function erase(job: Job, leave: () => void): Promise<void> {
  await deleteJob(job);
  leave();
  forget(job.id);
}

const isVisible = signal(document.visibilityState === "visible");
document.addEventListener("visibilitychange", () => {
  isVisible.value = document.visibilityState === "visible";
});

/** Jobs at work: the one that is shown, then the oldest, which are the next to run. */
const active = computed(() => {
  const shown = route.value.at === "job" ? route.value.id : "";
  const ids = jobs.value.filter((job) => !hasEnded(job)).map(({ id }) => id);
  return [...ids.filter((id) => id === shown), ...ids.filter((id) => id !== shown).reverse()];
});

const streams = new Map<string, AbortController>();

function followOnly(ids: string[]): void {
  for (const [id, stream] of streams) {
    if (!ids.includes(id)) {
      stream.abort();
      streams.delete(id);
    }
  }
  for (const id of ids.filter((id) => !streams.has(id))) {
    const stream = new AbortController();
    streams.set(id, stream);
    void follow(id, listenerOf(id), stream.signal);
  }
}

function listenerOf(id: string) {
  return {
    onJob: (job: Job) => {
      keep(job);
      if (listProblem.peek()?.status === 0) listProblem.value = null;
    },
    onProgress: (progress: Progress) => {
      const job = known.peek().get(id);
      // A job that was asked for may have been ahead of its events.
      if (job === undefined || hasEnded(job) || (job.progress?.fraction ?? 0) > progress.fraction) return;
      keep({ ...job, state: "running", queue_position: null, progress });
    },
    onGone: () => forget(id),
    onTrouble: (problem: Problem) => {
      listProblem.value = problem;
    },
  };
}

/** Begins to keep the list up to date. */
export function keepUpToDate(): void {
  effect(() => {
    // With another token there are other jobs.
    token.value;
    untracked(() => {
      followOnly([]);
      known.value = new Map();
      hasList.value = false;
      olderCursor.value = null;
      listProblem.value = null;
    });
  });
  const followed = computed(() => (isVisible.value ? active.value.slice(0, FOLLOWED).join() : ""));
  effect(() => {
    const ids = followed.value === "" ? [] : followed.value.split(",");
    untracked(() => followOnly(ids));
  });
  const isBusy = computed(() => active.value.length > FOLLOWED);
  effect(() => {
    token.value;
    if (!isVisible.value) return;
    const pace = isBusy.value ? BUSY_MS : IDLE_MS;
    // Without a token there is nothing to be had.
    const ask = () => listProblem.peek()?.status !== 401 && untracked(refresh);
    ask();
    const timer = setInterval(ask, pace);
    return () => clearInterval(timer);
  });
}

/** What could not be done, to be told to the user. */
export const actProblem = signal<{ title: string; problem: Problem } | null>(null);

/** Does something that may fail, and tells of it. */
export async function act(title: string, what: () => Promise<void>): Promise<void> {
  try {
    actProblem.value = null;
    await what();
  } catch (error) {
    actProblem.value = { title, problem: problemOf(error) };
  }
}

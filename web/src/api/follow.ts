/** Follows a job until it ends: by its events, or by asking when they do not come through. */

import { EventSourceParserStream } from "eventsource-parser/stream";
import { call, fetchJob, type Job, type Problem, type Progress, Refused } from "./client";

interface Listener {
  onJob(job: Job): void;
  onProgress(progress: Progress): void;
  /** It was deleted. */
  onGone(): void;
  /** The service is not reached; it is tried again. */
  onTrouble(problem: Problem): void;
}

/** How often in a row a stream may end without an event before the job is asked for instead. */
const TRIES = 2;
/** How often it is asked for before a stream is tried again. */
const POLLS = 10;
const PAUSE_MS = 1000;
/** Between tries while the service is not reached, at most. */
const LONG_PAUSE_MS = 10_000;
/** The first event comes at once: a stream that is silent for so long is kept back by a proxy. */
const SILENCE_MS = 5000;

export function hasEnded(job: Job): boolean {
  return job.state !== "queued" && job.state !== "running";
}

/** Returns when the job has ended, is gone, may not be seen, or `signal` is aborted. */
export async function follow(id: string, listener: Listener, signal: AbortSignal): Promise<void> {
  let [failures, polls, lastId, pauseMs] = [0, 0, "", PAUSE_MS];
  while (!signal.aborted) {
    try {
      pauseMs = Math.min(2 * pauseMs, LONG_PAUSE_MS);
      if (polls > 0) {
        polls--;
        if (polls === 0) failures = TRIES - 1;
        const job = await fetchJob(id, signal);
        listener.onJob(job);
        if (hasEnded(job)) return;
      } else {
        const heard = await listen(id, lastId, listener, signal);
        if (heard.isOver) return;
        lastId = heard.lastId;
        failures = heard.events > 0 ? 0 : failures + 1;
      }
      pauseMs = PAUSE_MS;
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof Refused && error.problem.status === 404) return listener.onGone();
      // Without being allowed to, asking again does not help.
      if (error instanceof Refused && [401, 403].includes(error.problem.status)) return;
      failures++;
      if (error instanceof Refused && error.problem.status === 0) listener.onTrouble(error.problem);
      else pauseMs = PAUSE_MS;
    }
    if (polls === 0 && failures >= TRIES) polls = POLLS;
    await pause(pauseMs, signal);
  }
}

interface Heard {
  lastId: string;
  events: number;
  /** There is no more to hear. */
  isOver: boolean;
}

/** Listens to one stream until it ends. */
async function listen(id: string, lastId: string, listener: Listener, signal: AbortSignal): Promise<Heard> {
  const stream = new AbortController();
  // One that comes back may have nothing to hear for long.
  const silence = lastId === "" ? setTimeout(() => stream.abort(), SILENCE_MS) : undefined;
  const heard: Heard = { lastId, events: 0, isOver: false };
  try {
    const headers = { Accept: "text/event-stream", ...(lastId === "" ? {} : { "Last-Event-ID": lastId }) };
    const either = AbortSignal.any([signal, stream.signal]);
    const response = await call(`/v1/jobs/${id}/events`, { headers, signal: either, cache: "no-store" });
    if (response.status === 204 || response.body === null) {
      listener.onJob(await fetchJob(id, signal));
      return { ...heard, isOver: true };
    }
    const events = response.body
      .pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array<ArrayBuffer>>)
      .pipeThrough(new EventSourceParserStream())
      .getReader();
    while (!heard.isOver) {
      const { done, value: event } = await events.read();
      if (done) break;
      clearTimeout(silence);
      heard.events++;
      heard.lastId = event.id ?? heard.lastId;
      heard.isOver = await pass(event, id, listener, signal);
    }
    return heard;
  } finally {
    // Also closes a stream that is left before its end.
    clearTimeout(silence);
    stream.abort();
  }
}

/** Passes an event on; whether it is the last one. */
async function pass(
  event: { event?: string | undefined; data: string },
  id: string,
  listener: Listener,
  signal: AbortSignal,
) {
  switch (event.event) {
    case "progress":
      listener.onProgress(JSON.parse(event.data));
      return false;
    case "gone":
      listener.onGone();
      return true;
    case "state": {
      const job = await fetchJob(id, signal);
      listener.onJob(job);
      return hasEnded(job);
    }
    default:
      return false;
  }
}

function pause(ms: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    const end = () => {
      clearTimeout(timer);
      signal.removeEventListener("abort", end);
      resolve();
    };
    const timer = setTimeout(end, ms);
    signal.addEventListener("abort", end);
  });
}

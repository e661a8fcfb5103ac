/** Follows a job until it ends: by its events, or by asking when they do not come through. */

import { EventSourceParserStream } from "eventsource-parser/stream";
import { call, fetchJob, type Job, type Progress, Refused } from "./client";

export interface Listener {
  onJob(job: Job): void;
  onProgress(progress: Progress): void;
  /** It was deleted. */
  onGone(): void;
}

/** How often a stream may fail without an event before the job is asked for instead. */
const TRIES = 2;
const PAUSE_MS = 1000;

export function hasEnded(job: Job): boolean {
  return job.state !== "queued" && job.state !== "running";
}

/** Returns when the job has ended, is gone, or `signal` is aborted. */
export async function follow(id: string, listener: Listener, signal: AbortSignal): Promise<void> {
  let failures = 0;
  let lastId = "";
  while (!signal.aborted) {
    try {
      if (failures < TRIES) {
        const heard = await listen(id, lastId, listener, signal);
        if (heard === "end") return;
        failures = heard === lastId ? failures + 1 : 0;
        lastId = heard;
      } else {
        const job = await fetchJob(id, signal);
        listener.onJob(job);
        if (hasEnded(job)) return;
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof Refused && error.problem.status === 404) return listener.onGone();
      // Without a token, or without being allowed to, asking again does not help.
      if (error instanceof Refused && [401, 403].includes(error.problem.status)) return;
      failures += 1;
    }
    await pause(signal);
  }
}

/** Listens to one stream; the id of its last event, or "end" when there is no more to hear. */
async function listen(id: string, lastId: string, listener: Listener, signal: AbortSignal): Promise<string> {
  const headers = { Accept: "text/event-stream", ...(lastId === "" ? {} : { "Last-Event-ID": lastId }) };
  const response = await call(`/v1/jobs/${id}/events`, { headers, signal, cache: "no-store" });
  if (response.status === 204 || response.body === null) {
    listener.onJob(await fetchJob(id, signal));
    return "end";
  }
  const events = response.body
    .pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array<ArrayBuffer>>)
    .pipeThrough(new EventSourceParserStream())
    .getReader();
  for (;;) {
    const { done, value: event } = await events.read();
    if (done) return lastId;
    if (event.event === "progress") listener.onProgress(JSON.parse(event.data));
    if (event.event === "gone") {
      listener.onGone();
      return "end";
    }
    if (event.event === "state") {
      lastId = event.id ?? lastId;
      const job = await fetchJob(id, signal);
      listener.onJob(job);
      if (hasEnded(job)) {
        await events.cancel();
        return "end";
      }
    }
  }
}

function pause(signal: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, PAUSE_MS);
    signal.addEventListener("abort", () => {
      clearTimeout(timer);
      resolve();
    });
  });
}

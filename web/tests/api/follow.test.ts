import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { Job, Problem } from "../../src/api/client";
import { follow } from "../../src/api/follow";

/** What the service answers, in order: by `events` to a stream, by `jobs` to a question for the job. */
let events: (() => Response)[];
let jobs: (() => Response)[];
let asked: { path: string; lastId: string | null; signal: AbortSignal | null }[];
let heard: string[];

const listener = {
  onJob: (job: Job) => heard.push(job.state),
  onProgress: (progress: Job["progress"]) => heard.push(`${progress?.stage}`),
  onGone: () => heard.push("gone"),
  onTrouble: (problem: Problem) => heard.push(problem.code),
};

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
  [events, jobs, asked, heard] = [[], [], [], []];
  vi.stubGlobal("fetch", async (path: string, init: RequestInit & { headers: Record<string, string> }) => {
    asked.push({ path, lastId: init.headers["Last-Event-ID"] ?? null, signal: init.signal ?? null });
    const answer = (path.endsWith("/events") ? events : jobs).shift();
    if (answer === undefined) throw new TypeError("nobody answers");
    return answer();
  });
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

/** Follows the job to the end; its pauses take no time. */
async function followed(): Promise<void> {
  let isOver = false;
  const over = follow("x", listener, new AbortController().signal).finally(() => {
    isOver = true;
  });
  while (!isOver) {
    await new Promise(setImmediate);
    await vi.advanceTimersByTimeAsync(250);
  }
  return over;
}

/** A stream of events that ends, or, if `isOpen`, goes on in silence until it is closed. */
function stream(text: string, isOpen = false): () => Response {
  return () => {
    const signal = asked.at(-1)?.signal;
    const body = new ReadableStream<Uint8Array>({
      start(to) {
        to.enqueue(new TextEncoder().encode(text));
        if (!isOpen) to.close();
        signal?.addEventListener("abort", () => isOpen && to.error(new DOMException("closed", "AbortError")));
      },
    });
    return new Response(body, { headers: { "Content-Type": "text/event-stream" } });
  };
}

const state = (id: number) => `event: state\nid: ${id}\ndata: {}\n\n`;
const progress = (stage: string) => `event: progress\ndata: {"stage":"${stage}"}\n\n`;
const job = (state: string) => () => Response.json({ id: "x", state });
const problem = (status: number) => () => Response.json({ code: "c", detail: "d", status }, { status });

test("a job is followed to its end, and its stream is closed", async () => {
  events = [stream(state(1) + progress("isomap") + state(2), true)];
  jobs = [job("running"), job("succeeded")];
  await followed();
  expect(heard).toEqual(["running", "isomap", "succeeded"]);
  expect(asked[0]?.signal?.aborted).toBe(true);
});

test("a stream that was cut is taken up where it ended", async () => {
  events = [stream(state(1)), stream(state(2))];
  jobs = [job("running"), job("failed")];
  await followed();
  expect(asked.filter(({ path }) => path.endsWith("/events")).map(({ lastId }) => lastId)).toEqual([null, "1"]);
  expect(heard).toEqual(["running", "failed"]);
});

test("streams that end without an event are given up for asking, and tried again later", async () => {
  events = [stream(""), stream(""), stream(state(1))];
  jobs = [...Array.from({ length: 10 }, () => job("running")), job("succeeded")];
  await followed();
  const kinds = asked.map(({ path }) => (path.endsWith("/events") ? "e" : "j")).join("");
  expect(kinds).toBe("eejjjjjjjjjjej");
  expect(heard.at(-1)).toBe("succeeded");
});

test("a stream that a proxy keeps back is given up", async () => {
  events = [stream("", true), stream("", true)];
  jobs = [job("succeeded")];
  await followed();
  expect(heard).toEqual(["succeeded"]);
  expect(asked.slice(0, 2).every(({ signal }) => signal?.aborted)).toBe(true);
});

test("an error beside the stream closes it", async () => {
  events = [stream(state(1), true), stream(state(1))];
  jobs = [problem(429), job("canceled")];
  await followed();
  expect(asked[0]?.signal?.aborted).toBe(true);
  expect(heard).toEqual(["canceled"]);
});

test.each([
  ["has ended", () => new Response(null, { status: 204 }), "succeeded"],
  ["is gone", problem(404), "gone"],
])("a job that %s is not asked for again", async (_, answer, last) => {
  events = [answer];
  jobs = [job("succeeded")];
  await followed();
  expect(heard).toEqual([last]);
});

test("nobody goes on asking without being allowed to", async () => {
  events = [problem(401)];
  await followed();
  expect(asked).toHaveLength(1);
  expect(heard).toEqual([]);
});

test("a service that is not reached is told of, and tried again ever less often", async () => {
  const nobody = () => {
    throw new TypeError("nobody answers");
  };
  events = [nobody, nobody];
  jobs = [nobody, nobody, nobody, job("succeeded")];
  const waits = vi.spyOn(globalThis, "setTimeout");
  await followed();
  expect(heard).toEqual([...Array.from({ length: 5 }, () => "no_answer"), "succeeded"]);
  const pauses = waits.mock.calls.map(([, ms]) => ms ?? 0).filter((ms) => ms >= 1000 && ms !== 5000);
  expect(pauses).toEqual([2000, 4000, 8000, 10_000, 10_000]);
});

test("following stops when it is not wanted any more", async () => {
  const wanted = new AbortController();
  events = [stream(state(1), true)];
  jobs = [job("running")];
  await follow("x", { ...listener, onJob: () => wanted.abort() }, wanted.signal);
  expect(asked[0]?.signal?.aborted).toBe(true);
});

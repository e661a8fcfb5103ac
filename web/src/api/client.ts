/** Requests to the service that served this page. */

import { signal } from "@preact/signals";
import type { components } from "./schema";

type Schemas = components["schemas"];
export type Job = Schemas["Job"];
export type Progress = Schemas["Progress"];
export type Problem = Schemas["Problem"];
export type Limits = Schemas["Limits"];
export type ResultFile = Schemas["Result"];
type JobList = Schemas["JobList"];
type SampleList = Schemas["SampleList"];
export type Sample = SampleList["samples"][number];

/** The token, in memory only: it is gone when the page is. */
export const token = signal<string | null>(null);
/** Why a token is asked for: the service refused the request, or the user wants another one. Null when it is not. */
export const tokenWanted = signal<Problem | "by hand" | null>(null);

/** What the service refused, in its own words. */
export class Refused extends Error {
  constructor(readonly problem: Problem) {
    super(problem.detail);
  }
}

/** A problem that the service did not tell: it was not reached, or something in between answered. */
function strange(title: string, detail: string, status = 0): Problem {
  return { type: "about:blank", code: "no_answer", title, detail, status, retryable: true };
}

function headers(more: Record<string, string> = {}): Record<string, string> {
  const shown = token.peek();
  return shown === null ? more : { ...more, Authorization: `Bearer ${shown}` };
}

/** @throws Refused when the service is not reached or answers with a problem. */
export async function call(path: string, init: RequestInit & { headers?: Record<string, string> } = {}) {
  const shown = token.peek();
  let response: Response;
  try {
    response = await fetch(path, { ...init, headers: headers(init.headers) });
  } catch (error) {
    if (init.signal?.aborted) throw error;
    throw new Refused(strange("The service cannot be reached", "No answer came. Is it running, and the network up?"));
  }
  if (!response.ok)
    throw new Refused(noteRefusal(readProblem(response.status, await response.text().catch(() => "")), shown));
  return response;
}

/** What an error is to people. */
export function problemOf(error: unknown): Problem {
  if (error instanceof Refused) return error.problem;
  return strange("This page did not expect that", error instanceof Error ? error.message : String(error));
}

/** The problem in an answer; one of our own when something between here and the service answered. */
function readProblem(status: number, body: string): Problem {
  try {
    const problem = JSON.parse(body);
    if (typeof problem.code === "string" && typeof problem.detail === "string") return problem;
  } catch {
    // No problem object: told below.
  }
  return strange("An answer that the service does not give", `Status ${status}; a proxy may have sent it.`, status);
}

/** Asks for a token when the one that was shown is what is wrong. */
function noteRefusal(problem: Problem, shown: string | null): Problem {
  // Of a token that is not used any more it is no news.
  if (problem.status === 401 && token.peek() === shown) tokenWanted.value = problem;
  return problem;
}

async function json<T>(path: string, init: Parameters<typeof call>[1] = {}): Promise<T> {
  const response = await call(path, init);
  return response.json().catch(() => {
    throw new Refused(readProblem(response.status, ""));
  });
}

export const fetchLimits = () => json<Limits>("/v1/limits");
export const fetchSamples = async () => (await json<SampleList>("/v1/samples")).samples;
export const fetchJob = (id: string, signal?: AbortSignal) =>
  json<Job>(`/v1/jobs/${id}`, signal === undefined ? {} : { signal });
export const cancelJob = (job: Job) => json<Job>(job.links.cancel ?? job.links.self, { method: "POST" });
export const retryJob = (job: Job) => json<Job>(job.links.retry ?? job.links.self, { method: "POST" });
export const deleteJob = (job: Job) => call(job.links.self, { method: "DELETE" });

/** A page of jobs, newest first, from `cursor` on. */
export const fetchJobs = (limit: number, cursor?: string) =>
  json<JobList>(`/v1/jobs?limit=${limit}${cursor === undefined ? "" : `&cursor=${encodeURIComponent(cursor)}`}`);

interface Submission {
  mask: Blob;
  params: Record<string, unknown>;
  labels: Record<string, string>;
  /** Also when equal work was done before. */
  anew: boolean;
}

/**
 * Sends a mask as a form: what people type does not get into addresses, which are logged. `onSent` hears the share
 * that has been sent; fetch would not tell.
 */
export function submit({ mask, params, labels, anew }: Submission, onSent: (share: number) => void): Promise<Job> {
  const shown = token.peek();
  const request = new XMLHttpRequest();
  request.open("POST", "/v1/jobs");
  for (const [name, value] of Object.entries(headers(anew ? { "Cache-Control": "no-cache" } : {}))) {
    request.setRequestHeader(name, value);
  }
  request.upload.onprogress = (event) => onSent(event.total > 0 ? event.loaded / event.total : 0);
  const form = new FormData();
  form.append("params", JSON.stringify(params));
  form.append("labels", JSON.stringify(labels));
  // Under this name instead of the file's own.
  form.append("mask", mask, "mask");
  return new Promise((resolve, reject) => {
    request.onload = () => {
      if (request.status === 202) resolve(JSON.parse(request.responseText));
      else reject(new Refused(noteRefusal(readProblem(request.status, request.responseText), shown)));
    };
    request.onerror = () =>
      reject(new Refused(strange("The mask could not be sent", "The connection ended before there was an answer.")));
    request.send(form);
  });
}

/** A result of a job. */
export function fetchResult(job: Job, name: string, signal?: AbortSignal): Promise<Response> {
  return call(resultPath(job, name), signal === undefined ? {} : { signal });
}

function resultPath(job: Job, name: string): string {
  return job.results.find((file) => file.name === name)?.href ?? `${job.links.self}/results/${name}`;
}

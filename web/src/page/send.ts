/** Masks on their way to the service. */

import { signal } from "@preact/signals";
import {
  call,
  fetchLimits,
  fetchSamples,
  type Job,
  type Limits,
  type Problem,
  problemOf,
  Refused,
  type Sample,
  submit,
} from "../api/client";
import { keep, own } from "./jobs";
import { assemble, type Field, type Filled, fieldsOf, type Schema } from "./params";
import { go, type Route, route } from "./route";
import { bytes, nameOf } from "./words";

export const limits = signal<Limits | null>(null);
export const samples = signal<Sample[]>([]);
export const fields = signal<Field[]>([]);

/** What the form holds. */
export const form = signal<Record<string, Filled>>({});
export const jobName = signal("");
/** Computes also what was computed before. */
export const anew = signal(false);

/** What a job is called on this page. */
export function titleOf(job: Job): string {
  return fileNames.value.get(job.id) ?? nameOf(job);
}

interface Sending {
  key: number;
  name: string;
  /** Share sent, 0 to 1; null while a sample is fetched. */
  share: number | null;
  problem: Problem | null;
}

export const sendings = signal<Sending[]>([]);
/** Names of files by job: kept in memory only, and never sent, for they may name a patient. */
const fileNames = signal<ReadonlyMap<string, string>>(new Map());

/** How long to wait for a service that does not answer, ms. */
const AGAIN_MS = 5000;

/** Asks the service for its limits and samples, until it answers. */
export async function askWhatIsTaken(): Promise<void> {
  try {
    if (limits.value === null) {
      limits.value = await fetchLimits();
      fields.value = fieldsOf(limits.value.params as Schema);
    }
    samples.value = await fetchSamples();
  } catch (error) {
    // Without being allowed to there are no samples; what to do about that is told elsewhere.
    if (problemOf(error).retryable) setTimeout(askWhatIsTaken, AGAIN_MS);
  }
}

let keys = 0;

/** Shows that something is being sent; what it returns tells how it goes on. */
function begin(name: string): { key: number; news(news: Partial<Sending>): void } {
  const key = ++keys;
  sendings.value = [...sendings.value, { key, name, share: null, problem: null }];
  const news = (news: Partial<Sending>) => {
    sendings.value = sendings.value.map((sending) => (sending.key === key ? { ...sending, ...news } : sending));
  };
  return { key, news };
}

export function dismiss(key: number): void {
  sendings.value = sendings.value.filter((sending) => sending.key !== key);
}

interface Wanted {
  params: Record<string, unknown>;
  labels: Record<string, string>;
  anew: boolean;
}

/** What the form says now; null while something in it is wrong. */
function wanted(labels: Record<string, string> = {}): Wanted | null {
  const { params, wrong } = assemble(fields.value, form.value);
  const name = jobName.value.trim();
  if (Object.keys(wrong).length > 0) return null;
  return { params, labels: name === "" ? labels : { ...labels, name }, anew: anew.value };
}

/** Sends files, one job each; shows the job when there is but one. */
export async function sendFiles(files: File[]): Promise<void> {
  const asked = wanted();
  if (asked === null) return;
  const from = route.peek();
  for (const file of files) {
    const job = await send(file.name, () => Promise.resolve(file), asked);
    if (job === null) continue;
    fileNames.value = new Map(fileNames.value).set(job.id, file.name);
    if (files.length === 1) showFrom(from, job);
  }
}

export async function sendSample(sample: Sample): Promise<void> {
  const asked = wanted({ sample: sample.name });
  const from = route.peek();
  const job = asked && (await send(sample.name, async () => (await call(sample.href)).blob(), asked));
  if (job !== null) showFrom(from, job);
}

/** Shows a job that was sent from there, unless its sender does something else by now. */
function showFrom(from: Route, job: Job): void {
  const isTyping = document.activeElement?.matches("input[type=text], input[type=password], select") ?? false;
  if (route.peek() === from && !isTyping) go({ at: "job", id: job.id });
}

/** Sends a mask; null when it was refused, which is told. */
async function send(name: string, mask: () => Promise<Blob>, asked: Wanted): Promise<Job | null> {
  const { key, news } = begin(name);
  try {
    const blob = await mask();
    refuseTooLarge(blob);
    const job = await own(submit({ mask: blob, ...asked }, (share) => news({ share })));
    keep(job);
    dismiss(key);
    return job;
  } catch (error) {
    news({ problem: problemOf(error) });
    return null;
  }
}

/** A server that refuses a long body ends the connection, and browsers then keep its answer to themselves. */
function refuseTooLarge(mask: Blob): void {
  const most = limits.value?.max_upload_bytes ?? Infinity;
  if (mask.size <= most) return;
  throw new Refused({
    type: "urn:medialrep:problem:upload_too_large",
    code: "upload_too_large",
    title: "Upload too large",
    status: 413,
    detail: `the file has ${bytes(mask.size)}, the service takes ${bytes(most)}`,
    hint: "send it compressed (.nii.gz), or crop it to the labels wanted",
    retryable: false,
  });
}

/** Masks on their way to the service. */

import { signal } from "@preact/signals";
import {
  call,
  fetchLimits,
  fetchSamples,
  type Limits,
  type Problem,
  Refused,
  type Sample,
  submit,
} from "../api/client";
import { add } from "./jobs";
import { assemble, type Field, type Filled, fieldsOf, type Schema } from "./params";
import { go } from "./route";
import { bytes } from "./words";

export const limits = signal<Limits | null>(null);
export const samples = signal<Sample[]>([]);
export const fields = signal<Field[]>([]);

/** What the form holds. */
export const form = signal<Record<string, Filled>>({});
export const jobName = signal("");
/** Computes also what was computed before. */
export const anew = signal(false);

export interface Sending {
  key: number;
  name: string;
  /** Share sent, 0 to 1; null while a sample is fetched. */
  share: number | null;
  problem: Problem | null;
}

export const sendings = signal<Sending[]>([]);
/** Names of files by job: kept in memory only, and never sent, for they may name a patient. */
export const fileNames = signal<ReadonlyMap<string, string>>(new Map());

/** Asks the service what it takes. */
export async function askForLimits(): Promise<void> {
  limits.value = await fetchLimits();
  fields.value = fieldsOf(limits.value.params as Schema);
}

export async function askForSamples(): Promise<void> {
  samples.value = await fetchSamples();
}

let keys = 0;

function begin(name: string): (news: Partial<Sending>) => void {
  const key = ++keys;
  sendings.value = [...sendings.value, { key, name, share: null, problem: null }];
  return (news) => {
    sendings.value = sendings.value.map((sending) => (sending.key === key ? { ...sending, ...news } : sending));
    if (news.share === Infinity) dismiss(key);
  };
}

export function dismiss(key: number): void {
  sendings.value = sendings.value.filter((sending) => sending.key !== key);
}

/** Sends files, one job each; shows the job when there is but one. */
export async function sendFiles(files: File[]): Promise<void> {
  for (const file of files) {
    await send(file.name, () => Promise.resolve(file), {}, files.length === 1);
  }
}

export async function sendSample(sample: Sample): Promise<void> {
  await send(sample.name, async () => (await call(sample.href)).blob(), { sample: sample.name }, true);
}

async function send(name: string, mask: () => Promise<Blob>, more: Record<string, string>, isShown: boolean) {
  const { params, wrong } = assemble(fields.value, form.value);
  if (Object.keys(wrong).length > 0) return;
  const news = begin(name);
  try {
    const blob = await mask();
    refuseTooLarge(blob);
    const given = jobName.value.trim();
    const labels = given === "" ? more : { ...more, name: given };
    const job = await submit({ mask: blob, params, labels, anew: anew.value }, (share) => news({ share }));
    if (more.sample === undefined) fileNames.value = new Map(fileNames.value).set(job.id, name);
    add(job);
    news({ share: Infinity });
    if (isShown) go({ at: "job", id: job.id });
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    news({ problem: error.problem });
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

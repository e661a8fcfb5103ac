/** Numbers, times and states in words. */

import type { Job, Progress } from "../api/client";
import type { Figure, Structure } from "../model/thickness";

export function bytes(count: number): string {
  const units = ["B", "kB", "MB", "GB"];
  const step = Math.min(Math.max(Math.floor(Math.log10(Math.max(count, 1)) / 3), 0), units.length - 1);
  const value = count / 1000 ** step;
  return `${value.toFixed(step === 0 || value >= 100 ? 0 : 1)} ${units[step]}`;
}

/** A number with its decimals; a dash when there is none. */
export function number(value: number | null | undefined, decimals = 2): string {
  if (value === null || value === undefined) return "–";
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

/** A structure by its name, where it has one, and its label. */
export function structureName({ label, name }: Pick<Structure, "label" | "name">): string {
  return name ? `${name} (label ${label})` : `label ${label}`;
}

/** A figure by its number; sheets are what figures are as a rule. */
export function figureName({ index, kind }: Pick<Figure, "index" | "kind">): string {
  return kind === "tube" ? `figure ${index} (tube)` : `figure ${index}`;
}

export function duration(seconds: number): string {
  if (seconds < 1) return `${Math.round(seconds * 1000)} ms`;
  if (seconds < 60) return `${seconds.toFixed(seconds < 10 ? 1 : 0)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return seconds < 129_600 ? `${Math.round(seconds / 3600)} h` : `${Math.round(seconds / 86_400)} days`;
}

export function time(rfc3339: string): string {
  return new Date(rfc3339).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "medium" });
}

/** Seconds of the last run; null when there was none. */
export function runSeconds(job: Job): number | null {
  if (job.started_at === null || job.ended_at === null) return null;
  return (Date.parse(job.ended_at) - Date.parse(job.started_at)) / 1000;
}

const STATES: Record<Job["state"], string> = {
  queued: "waiting",
  running: "running",
  succeeded: "done",
  failed: "failed",
  canceled: "cancelled",
};

export function stateOf(job: Job): string {
  if (job.cancel_requested && job.state === "running") return "stopping";
  const place = job.queue_position === null ? "" : `, place ${job.queue_position} in the queue`;
  return `${STATES[job.state]}${place}`;
}

/** What is done in each stage of a run. */
const STAGES: Record<string, string> = {
  read: "reading the file",
  mask: "cleaning the mask",
  distance: "measuring distances",
  skeleton: "thinning to the medial surface",
  sheets: "separating the sheets",
  sides: "finding both sides",
  isomap: "laying the sheet flat",
  lattice: "placing the lattice",
  spokes: "drawing the vectors",
  quality: "checking the result",
};

export function stage({ stage, structure, structures, fraction }: Progress): string {
  // What is left are the files.
  if (fraction >= 1) return "finishing";
  const of = structures > 1 ? `structure ${structure + 1} of ${structures}: ` : "";
  return `${of}${STAGES[stage] ?? stage}`;
}

/** The name that the sender gave a job, or the start of its id. */
export function nameOf(job: Job): string {
  const { name, sample } = job.labels;
  if (name !== undefined) return name;
  return sample === undefined ? `job …${job.id.slice(-6)}` : `sample ${sample}`;
}

export function plural(count: number, one: string, many = `${one}s`): string {
  return `${count} ${count === 1 ? one : many}`;
}

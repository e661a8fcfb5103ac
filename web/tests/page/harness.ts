/** A service of its own and a browser for the tests of the page. */

import { type ChildProcess, execFileSync, spawn } from "node:child_process";
import { once } from "node:events";
import { existsSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { type Browser, chromium, type Page } from "playwright-core";

const PROGRAM = process.env.MEDIALREP_PROGRAM ?? "../target/debug/medialrep";
const BROWSERS = [process.env.BROWSER, "/usr/bin/chromium", "/usr/bin/google-chrome"];

export interface Service {
  url: string;
  dataDir: string;
  stop(): Promise<void>;
}

/** Starts the program on a port of its own. */
export async function startService(options: string[] = [], dataDir = scratch()): Promise<Service> {
  const { MEDIALREP_WORKERS = "1", ...inherited } = process.env;
  const server = spawn(PROGRAM, ["serve", "--log-format", "json", "--data-dir", dataDir, ...options], {
    env: { ...inherited, MEDIALREP_WORKERS, MEDIALREP_LISTEN: "127.0.0.1:0", MEDIALREP_MIN_FREE_MIB: "0" },
    stdio: ["ignore", "ignore", "pipe"],
  });
  const address = await firstLine(server);
  return {
    url: `http://${address}`,
    dataDir,
    async stop() {
      server.removeAllListeners("exit");
      const ended = once(server, "exit");
      server.kill();
      await ended;
      rmSync(dataDir, { recursive: true, force: true });
    },
  };
}

/** The address in the first line of the log; the rest is read so that the service never waits for a full pipe. */
function firstLine(server: ChildProcess): Promise<string> {
  return new Promise((resolve, reject) => {
    server.once("error", reject);
    server.once("exit", (code) => reject(new Error(`the service ended with ${code}`)));
    const lines = createInterface({ input: server.stderr as NodeJS.ReadableStream });
    lines.once("line", (line) => resolve(JSON.parse(line).address));
    lines.on("line", () => {});
  });
}

export function scratch(): string {
  return mkdtempSync(join(tmpdir(), "medialrep-page-"));
}

/** Runs the program and gives what it prints. */
export function run(...options: string[]): string {
  return execFileSync(PROGRAM, options, { encoding: "utf8" });
}

/** A sample's mask as a file. */
export function sampleFile(dir: string, name: string, ...options: string[]): string {
  const path = join(dir, `${name}.nii.gz`);
  run("sample", name, "--out", path, ...options);
  return path;
}

/** Draws without a graphics card, as machines that test have none. */
export function startBrowser(): Promise<Browser> {
  const executablePath = BROWSERS.find((path) => path !== undefined && existsSync(path));
  if (executablePath === undefined) throw new Error("the tests of the page need chromium: apt-get install chromium");
  const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
  return chromium.launch({ executablePath, args });
}

/** Sends a mask as any client would; the job once it has ended. */
export async function finishedJob(service: Service, mask: string, params: object = {}) {
  const query = new URLSearchParams({ params: JSON.stringify(params) });
  const body = readFileSync(mask);
  const sent = await fetch(`${service.url}/v1/jobs?${query}`, { method: "POST", body, headers: { Prefer: "wait=50" } });
  const job = (await sent.json()) as { id: string; state: string };
  if (job.state !== "succeeded") throw new Error(`the job has ${job.state}`);
  return job;
}

export async function resultOf(service: Service, id: string) {
  return (await fetch(`${service.url}/v1/jobs/${id}/results/thickness.json`)).json();
}

/** What the page must never do, noted while it is used. */
export interface Watch {
  /** Requests to other servers. */
  foreign: string[];
  /** Errors of scripts, and what the content security policy stopped. */
  errors: string[];
}

export function watch(page: Page, service: Service): Watch {
  const noted: Watch = { foreign: [], errors: [] };
  page.on("request", (request) => {
    const url = new URL(request.url());
    if (!["data:", "blob:"].includes(url.protocol) && url.origin !== service.url) noted.foreign.push(request.url());
  });
  page.on("pageerror", (error) => noted.errors.push(String(error)));
  page.on("console", (message) => {
    // Answers that are refusals are logged by the browser itself.
    if (message.type() === "error" && !message.text().startsWith("Failed to load resource")) {
      noted.errors.push(message.text());
    }
  });
  return noted;
}

/** The job of an address such as `…/#/jobs/{id}`. */
export function idIn(url: string): string {
  return /#\/jobs\/([0-9a-f-]{36})$/.exec(url)?.[1] ?? "";
}

/** Waits for a model to be drawn. */
export async function modelShown(page: Page): Promise<void> {
  await page.waitForSelector("medial-viewer[data-state=ready]", { timeout: 30_000 });
}

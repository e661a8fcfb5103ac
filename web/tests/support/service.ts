/** The program, as a command and as a service, and a browser, for the tests. */

import { type ChildProcess, execFileSync, spawn } from "node:child_process";
import { once } from "node:events";
import { existsSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { type Browser, chromium, type Page } from "playwright-core";
import { afterAll } from "vitest";
import type { Thickness } from "../../src/model/thickness";

const PROGRAM = process.env.MEDIALREP_PROGRAM ?? "../target/debug/medialrep";
const BROWSERS = [process.env.MEDIALREP_BROWSER, "/usr/bin/chromium", "/usr/bin/google-chrome"];

export interface Service {
  url: string;
  dataDir: string;
  stop(): Promise<void>;
}

/** Starts the program on a port of its own. */
export async function startService(
  options: string[] = [],
  dataDir = mkdtempSync(join(tmpdir(), "medialrep-web-")),
): Promise<Service> {
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

/** A folder that goes with the tests of its file. */
export function scratch(): string {
  const dir = mkdtempSync(join(tmpdir(), "medialrep-web-"));
  afterAll(() => rmSync(dir, { recursive: true, force: true }));
  return dir;
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

/** What the program makes of one of its samples. */
export function sampleResult(name: string): { glb: ArrayBuffer; thickness: Thickness } {
  const dir = mkdtempSync(join(tmpdir(), "medialrep-web-"));
  try {
    run("run", sampleFile(dir, name), "--out", join(dir, "result"));
    const bytes = readFileSync(join(dir, "result", "model.glb"));
    const glb = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength) as ArrayBuffer;
    return { glb, thickness: JSON.parse(readFileSync(join(dir, "result", "thickness.json"), "utf8")) };
  } finally {
    rmSync(dir, { recursive: true });
  }
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

export async function resultOf(service: Service, id: string): Promise<Thickness> {
  return (await fetch(`${service.url}/v1/jobs/${id}/results/thickness.json`)).json();
}

/** The job of an address such as `…/#/jobs/{id}`. */
export function idIn(url: string): string {
  return /#\/jobs\/([0-9a-f-]{36})$/.exec(url)?.[1] ?? "";
}

/** Waits for a model to be drawn. */
export async function modelShown(page: Page): Promise<void> {
  await page.waitForSelector("medial-viewer[data-state=ready]", { timeout: 30_000 });
}

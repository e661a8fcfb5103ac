/** What people do with the page, for the tests. */

import { readFileSync } from "node:fs";
import type { Page } from "playwright-core";
import { PNG } from "pngjs";
import type { MedialViewer, NodeRef, Surface } from "../../src/viewer";
import { modelShown } from "./service";

/** Chooses a sample and sends it; returns when its job is shown. */
export async function sendSample(page: Page, name: string): Promise<void> {
  await page.getByLabel("Sample", { exact: true }).selectOption(name);
  await page.getByRole("button", { name: "Send sample" }).click();
  await page.waitForURL(/#\/jobs\//);
}

export async function openJob(page: Page, url: string, id: string): Promise<void> {
  await page.goto(`${url}/#/jobs/${id}`);
  await modelShown(page);
}

/** Where a node is drawn, in CSS px of the page. */
export async function placeOf(page: Page, node: NodeRef, surface: Surface): Promise<{ x: number; y: number }> {
  const within = await page
    .locator("medial-viewer")
    .first()
    .evaluate((viewer, [node, surface]) => (viewer as MedialViewer).screenOf(node as NodeRef, surface as Surface), [
      node,
      surface,
    ] as const);
  const box = await page.locator("medial-viewer").first().boundingBox();
  if (within === null || box === null) throw new Error("the node is not in the picture");
  return { x: box.x + within.x, y: box.y + within.y };
}

/** Lets the next frames be drawn. */
export async function settled(page: Page): Promise<void> {
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 250))));
}

/** What the 3D view looks like now. */
export async function pictureOf(page: Page): Promise<PNG> {
  await settled(page);
  return PNG.sync.read(await page.locator("medial-viewer").first().screenshot());
}

/** RGB of a pixel. */
export function colorAt({ data, width }: PNG, x: number, y: number): [number, number, number] {
  const from = 4 * (Math.round(y) * width + Math.round(x));
  return [data[from] ?? 0, data[from + 1] ?? 0, data[from + 2] ?? 0];
}

/** How many pixels differ. */
export function changes(a: PNG, b: PNG): number {
  let count = 0;
  for (let y = 0; y < a.height; y++) {
    for (let x = 0; x < a.width; x++) {
      if (distance(colorAt(a, x, y), colorAt(b, x, y)) > 6) count++;
    }
  }
  return count;
}

export function distance(a: number[], b: number[]): number {
  return Math.max(...a.map((value, channel) => Math.abs(value - (b[channel] ?? 0))));
}

const AXE = readFileSync(new URL("../../node_modules/axe-core/axe.min.js", import.meta.url), "utf8");

/** What axe finds that is serious or critical. Evaluated by the debugger, which no policy of the page forbids. */
export async function findings(page: Page): Promise<string[]> {
  await settled(page);
  await page.evaluate(AXE);
  return page.evaluate(async () => {
    const { axe } = window as unknown as { axe: typeof import("axe-core") };
    const { violations } = await axe.run();
    return violations
      .filter(({ impact }) => impact === "serious" || impact === "critical")
      .map(({ id, help, nodes }) => `${id}: ${help}: ${nodes.map(({ target }) => target.join(" ")).join(", ")}`);
  });
}

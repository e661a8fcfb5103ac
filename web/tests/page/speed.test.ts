/** How fast the 3D view turns. Figures depend on the machine: the bars here only catch what is broken. */

import { existsSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import { ellipsoids } from "../support/label-map";
import { leaveOut } from "../support/left-out";
import { finishedJob, resultOf, type Service, scratch, startBrowser, startService } from "../support/service";
import { changes, openJob, pictureOf } from "../support/use";

/** Real masks, where they are at hand. */
const BIGBRAIN = new URL("../../../../shared/data/volumes/bigbrain.nii.gz", import.meta.url).pathname;

let browser: Browser;
let service: Service;
const files = scratch();

beforeAll(async () => {
  [browser, service] = await Promise.all([startBrowser(), startService()]);
});

afterAll(async () => {
  await browser?.close();
  await service?.stop();
});

/** Frames a second and the longest frame, ms, while the view turns for some seconds at 1280 × 800. */
async function turning(page: Page): Promise<{ perSecond: number; longest: number }> {
  return page.locator("medial-viewer").evaluate(async (element) => {
    const viewer = element as HTMLElementTagNameMap["medial-viewer"];
    Object.assign(viewer.style, { position: "fixed", inset: "0", width: "1280px", height: "800px", zIndex: "9" });
    const frame = () => new Promise<number>((drawn) => requestAnimationFrame(drawn));
    for (let n = 0; n < 10; n++) await frame();
    const start = await frame();
    let [last, count, longest] = [start, 0, 0];
    while (last - start < 3000) {
      const camera = viewer.camera;
      if (!camera) throw new Error("there is no camera");
      const [x, y, z] = camera.direction;
      const angle = 0.03;
      const direction: [number, number, number] = [
        x * Math.cos(angle) - y * Math.sin(angle),
        x * Math.sin(angle) + y * Math.cos(angle),
        z,
      ];
      viewer.camera = { ...camera, direction };
      const now = await frame();
      longest = Math.max(longest, now - last);
      last = now;
      count++;
    }
    return { perSecond: (1000 * count) / (last - start), longest };
  });
}

async function measure(name: string, mask: string) {
  const { id } = await finishedJob(service, mask);
  const { structures } = await resultOf(service, id);
  const page = await (await browser.newContext({ viewport: { width: 1280, height: 800 } })).newPage();
  await openJob(page, service.url, id);
  const found = await turning(page);
  await page.context().close();
  console.log(
    `${name}: ${structures.length} structures, ${found.perSecond.toFixed(1)} frames a second, longest ${found.longest.toFixed(0)} ms`,
  );
  return { ...found, structures: structures.length };
}

test("one of sixty structures is hidden at once", async () => {
  const mask = join(files, "many.nii");
  writeFileSync(mask, ellipsoids(10, 6));
  const { id } = await finishedJob(service, mask);
  const page = await (await browser.newContext({ viewport: { width: 1280, height: 800 } })).newPage();
  await openJob(page, service.url, id);
  await page.getByRole("checkbox", { name: "label 7", exact: true }).waitFor();
  const before = await pictureOf(page);
  const ms = await page.evaluate(async () => {
    const start = performance.now();
    document.querySelector<HTMLInputElement>('input[name="6"]')?.click();
    await new Promise((drawn) => requestAnimationFrame(() => setTimeout(drawn)));
    return performance.now() - start;
  });
  expect(changes(await pictureOf(page), before)).toBeGreaterThan(200);
  console.log(`hiding one of sixty structures took ${ms.toFixed(0)} ms`);
  await page.context().close();
  expect(ms).toBeLessThan(600);
});

test("sixty structures turn without stutter", async () => {
  const mask = join(files, "sixty.nii");
  writeFileSync(mask, ellipsoids(10, 6));
  const { structures, perSecond, longest } = await measure("sixty ellipsoids", mask);
  expect(structures).toBe(60);
  expect(perSecond).toBeGreaterThan(8);
  expect(longest).toBeLessThan(700);
});

test("the 22 structures of a brain turn", async (context) => {
  if (!existsSync(BIGBRAIN)) leaveOut(context, "the mask of a brain is not beside this repository");
  const { perSecond } = await measure("bigbrain", BIGBRAIN);
  expect(perSecond).toBeGreaterThan(8);
});

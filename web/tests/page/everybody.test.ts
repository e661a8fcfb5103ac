import type { BrowserContextOptions } from "playwright-core";
import { expect, test } from "vitest";
import { PAPERS, usePages } from "../support/pages";
import { finishedJob, sampleFile } from "../support/service";
import { findings, openJob } from "../support/use";

const pages = usePages();

for (const [name, options] of [
  ["light", { colorScheme: "light" }],
  ["dark", { colorScheme: "dark" }],
  ["phone", { viewport: { width: 375, height: 700 }, hasTouch: true, isMobile: true }],
] as [string, BrowserContextOptions][]) {
  test(`nothing serious is found by axe, and nothing sticks out: ${name}`, async () => {
    const page = await pages.open({ ...options });
    await page.goto(pages.service.url);
    await page.getByText("Parameters", { exact: false }).first().click();
    await page.getByLabel("uncertainty", { exact: true }).last().fill("65");
    expect(await findings(page)).toEqual([]);
    await openJob(page, pages.service.url, pages.bent.id);
    for (const title of ["Take away", "Compare"]) await page.getByRole("heading", { name: title }).click();
    expect(await findings(page)).toEqual([]);
    const { id } = await finishedJob(pages.service, sampleFile(pages.files, "bent"), { ...PAPERS, resolution_mm: 1.3 });
    await page.goto(`${pages.service.url}/#/compare/${pages.bent.id}/${id}`);
    await page.getByText(/Second minus first/).waitFor();
    expect(await findings(page)).toEqual([]);
    const width = await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
    expect(width[0]).toBeLessThanOrEqual(width[1] ?? 0);
  });
}

import { mkdtempSync, readFileSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { gunzipSync } from "node:zlib";
import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import { usePages } from "../support/pages";
import { finishedJob, idIn, modelShown, run, sampleFile, startService } from "../support/service";
import { colorAt, distance, openJob, pictureOf, sendSample, settled } from "../support/use";

const pages = usePages();

function stateOf(page: Page) {
  return expect.poll(() => page.locator(".job-view .state").textContent(), { timeout: 30_000 });
}

/** Presses Delete, and again when it asks. */
async function eraseShown(page: Page): Promise<void> {
  const view = page.locator(".job-view");
  await view.getByRole("button", { name: /^Delete/ }).click();
  await view.getByRole("button", { name: /^Erase it/ }).click();
}

async function setUncertainty(page: Page, repeats: number): Promise<void> {
  await page.getByText("Parameters", { exact: false }).first().click();
  await page.getByLabel("uncertainty", { exact: true }).last().fill(String(repeats));
}

test("a sample is sent, its stages are told, and its model is drawn", async () => {
  const page = await pages.open();
  await page.goto(pages.service.url);
  await page.evaluate(() => {
    const told = new Set<string>();
    (window as unknown as { told: Set<string> }).told = told;
    new MutationObserver(() => {
      for (const stage of document.querySelectorAll(".job-view .stage")) told.add(stage.textContent ?? "");
    }).observe(document.body, { subtree: true, childList: true, characterData: true });
  });
  await setUncertainty(page, 6);
  await sendSample(page, "wye");
  await modelShown(page);
  await stateOf(page).toBe("done");
  const told = await page.evaluate(() => [...(window as unknown as { told: Set<string> }).told]);
  expect(told.filter((stage) => !["waiting", "begins"].includes(stage)).length).toBeGreaterThan(1);
  const job = await (await fetch(`${pages.service.url}/v1/jobs/${idIn(page.url())}`)).json();
  expect(job.params).toEqual({ uncertainty: 6 });
  const picture = await pictureOf(page);
  const ground = colorAt(picture, 5, picture.height / 2);
  let drawn = 0;
  for (let x = 0; x < picture.width; x += 4) {
    for (let y = 0; y < picture.height; y += 4) if (distance(colorAt(picture, x, y), ground) > 20) drawn++;
  }
  expect(drawn / ((picture.width * picture.height) / 16)).toBeGreaterThan(0.05);
});

test("a job is opened by its link, and erased", async () => {
  const page = await pages.open();
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "slab"), { margin: 0.1 });
  await openJob(page, pages.service.url, id);
  await eraseShown(page);
  await page.waitForURL(/#\/$/);
  expect((await fetch(`${pages.service.url}/v1/jobs/${id}`)).status).toBe(404);
  await page.goto(`${pages.service.url}/#/jobs/${id}`);
  await page.getByText("This job cannot be shown").waitFor();
});

test("a job is cancelled, and run again", async () => {
  const page = await pages.open();
  await page.goto(pages.service.url);
  await setUncertainty(page, 64);
  await sendSample(page, "cross");
  const view = page.locator(".job-view");
  await view.getByRole("button", { name: /^Cancel/ }).click();
  await stateOf(page).toBe("cancelled");
  await view.getByRole("button", { name: /^Retry/ }).click();
  await stateOf(page).toMatch(/waiting|running/);
  await view.getByRole("button", { name: /^Cancel/ }).click();
  await stateOf(page).toBe("cancelled");
});

test("what is refused is told in the service's words", async () => {
  const page = await pages.open();
  await page.goto(pages.service.url);
  const bad = join(pages.files, "notes.nii");
  writeFileSync(bad, "not a mask at all, but long enough to be looked at ".repeat(20));
  await page.getByLabel("Mask files").setInputFiles(bad);
  const refusal = page.getByRole("alert").filter({ hasText: "notes.nii was refused" });
  await refusal.waitFor();
  expect(await refusal.textContent()).toMatch(/not_nifti/);
  expect(await refusal.textContent()).toMatch(/What to do/);
  await sendSample(page, "mobius");
  await stateOf(page).toBe("failed");
  expect(await page.locator(".job-view .problem").textContent()).toMatch(/only one side.*not_orientable/s);
});

test("masks dropped on the page are sent, one job each", async () => {
  const page = await pages.open();
  await page.goto(pages.service.url);
  await page.getByText("Choose a mask").waitFor();
  const before = await page.locator(".job").count();
  const masks = ["bump", "thin"].map((name) => [
    `${name}.nii.gz`,
    readFileSync(sampleFile(pages.files, name)).toString("base64"),
  ]);
  await page.evaluate((masks) => {
    const held = new DataTransfer();
    for (const [name = "", base64 = ""] of masks) {
      held.items.add(new File([Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0))], name));
    }
    for (const type of ["dragover", "drop"]) {
      document.body.dispatchEvent(new DragEvent(type, { dataTransfer: held, bubbles: true, cancelable: true }));
    }
  }, masks);
  await page.locator(".job[data-state=succeeded]", { hasText: "bump.nii.gz" }).waitFor();
  await page.locator(".job[data-state=failed]", { hasText: "thin.nii.gz" }).waitFor();
  expect(await page.locator(".job").count()).toBe(before + 2);
});

test("a parameter that is out of range is told before anything is sent", async () => {
  const page = await pages.open();
  await page.goto(pages.service.url);
  await page.getByText("Parameters", { exact: false }).first().click();
  await page.getByLabel("margin: how to set it").selectOption({ label: "a number" });
  await page.getByLabel("margin", { exact: true }).last().fill("2");
  await page.getByText(/margin: a number from/).waitFor();
  await page.getByText(/Nothing can be sent: look at margin/).waitFor();
  expect(await page.getByRole("button", { name: "Send sample" }).isDisabled()).toBe(true);
});

test("a job is followed by asking when its events do not come through", async () => {
  const page = await pages.open();
  await page.goto(pages.service.url);
  await page.getByLabel("Sample", { exact: true }).waitFor();
  for (const path of ["**/events", "**/v1/jobs?limit*"]) await page.route(path, (route) => route.abort());
  await setUncertainty(page, 3);
  await sendSample(page, "twisted");
  await stateOf(page).toBe("done");
});

test("a token is asked for, kept in memory only, and gone with the page", async () => {
  const guarded = mkdtempSync(join(tmpdir(), "medialrep-web-"));
  const token = run("token", "create", "--tenant", "radiology", "--data-dir", guarded).trim();
  const locked = await startService([], guarded);
  try {
    const page = await pages.open({}, locked);
    await page.goto(locked.url);
    const dialog = page.getByRole("dialog");
    const give = async (text: string) => {
      await dialog.getByRole("textbox", { name: "Token" }).fill(text);
      await dialog.getByRole("button", { name: "Go on" }).click();
    };
    await give("wrong");
    await dialog.getByText("The token was refused").waitFor();
    await give(token);
    await page.getByLabel("Sample", { exact: true }).waitFor();
    await settled(page);
    expect(await dialog.isVisible()).toBe(false);
    await page.getByRole("button", { name: "Change token" }).click();
    await give(token);
    await settled(page);
    expect(await dialog.isVisible()).toBe(false);
    await sendSample(page, "bent");
    await modelShown(page);
    const kept = await page.evaluate(() =>
      JSON.stringify([{ ...localStorage }, { ...sessionStorage }, document.cookie, location.href]),
    );
    expect(kept).not.toContain(token);
    expect((await page.context().storageState()).origins).toEqual([]);
    await page.getByText("Take away").click();
    const [file] = await Promise.all([
      page.waitForEvent("download"),
      page.getByRole("button", { name: "thickness.csv" }).click(),
    ]);
    expect(readFileSync(await file.path(), "utf8")).toMatch(/^structure,label,figure/);
    expect(await page.getByLabel("curl commands").inputValue()).toContain("$TOKEN");
    await page.reload();
    await page.getByRole("dialog").waitFor();
  } finally {
    await locked.stop();
  }
});

test("a mask's name stays in the page", async () => {
  const page = await pages.open();
  const sent: string[] = [];
  page.on("request", (request) =>
    sent.push(request.url(), request.postData() ?? "", JSON.stringify(request.headers())),
  );
  await page.goto(pages.service.url);
  const named = join(pages.files, "DOE_JANE.nii.gz");
  writeFileSync(named, readFileSync(sampleFile(pages.files, "ellipsoid")));
  await page.getByLabel("Mask files").setInputFiles(named);
  await page.waitForURL(/#\/jobs\//);
  await page.getByRole("heading", { name: "DOE_JANE.nii.gz" }).waitFor();
  expect(sent.join("\n")).not.toContain("DOE_JANE");
  expect(page.url()).not.toContain("DOE_JANE");
});

test("what the page weighs, and how soon a result is seen", async () => {
  const page = await pages.open();
  let weight = 0;
  page.on("requestfinished", async (request) => {
    if (!new URL(request.url()).pathname.startsWith("/v1/")) weight += (await request.sizes()).responseBodySize;
  });
  await page.goto(pages.service.url);
  await page.getByLabel("Sample", { exact: true }).waitFor();
  await settled(page);
  expect(weight).toBeLessThan(400_000);
  await sendSample(page, "leaf");
  await modelShown(page);
  const shown = Date.now();
  const job = await (await fetch(`${pages.service.url}/v1/jobs/${idIn(page.url())}`)).json();
  const seconds = (shown - Date.parse(job.ended_at)) / 1000;
  console.log(
    `page ${(weight / 1000).toFixed(0)} kB as sent; the model ${seconds.toFixed(2)} s after the end of its job`,
  );
  // The bar is 1.5 s on a quiet machine; tests run on busy ones.
  expect(seconds).toBeLessThan(6);
});

test("a job that is chosen comes into view, and nothing moves when it is", async () => {
  const page = await pages.open({ viewport: { width: 375, height: 700 } });
  await openJob(page, pages.service.url, pages.bent.id);
  expect(await page.evaluate(() => scrollY)).toBe(0);
  // The list is below the job; another job is chosen from there.
  await page.locator(`[data-job="${pages.bent.id}"] .job-link`).scrollIntoViewIfNeeded();
  const other = page.locator(`.job:not([data-job="${pages.bent.id}"]) .job-link`).first();
  await other.click();
  const isInView = () =>
    page.evaluate(() => {
      const top = document.getElementById("main")?.getBoundingClientRect().top ?? Number.NaN;
      return top > -1 && top < innerHeight / 2;
    });
  await expect.poll(isInView).toBe(true);
});

test("the keyboard stays near what was done", async () => {
  const page = await pages.open();
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "slab"), { margin: 0.2 });
  await page.goto(`${pages.service.url}/#/`);
  const row = page.locator(`[data-job="${id}"]`);
  await row.getByRole("button", { name: /^Delete/ }).focus();
  await page.keyboard.press("Enter");
  await row.getByRole("button", { name: /^Erase it/ }).waitFor();
  await page.keyboard.press("Enter");
  await row.waitFor({ state: "detached" });
  await expect.poll(() => page.evaluate(() => document.activeElement?.id)).toBe("main");
});

test("an erase that is refused leaves the job where it is", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  await page.route(`**/v1/jobs/${pages.bent.id}`, (route) =>
    route.request().method() === "DELETE"
      ? route.fulfill({ status: 403, json: { code: "scope_missing", detail: "the token may only read" } })
      : route.continue(),
  );
  await eraseShown(page);
  await page.getByText("It could not be erased").waitFor();
  expect(page.url()).toContain(pages.bent.id);
  await page.getByRole("button", { name: "Dismiss" }).click();
  expect(await page.getByText("It could not be erased").count()).toBe(0);
});

test("what the file's header leaves open is told with the result", async () => {
  const page = await pages.open();
  const mask = gunzipSync(readFileSync(sampleFile(pages.files, "bump")));
  // xyzt_units: the unit of lengths is not said.
  mask.writeUInt8(0, 123);
  const unknown = join(pages.files, "unknown.nii");
  writeFileSync(unknown, mask);
  const { id } = await finishedJob(pages.service, unknown);
  await openJob(page, pages.service.url, id);
  const job = await (await fetch(`${pages.service.url}/v1/jobs/${id}`)).json();
  const said: string = job.warnings[0].message;
  await page.locator(".verdicts", { hasText: said }).waitFor();
});

test("a mask that has been sent does not take the page from who types", async () => {
  const page = await pages.open();
  await page.goto(`${pages.service.url}/#/`);
  await page.getByText("Parameters").first().click();
  let pass = () => {};
  const held = new Promise<void>((free) => {
    pass = free;
  });
  await page.route("**/v1/jobs", async (route) => {
    if (route.request().method() === "POST") await held;
    await route.continue();
  });
  await page.getByRole("button", { name: "Send sample" }).click();
  const name = page.getByLabel("Name of the job");
  await name.pressSequentially("left");
  const before = await page.locator(".job").count();
  pass();
  await expect.poll(() => page.locator(".job").count()).toBe(before + 1);
  await name.pressSequentially("-kidney");
  expect(await name.inputValue()).toBe("left-kidney");
  expect(page.url()).toMatch(/#\/$/);
});

import { once } from "node:events";
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import type { AddressInfo } from "node:net";
import { expect, test } from "vitest";
import type { Thickness } from "../../src/model/thickness";
import { PAPERS, usePages } from "../support/pages";
import { finishedJob, resultOf, sampleFile, startService } from "../support/service";
import { changes, colorAt, distance, openJob, pictureOf, placeOf, settled } from "../support/use";

const pages = usePages();

function node(i: number, j: number) {
  return { structure: 0, figure: 0, i, j };
}

test("nodes have the colour that the legend gives to their thickness", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  for (const layer of ["Object", "Upper surface", "Lower surface", "Thickness vectors"])
    await page.getByLabel(layer).uncheck();
  // The sheet lies across the line of sight, so that no part hides another.
  await page
    .locator("medial-viewer")
    .evaluate((viewer) => (viewer as HTMLElementTagNameMap["medial-viewer"]).lookFrom("S"));
  const picture = await pictureOf(page);
  const box = await page.locator("medial-viewer").boundingBox();
  const legend = await page.locator("medial-viewer").evaluate((element) => {
    const bar = element.shadowRoot?.querySelector<HTMLElement>(".legend .bar");
    const [low, high] = (element as HTMLElementTagNameMap["medial-viewer"]).shownRange;
    return { image: bar?.style.background ?? "", low, high };
  });
  const stops = [...legend.image.matchAll(/rgb\((\d+), (\d+), (\d+)\)/g)].map((stop) => stop.slice(1).map(Number));
  expect(stops.length).toBeGreaterThan(10);
  const [figure] = pages.bent.numbers.structures[0]?.figures ?? [];
  if (!figure || !box) throw new Error("there is a figure, and it is shown");
  const { rows, cols } = figure.grid;
  for (const [i, j] of [
    [1, 1],
    [2, 4],
    [4, 6],
  ] as const) {
    const place = await placeOf(page, node(i, j), "medial");
    const seen = colorAt(picture, place.x - box.x, place.y - box.y);
    const value = figure.thickness.total_mm[i * cols + j] ?? Number.NaN;
    const share = (value - legend.low) / (legend.high - legend.low);
    const meant = stops[Math.round(share * (stops.length - 1))] ?? [];
    // Turned away from the eye a surface is darker, by as much in each channel of light.
    const shade = Math.max(...seen) / Math.max(...meant);
    expect(shade, `node ${i}, ${j} of ${rows} × ${cols}`).toBeGreaterThan(0.75);
    expect(shade).toBeLessThan(1.05);
    expect(
      distance(
        seen,
        meant.map((channel) => channel * shade),
      ),
    ).toBeLessThan(28);
  }
});

test("every layer can be shown and hidden", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  const layers = [
    "Object",
    "Medial sheet",
    "Upper surface",
    "Lower surface",
    "Crest",
    "Thickness vectors",
    "Closed surface",
  ];
  for (const layer of layers) await page.getByLabel(layer).uncheck();
  const empty = await pictureOf(page);
  for (const layer of layers) {
    await page.getByLabel(layer).check();
    expect(changes(await pictureOf(page), empty), layer).toBeGreaterThan(300);
    await page.getByLabel(layer).uncheck();
  }
  expect(changes(await pictureOf(page), empty)).toBeLessThan(50);
});

test("a node that is pointed at tells its thickness, in both views", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  const figure = pages.bent.numbers.structures[0]?.figures[0];
  if (!figure || figure.kind === "tube") throw new Error("there is a sheet");
  const { thickness, grid } = figure;
  const place = await placeOf(page, node(2, 3), "upper");
  await page.mouse.move(place.x, place.y);
  const at = 2 * grid.cols + 3;
  const texts = [thickness.upper_mm[at], thickness.lower_mm[at], thickness.total_mm[at]].map(
    (mm) => mm?.toFixed(2) ?? "",
  );
  const tooltip = page.locator("medial-viewer .tooltip");
  await expect.poll(() => tooltip.textContent()).toContain("(2, 3)");
  await settled(page);
  expect(await tooltip.isVisible()).toBe(true);
  for (const text of texts) expect(await tooltip.textContent()).toContain(text);
  const reading = page.locator(".reading");
  await expect.poll(() => reading.textContent()).toContain("Node (2, 3)");
  for (const text of texts) expect(await reading.textContent()).toContain(text);
});

test("a node reached with the keyboard on the plane is marked in space", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  const before = await pictureOf(page);
  await page.locator(".plane").focus();
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("ArrowUp");
  await expect.poll(() => page.locator(".reading").textContent()).toContain("Node (1, 1)");
  expect(changes(await pictureOf(page), before)).toBeGreaterThan(20);
});

test("two picked nodes tell their distance", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  const medial = pages.bent.numbers.structures[0]?.figures[0]?.medial ?? [];
  const [a, b] = [medial[0], medial[7]];
  if (!a || !b) throw new Error("there are nodes");
  await page.locator(".plane").focus();
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("Enter");
  for (let step = 0; step < 7; step++) await page.keyboard.press("ArrowRight");
  await page.keyboard.press("Enter");
  const straight = Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]).toFixed(2);
  await expect
    .poll(() => page.locator("medial-viewer").evaluate((viewer) => viewer.shadowRoot?.textContent))
    .toContain(straight);
});

test("the letters of the axes are where the patient's sides are", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  const gizmo = page.locator("medial-viewer").getByRole("button", { name: /right/i });
  const [right, left] = [
    await gizmo.first().boundingBox(),
    await page.locator("medial-viewer").getByRole("button", { name: /left/i }).first().boundingBox(),
  ];
  if (!right || !left) throw new Error("there are letters");
  const medial = pages.bent.numbers.structures[0]?.figures[0]?.medial ?? [];
  const cols = pages.bent.numbers.structures[0]?.figures[0]?.grid.cols ?? 1;
  const order = medial.map((_, index) => index).sort((m, n) => (medial[m]?.[0] ?? 0) - (medial[n]?.[0] ?? 0));
  const place = (index = 0) => placeOf(page, node(Math.floor(index / cols), index % cols), "medial");
  // World x grows to the patient's right, which is at the left of who looks at the face.
  const [most, least] = [await place(order.at(-1)), await place(order[0])];
  expect(Math.sign(most.x - least.x)).toBe(Math.sign(right.x - left.x));
  expect(right.x).toBeLessThan(left.x);
});

test("two jobs are compared node by node, under one camera", async () => {
  const page = await pages.open();
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "bent"), { ...PAPERS, resolution_mm: 1.3 });
  await page.goto(`${pages.service.url}/#/compare/${pages.bent.id}/${id}`);
  await page.getByText(/Second minus first, over 48 nodes/).waitFor();
  const other: Thickness = await resultOf(pages.service, id);
  const totals = [pages.bent.numbers, other].map(
    ({ structures }) => structures[0]?.figures[0]?.thickness.total_mm ?? [],
  );
  const mean = totals[1]?.reduce<number>((sum, value, at) => sum + ((value ?? 0) - (totals[0]?.[at] ?? 0)) / 48, 0);
  await page.getByText(`mean ${mean?.toFixed(3)} mm`).waitFor();
  const cameras = () =>
    page
      .locator("medial-viewer")
      .evaluateAll((all) =>
        all.map((viewer) =>
          (viewer as HTMLElementTagNameMap["medial-viewer"]).camera?.direction.map((x) => x.toFixed(4)),
        ),
      );
  const before = await cameras();
  const box = await page.locator("medial-viewer").first().boundingBox();
  if (!box) throw new Error("there is a view");
  await page.mouse.move(box.x + 200, box.y + 200);
  await page.mouse.down();
  await page.mouse.move(box.x + 280, box.y + 230, { steps: 5 });
  await page.mouse.up();
  await settled(page);
  const after = await cameras();
  expect(after[0]).not.toEqual(before[0]);
  expect(after[1]).toEqual(after[0]);
});

test("files, a picture and the curl lines can be taken away", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  await page.getByText("Take away").click();
  const [file] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("link", { name: "thickness.json" }).click(),
  ]);
  expect(JSON.parse(readFileSync(await file.path(), "utf8"))).toEqual(pages.bent.numbers);
  const [picture] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("button", { name: /PNG/ }).click(),
  ]);
  expect(
    readFileSync(await picture.path())
      .subarray(1, 4)
      .toString(),
  ).toBe("PNG");
  const lines = await page.getByLabel("curl commands").inputValue();
  expect(lines).toContain(`curl -OJ '${pages.service.url}/v1/jobs/${pages.bent.id}/results/model.glb'`);
});

test("the example embeds the viewer in a page of another origin", async () => {
  const example = new URL("../../../examples/embed.html", import.meta.url);
  // A server of pages beside it, as a front end has.
  let html = "";
  const front = createServer((_, answer) => answer.setHeader("Content-Type", "text/html").end(html)).listen(
    0,
    "127.0.0.1",
  );
  await once(front, "listening");
  const origin = `http://127.0.0.1:${(front.address() as AddressInfo).port}`;
  const open = await startService(["--cors-origins", origin]);
  try {
    const { id } = await finishedJob(open, sampleFile(pages.files, "tee"));
    html = readFileSync(example, "utf8").replaceAll("http://127.0.0.1:8080", open.url).replaceAll("JOB", id);
    const page = await pages.open({}, open);
    await page.goto(origin);
    await page.waitForFunction(() => document.querySelector("medial-viewer")?.result?.structures.length === 1);
    await settled(page);
    const { structures } = await page
      .locator("medial-viewer")
      .evaluate((viewer) => (viewer as HTMLElementTagNameMap["medial-viewer"]).result ?? { structures: [] });
    expect(structures[0]?.figures.length).toBe(3);
  } finally {
    front.close();
    await open.stop();
  }
});

test("picks are forgotten by the button and by Escape, and not drawn where they are hidden", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  const before = await pictureOf(page);
  const pickTwo = async () => {
    await page.locator(".plane").focus();
    for (const key of ["ArrowRight", "Enter", "ArrowUp", "Enter"]) await page.keyboard.press(key);
  };
  await pickTwo();
  const picked = await pictureOf(page);
  expect(changes(picked, before)).toBeGreaterThan(100);
  const label = page.getByRole("checkbox", { name: "label 1", exact: true });
  await label.uncheck();
  const ground = await pictureOf(page);
  await page.keyboard.press("Escape");
  expect(changes(await pictureOf(page), ground)).toBeLessThan(50);
  await label.check();
  const clear = page.getByRole("button", { name: "Clear picks" });
  await clear.click();
  expect(await clear.isVisible()).toBe(false);
  await pickTwo();
  await clear.waitFor();
  await page.keyboard.press("Escape");
  await clear.waitFor({ state: "hidden" });
});

test("a side without values has no say in the scale that two jobs share", async () => {
  const page = await pages.open();
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "bent"), { ...PAPERS, uncertainty: 3 });
  const rangeOf = (nth: number) =>
    page
      .locator("medial-viewer")
      .nth(nth)
      .evaluate((viewer) => (viewer as HTMLElementTagNameMap["medial-viewer"]).shownRange);
  await openJob(page, pages.service.url, id);
  await page.getByLabel("Colour by").selectOption("uncertainty");
  await settled(page);
  const alone = await rangeOf(0);
  await page.goto(`${pages.service.url}/#/compare/${pages.bent.id}/${id}`);
  await page.getByText(/Second minus first/).waitFor();
  await page.getByLabel("Colour by").selectOption("uncertainty");
  await expect.poll(() => rangeOf(1)).toEqual(alone);
  expect(await rangeOf(0)).toEqual(alone);
});

test("two compared jobs keep one scale, also after a reset", async () => {
  const page = await pages.open();
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "slab"));
  await page.goto(`${pages.service.url}/#/compare/${pages.bent.id}/${id}`);
  await page.getByLabel("Colour by").selectOption("each");
  const ranges = () =>
    page
      .locator("medial-viewer")
      .evaluateAll((all) => all.map((viewer) => (viewer as HTMLElementTagNameMap["medial-viewer"]).shownRange));
  await settled(page);
  const [first, second] = await ranges();
  expect(second).toEqual(first);
  expect(await page.getByRole("button", { name: "Reset" }).count()).toBe(0);
  const highest = page.getByLabel("Highest value of the colour scale").first();
  await highest.fill("6");
  await highest.press("Enter");
  await expect.poll(ranges).toEqual([
    [first?.[0], 6],
    [first?.[0], 6],
  ]);
  await page.getByRole("button", { name: "Reset" }).first().click();
  await expect.poll(ranges).toEqual([first, first]);
});

test("what is laid flat is never what is hidden", async () => {
  const page = await pages.open();
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "two"));
  await openJob(page, pages.service.url, id);
  const flat = page.getByLabel("Figure laid flat");
  expect(await flat.locator("option").allTextContents()).toEqual(["label 11, figure 0", "label 2101, figure 0"]);
  await page.getByRole("button", { name: "Show only label 2101" }).click();
  expect(await flat.locator("option").allTextContents()).toEqual(["label 2101, figure 0"]);
  await page.getByRole("button", { name: "None" }).click();
  await page.getByText("No figure is shown that could be laid flat.").waitFor();
});

test("a structure that has a name is called by it", async () => {
  const page = await pages.open();
  const names = { 11: "left caudate" };
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "two"), { names });
  await openJob(page, pages.service.url, id);
  await page.getByRole("checkbox", { name: "left caudate (label 11)", exact: true }).waitFor();
  await page.getByRole("checkbox", { name: "label 2101", exact: true }).waitFor();
  const laidFlat = page.getByLabel("Figure laid flat").locator("option");
  expect(await laidFlat.first().textContent()).toBe("left caudate (label 11), figure 0");
});

test("nodes off the sheet are told of", async () => {
  const page = await pages.open();
  const params = { lattice: "regular", grid: { rows: 9, cols: 12 } };
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "leaf"), params);
  await openJob(page, pages.service.url, id);
  const { structures } = await resultOf(pages.service, id);
  const valid = structures[0]?.figures[0]?.valid ?? [];
  expect(valid).toContain(false);
  await page.locator(".plane").focus();
  await page.keyboard.press("ArrowRight");
  const first = valid.indexOf(true);
  await expect
    .poll(() => page.locator(".reading").textContent())
    .toContain(`Node (${Math.floor(first / 12)}, ${first % 12})`);
  for (let step = 0; step < 12; step++) await page.keyboard.press("ArrowLeft");
  for (let step = 0; step < 9; step++) await page.keyboard.press("ArrowDown");
  expect(valid[0]).toBe(false);
  await expect.poll(() => page.locator(".reading").textContent()).toBe("Node (0, 0) is not on the sheet.");
});

test("a tap reads a node, on the plane and in space", async () => {
  const page = await pages.open({ viewport: { width: 375, height: 700 }, hasTouch: true, isMobile: true });
  await openJob(page, pages.service.url, pages.bent.id);
  const place = await placeOf(page, node(3, 4), "upper");
  await page.touchscreen.tap(place.x, place.y);
  await page.locator("medial-viewer .tooltip", { hasText: "(3, 4)" }).waitFor();
  const plane = page.locator(".plane");
  await plane.scrollIntoViewIfNeeded();
  const box = await plane.boundingBox();
  if (!box) throw new Error("there is a plane");
  await page.touchscreen.tap(box.x + box.width / 2, box.y + box.height / 2);
  await expect.poll(() => page.locator(".reading").textContent()).toMatch(/^Node \(\d, \d\): upper/);
});

test("the standard deviation is read where it was asked for", async () => {
  const page = await pages.open();
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "bent"), { uncertainty: 3 });
  await openJob(page, pages.service.url, id);
  const { structures } = await resultOf(pages.service, id);
  const sd = structures[0]?.figures[0]?.uncertainty?.total_mm[0] ?? Number.NaN;
  await page.locator(".plane").focus();
  await page.keyboard.press("ArrowRight");
  await expect.poll(() => page.locator(".reading").textContent()).toContain(`± ${sd.toFixed(2)} mm`);
  await page.getByLabel("Colour by").selectOption("uncertainty");
  await page.locator("medial-viewer .legend", { hasText: "Standard deviation" }).waitFor();
});

test("the histogram tells the share of the area, weighted as the result has it", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  const titles = await page.locator(".histogram title").allTextContents();
  const bars = titles.map((title) => /^([\d.]+) to ([\d.]+): ([\d.]+) %/.exec(title)?.slice(1).map(Number) ?? []);
  expect(bars.reduce((sum, [, , percent]) => sum + (percent ?? Number.NaN), 0)).toBeCloseTo(100, 0);
  const { thickness, node_area_mm2 = [] } = pages.bent.numbers.structures[0]?.figures[0] ?? {};
  const all = node_area_mm2.reduce<number>((sum, area) => sum + (area ?? 0), 0);
  // The highest bar holds what lies within its bounds, which are told with two digits.
  const [low = 0, high = 0, percent = 0] = bars.reduce((a, b) => ((a[2] ?? 0) > (b[2] ?? 0) ? a : b));
  const percentWithin = (from: number, to: number): number => {
    const within = node_area_mm2.filter((_, node) => {
      const total = thickness?.total_mm[node] ?? Number.NaN;
      return total >= from && total < to;
    });
    return (100 * within.reduce<number>((sum, area) => sum + (area ?? 0), 0)) / all;
  };
  expect(percent).toBeGreaterThan(percentWithin(low + 0.01, high - 0.01) - 0.1);
  expect(percent).toBeLessThan(percentWithin(low - 0.01, high + 0.01) + 0.1);
  expect(percent).toBeGreaterThan(5);
});

import type { Page } from "playwright-core";
import { expect, test } from "vitest";
import type { Thickness } from "../../src/model/thickness";
import { bentTube, GRID } from "../support/bent-tube";
import { usePages } from "../support/pages";
import { finishedJob, sampleFile } from "../support/service";
import { changes, colorAt, distance, findings, openJob, pictureOf, placeOf, settled } from "../support/use";

const pages = usePages();
const made = bentTube();

function node(i: number, j: number) {
  return { structure: 0, figure: 0, i, j };
}

/** Answers what is asked of a job's results with a result of tubes. */
async function serveTube(page: Page, id: string, { glb, thickness } = made): Promise<void> {
  const at = `**/v1/jobs/${id}/results`;
  await page.route(`${at}/model.glb`, (route) => route.fulfill({ body: Buffer.from(glb) }));
  await page.route(`${at}/thickness.json`, (route) => route.fulfill({ json: thickness }));
  const points = "structure,figure,surface,x_mm,y_mm,z_mm,u_mm,v_mm\n";
  await page.route(`${at}/points.csv`, (route) => route.fulfill({ body: points }));
}

async function openTube(options = {}): Promise<Page> {
  const page = await pages.open(options);
  await serveTube(page, pages.bent.id);
  await openJob(page, pages.service.url, pages.bent.id);
  return page;
}

function lengthsAt(i: number, j: number): string[] {
  const { wall_mm, total_mm } = made.tube.thickness;
  return [wall_mm, total_mm].map((list) => list[i * GRID.cols + j]?.toFixed(2) ?? "");
}

test("every layer of tubes and sheets can be shown and hidden", async () => {
  const page = await openTube();
  const names = await page
    .getByRole("group", { name: "Layers" })
    .getByRole("checkbox")
    .evaluateAll((all) => all.map((box) => (box as HTMLInputElement).name));
  expect(names).toEqual(["object", "medial", "upper", "lower", "crest", "centreline", "wall", "vectors", "closed"]);
  for (const name of names) await page.locator(`input[name=${name}]`).uncheck();
  const empty = await pictureOf(page);
  for (const name of ["centreline", "wall", "vectors", "closed"]) {
    await page.locator(`input[name=${name}]`).check();
    expect(changes(await pictureOf(page), empty), name).toBeGreaterThan(100);
    await page.locator(`input[name=${name}]`).uncheck();
  }
  expect(changes(await pictureOf(page), empty)).toBeLessThan(50);
});

test("sheets alone have no layers of tubes", async () => {
  const page = await pages.open();
  await openJob(page, pages.service.url, pages.bent.id);
  expect(await page.getByLabel("Wall", { exact: true }).count()).toBe(0);
  expect(await page.getByLabel("Centreline").count()).toBe(0);
});

test("the wall has other colours by its lengths than by its radius", async () => {
  const page = await openTube();
  for (const layer of ["Object", "Thickness vectors", "Centreline"]) await page.getByLabel(layer).uncheck();
  await page.getByLabel("Colour by").selectOption("each");
  const lengths = await pictureOf(page);
  await page.getByLabel("Colour by").selectOption("radius");
  await page.locator("medial-viewer .legend", { hasText: "Radius of the inscribed ball" }).waitFor();
  expect(changes(await pictureOf(page), lengths)).toBeGreaterThan(1000);
  // Node by node the wall is coloured as the legend says: the outer side of the bend is farther from the centre.
  await page.getByLabel("Colour by").selectOption("each");
  await page.locator("medial-viewer").evaluate((viewer) => {
    (viewer as HTMLElementTagNameMap["medial-viewer"]).lookFrom("A");
  });
  const picture = await pictureOf(page);
  const box = await page.locator("medial-viewer").boundingBox();
  const colorOf = async (i: number, j: number) => {
    const place = await placeOf(page, node(i, j), "wall");
    return colorAt(picture, place.x - (box?.x ?? 0), place.y - (box?.y ?? 0));
  };
  const [outer, inner] = [await colorOf(1, 6), await colorOf(3, 6)];
  expect(distance(outer, inner)).toBeGreaterThan(30);
});

test("a node of the wall that is pointed at tells its lengths, in both views", async () => {
  const page = await openTube();
  await page.locator("medial-viewer").evaluate((viewer) => {
    (viewer as HTMLElementTagNameMap["medial-viewer"]).lookFrom("A");
  });
  await settled(page);
  // Row 2 faces the eye; row 6, on the far side, is behind it.
  const place = await placeOf(page, node(2, 6), "wall");
  await page.mouse.move(place.x, place.y);
  const tooltip = page.locator("medial-viewer .tooltip");
  await expect.poll(() => tooltip.textContent()).toContain("(2, 6) · label 4, figure 0");
  const told = (await tooltip.textContent()) ?? "";
  for (const text of lengthsAt(2, 6)) expect(told).toContain(text);
  expect(told).toContain("Ball radius");
  expect(told).toContain("Position");
  expect(told).not.toContain("Upper");
  const [wall, total] = lengthsAt(2, 6);
  await expect
    .poll(() => page.locator(".reading").textContent())
    .toContain(`Node (2, 6): wall ${wall}, total ${total}, ball radius`);
});

test("the keyboard goes round the tube on the plane, and picks on both ends of the seam", async () => {
  const page = await openTube();
  const plane = page.locator(".plane");
  expect(await plane.getAttribute("aria-label")).toContain("8 nodes around by 12 along");
  expect(await page.getByLabel("Surface laid flat").count()).toBe(0);
  await plane.focus();
  await page.keyboard.press("ArrowRight");
  await expect.poll(() => page.locator(".reading").textContent()).toContain("Node (0, 0): wall");
  await page.keyboard.press("ArrowDown");
  await expect.poll(() => page.locator(".reading").textContent()).toContain("Node (7, 0): wall");
  await page.keyboard.press("Enter");
  await page.keyboard.press("ArrowUp");
  await expect.poll(() => page.locator(".reading").textContent()).toContain("Node (0, 0): wall");
  await page.keyboard.press("Enter");
  await expect
    .poll(() => page.locator("medial-viewer").evaluate((viewer) => viewer.shadowRoot?.textContent))
    .toMatch(/Distance .* along the wall/);
});

test("in space the keyboard goes from node to node and reads them out", async () => {
  const page = await openTube();
  await page.locator("medial-viewer .stage").focus();
  await page.keyboard.press("n");
  const said = page.locator("medial-viewer [aria-live]");
  await expect.poll(() => said.textContent()).toContain("Node row 0, column 0 of label 4, figure 0. Wall");
  expect(await page.locator("medial-viewer .tooltip").isVisible()).toBe(true);
});

test("the numbers tell of the tube", async () => {
  const page = await openTube();
  await page.getByText("share of the area of sheets and walls").waitFor();
  // 216 mm² of the sheet, which is 5 mm thick; 1700 mm² of the wall, which is on both sides.
  expect(await page.locator(".histogram title").first().textContent()).toMatch(/^5\.00 to .*: 20\.3 % of the area$/);
  const rows = await page
    .getByRole("region", { name: "Summary of thickness" })
    .locator("tbody tr")
    .evaluateAll((all) => all.map((row) => [...row.children].slice(0, 2).map((cell) => cell.textContent)));
  expect(rows).toEqual([
    ["4", "both"],
    ["4", "upper"],
    ["4", "lower"],
    ["4", "wall"],
  ]);
  const about = page.getByRole("region", { name: "Summary of tubes" });
  expect(await about.textContent()).toContain("trunk (label 4), figure 0: 47.1 mm long, mean radius 5.50 mm");
  await page.getByRole("checkbox", { name: "figure 1", exact: true }).uncheck();
  await page.getByText("share of the wall's area").waitFor();
  expect(await page.getByLabel("Figure laid flat").locator("option").allTextContents()).toEqual([
    "trunk (label 4), figure 0 (tube)",
  ]);
});

test("a refused label is shown as its object, with the reason", async () => {
  const page = await openTube();
  const row = page.locator(".structures li", { hasText: "label 9" });
  expect(await row.textContent()).toContain("refused");
  for (const said of ["the object is a ball", "measure it by its radius"]) {
    expect(await row.textContent()).toContain(said);
  }
  const before = await pictureOf(page);
  await page.getByRole("checkbox", { name: "label 9", exact: true }).uncheck();
  expect(changes(await pictureOf(page), before)).toBeGreaterThan(200);
  await page.getByRole("button", { name: "Show only label 9" }).click();
  await settled(page);
  const box = await page.locator("medial-viewer").boundingBox();
  if (!box) throw new Error("there is a view");
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  const tooltip = page.locator("medial-viewer .tooltip", { hasText: "Label 9 was refused" });
  await tooltip.waitFor();
  expect(await tooltip.textContent()).toContain("the object is a ball");
});

test("two tubes are compared; a tube and a sheet are not", async () => {
  const page = await pages.open();
  const { id } = await finishedJob(pages.service, sampleFile(pages.files, "slab"));
  await serveTube(page, pages.bent.id);
  await serveTube(page, id, bentTube(0.5));
  await page.goto(`${pages.service.url}/#/compare/${pages.bent.id}/${id}`);
  // 96 of the tube, which is wider on both sides, and 12 of the sheet, which is the same.
  await page.getByText("Second minus first, over 108 nodes: mean 0.889 mm").waitFor();
  await page.getByLabel("Wall", { exact: true }).waitFor();
  const other: Thickness = structuredClone(made.thickness);
  other.structures[0]?.figures.reverse().forEach((figure, index) => {
    figure.index = index;
  });
  await page.unroute(`**/v1/jobs/${id}/results/thickness.json`);
  await page.route(`**/v1/jobs/${id}/results/thickness.json`, (route) => route.fulfill({ json: other }));
  await page.reload();
  await page.getByText("label 4: figure 0 is a tube and a sheet").waitFor();
});

for (const colorScheme of ["light", "dark"] as const) {
  test(`axe finds nothing serious beside a tube: ${colorScheme}`, async () => {
    const page = await openTube({ colorScheme });
    await page.getByRole("button", { name: "Show only label 9" }).waitFor();
    expect(await findings(page)).toEqual([]);
  });
}

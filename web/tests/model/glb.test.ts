import { beforeAll, describe, expect, it } from "vitest";
import type { GlbModel } from "../../src/model/glb";
import { fromGlb } from "../../src/model/glb-result";
import { figuresOf, fromThickness, placesOf, type Result, type ResultSheet } from "../../src/model/result";
import type { Thickness } from "../../src/model/thickness";
import { readGlb } from "../../src/viewer/read-glb";
import { sampleResult } from "../support/service";

let glb: ArrayBuffer;
let thickness: Thickness;
let model: GlbModel;

beforeAll(async () => {
  ({ glb, thickness } = sampleResult("wye"));
  model = await readGlb(glb);
});

describe("model.glb", () => {
  it("says which way the patient lies", () => {
    expect(model.space).toBe("RAS");
    expect(model.up.map((x) => Math.round(1e9 * x) / 1e9 + 0)).toEqual([0, 0, 1]);
    expect(model.front.map((x) => Math.round(1e9 * x) / 1e9 + 0)).toEqual([0, 1, 0]);
  });

  it("has every layer of every figure, and the object of the structure", () => {
    const figures = figuresOf(fromThickness(thickness));
    expect(figures.length).toBe(3);
    for (const layer of ["medial", "upper", "lower", "crest", "vectors"]) {
      const owners = model.meshes.filter((mesh) => mesh.layer === layer).map((mesh) => mesh.figure);
      expect(owners).toEqual(figures.map(({ index }) => index));
    }
    expect(model.meshes.filter((mesh) => mesh.layer === "object").map((mesh) => mesh.figure)).toEqual([null]);
  });

  it("has indices within its vertices", () => {
    for (const { indices, positions } of model.meshes) {
      expect(indices.reduce((most, index) => Math.max(most, index), 0)).toBeLessThan(positions.length / 3);
    }
  });
});

describe("a result from model.glb alone", () => {
  it("is that of thickness.json to the precision of its numbers", () => {
    const alone = fromGlb(model);
    const full = fromThickness(thickness);
    expect(alone.structures.map(({ index, label }) => [index, label])).toEqual(
      full.structures.map(({ index, label }) => [index, label]),
    );
    const pairs = sheetsOf(alone).map((sheet, n) => [sheet, sheetsOf(full)[n]] as const);
    for (const [got, wanted] of pairs) {
      expect([got.rows, got.cols, got.order]).toEqual([wanted?.rows, wanted?.cols, wanted?.order]);
      for (const surface of ["medial", "upper", "lower"] as const)
        near(placesOf(got, surface).flat(), wanted && placesOf(wanted, surface).flat());
      for (const list of ["upper_mm", "lower_mm", "total_mm"] as const) near(got[list], wanted?.[list]);
    }
  });

  it("has neither radius nor plane", () => {
    for (const { radius_mm, distortion, intrinsic } of figuresOf(fromGlb(model))) {
      expect([radius_mm, distortion, intrinsic]).toEqual([null, null, null]);
    }
  });
});

function sheetsOf(result: Result): ResultSheet[] {
  return figuresOf(result).filter((figure) => figure.kind === "sheet");
}

/** A node that belongs to no quad is missing in the file. */
function near(got: (number | null)[], wanted: (number | null)[] | undefined): void {
  expect(got.length).toBe(wanted?.length);
  got.forEach((value, n) => {
    if (value !== null)
      expect(Math.abs(value - (wanted?.[n] ?? Number.NaN))).toBeLessThan(1e-5 * (1 + Math.abs(value)));
  });
  expect(got.filter((value) => value !== null).length).toBeGreaterThan(0.9 * got.length);
}

describe("thickness.json", () => {
  it("has nothing of invalid nodes", () => {
    const changed = structuredClone(thickness);
    const figure = changed.structures[0]?.figures[0];
    if (figure) figure.valid[3] = false;
    const [first] = sheetsOf(fromThickness(changed));
    expect([first?.medial[3], first?.upper_mm[3], first?.radius_mm?.[3], first?.intrinsic?.upper[3]]).toEqual([
      null,
      null,
      null,
      null,
    ]);
  });

  it("may be older than the distortion of nodes", () => {
    const old = structuredClone(thickness);
    for (const figure of old.structures.flatMap((structure) => structure.figures)) {
      Reflect.deleteProperty(figure, "area_distortion");
    }
    expect(figuresOf(fromThickness(old)).map(({ distortion }) => distortion)).toEqual([null, null, null]);
  });
});

describe("a file that is no model", () => {
  it("is refused in words", async () => {
    const page = new TextEncoder().encode("<!doctype html><title>404</title>").buffer as ArrayBuffer;
    const cut = [0.01, 0.5, 0.99].map((share) => glb.slice(0, Math.floor(glb.byteLength * share)));
    for (const file of [new ArrayBuffer(0), page, ...cut])
      await expect(readGlb(file)).rejects.toThrow("no whole GLB file");
  });
});

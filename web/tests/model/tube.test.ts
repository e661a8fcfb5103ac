import { beforeAll, describe, expect, it } from "vitest";
import type { GlbModel } from "../../src/model/glb";
import { fromGlb } from "../../src/model/glb-result";
import { distances, type NodeInfo, nodeInfo } from "../../src/model/node-info";
import { alongSurface, nodeOfPlace, placesOfNode, planeOf } from "../../src/model/plane";
import { quantitiesOf, rangeOf, valuesOf } from "../../src/model/quantity";
import { figuresOf, fromThickness, type Result, type ResultTube } from "../../src/model/result";
import { readGlb } from "../../src/viewer/read-glb";
import { bentTube, GRID } from "../support/bent-tube";
import { figure, resultOf, tube } from "../support/made-up";

const made = bentTube();
let model: GlbModel;

beforeAll(async () => {
  model = await readGlb(made.glb);
});

function firstTube(result: Result): ResultTube {
  const [found] = figuresOf(result);
  if (found?.kind !== "tube") throw new Error("the first figure is a tube");
  return found;
}

describe("model.glb of a tube", () => {
  it("has its layers beside those of a sheet", () => {
    expect(model.structures[0]?.figures.map(({ kind }) => kind)).toEqual(["tube", "sheet"]);
    const layersOf = (figure: number | null) =>
      model.meshes.filter((mesh) => mesh.structure === 0 && mesh.figure === figure).map(({ layer }) => layer);
    expect(layersOf(0)).toEqual(["centreline", "wall", "vectors", "closed"]);
    expect(layersOf(1)).toEqual(["medial", "upper", "lower"]);
    expect(layersOf(null)).toEqual(["object"]);
  });

  it("has row 0 of the wall twice, and it is the same nodes", () => {
    const wall = model.meshes.find(({ layer }) => layer === "wall");
    const nodes = [...(wall?.nodes ?? [])];
    const count = GRID.rows * GRID.cols;
    expect(nodes.slice(0, count)).toEqual(Array.from({ length: count }, (_, n) => n));
    expect(nodes.slice(count)).toEqual(Array.from({ length: GRID.cols }, (_, n) => n));
  });

  it("has the object of what was refused", () => {
    expect(model.structures[1]?.refusal).toBe("ball");
    expect(model.meshes.filter(({ structure }) => structure === 1).map(({ layer }) => layer)).toEqual(["object"]);
  });
});

describe("a tube in a result", () => {
  it("is the same from model.glb alone, to the precision of its numbers", () => {
    const [alone, full] = [firstTube(fromGlb(model)), firstTube(fromThickness(made.thickness))];
    expect([alone.rows, alone.cols, alone.order]).toEqual([full.rows, full.cols, full.order]);
    for (const list of ["wall_mm", "total_mm"] as const) near(alone[list], full[list]);
    for (const list of ["wall", "medial"] as const) near(alone[list].flat(), full[list].flat());
    expect(alone.intrinsic).toBeNull();
  });

  it("has nothing of invalid nodes", () => {
    const changed = structuredClone(made.thickness);
    const [first] = changed.structures[0]?.figures ?? [];
    if (first) first.valid[3] = false;
    const found = firstTube(fromThickness(changed));
    expect([found.wall[3], found.medial[3], found.wall_mm[3], found.intrinsic?.wall[3]]).toEqual([
      null,
      null,
      null,
      null,
    ]);
  });

  it("is read at a node on its wall", () => {
    const info = nodeInfo(resultOf(tube()), { structure: 0, figure: 0, i: 1, j: 2 });
    expect(info).toMatchObject({
      kind: "tube",
      wall_mm: 2,
      upper_mm: null,
      lower_mm: null,
      total_mm: 4,
      radius_mm: 1.9,
      position: [4, 0, 2],
    });
  });
});

function near(got: (number | null)[], wanted: (number | null)[]): void {
  expect(got.length).toBe(wanted.length);
  got.forEach((value, n) => {
    expect(Math.abs((value ?? Number.NaN) - (wanted[n] ?? Number.NaN))).toBeLessThan(1e-5);
  });
}

describe("what colours a tube", () => {
  it("is told of its wall", () => {
    expect(valuesOf(tube({ wall_mm: tube().wall_mm.map(() => 1.5) }), "each", "wall")).toEqual(new Array(12).fill(1.5));
    expect(valuesOf(tube(), "total", "wall")).toEqual(new Array(12).fill(4));
    expect(valuesOf(tube(), "radius", "wall")).toEqual(new Array(12).fill(1.9));
    expect(new Set(valuesOf(tube(), "side", "wall"))).toEqual(new Set([3]));
  });

  it("is what has values, and counts beside sheets", () => {
    expect(quantitiesOf(resultOf(tube()))).toEqual(["total", "each", "radius", "side", "figure"]);
    const mixed = resultOf(figure(), tube());
    expect(rangeOf(mixed, "total")).toEqual([3, 4]);
    expect(rangeOf(mixed, "each")).toEqual([1, 2.4]);
    expect(quantitiesOf(mixed)).toContain("distortion");
  });
});

describe("a tube laid flat", () => {
  it("is cut open along row 0, which comes again at the end of the round", () => {
    const plane = planeOf(tube(), "wall");
    expect(plane.length).toBe(15);
    const around = 8 * Math.SQRT2;
    [0, 2, 4].forEach((u, j) => {
      expect(plane[12 + j]?.[0]).toBe(u);
      expect(plane[12 + j]?.[1]).toBeCloseTo(around, 12);
    });
    expect(nodeOfPlace(tube(), 13)).toBe(1);
    expect(placesOfNode(tube(), 1)).toEqual([1, 13]);
    expect(placesOfNode(tube(), 4)).toEqual([4]);
    expect(placesOfNode(figure(), 1)).toEqual([1]);
  });

  it("has no seam where a node of it is not known", () => {
    const wall = tube().wall.map((point, node) => (node === 10 ? null : point));
    expect(planeOf(tube({ wall }), "wall").map((place) => place === null)[13]).toBe(true);
    expect(planeOf(tube({ intrinsic: null }), "wall")).toEqual([]);
    expect(planeOf(tube(), "upper")).toEqual([]);
  });

  it("has the shorter way round", () => {
    const side = 2 * Math.SQRT2;
    expect(alongSurface(tube(), 0, 3)).toBeCloseTo(side, 12);
    expect(alongSurface(tube(), 0, 9)).toBeCloseTo(side, 12);
    expect(alongSurface(tube(), 0, 6)).toBeCloseTo(2 * side, 12);
    expect(alongSurface(tube(), 0, 11)).toBeCloseTo(Math.hypot(4, side), 12);
    expect(alongSurface(tube({ intrinsic: null }), 0, 3)).toBeNull();
  });

  it("is measured straight from wall to wall", () => {
    const result = resultOf(tube());
    const info = (i: number) => nodeInfo(result, { structure: 0, figure: 0, i, j: 0 }) as NodeInfo;
    const { straight, along } = distances(result, info(0), info(2));
    expect(straight).toBe(4);
    expect(along).toBeCloseTo(4 * Math.SQRT2, 12);
  });
});

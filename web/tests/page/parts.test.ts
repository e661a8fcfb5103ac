import { expect, test } from "vitest";
import type { Job } from "../../src/api/client";
import type { Result, ResultFigure } from "../../src/model/result";
import { curlLines } from "../../src/page/curl";
import { difference } from "../../src/page/difference";
import { barMm, frameOf, nodeTree, place } from "../../src/page/flat";
import { histogram } from "../../src/page/histogram";
import { keyOf, parsePoints } from "../../src/page/points";
import { tubeText } from "../../src/page/tube-list";
import { bytes, duration, figureName } from "../../src/page/words";
import { bentTube } from "../support/bent-tube";
import { figure, tube } from "../support/made-up";

const HEAD = "structure,figure,surface,x_mm,y_mm,z_mm,u_mm,v_mm";

test("points are told apart by figure and surface", () => {
  const points = parsePoints(
    `${HEAD}\n0,0,medial,1,2,3,4.5,-5\n0,0,medial,1,2,3,6,7\n0,1,upper,1,2,3,8,9\n0,0,medial,1,2,3,,\n`,
  );
  expect([...(points.get(keyOf(0, 0, "medial")) ?? [])]).toEqual([4.5, -5, 6, 7]);
  expect([...(points.get(keyOf(0, 1, "upper")) ?? [])]).toEqual([8, 9]);
  expect(points.size).toBe(2);
});

test("points in other columns are not taken for points", () => {
  expect(() => parsePoints("x,y\n1,2\n")).toThrow(/other columns/);
});

test("a histogram keeps all the weight, also of what is outside", () => {
  const values = [-5, 0, 0.9, 1, 2, 99].map((value) => ({ value, weight: 2 }));
  const bins = histogram(values, [0, 2], 2);
  expect(bins.map(({ weight }) => weight)).toEqual([6, 6]);
  expect(bins.map(({ from, to }) => [from, to])).toEqual([
    [0, 1],
    [1, 2],
  ]);
  expect(histogram([{ value: 3, weight: 1 }], [3, 3], 4)[0]?.weight).toBe(1);
});

test("a frame shows everything at one scale, v upward", () => {
  const frame = frameOf([[0, 0], null, [20, 0]], new Float32Array([0, 10]), 236, 236);
  expect(frame.scale).toBe(10);
  expect(place(frame, [0, 0])).toEqual([18, 168]);
  expect(place(frame, [20, 10])).toEqual([218, 68]);
});

test("the bar of the scale has a round length that can be seen", () => {
  for (const scale of [0.013, 0.4, 1, 3.7, 11, 13.75, 14, 55, 900]) {
    const mm = barMm(scale);
    expect(mm * scale, `${scale}`).toBeGreaterThan(35);
    expect(mm * scale, `${scale}`).toBeLessThanOrEqual(110);
    expect(Number(mm.toPrecision(2))).toBe(mm);
  }
});

test("the node nearest to a point of the plane is found within reach", () => {
  const nodes = nodeTree([[0, 0], null, [5, 0]]);
  expect(nodes.find(4, 1, 2)?.index).toBe(2);
  expect(nodes.find(2.5, 4, 2)).toBeUndefined();
});

function thick(structure: number, rows: number, cols: number, total_mm: (number | null)[]): ResultFigure {
  return figure({ structure, rows, cols, total_mm });
}

function result(...structures: [label: number, figure: ResultFigure | null][]): Result {
  return {
    structures: structures.map(([label, figure], index) => ({
      index,
      label,
      refusal: null,
      figures: figure === null ? [] : [figure],
    })),
  };
}

test("structures are compared by label, node by node", () => {
  const first = result([7, thick(0, 1, 3, [1, 2, null])], [9, thick(1, 1, 2, [4, 4])]);
  const second = result([9, thick(0, 1, 2, [5, 3])], [7, thick(1, 1, 3, [1.5, 1, 8])]);
  const found = difference(first, second);
  expect(found.ofFirst).toEqual([
    { structure: 0, figure: 0, values: [0.5, -1, null] },
    { structure: 1, figure: 0, values: [1, -1] },
  ]);
  expect(found.ofSecond.map(({ structure }) => structure)).toEqual([1, 0]);
  expect(found.summary).toMatchObject({ nodes: 4, mean: -0.125, largest: -1 });
  expect(found.left).toEqual([]);
});

test("what cannot be compared is named", () => {
  const first = result([7, thick(0, 1, 2, [1, 1])], [8, thick(1, 1, 2, [1, 1])], [5, thick(2, 1, 2, [1, 1])]);
  const second = result([7, thick(0, 2, 1, [1, 1])], [9, thick(1, 1, 2, [1, 1])], [5, null]);
  const { summary, left } = difference(first, second);
  expect(summary).toBeNull();
  expect(left).toEqual([
    "label 7: grids are 1 × 2 and 2 × 1",
    "label 8 is in the first only",
    "label 5 has 1 and 0 figures",
    "label 9 is in the second only",
  ]);
});

test("tubes are compared node by node, and with tubes only", () => {
  const wider = tube({ total_mm: tube().total_mm.map(() => 4.5) });
  const found = difference(result([7, tube()]), result([7, wider]));
  expect(found.left).toEqual([]);
  expect(found.summary).toMatchObject({ nodes: 12, mean: 0.5, sd: 0, largest: 0.5 });
  expect(difference(result([7, tube()]), result([7, figure({ rows: 4 })])).left).toEqual([
    "label 7: figure 0 is a tube and a sheet",
  ]);
  expect(difference(result([7, tube()]), result([7, tube({ rows: 6, cols: 2 })])).left).toEqual([
    "label 7: grids are 4 × 3 and 6 × 2",
  ]);
});

test("what a tube measures is told in words", () => {
  expect(tubeText(bentTube().tube)).toBe(
    "47.1 mm long, mean radius 5.50 mm, mean diameter 11.00 mm (5 to 95 %: 10.2 to 11.8), mean section 95.3 mm², tortuosity 1.11",
  );
  expect(figureName({ index: 2, kind: "tube" })).toBe("figure 2 (tube)");
  expect(figureName({ index: 2 })).toBe("figure 2");
});

test("the curl lines hold the parameters, and a place for the token, never the token", () => {
  const job = {
    id: "x",
    labels: {},
    params: { grid: "auto" },
    links: { self: "/v1/jobs/x" },
    results: [{ href: "/v1/jobs/x/results/model.glb" }],
  } as unknown as Job;
  const lines = curlLines(job, "https://mask.example.org", true, null);
  expect(lines).toContain(`-F 'mask=@mask.nii.gz' -F 'params={"grid":"auto"}' 'https://mask.example.org/v1/jobs'`);
  expect(lines).toContain("'https://mask.example.org/v1/jobs/x/results/model.glb'");
  expect(lines.match(/\$TOKEN/g)).toHaveLength(3);
  expect(curlLines(job, "http://h", false, "a'; touch pwned #")).toContain(
    `'http://h/v1/samples/a'\\''; touch pwned #'`,
  );
});

test("sizes and times are told in units for people", () => {
  expect([0, 999, 1000, 12_345_678].map(bytes)).toEqual(["0 B", "999 B", "1.0 kB", "12.3 MB"]);
  expect([0.031, 1.25, 59, 3600, 604_800].map(duration)).toEqual(["31 ms", "1.3 s", "59 s", "60 min", "7 days"]);
});

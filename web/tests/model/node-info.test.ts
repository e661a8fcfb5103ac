import { describe, expect, it } from "vitest";
import { distances, type NodeInfo, nodeInfo, sameNode } from "../../src/model/node-info";
import { withDifference } from "../../src/model/result";
import { figure, resultOf } from "../support/made-up";

const node = (i: number, j: number, structure = 0) => ({ structure, figure: 0, i, j });
const known = (info: NodeInfo | null): NodeInfo => {
  if (!info) throw new Error("no such node");
  return info;
};

describe("reading of a node", () => {
  it("has what is known of it", () => {
    expect(nodeInfo(resultOf(figure()), node(1, 1))).toEqual({
      ...node(1, 1),
      label: 11,
      kind: "sheet",
      upper_mm: 1,
      lower_mm: 2.4,
      wall_mm: null,
      total_mm: 3.4,
      radius_mm: 1.7,
      sd_mm: null,
      position: [1, 1, 0],
      difference: null,
    });
  });

  it("is null where there is no node", () => {
    for (const nowhere of [node(1, 2), node(2, 0), node(0, 3), node(-1, 0), node(0, 0, 9)]) {
      expect(nodeInfo(resultOf(figure()), nowhere)).toBeNull();
    }
  });

  it("has the difference handed in, until it is taken away", () => {
    const result = withDifference(resultOf(figure()), [{ structure: 0, figure: 0, values: [0, 0.5, 0, 0, 0, null] }]);
    expect(nodeInfo(result, node(0, 1))?.difference).toBe(0.5);
    expect(nodeInfo(withDifference(result, null), node(0, 1))?.difference).toBeNull();
  });
});

describe("distance", () => {
  const result = resultOf(figure(), figure());

  it("is straight and along the sheet in one figure", () => {
    const [a, b] = [known(nodeInfo(result, node(0, 0))), known(nodeInfo(result, node(1, 1)))];
    expect(distances(result, a, b)).toEqual({ straight: Math.SQRT2, along: Math.SQRT2 });
  });

  it("is straight only between figures and without a plane", () => {
    const [a, b] = [known(nodeInfo(result, node(0, 0))), known(nodeInfo(result, node(0, 2, 1)))];
    expect(distances(result, a, b)).toEqual({ straight: 2, along: null });
    const flat = resultOf(figure({ intrinsic: null }));
    expect(distances(flat, a, { ...a, j: 1 }).along).toBeNull();
  });
});

it("nodes are the same when all four numbers are", () => {
  expect(sameNode(node(0, 1), node(0, 1))).toBe(true);
  expect(sameNode(node(0, 1), node(1, 0))).toBe(false);
  expect(sameNode(null, null)).toBe(true);
  expect(sameNode(node(0, 1), null)).toBe(false);
});

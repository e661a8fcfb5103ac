import { describe, expect, it } from "vitest";
import { quantitiesOf, rangeOf, valuesOf } from "../../src/model/quantity";
import { withDifference } from "../../src/model/result";
import { figure, resultOf } from "../support/made-up";

describe("values", () => {
  it("total is the same on every surface", () => {
    for (const surface of ["medial", "upper", "lower"] as const) {
      expect(valuesOf(figure(), "total", surface)).toEqual([3, 3, 3, 3, 3.4, null]);
    }
  });

  it("each is the own thickness of a side and the mean on the medial surface", () => {
    expect(valuesOf(figure(), "each", "upper")).toEqual([1, 1, 1, 1, 1, null]);
    expect(valuesOf(figure(), "each", "lower")).toEqual([2, 2, 2, 2, 2.4, null]);
    expect(valuesOf(figure(), "each", "medial")).toEqual([1.5, 1.5, 1.5, 1.5, 1.7, null]);
  });

  it("what is not known is null for every node", () => {
    const bare = figure({ radius_mm: null, distortion: null });
    for (const quantity of ["radius", "distortion", "difference"] as const) {
      expect(valuesOf(bare, quantity, "medial")).toEqual([null, null, null, null, null, null]);
    }
  });

  it("categories are whole numbers", () => {
    expect(valuesOf(figure(), "side", "lower")).toEqual([2, 2, 2, 2, 2, 2]);
    expect(valuesOf(figure({ order: 7 }), "figure", "lower")).toEqual([7, 7, 7, 7, 7, 7]);
  });
});

describe("quantities offered", () => {
  it("are those with values", () => {
    const full = resultOf(figure());
    expect(quantitiesOf(full)).toEqual(["total", "each", "radius", "side", "figure", "distortion"]);
    const bare = resultOf(figure({ radius_mm: null, distortion: null }));
    expect(quantitiesOf(bare)).toEqual(["total", "each", "side", "figure"]);
    const compared = withDifference(full, [{ structure: 0, figure: 0, values: [1, 0, 0, 0, 0, null] }]);
    expect(quantitiesOf(compared)).toContain("difference");
  });
});

describe("range", () => {
  it("has round bounds round the values", () => {
    const [low, high] = rangeOf(resultOf(figure()), "total");
    expect([low, high]).toEqual([3, 3.4]);
    expect(rangeOf(resultOf(figure()), "each")).toEqual([1, 2.4]);
  });

  it("counts visible structures only", () => {
    const result = resultOf(figure(), figure({ total_mm: [10, 20, 10, 10, 10, null] }));
    expect(rangeOf(result, "total", new Set([1]))).toEqual([10, 20]);
    expect(rangeOf(result, "total")[0]).toBeLessThanOrEqual(3);
  });

  it("of a diverging quantity is symmetrical about 0", () => {
    expect(rangeOf(resultOf(figure()), "distortion")).toEqual([-0.3, 0.3]);
  });

  it("is never empty", () => {
    for (const quantity of ["total", "each", "radius", "distortion", "difference"] as const) {
      for (const result of [resultOf(), resultOf(figure({ total_mm: [3, 3, 3, 3, 3, 3] }))]) {
        const [low, high] = rangeOf(result, quantity);
        expect(high).toBeGreaterThan(low);
      }
    }
  });
});

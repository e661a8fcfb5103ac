import { expect, it } from "vitest";
import { niceRange, ticks } from "../../src/model/scale";

it("bounds are round and enclose", () => {
  expect(niceRange(1.965, 4.671)).toEqual([1.5, 5]);
  expect(niceRange(0.3, 17.9)).toEqual([0, 18]);
  expect(niceRange(-0.0119, 0.013)).toEqual([-0.012, 0.014]);
  for (const [low, high] of [
    [0.1, 0.7],
    [-3, 1e6],
    [1e-7, 2e-7],
    [5, 5],
    [0, 0],
  ] as const) {
    const [from, to] = niceRange(low, high);
    expect(from).toBeLessThanOrEqual(low);
    expect(to).toBeGreaterThanOrEqual(high);
    expect(to).toBeGreaterThan(from);
  }
});

it("ticks lie in the range and have no long fractions", () => {
  expect(ticks(0, 18, 4)).toEqual([0, 5, 10, 15]);
  expect(ticks(-0.3, 0.3, 4)).toEqual([-0.2, 0, 0.2]);
  expect(ticks(3, 3, 4)).toEqual([3]);
});

import { interpolateRdYlBu, interpolateViridis } from "d3-scale-chromatic";
import { describe, expect, it } from "vitest";
import { colorOf, cssColorOf, NO_VALUE } from "../../src/model/colors";

const hex = ([red, green, blue]: number[]) =>
  `#${[red, green, blue].map((x) => (x ?? 0).toString(16).padStart(2, "0")).join("")}`;

describe("colours", () => {
  it("of a sequential quantity are viridis", () => {
    for (const share of [0, 0.25, 0.5, 0.9, 1]) {
      expect(hex(colorOf("total", 2 + 4 * share, [2, 6]))).toBe(interpolateViridis(share));
    }
  });

  it("of a diverging quantity go from blue through yellow to red", () => {
    for (const share of [0, 0.25, 0.5, 1]) {
      expect(cssColorOf("difference", -1 + 2 * share, [-1, 1])).toBe(interpolateRdYlBu(1 - share));
    }
  });

  it("stay at the end beyond the range", () => {
    expect(colorOf("total", 100, [0, 1])).toEqual(colorOf("total", 1, [0, 1]));
    expect(colorOf("total", -100, [0, 1])).toEqual(colorOf("total", 0, [0, 1]));
  });

  it("of no value is grey", () => {
    for (const quantity of ["total", "side", "difference"] as const) {
      expect(colorOf(quantity, null, [0, 1])).toEqual(NO_VALUE);
    }
  });

  it("of neighbouring categories differ, and of as many as there may be exist", () => {
    for (let figure = 0; figure < 60; figure++) {
      expect(colorOf("figure", figure, [0, 59])).not.toEqual(colorOf("figure", figure + 1, [0, 59]));
    }
  });
});

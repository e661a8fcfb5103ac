import { expect, it } from "vitest";
import { Attention } from "../../src/viewer/attention";
import { Shown } from "../../src/viewer/shown";
import { figure, resultOf } from "../support/made-up";

const result = resultOf(figure(), figure());
const node = (i: number, j: number, structure = 0) => ({ structure, figure: 0, i, j });
const places = (attention: Attention) => attention.picks.map(({ i, j }) => [i, j]);

it("two picks measure, a third begins anew, the same again lets go", () => {
  const attention = new Attention();
  attention.pick(result, node(0, 0));
  attention.pick(result, node(0, 1));
  expect(places(attention)).toEqual([
    [0, 0],
    [0, 1],
  ]);
  attention.pick(result, node(0, 2));
  expect(places(attention)).toEqual([[0, 2]]);
  attention.pick(result, node(0, 2));
  expect(places(attention)).toEqual([]);
  expect(attention.pick(result, node(7, 7))).toBe(false);
});

it("pointing says whether the node is another one", () => {
  const attention = new Attention();
  expect(attention.hover(result, node(0, 0))).toBe(true);
  expect(attention.hover(result, node(0, 0))).toBe(false);
  expect(attention.hover(result, null)).toBe(true);
  expect(attention.hover(result, node(9, 9))).toBe(false);
});

it("steps go through all nodes that are shown and known, and round", () => {
  const attention = new Attention();
  const shown = new Shown();
  const walk = (steps: number) =>
    Array.from({ length: steps }, () => {
      attention.hover(result, attention.neighbour(result, shown, 1));
      return attention.hovered && [attention.hovered.structure, attention.hovered.i, attention.hovered.j];
    });
  expect(walk(6)).toEqual([
    [0, 0, 0],
    [0, 0, 1],
    [0, 0, 2],
    [0, 1, 0],
    [0, 1, 1],
    [1, 0, 0],
  ]);
  expect(attention.neighbour(result, shown, -1)).toEqual(node(1, 1));
  shown.setStructure(1, false);
  attention.clear();
  expect(walk(6).at(-1)).toEqual([0, 0, 0]);
  shown.setStructure(0, false);
  expect(attention.neighbour(result, shown, 1)).toBeNull();
});

import type { Result, ResultFigure, ResultSheet, ResultTube } from "../../src/model/result";
import type { Flat, Point } from "../../src/model/thickness";

const PLANE: (Flat | null)[] = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], null];

/** A sheet of 2 × 3 nodes on the plane z = 0, upper 1 mm above, lower 2 mm below; its last node is not known. */
export function figure(changes: Partial<ResultSheet> = {}): ResultSheet {
  const places = [0, 1].flatMap((i) => [0, 1, 2].map((j): Point => [j, i, 0]));
  const at = (z: number) => places.map(([x, y], node): Point | null => (node === 5 ? null : [x, y, z]));
  return {
    kind: "sheet",
    structure: 0,
    index: 0,
    order: 0,
    rows: 2,
    cols: 3,
    medial: at(0),
    upper: at(1),
    lower: at(-2),
    upper_mm: [1, 1, 1, 1, 1, null],
    lower_mm: [2, 2, 2, 2, 2.4, null],
    total_mm: [3, 3, 3, 3, 3.4, null],
    sd_mm: null,
    radius_mm: [1.5, 1.5, 1.5, 1.5, 1.7, null],
    area_mm2: [0.25, 0.5, 0.25, 0.25, 0.5, null],
    distortion: [-0.3, 0.1, 0, 0, 0.1, null],
    intrinsic: { medial: PLANE, upper: PLANE, lower: PLANE },
    difference: null,
    ...changes,
  };
}

/** A tube along x, 4 nodes around by 3 along, radius 2 mm; its lattice is 2 mm long from column to column. */
export function tube(changes: Partial<ResultTube> = {}): ResultTube {
  const nodes = [0, 1, 2, 3].flatMap((i) => [0, 1, 2].map((j) => ({ i, j })));
  const all = (value: number) => nodes.map(() => value);
  return {
    kind: "tube",
    structure: 0,
    index: 0,
    order: 0,
    rows: 4,
    cols: 3,
    medial: nodes.map(({ j }): Point => [2 * j, 0, 0]),
    wall: nodes.map(({ i, j }): Point => [2 * j, [2, 0, -2, 0][i] ?? 0, [0, 2, 0, -2][i] ?? 0]),
    wall_mm: all(2),
    total_mm: all(4),
    radius_mm: all(1.9),
    sd_mm: null,
    area_mm2: all(3),
    distortion: null,
    intrinsic: { wall: nodes.map(({ i, j }): Flat => [2 * j, 2 * Math.SQRT2 * i]) },
    difference: null,
    ...changes,
  };
}

/** Structures with one figure each, labels 11, 12, … */
export function resultOf(...figures: ResultFigure[]): Result {
  return {
    structures: figures.map((figure, index) => ({
      index,
      label: 11 + index,
      refusal: null,
      figures: [{ ...figure, structure: index, order: index }],
    })),
  };
}

import type { Result, ResultFigure } from "../../src/model/result";
import type { Flat, Point } from "../../src/model/thickness";

const PLANE: (Flat | null)[] = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], null];

/** A figure of 2 × 3 nodes on the plane z = 0, upper 1 mm above, lower 2 mm below; its last node is not known. */
export function figure(changes: Partial<ResultFigure> = {}): ResultFigure {
  const places = [0, 1].flatMap((i) => [0, 1, 2].map((j): Point => [j, i, 0]));
  const at = (z: number) => places.map(([x, y], node): Point | null => (node === 5 ? null : [x, y, z]));
  return {
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

import type { Flat, Numbers, Point, Surface, Thickness } from "./thickness";

/** A node of a lattice. `structure` and `figure` are the `index` of thickness.json, `i` the row, `j` the column. */
export interface NodeRef {
  structure: number;
  figure: number;
  i: number;
  j: number;
}

/** What is known of every node, from thickness.json or from model.glb alone. */
export interface Result {
  structures: ResultStructure[];
}

export interface ResultStructure {
  index: number;
  label: number;
  /** Why it has no figures, in words or as a code. */
  refusal: string | null;
  figures: ResultFigure[];
}

/** One sheet. Arrays have rows · cols entries, row by row. Lengths are mm, positions RAS mm; null is not known. */
export interface ResultFigure {
  structure: number;
  index: number;
  /** Number of the figure among all figures of the result: chooses its colour. */
  order: number;
  rows: number;
  cols: number;
  medial: (Point | null)[];
  upper: (Point | null)[];
  lower: (Point | null)[];
  upper_mm: Numbers;
  lower_mm: Numbers;
  total_mm: Numbers;
  radius_mm: Numbers | null;
  /** Standard deviation of the total thickness. */
  sd_mm: Numbers | null;
  /** Area of the sheet that each node stands for, mm². */
  area_mm2: Numbers | null;
  /** Logarithm of the share of the area in space over that in the intrinsic plane. */
  distortion: Numbers | null;
  /** Places in the intrinsic plane of each surface, mm. */
  intrinsic: Record<Surface, (Flat | null)[]> | null;
  /** Thickness minus that of another result, mm; handed in. */
  difference: Numbers | null;
}

/** Values of the nodes of one figure, row by row. */
export interface FigureValues {
  structure: number;
  figure: number;
  values: Numbers;
}

/** Reads thickness.json. What an invalid node has is taken as not known. */
export function fromThickness(json: Thickness): Result {
  let order = 0;
  const structures = json.structures.map((structure) => ({
    index: structure.index,
    label: structure.label,
    refusal: structure.refusal?.message ?? null,
    figures: structure.figures.map((figure): ResultFigure => {
      const valid = <T>(list: readonly T[]): (T | null)[] =>
        list.map((value, node) => (figure.valid[node] ? value : null));
      const points = (list: readonly Point[]) => valid(list).map((p) => (isFinitePoint(p) ? p : null));
      const flats = (list: readonly (Flat | null)[]) => valid(list).map((p) => (isFinitePoint(p) ? p : null));
      return {
        structure: structure.index,
        index: figure.index,
        order: order++,
        rows: figure.grid.rows,
        cols: figure.grid.cols,
        medial: points(figure.medial),
        upper: points(figure.upper),
        lower: points(figure.lower),
        upper_mm: valid(figure.thickness.upper_mm),
        lower_mm: valid(figure.thickness.lower_mm),
        total_mm: valid(figure.thickness.total_mm),
        radius_mm: valid(figure.medial_radius_mm),
        sd_mm: figure.uncertainty ? valid(figure.uncertainty.total_mm) : null,
        area_mm2: figure.node_area_mm2 ? valid(figure.node_area_mm2) : null,
        distortion: figure.area_distortion ? valid(figure.area_distortion) : null,
        intrinsic: {
          medial: flats(figure.intrinsic.medial),
          upper: flats(figure.intrinsic.upper),
          lower: flats(figure.intrinsic.lower),
        },
        difference: null,
      };
    }),
  }));
  return { structures };
}

/** The same result with the differences given; a figure that is not among them has none. */
export function withDifference(result: Result, differences: readonly FigureValues[] | null): Result {
  const structures = result.structures.map((structure) => ({
    ...structure,
    figures: structure.figures.map((figure) => {
      const given = differences?.find((d) => d.structure === figure.structure && d.figure === figure.index);
      return { ...figure, difference: given?.values ?? null };
    }),
  }));
  return { structures };
}

export function figuresOf(result: Result): ResultFigure[] {
  return result.structures.flatMap((structure) => structure.figures);
}

export function figureOf(result: Result, structure: number, figure: number): ResultFigure | null {
  const found = result.structures.find((s) => s.index === structure);
  return found?.figures.find((f) => f.index === figure) ?? null;
}

/** Number of a node in the arrays of its figure. */
export function indexOf({ cols }: ResultFigure, { i, j }: { i: number; j: number }): number {
  return i * cols + j;
}

/** The node of that number. */
export function refOf({ structure, index, cols }: ResultFigure, node: number): NodeRef {
  return { structure, figure: index, i: Math.floor(node / cols), j: node % cols };
}

function isFinitePoint(point: readonly (number | null)[] | null | undefined): boolean {
  return Array.isArray(point) && point.every((x) => Number.isFinite(x));
}

import {
  type Figure,
  type Flat,
  type Numbers,
  type Point,
  type Sheet,
  SURFACES_OF,
  type Surface,
  type Thickness,
  type Tube,
} from "./thickness";

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

export type ResultFigure = ResultSheet | ResultTube;

/** Arrays have rows · cols entries, row by row. Lengths are mm, positions RAS mm; null is not known. */
interface AnyFigure {
  structure: number;
  index: number;
  /** Number of the figure among all figures of the result: chooses its colour. */
  order: number;
  rows: number;
  cols: number;
  /** Of a tube the centre of the column. */
  medial: (Point | null)[];
  total_mm: Numbers;
  radius_mm: Numbers | null;
  /** Standard deviation of the total thickness. */
  sd_mm: Numbers | null;
  /** Area that each node stands for, of the sheet or of the wall, mm². */
  area_mm2: Numbers | null;
  /** Logarithm of the share of the area in space over that in the intrinsic plane. */
  distortion: Numbers | null;
  /** Thickness minus that of another result, mm; handed in. */
  difference: Numbers | null;
}

/** One sheet. */
export interface ResultSheet extends AnyFigure {
  kind: "sheet";
  upper: (Point | null)[];
  lower: (Point | null)[];
  upper_mm: Numbers;
  lower_mm: Numbers;
  /** Places in the intrinsic plane of each surface, mm. */
  intrinsic: Sheet["intrinsic"] | null;
}

/** A tube: rows go round it, the last one beside the first, and columns along. */
export interface ResultTube extends AnyFigure {
  kind: "tube";
  wall: (Point | null)[];
  wall_mm: Numbers;
  /** Arc length along and around, mm. */
  intrinsic: Tube["intrinsic"] | null;
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
    figures: structure.figures.map((figure) => figureFrom(figure, structure.index, order++)),
  }));
  return { structures };
}

function figureFrom(figure: Figure, structure: number, order: number): ResultFigure {
  const known = <T>(list: readonly T[]) => validOf(figure, list);
  const any: AnyFigure = {
    structure,
    index: figure.index,
    order,
    rows: figure.grid.rows,
    cols: figure.grid.cols,
    medial: placesFrom(figure, figure.medial),
    total_mm: known(figure.thickness.total_mm),
    radius_mm: known(figure.medial_radius_mm),
    sd_mm: figure.uncertainty ? known(figure.uncertainty.total_mm) : null,
    area_mm2: figure.node_area_mm2 ? known(figure.node_area_mm2) : null,
    distortion: null,
    difference: null,
  };
  if (figure.kind === "tube") {
    return {
      ...any,
      kind: "tube",
      wall: placesFrom(figure, figure.wall),
      wall_mm: known(figure.thickness.wall_mm),
      intrinsic: { wall: placesFrom(figure, figure.intrinsic.wall) },
    };
  }
  return {
    ...any,
    kind: "sheet",
    upper: placesFrom(figure, figure.upper),
    lower: placesFrom(figure, figure.lower),
    upper_mm: known(figure.thickness.upper_mm),
    lower_mm: known(figure.thickness.lower_mm),
    distortion: figure.area_distortion ? known(figure.area_distortion) : null,
    intrinsic: {
      medial: placesFrom(figure, figure.intrinsic.medial),
      upper: placesFrom(figure, figure.intrinsic.upper),
      lower: placesFrom(figure, figure.intrinsic.lower),
    },
  };
}

function validOf<T>({ valid }: Figure, list: readonly T[]): (T | null)[] {
  return list.map((value, node) => (valid[node] ? value : null));
}

function placesFrom<T extends Point | Flat>(figure: Figure, list: readonly (T | null)[]): (T | null)[] {
  return validOf(figure, list).map((place) => (isFinitePoint(place) ? place : null));
}

/** The nodes on one of the surfaces; none on what the figure does not have. */
export function placesOf(figure: ResultFigure, surface: Surface): (Point | null)[] {
  if (surface === "medial") return figure.medial;
  if (figure.kind === "tube") return surface === "wall" ? figure.wall : [];
  return surface === "wall" ? [] : figure[surface];
}

/** Where the nodes are for people: on the sheet, or on the wall of the tube. */
export function positionsOf(figure: ResultFigure): (Point | null)[] {
  return placesOf(figure, SURFACES_OF[figure.kind][0] ?? "medial");
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

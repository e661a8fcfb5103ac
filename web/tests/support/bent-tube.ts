/** A result with tubes, made without the program: its thickness.json and its model.glb. */

import type { Flat, Point, Sheet, Spread, Structure, Thickness, Tube } from "../../src/model/thickness";
import { GLTF_FROM_WORLD, glbOf, type MadeMesh, type MadeNode } from "./glb";

/** Nodes around and along; the first and the last column are on the caps. */
export const GRID = { rows: 8, cols: 12 };
const [ROWS, COLS] = [GRID.rows, GRID.cols];
/** Of the quarter of a circle that the centreline is, mm. */
const BEND = 30;
const LENGTH = (BEND * Math.PI) / 2;
const ORIGIN: Point = [0, 0, 0];

interface Tubes {
  glb: ArrayBuffer;
  thickness: Thickness;
  /** Its only tube: structure 0, figure 0. */
  tube: Tube;
}

/**
 * Label 4 is a tube that is bent and grows from end to end, and a small sheet before its first end; label 9 was
 * refused. `wider` adds to the radius, mm.
 */
export function bentTube(wider = 0): Tubes {
  const tube = tubeFigure(wider);
  const sheet = sheetFigure();
  const both = structure(0, 4, "trunk");
  const [wall, closed] = [wallMesh(tube), closedMesh(tube, [tube.caps.start, tube.caps.end])];
  const model: MadeNode = {
    extras: { space: "RAS", unit: "mm" },
    matrix: GLTF_FROM_WORLD,
    children: [
      {
        extras: { structure: 0, label: 4 },
        children: [
          {
            extras: { structure: 0, label: 4, figure: 0, ...GRID, kind: "tube", has_closed_surface: true },
            children: [centrelineMesh(tube, [tube.caps.start, tube.caps.end]), wall, vectorsMesh(tube), closed],
          },
          { extras: { structure: 0, label: 4, figure: 1, ...sheet.grid, kind: "sheet" }, children: sheetMeshes(sheet) },
          { ...closed, kind: "object" },
        ],
      },
      { extras: { structure: 1, label: 9, refusal: "ball" }, children: [ball([-22, 0, 10], 7)] },
    ],
  };
  const refusal = {
    code: "ball",
    message: "the object is a ball",
    hint: "a ball has no medial sheet: measure it by its radius",
  };
  const thickness: Thickness = {
    structures: [
      { ...both, figures: [tube, sheet], quality: { verdict: "pass" } },
      { ...structure(1, 9, null), refusal },
    ],
    warnings: [],
  };
  return { glb: glbOf(model), thickness, tube };
}

function structure(index: number, label: number, name: string | null): Structure {
  const summary = { upper_mm: spread([3]), lower_mm: spread([2]), total_mm: spread([5, 11]), area_mm2: 1800 };
  return { index, label, name, figures: [], thickness_summary: summary, quality: {}, warnings: [] };
}

/** One value for each node, row by row. */
function nodes<T>(each: (i: number, j: number) => T): T[] {
  return Array.from({ length: ROWS * COLS }, (_, node) => each(Math.floor(node / COLS), node % COLS));
}

/** Which way along, as an angle of the bend; columns of a cap are at its end. */
function bendAt(j: number): number {
  return (Math.min(Math.max(j - 1, 0), COLS - 3) / (COLS - 3)) * (Math.PI / 2);
}

function centreAt(j: number): Point {
  return [BEND * Math.cos(bendAt(j)), 0, BEND * Math.sin(bendAt(j))];
}

/** From the centre to a node: row 0 away from the middle of the bend, half way towards the tip on a cap. */
function directionAt(i: number, j: number): Point {
  const [bend, turn] = [bendAt(j), (2 * Math.PI * i) / ROWS];
  const forward = j === 0 ? -Math.SQRT1_2 : j === COLS - 1 ? Math.SQRT1_2 : 0;
  const out = forward === 0 ? 1 : Math.SQRT1_2;
  const [x, y] = [out * Math.cos(turn), out * Math.sin(turn)];
  return [x * Math.cos(bend) - forward * Math.sin(bend), y, x * Math.sin(bend) + forward * Math.cos(bend)];
}

function radiusAt(j: number, wider: number): number {
  return 5 + wider + j / (COLS - 1);
}

/** As far beyond an end as the tube is wide there. */
function tipAt(j: number, wider: number): Point {
  const [bend, forward] = [bendAt(j), j === 0 ? -1 : 1];
  return plus(centreAt(j), times([-Math.sin(bend), 0, Math.cos(bend)], forward * radiusAt(j, wider)));
}

function tubeFigure(wider: number) {
  // Farther on the outer side of the bend by as much as it is nearer on the inner one.
  const wall_mm = nodes((i, j) => radiusAt(j, wider) * (1 + 0.1 * Math.cos((2 * Math.PI * i) / ROWS)));
  const total_mm = nodes((_, j) => 2 * radiusAt(j, wider));
  const medial = nodes((_, j) => centreAt(j));
  const vectors = nodes((i, j) => times(directionAt(i, j), wall_mm[i * COLS + j] ?? 0));
  const wall = medial.map((centre, node) => plus(centre, vectors[node] ?? ORIGIN));
  const stations = Array.from({ length: COLS }, (_, j) => (LENGTH * bendAt(j)) / (Math.PI / 2));
  const radii = stations.map((_, j) => radiusAt(j, wider));
  return {
    index: 0,
    kind: "tube" as const,
    part: 0,
    grid: GRID,
    centreline: stations.map((_, j) => centreAt(j)),
    medial,
    wall,
    caps: { start: tipAt(0, wider), end: tipAt(COLS - 1, wider), columns: [1, 1] },
    valid: wall.map(() => true),
    repaired: wall.map(() => null),
    vectors: { wall: vectors },
    thickness: { wall_mm, total_mm },
    thickness_summary: { wall_mm: spread(wall_mm), total_mm: spread(total_mm), area_mm2: 1700 },
    tube_summary: {
      length_mm: LENGTH,
      radius_mm: spread(radii),
      diameter_mm: spread(radii.map((mm) => 2 * mm)),
      section_area_mm2: spread(radii.map((mm) => Math.PI * mm * mm)),
      curvature_per_mm: spread([1 / BEND]),
      tortuosity: Math.PI / 2 / Math.SQRT2,
    },
    sections: {
      station_mm: stations,
      area_mm2: radii.map((mm) => Math.PI * mm * mm),
      perimeter_mm: radii.map((mm) => 2 * Math.PI * mm),
      radius_mm: radii,
    },
    node_area_mm2: wall.map(() => 1700 / wall.length),
    medial_radius_mm: nodes((_, j) => 0.95 * radiusAt(j, wider)),
    intrinsic: { wall: nodes((i, j): Flat => [5 * j, around(wall, i, j)]) },
    uncertainty: null,
  } satisfies Tube & Record<string, unknown>;
}

/** Arc length from row 0 to a node, as straight pieces. */
function around(wall: readonly Point[], i: number, j: number): number {
  let way = 0;
  for (let row = 1; row <= i; row++) {
    const [a, b] = [wall[(row - 1) * COLS + j] ?? ORIGIN, wall[row * COLS + j] ?? ORIGIN];
    way += Math.hypot(...plus(b, times(a, -1)));
  }
  return way;
}

/** 3 × 4 nodes across the axis of the first end. */
function sheetFigure(): Sheet {
  const at = (z: number) =>
    Array.from({ length: 12 }, (_, n): Point => [BEND + 6 * ((n % 4) - 1.5), 6 * (Math.floor(n / 4) - 1), z]);
  const all = (value: number) => new Array<number>(12).fill(value);
  const flat = at(0).map(([x, y]): Flat => [x - BEND, y]);
  return {
    index: 1,
    kind: "sheet",
    grid: { rows: 3, cols: 4 },
    medial: at(-16),
    upper: at(-13),
    lower: at(-18),
    valid: all(1).map(() => true),
    thickness: { upper_mm: all(3), lower_mm: all(2), total_mm: all(5) },
    medial_radius_mm: all(2.4),
    node_area_mm2: all(18),
    intrinsic: { medial: flat, upper: flat, lower: flat },
    uncertainty: null,
  };
}

/** The nodes once more for the seam, so that row 0 comes again as the last. */
function wallMesh({ wall, medial, thickness }: Tube): MadeMesh {
  const seen = Array.from({ length: (ROWS + 1) * COLS }, (_, n) => n % (ROWS * COLS));
  const at = <T>(list: readonly T[]) => seen.map((node) => list[node] as T);
  return {
    kind: "wall",
    positions: at(wall),
    normals: at(wall.map((point, node) => unit(plus(point, times(medial[node] ?? ORIGIN, -1))))),
    places: seen.map((_, n) => [(n % COLS) / (COLS - 1), Math.floor(n / COLS) / ROWS]),
    thickness_mm: at(thickness.wall_mm as number[]),
    indices: quads(ROWS + 1, COLS),
  };
}

function closedMesh({ wall, medial }: Tube, tips: readonly [Point, Point]): MadeMesh {
  const count = ROWS * COLS;
  const indices = quads(ROWS + 1, COLS).map((n) => n % count);
  for (let i = 0; i < ROWS; i++) {
    const next = (i + 1) % ROWS;
    indices.push(count, next * COLS, i * COLS, count + 1, (i + 1) * COLS - 1, (next + 1) * COLS - 1);
  }
  const positions = [...wall, ...tips];
  const middle = times(positions.reduce(plus), 1 / positions.length);
  const normals = positions.map((point, n) => unit(plus(point, times(medial[n] ?? middle, -1))));
  return { kind: "closed", positions, normals, indices };
}

/** From tip to tip; the columns of a cap are one point. */
function centrelineMesh({ medial }: Tube, [start, end]: readonly [Point, Point]): MadeMesh {
  const positions = [start, ...medial.slice(1, COLS - 1), end];
  const pairs = positions.slice(1).map((_, n) => [n, n + 1]);
  return { kind: "centreline", positions, indices: pairs.flat(), isLines: true };
}

function vectorsMesh({ medial, wall }: Tube): MadeMesh {
  const positions = wall.flatMap((point, node) => [medial[node] ?? point, point]);
  return { kind: "vectors", positions, indices: positions.map((_, n) => n), isLines: true };
}

function sheetMeshes({ medial, upper, lower, thickness, grid: { rows, cols } }: Sheet): MadeMesh[] {
  const mesh = (kind: string, positions: Point[], thickness_mm: (number | null)[]): MadeMesh => ({
    kind,
    positions,
    normals: positions.map(() => [0, 0, 1]),
    places: positions.map((_, n) => [(n % cols) / (cols - 1), Math.floor(n / cols) / (rows - 1)]),
    thickness_mm: thickness_mm as number[],
    indices: quads(rows, cols),
  });
  return [
    mesh("medial", medial, thickness.total_mm),
    mesh("upper", upper, thickness.upper_mm),
    mesh("lower", lower, thickness.lower_mm),
  ];
}

/** An octahedron, which is ball enough. */
function ball(centre: Point, radius: number): MadeMesh {
  const normals = [0, 1, 2].flatMap((axis) =>
    [1, -1].map((sign): Point => [axis === 0 ? sign : 0, axis === 1 ? sign : 0, axis === 2 ? sign : 0]),
  );
  const indices = [0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5];
  return { kind: "object", positions: normals.map((normal) => plus(centre, times(normal, radius))), normals, indices };
}

/** Two triangles for each quad of a lattice. */
function quads(rows: number, cols: number): number[] {
  const corners: number[] = [];
  for (let i = 0; i + 1 < rows; i++) {
    for (let j = 0; j + 1 < cols; j++) {
      const n = i * cols + j;
      corners.push(n, n + cols, n + 1, n + 1, n + cols, n + cols + 1);
    }
  }
  return corners;
}

function spread(values: number[]): Spread {
  const sorted = [...values].sort((a, b) => a - b);
  const at = (share: number) => sorted[Math.round(share * (sorted.length - 1))] ?? null;
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  const sd = Math.sqrt(values.reduce((sum, value) => sum + (value - mean) ** 2, 0) / values.length);
  return { mean, sd, p5: at(0.05), p50: at(0.5), p95: at(0.95) };
}

function plus(a: Point, b: Point): Point {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

function times([x, y, z]: Point, factor: number): Point {
  return [factor * x, factor * y, factor * z];
}

function unit(point: Point): Point {
  return times(point, 1 / (Math.hypot(...point) || 1));
}

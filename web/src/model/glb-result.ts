import type { GlbMesh, GlbModel, GlbStructure, Layer } from "./glb";
import type { Result, ResultFigure, ResultSheet, ResultTube } from "./result";
import type { Numbers, Point } from "./thickness";

/** What model.glb alone says of the nodes, to the precision of its 32-bit numbers. */
export function fromGlb(model: GlbModel): Result {
  let order = 0;
  const structures = model.structures.map((structure) => ({
    index: structure.index,
    label: structure.label,
    refusal: structure.refusal,
    figures: structure.figures.map((_, n) => figureFrom(model, structure, n, order++)),
  }));
  return { structures };
}

function figureFrom(model: GlbModel, structure: GlbStructure, n: number, order: number): ResultFigure {
  const { kind = "sheet", index = n, rows = 0, cols = 0 } = structure.figures[n] ?? {};
  const meshOf = (layer: Layer) =>
    model.meshes.find((m) => m.layer === layer && m.structure === structure.index && m.figure === index);
  const any = {
    structure: structure.index,
    index,
    order,
    rows,
    cols,
    radius_mm: null,
    sd_mm: null,
    area_mm2: null,
    distortion: null,
    intrinsic: null,
    difference: null,
  };
  if (kind === "tube") return { ...any, ...tubeFrom(rows, cols, meshOf("wall"), meshOf("vectors")) };
  return { ...any, ...sheetFrom(rows * cols, meshOf("medial"), meshOf("upper"), meshOf("lower")) };
}

/** What the meshes tell. */
type Told<Figure extends ResultFigure, Own extends keyof Figure> = Pick<Figure, "kind" | "medial" | "total_mm" | Own>;

type MaybeMesh = GlbMesh | undefined;

function sheetFrom(
  count: number,
  medial: MaybeMesh,
  upper: MaybeMesh,
  lower: MaybeMesh,
): Told<ResultSheet, "upper" | "lower" | "upper_mm" | "lower_mm"> {
  return {
    kind: "sheet",
    medial: pointsOf(medial, count),
    upper: pointsOf(upper, count),
    lower: pointsOf(lower, count),
    upper_mm: thicknessOf(upper, count),
    lower_mm: thicknessOf(lower, count),
    total_mm: thicknessOf(medial, count),
  };
}

function tubeFrom(
  rows: number,
  cols: number,
  wall: MaybeMesh,
  vectors: MaybeMesh,
): Told<ResultTube, "wall" | "wall_mm"> {
  const count = rows * cols;
  const wall_mm = thicknessOf(wall, count);
  const total_mm = wall_mm.map((mm, node) => {
    // Half way round, in the same column.
    const opposite = wall_mm[(node + (rows / 2) * cols) % count] ?? null;
    return mm === null || opposite === null ? null : mm + opposite;
  });
  return { kind: "tube", medial: startsOf(vectors, count), wall: pointsOf(wall, count), wall_mm, total_mm };
}

/** Where the vectors of a tube begin: there is one for each node, in their order. */
function startsOf(vectors: MaybeMesh, count: number): (Point | null)[] {
  const starts = new Array<Point | null>(count).fill(null);
  if (vectors?.positions.length !== 6 * count) return starts;
  return starts.map((_, node) => vertexOf(vectors, 2 * node));
}

function vertexOf({ positions }: GlbMesh, vertex: number): Point {
  const [x = 0, y = 0, z = 0] = positions.subarray(3 * vertex, 3 * vertex + 3);
  return [x, y, z];
}

function pointsOf(mesh: MaybeMesh, count: number): (Point | null)[] {
  const points = new Array<Point | null>(count).fill(null);
  mesh?.nodes?.forEach((node, vertex) => {
    points[node] = vertexOf(mesh, vertex);
  });
  return points;
}

function thicknessOf(mesh: MaybeMesh, count: number): Numbers {
  const values = new Array<number | null>(count).fill(null);
  mesh?.nodes?.forEach((node, vertex) => {
    values[node] = mesh.thickness_mm?.[vertex] ?? null;
  });
  return values;
}

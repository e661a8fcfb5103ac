import type { GlbMesh, GlbModel, GlbStructure } from "./glb";
import type { Result, ResultFigure } from "./result";
import type { Numbers, Point, Surface } from "./thickness";

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
  const { index = n, rows = 0, cols = 0 } = structure.figures[n] ?? {};
  const count = rows * cols;
  const meshOf = (layer: Surface) =>
    model.meshes.find((m) => m.layer === layer && m.structure === structure.index && m.figure === index);
  const [medial, upper, lower] = [meshOf("medial"), meshOf("upper"), meshOf("lower")];
  return {
    structure: structure.index,
    index,
    order,
    rows,
    cols,
    medial: pointsOf(medial, count),
    upper: pointsOf(upper, count),
    lower: pointsOf(lower, count),
    upper_mm: thicknessOf(upper, count),
    lower_mm: thicknessOf(lower, count),
    total_mm: thicknessOf(medial, count),
    radius_mm: null,
    sd_mm: null,
    area_mm2: null,
    distortion: null,
    intrinsic: null,
    difference: null,
  };
}

function pointsOf(mesh: GlbMesh | undefined, count: number): (Point | null)[] {
  const points = new Array<Point | null>(count).fill(null);
  mesh?.nodes?.forEach((node, vertex) => {
    const [x = 0, y = 0, z = 0] = mesh.positions.subarray(3 * vertex, 3 * vertex + 3);
    points[node] = [x, y, z];
  });
  return points;
}

function thicknessOf(mesh: GlbMesh | undefined, count: number): Numbers {
  const values = new Array<number | null>(count).fill(null);
  mesh?.nodes?.forEach((node, vertex) => {
    values[node] = mesh.thickness_mm?.[vertex] ?? null;
  });
  return values;
}

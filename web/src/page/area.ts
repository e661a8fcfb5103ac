/** How much of the medial sheet each node stands for. */

import type { Grid, Point } from "../model/thickness";

/** A quarter of the area of every quad round a node, mm²; the weights of the summary in thickness.json. */
export function nodeAreas({ rows, cols }: Grid, medial: (Point | null)[]): Float64Array {
  const areas = new Float64Array(rows * cols);
  for (let i = 0; i + 1 < rows; i++) {
    for (let j = 0; j + 1 < cols; j++) {
      const nodes = [i * cols + j, i * cols + j + 1, (i + 1) * cols + j + 1, (i + 1) * cols + j];
      const corners = nodes.map((node) => medial[node]);
      const [a, b, c, d] = corners;
      if (!a || !b || !c || !d) continue;
      const area = half(minus(c, a), minus(d, b));
      for (const node of nodes) areas[node] = (areas[node] ?? 0) + area / 4;
    }
  }
  return areas;
}

/** Half the length of the cross product: the area between the diagonals of a quad. */
function half(u: Point, v: Point): number {
  return Math.hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]) / 2;
}

function minus(a: Point, b: Point): Point {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

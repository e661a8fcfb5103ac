import { figureOf, indexOf, type NodeRef, type Result } from "./result";
import type { Point } from "./thickness";

/** What can be read at a node. Lengths are mm. */
export interface NodeInfo extends NodeRef {
  /** Of the structure, as in the mask. */
  label: number;
  upper_mm: number | null;
  lower_mm: number | null;
  total_mm: number | null;
  radius_mm: number | null;
  /** Standard deviation of the total thickness. */
  sd_mm: number | null;
  /** Of the medial node, RAS mm. */
  position: Point;
  difference: number | null;
}

/** Null if there is no such node or it has no position. */
export function nodeInfo(result: Result, { structure, figure, i, j }: NodeRef): NodeInfo | null {
  const found = figureOf(result, structure, figure);
  if (!found || i < 0 || i >= found.rows || j < 0 || j >= found.cols) return null;
  const node = indexOf(found, { i, j });
  const position = found.medial[node];
  const label = result.structures.find((s) => s.index === structure)?.label;
  if (!position || label === undefined) return null;
  return {
    structure,
    figure,
    i,
    j,
    label,
    upper_mm: found.upper_mm[node] ?? null,
    lower_mm: found.lower_mm[node] ?? null,
    total_mm: found.total_mm[node] ?? null,
    radius_mm: found.radius_mm?.[node] ?? null,
    sd_mm: found.sd_mm?.[node] ?? null,
    position,
    difference: found.difference?.[node] ?? null,
  };
}

export function sameNode(a: NodeRef | null, b: NodeRef | null): boolean {
  if (!a || !b) return a === b;
  return a.structure === b.structure && a.figure === b.figure && a.i === b.i && a.j === b.j;
}

/** Straight distance of the medial nodes and, in one figure, that in the intrinsic plane; mm. */
export function distances(result: Result, a: NodeInfo, b: NodeInfo): { straight: number; along: number | null } {
  const straight = Math.hypot(...a.position.map((x, axis) => x - (b.position[axis] ?? 0)));
  const figure = a.structure === b.structure && a.figure === b.figure ? figureOf(result, a.structure, a.figure) : null;
  const [from, to] = [a, b].map((node) => figure?.intrinsic?.medial[indexOf(figure, node)]);
  return { straight, along: from && to ? Math.hypot(from[0] - to[0], from[1] - to[1]) : null };
}

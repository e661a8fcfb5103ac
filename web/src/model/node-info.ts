import { alongSurface } from "./plane";
import { figureOf, indexOf, type NodeRef, positionsOf, type Result } from "./result";
import type { FigureKind, Point } from "./thickness";

/** What can be read at a node. Lengths are mm. */
export interface NodeInfo extends NodeRef {
  /** Of the structure, as in the mask. */
  label: number;
  /** Of the figure: sheets have upper and lower, tubes a wall. */
  kind: FigureKind;
  upper_mm: number | null;
  lower_mm: number | null;
  /** From the centre to the wall. */
  wall_mm: number | null;
  total_mm: number | null;
  radius_mm: number | null;
  /** Standard deviation of the total thickness. */
  sd_mm: number | null;
  /** Of the medial node, of a tube on its wall; RAS mm. */
  position: Point;
  difference: number | null;
}

/** Null if there is no such node or it has no position. */
export function nodeInfo(result: Result, { structure, figure, i, j }: NodeRef): NodeInfo | null {
  const found = figureOf(result, structure, figure);
  if (!found || i < 0 || i >= found.rows || j < 0 || j >= found.cols) return null;
  const node = indexOf(found, { i, j });
  const position = positionsOf(found)[node];
  const label = result.structures.find((s) => s.index === structure)?.label;
  if (!position || label === undefined) return null;
  return {
    structure,
    figure,
    i,
    j,
    label,
    kind: found.kind,
    upper_mm: found.kind === "sheet" ? (found.upper_mm[node] ?? null) : null,
    lower_mm: found.kind === "sheet" ? (found.lower_mm[node] ?? null) : null,
    wall_mm: found.kind === "tube" ? (found.wall_mm[node] ?? null) : null,
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

/** Straight distance of the nodes and, in one figure, that along its surface; mm. */
export function distances(result: Result, a: NodeInfo, b: NodeInfo): { straight: number; along: number | null } {
  const straight = Math.hypot(...a.position.map((x, axis) => x - (b.position[axis] ?? 0)));
  const figure = a.structure === b.structure && a.figure === b.figure ? figureOf(result, a.structure, a.figure) : null;
  return { straight, along: figure && alongSurface(figure, indexOf(figure, a), indexOf(figure, b)) };
}

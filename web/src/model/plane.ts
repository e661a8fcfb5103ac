/** Figures laid flat. */

import type { ResultFigure, ResultTube } from "./result";
import type { Flat, Surface } from "./thickness";

/**
 * The places in the intrinsic plane of a surface, mm, row by row; none if they are not known. The wall of a tube is
 * cut open along row 0, which comes again after the last row: see `nodeOfPlace`.
 */
export function planeOf(figure: ResultFigure, surface: Surface): (Flat | null)[] {
  if (figure.intrinsic === null) return [];
  if (figure.kind === "sheet") return surface === "wall" ? [] : figure.intrinsic[surface];
  if (surface !== "wall") return [];
  const seam = Array.from({ length: figure.cols }, (_, column) => seamAt(figure, column));
  return [...figure.intrinsic.wall, ...seam];
}

/** The node that has a place in what `planeOf` gives. */
export function nodeOfPlace({ rows, cols }: ResultFigure, place: number): number {
  return place % (rows * cols);
}

/** The places of a node in what `planeOf` gives: two on the seam of a tube. */
export function placesOfNode({ kind, rows, cols }: ResultFigure, node: number): number[] {
  return kind === "tube" && node < cols ? [node, node + rows * cols] : [node];
}

/** The way between two nodes on the surface as the plane tells it, mm; null if it is not known. */
export function alongSurface(figure: ResultFigure, from: number, to: number): number | null {
  if (figure.kind === "tube") return alongWall(figure, from, to);
  const [a, b] = [figure.intrinsic?.medial[from], figure.intrinsic?.medial[to]];
  return a && b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : null;
}

/** By the shorter way round, on a round as long as the mean of those of both columns. */
function alongWall(tube: ResultTube, from: number, to: number): number | null {
  const [a, b] = [onRound(tube, from), onRound(tube, to)];
  if (!a || !b) return null;
  const share = Math.abs(a.share - b.share);
  return Math.hypot(a.u - b.u, (Math.min(share, 1 - share) * (a.round + b.round)) / 2);
}

/** Where a node is along the tube, on its round as a share of it, and how long the round is; mm. */
function onRound(tube: ResultTube, node: number): { u: number; share: number; round: number } | null {
  const column = node % tube.cols;
  const [place, start] = [tube.intrinsic?.wall[node], tube.intrinsic?.wall[column]];
  const end = seamAt(tube, column);
  if (!place || !start || !end) return null;
  const round = end[1] - start[1];
  return { u: place[0], share: round > 0 ? (place[1] - start[1]) / round : 0, round };
}

/** Row 0 at the end of the round: beyond the last row by the way from there in space. */
function seamAt({ intrinsic, wall, rows, cols }: ResultTube, column: number): Flat | null {
  const last = (rows - 1) * cols + column;
  const [first, before] = [intrinsic?.wall[column], intrinsic?.wall[last]];
  const [to, from] = [wall[column], wall[last]];
  if (!first || !before || !to || !from) return null;
  return [first[0], before[1] + Math.hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2])];
}

/** The intrinsic plane of a figure, drawn (Ward and Hamarneh, figure 4); the wall of a tube, unrolled. */

import { quadtree } from "d3-quadtree";
import { cssColorOf } from "../model/colors";
import { nodeOfPlace } from "../model/plane";
import type { Quantity, Range } from "../model/quantity";
import type { ResultFigure } from "../model/result";
import { ticks } from "../model/scale";
import type { Flat, Numbers } from "../model/thickness";

/** Room round the drawing, CSS px. */
const BORDER = 18;
const NODE_RADIUS = 4;
/** How near the pointer must come to a node, CSS px. */
export const REACH = 24;

/** From mm of the plane to CSS px. */
export interface Frame {
  scale: number;
  left: number;
  top: number;
}

/** Fits the plane into a canvas; u goes right, v up. */
export function frameOf(points: (Flat | null)[], voxels: Float32Array | null, width: number, height: number): Frame {
  let [lowU, highU, lowV, highV] = [Infinity, -Infinity, Infinity, -Infinity];
  const take = (u: number, v: number) => {
    [lowU, highU] = [Math.min(lowU, u), Math.max(highU, u)];
    [lowV, highV] = [Math.min(lowV, v), Math.max(highV, v)];
  };
  for (const point of points) if (point !== null) take(...point);
  for (let at = 0; voxels !== null && at < voxels.length; at += 2) take(voxels[at] ?? 0, voxels[at + 1] ?? 0);
  if (lowU > highU) return { scale: 1, left: 0, top: 0 };
  const scale = Math.min(
    (width - 2 * BORDER) / Math.max(highU - lowU, 1e-6),
    (height - 2 * BORDER) / Math.max(highV - lowV, 1e-6),
  );
  return { scale, left: width / 2 - (scale * (lowU + highU)) / 2, top: height / 2 + (scale * (lowV + highV)) / 2 };
}

export function place({ scale, left, top }: Frame, [u, v]: Flat): [number, number] {
  return [left + scale * u, top - scale * v];
}

export interface Drawing {
  figure: ResultFigure;
  /** Of the surface that is shown; its places are those of `planeOf`. */
  plane: (Flat | null)[];
  nodes: ReturnType<typeof nodeTree>;
  values: Numbers;
  voxels: Float32Array | null;
  quantity: Quantity;
  range: Range;
  ink: string;
  frame: Frame;
}

export function draw(context: CanvasRenderingContext2D, drawing: Drawing): void {
  context.clearRect(0, 0, context.canvas.width, context.canvas.height);
  drawVoxels(context, drawing);
  drawLattice(context, drawing);
  drawNodes(context, drawing);
  drawScale(context, drawing);
}

/** Each voxel point in the colour of the node nearest to it. */
function drawVoxels(context: CanvasRenderingContext2D, drawing: Drawing) {
  const { figure, voxels, nodes, values, quantity, range, frame } = drawing;
  if (voxels === null) return;
  const colors = values.map((value) => cssColorOf(quantity, value, range));
  const size = Math.min(Math.max(frame.scale * 0.35, 1), 3);
  context.globalAlpha = 0.45;
  for (let at = 0; at < voxels.length; at += 2) {
    const [u, v] = [voxels[at] ?? 0, voxels[at + 1] ?? 0];
    const node = nodes.find(u, v);
    if (node === undefined) continue;
    context.fillStyle = colors[nodeOfPlace(figure, node.index)] ?? "";
    const [x, y] = place(frame, [u, v]);
    context.fillRect(x - size / 2, y - size / 2, size, size);
  }
  context.globalAlpha = 1;
}

function drawLattice(context: CanvasRenderingContext2D, { figure: { cols }, plane, frame, ink }: Drawing): void {
  const rows = plane.length / cols;
  context.strokeStyle = ink;
  context.globalAlpha = 0.6;
  context.lineWidth = 1;
  context.beginPath();
  const join = (from: number, to: number) => {
    const [a, b] = [plane[from], plane[to]];
    if (!a || !b) return;
    context.moveTo(...place(frame, a));
    context.lineTo(...place(frame, b));
  };
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < cols; j++) {
      const at = i * cols + j;
      if (j + 1 < cols) join(at, at + 1);
      if (i + 1 < rows) join(at, at + cols);
    }
  }
  context.stroke();
  context.globalAlpha = 1;
}

function drawNodes(context: CanvasRenderingContext2D, drawing: Drawing): void {
  const { plane, frame, figure } = drawing;
  // Dense lattices get smaller nodes.
  const step = (frame.scale * extent(plane)) / Math.max(figure.cols, 1);
  const radius = Math.min(Math.max(step / 4, 1.5), NODE_RADIUS);
  for (const at of plane.keys()) drawNode(context, drawing, at, radius, 0.75);
}

/** Nodes with a ring, by their places: pointed at, or picked. */
export function drawMarks(context: CanvasRenderingContext2D, drawing: Drawing, places: number[]): void {
  context.clearRect(0, 0, context.canvas.width, context.canvas.height);
  for (const at of places) drawNode(context, drawing, at, NODE_RADIUS + 3, 2.5);
}

function drawNode(context: CanvasRenderingContext2D, drawing: Drawing, at: number, radius: number, line: number) {
  const point = drawing.plane[at];
  if (!point) return;
  context.beginPath();
  context.arc(...place(drawing.frame, point), radius, 0, 2 * Math.PI);
  const value = drawing.values[nodeOfPlace(drawing.figure, at)] ?? null;
  context.fillStyle = cssColorOf(drawing.quantity, value, drawing.range);
  context.fill();
  context.strokeStyle = drawing.ink;
  context.lineWidth = line;
  context.stroke();
}

function extent(plane: (Flat | null)[]): number {
  const us = plane.flatMap((point) => (point === null ? [] : [point[0]]));
  return us.length === 0 ? 0 : us.reduce((a, b) => Math.max(a, b)) - us.reduce((a, b) => Math.min(a, b));
}

/** A round length that is at most 110 px long and at least a third of that. */
export function barMm(pxPerMm: number): number {
  return ticks(0, 110 / pxPerMm, 2).at(-1) ?? 0;
}

/** A bar of a round length. */
function drawScale(context: CanvasRenderingContext2D, { frame, ink }: Drawing): void {
  const length = barMm(frame.scale);
  const bottom = context.canvas.clientHeight - 6;
  context.strokeStyle = ink;
  context.fillStyle = ink;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(6, bottom);
  context.lineTo(6 + length * frame.scale, bottom);
  context.stroke();
  context.font = "12px system-ui, sans-serif";
  context.fillText(`${length} mm`, 6, bottom - 5);
}

interface Placed {
  u: number;
  v: number;
  index: number;
}

/** Finds the place of a node nearest to a point of the plane. */
export function nodeTree(plane: (Flat | null)[]) {
  const nodes = plane.flatMap((point, index): Placed[] =>
    point === null ? [] : [{ u: point[0], v: point[1], index }],
  );
  return quadtree(
    nodes,
    ({ u }) => u,
    ({ v }) => v,
  );
}
